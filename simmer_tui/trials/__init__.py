"""Trials: many runs of a control program, each with a robot of its own.

In: a program's command line, a set, seeds, and what varies.
Out: results of runs in a folder, success rates with intervals, and causes of failures.
"""

__all__ = ["compare", "folder", "intervals", "local", "run", "trial"]
