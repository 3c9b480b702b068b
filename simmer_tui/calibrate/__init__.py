"""The simulator learns a robot: a configuration set from run logs of the real one."""
