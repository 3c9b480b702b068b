"""Trials: many runs of a control program, each with a robot of its own.

In: a program's command line, a set, seeds, and what varies.
Out: results of runs in a folder, success rates with intervals, and causes of failures.

`run.py` does one run and fills its `TrialResult` (`trial.py`). `trials_summary.py` has tables and columns.
"""

__all__ = ["compare", "folder", "intervals", "local", "run", "trial"]
