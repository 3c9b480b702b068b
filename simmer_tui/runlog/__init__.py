"""Run logs: one JSON object a line, written during the run, read back, and run again."""

__all__ = ["header", "index", "log_records", "reader", "rerun", "writer"]
