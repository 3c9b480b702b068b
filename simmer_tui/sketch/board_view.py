"""A board as people see it at one moment."""

from msgspec import Struct, structs

from simmer_tui.errors import printable
from simmer_tui.run.events import DisplayChanged
from simmer_tui.run.state import State
from simmer_tui.sketch.text_display import DISPLAY_COLUMNS, DISPLAY_ROWS, MOST_DISPLAYS


class PinView(Struct, frozen=True):
    """A pin that the sketch has used: its name, and what the sketch does with it, such as `output, 78 %`."""

    name: str
    text: str


class PortView(Struct, frozen=True):
    """A serial port that does not go to the laptop, such as `USB`, and the last line that was sent there."""

    name: str
    line: str


class BoardView(Struct, frozen=True):
    """A board at one moment.

    Attributes:
        name: its name in wiring.toml.
        time: its clock, simulated seconds.
        busy: the share of the last second in which its sketch did not wait in delay(); None if nobody knows.
        led: True if its own LED is on.
        line: the last line that it has sent to the laptop; empty if it has none.
        pins: the pins that its sketch has used.
        displays: the rows of text on each of its displays.
        led_pin: the pin of its own LED.
        ports: its other ports that it has sent to.
        failed: why it has ended; empty while it runs.
    """

    name: str
    time: float
    busy: float | None
    led: bool
    line: str
    pins: tuple[PinView, ...] = ()
    failed: str = ""
    displays: tuple[tuple[str, ...], ...] = ()
    led_pin: str = "13"
    ports: tuple[PortView, ...] = ()


# Judged: more are on no screen.
_MOST_BOARDS, _LONGEST_NAME, _MOST_PORTS, _LONGEST_LINE = 8, 40, 8, 200


def logged_views(state: State, time: float) -> tuple[BoardView, ...]:
    """The boards of a logged run at a simulated time, by what they showed in the state then."""
    views = []
    for each in state.displays[:_MOST_BOARDS]:
        lines = [line for line in state.lines if line.board == each.board]
        said = next((line.text for line in lines if not line.port), "")
        ports = [
            PortView(printable(line.port[:_LONGEST_NAME]), printable(line.text[:_LONGEST_LINE]))
            for line in lines[:_MOST_PORTS]
            if line.port
        ]
        said = printable(said[:_LONGEST_LINE])
        views.append(structs.replace(logged_view(each), time=time, line=said, ports=tuple(ports)))
    return tuple(views)


def logged_view(change: DisplayChanged) -> BoardView:
    """A board by what it shows. Texts of a log are cut to what a display has."""
    return BoardView(
        name=printable(change.board[:_LONGEST_NAME]),
        time=change.time,
        busy=change.busy,
        led=change.led,
        line="",
        displays=tuple(
            tuple(printable(row[:DISPLAY_COLUMNS]) for row in rows[:DISPLAY_ROWS])
            for rows in change.displays[:MOST_DISPLAYS]
        ),
        led_pin=printable(change.led_pin[:_LONGEST_NAME]),
    )
