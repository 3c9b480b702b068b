"""The picture of the maze.

In: a scene: maze, robot, rays, trail, beliefs and contacts, inches.
Out: terminal cells.

`scene.py` is what one frame shows, `painter.py` draws it, `palette.py` has the colours of all looks.
"""
