"""The terminal app: maze, panels, console, and the replay on a recorded source.

In: frozen snapshots of a run, keys, mouse and lines typed.
Out: frames in the terminal, and orders of the user.

A panel is a function of one snapshot. Values kept over time are in the snapshot's state (`run/state.py`).
"""
