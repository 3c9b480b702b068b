"""People's part in a run beside programs.

In: orders and commands that people type, from console, keys or page.
Out: commands and actions in the robot's queue, and their answers.
"""
