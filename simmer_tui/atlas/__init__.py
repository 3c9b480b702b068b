"""The atlas: expected readings of sensors at every pose of a grid, computed once and stored in a file."""
