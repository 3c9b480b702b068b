"""Links move bytes to and from programs and robots. Import each where it is needed."""

__all__ = ["belief_link", "binary_link", "packet_link", "port_list", "ports", "serial_bridge", "serial_link"]
