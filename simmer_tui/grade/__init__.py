"""Grading of a course: teams' programs on the same missions, each in a sandbox, with as few runs as
possible."""
