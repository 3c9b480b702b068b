"""Grading of a course: teams' programs on the same missions, each sandboxed, with few runs."""
