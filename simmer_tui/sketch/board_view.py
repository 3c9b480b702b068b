"""A board as people see it at one moment."""

from msgspec import Struct


class PinView(Struct, frozen=True):
    """A pin that the sketch has used: its name, and what the sketch does with it, such as `output, 78 %`."""

    name: str
    text: str


class BoardView(Struct, frozen=True):
    """A board at one moment.

    Attributes:
        name: its name in wiring.toml.
        time: its clock, simulated seconds.
        busy: the share of the last second in which its sketch did not wait in delay().
        led: True if its own LED is on.
        line: the last line that it has sent to the laptop; empty if it has none.
        pins: the pins that its sketch has used.
        displays: the rows of text on each of its displays.
        led_pin: the pin of its own LED.
        failed: why it has ended; empty while it runs.
    """

    name: str
    time: float
    busy: float
    led: bool
    line: str
    pins: tuple[PinView, ...] = ()
    failed: str = ""
    displays: tuple[tuple[str, ...], ...] = ()
    led_pin: str = "13"
