"""Grading of a course: teams' programs on the same missions, each sandboxed, with few runs.

In: a folder of submissions and the course's plan.
Out: a result for each team, as table, page and CSV.

`course.py` has the keys of course.toml. `robot_rules.py`, `wiring_rules.py` and `limits.py` hold teams to
them.
"""
