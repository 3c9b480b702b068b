"""Sketches that run on a cycle-true core and on a board of ours: see `test_against_simavr.py`."""
