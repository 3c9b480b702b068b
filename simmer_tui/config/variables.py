"""Environment variables by which a program learns of its simulator. Those of ports stand with the ports
(`dialects.py`), those of a mission with the mission."""

HOST = "SIMMER_HOST"
SERIAL_NAMES = "SIMMER_SERIAL_NAMES"
SET = "SIMMER_CONFIG"
DRIVE_PROFILE = "SIMMER_DRIVE_PROFILE"
SENSOR_PROFILE = "SIMMER_SENSOR_PROFILE"
MAZE = "SIMMER_MAZE"
