"""Grading of a course: teams' programs on the same missions, each sandboxed, with few runs.

In: a folder of submissions and the course's plan.
Out: a result for each team, as table, page and CSV.
"""
