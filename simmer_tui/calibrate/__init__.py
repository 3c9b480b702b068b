"""Calibration: a configuration set that behaves as a real robot does.

In: run logs of the robot, and the set it is thought to be.
Out: estimates with intervals, a set's files, and what the model lacks.

`parameters.py` lists what is estimated; a kind of sensor names its own. `effects.py` has what the model may
lack.
"""
