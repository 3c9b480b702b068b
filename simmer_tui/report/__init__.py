"""The report of a run: what happened, why, figures, tables and the player.

In: the header and events of a run, live or from its log.
Out: a verdict, and a document for terminal, page and JSON.

`moments.py` lists what happened, `cause_order.py` decides why. Both query the run's history
(`run/run_history.py`).
"""

__all__ = ["content", "run_statistics"]
