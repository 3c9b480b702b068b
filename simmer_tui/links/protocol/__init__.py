"""The wire formats, without input or output.

In: bytes of a program, and results of its commands.
Out: commands, and the bytes of their replies.

The form of a number, such as `float32`, is a row of the table in `config/reply_formats.py`; `replies.py`
packs and reads it for all dialects. The syntax of commands, and how many answers make one reply, is each
dialect's own: `binary.py`, `packets.py`.

`packets.py` and `binary.py` have two users each: their link over TCP, and `course_device.py` on a serial
port.
"""
