"""The wire formats, without input or output.

In: bytes of a program, and results of its commands.
Out: commands, and the bytes of their replies.
"""
