"""Bytes in, bytes out: the ports of programs, the wire to a real robot, and the choice of the robot that
answers.

In: bytes of connections, serial ports and pseudo-terminals.
Out: messages with their commands to a robot's session, and replies as bytes.

Each `NAME_link.py` serves the ports of one dialect. `course_device.py` speaks packets and binary on a serial
port. Import each link where it is needed.
"""
