"""Trials: a control program run many times, each time by its own robot, and how often it succeeds."""

__all__ = ["compare", "folder", "intervals", "local", "run", "trial"]
