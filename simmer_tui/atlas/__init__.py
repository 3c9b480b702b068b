"""The atlas: expected readings of sensors at every pose of a grid.

In: a `SimulationSpec` and the grid's spacing.
Out: arrays (rows, columns, headings, sensors), inches, and their files.
"""
