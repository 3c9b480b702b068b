"""Trials: many runs of a control program, each with a robot of its own, and their success rate."""

__all__ = ["compare", "folder", "intervals", "local", "run", "trial"]
