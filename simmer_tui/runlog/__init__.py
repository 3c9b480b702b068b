"""Run logs: one JSON object a line, written during the run, read back, and run again.

In: events of a live run, or a log file.
Out: lines of a log, or its events and commands again.
"""

__all__ = ["header", "index", "log_records", "reader", "rerun", "writer"]
