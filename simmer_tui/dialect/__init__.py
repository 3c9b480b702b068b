"""A team's own language, by the rules of its dialect.toml, and the device that plays the robot.

In: bytes of a team's program, and the results of the robot's commands.
Out: the robot's commands, and bytes of the team's replies.

`frames.py` cuts bytes into messages, `patterns.py` matches them, `expressions.py` computes values,
`device.py` plays the robot. The keys of dialect.toml are in `config/dialect_toml.py`, its reader in
`config/dialect_reader.py`.
"""
