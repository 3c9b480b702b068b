"""Calibration: a configuration set from run logs of a real robot."""
