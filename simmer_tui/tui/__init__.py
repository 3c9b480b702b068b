"""The terminal app: maze, panels, console, and the replay on a recorded source.

In: frozen snapshots of a run, keys, mouse and lines typed.
Out: frames in the terminal, and orders of the user.
"""
