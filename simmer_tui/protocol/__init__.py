"""What the bytes mean, in every dialect: no sockets, no clock."""

__all__ = ["binary", "framing", "packets", "packets_reply"]
