"""The atlas: what every sensor reads at every pose of a grid, computed once and kept in a file."""
