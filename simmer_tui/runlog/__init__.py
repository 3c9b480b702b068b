"""Run logs: one JSON object a line, written as the run goes on, read back, and run again."""

__all__ = ["header", "index", "log_records", "reader", "rerun", "writer"]
