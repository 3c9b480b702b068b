"""The wire formats, without input or output.

In: bytes of a program, and results of its commands.
Out: commands, and the bytes of their replies.

`packets.py` and `binary.py` have two users each: their link over TCP, and `course_device.py` on a serial
port.
"""
