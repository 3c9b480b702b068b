"""The picture of the maze.

In: a scene: maze, robot, rays, trail, beliefs and contacts, inches.
Out: terminal cells.
"""
