"""The wire formats without any input or output: bytes in, commands out, replies to bytes, per dialect."""
