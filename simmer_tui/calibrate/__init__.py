"""Calibration: a configuration set that behaves as a real robot does.

In: run logs of the robot, and the set it is thought to be.
Out: estimates with intervals, a set's files, and what the model lacks.
"""
