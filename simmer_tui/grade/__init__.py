"""A course graded: teams' programs on the same missions, each in a sandbox, with as few runs as it takes."""
