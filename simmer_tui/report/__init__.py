"""The report of a run: what happened, why, figures, tables and the player.

In: the header and events of a run, live or from its log.
Out: a verdict, and a document for terminal, page and JSON.
"""

__all__ = ["content", "run_statistics"]
