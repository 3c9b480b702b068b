"""What a logged run amounts to: figures, pictures, and where it went wrong."""

__all__ = ["content", "run_statistics"]
