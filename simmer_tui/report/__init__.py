"""The report of a logged run: figures, pictures, and the cause of a failure."""

__all__ = ["content", "run_statistics"]
