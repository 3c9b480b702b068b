"""A team's own Arduino sketches in the loop: boards that run them, and what their pins are wired to.

In: a set with a wiring.toml, and the sketches that it names.
Out: commands of the robot's wheels and gripper, and bytes of the line to the laptop's program.

`boards.py` has the kinds of boards, `parts.py` the electronics of parts. `NAME_check.py` finds mistakes of a
wiring, `NAME_draft.py` drafts one. The keys of wiring.toml are in `config/wiring_toml.py`.
"""
