"""Bytes to and from programs and robots: each link is imported by those who need it."""

__all__ = ["belief_link", "binary_link", "packet_link", "port_list", "ports", "serial_bridge", "serial_link"]
