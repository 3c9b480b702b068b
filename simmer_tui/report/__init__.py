"""What a logged run amounts to: figures, pictures, and where it went wrong."""

__all__ = ["html_report", "run_statistics"]
