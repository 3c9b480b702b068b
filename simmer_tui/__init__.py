"""SimMeR-TUI: a simulator for mechatronics robots, driven over TCP or from a terminal.

Importing this package loads nothing but the standard library; the client in
`simmer_tui.client` stays as light as that.
"""

__version__ = "0.1.0"
