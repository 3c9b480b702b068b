"""The picture of the maze: scenes in, terminal cells out."""
