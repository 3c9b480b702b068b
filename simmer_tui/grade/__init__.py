"""A course graded: teams' programs on the same missions, each closed in, with as few runs as it takes."""
