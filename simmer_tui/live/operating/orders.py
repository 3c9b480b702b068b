"""Orders: what people may type or choose. Commands go to the robot; orders start with a colon."""

import difflib
import re
from collections.abc import Callable, Sequence

from msgspec import Struct

from simmer_tui.config.settings import PACES
from simmer_tui.errors import ConsoleCommandError
from simmer_tui.live.operating.switches import SWITCHES
from simmer_tui.run.events import LARGEST_NUMBER, Action, ActionName
from simmer_tui.sim.command import (
    LARGEST_VALUE,
    WORD,
    Command,
    cut,
    keyboard_text,
    meant_number,
    parse_command,
    parse_value,
)
from simmer_tui.sim.command_codes import code_meanings
from simmer_tui.sim.noise import SEEDS
from simmer_tui.sim.rules import NumberRule, did_you_mean
from simmer_tui.sim.specs import SimulationSpec
from simmer_tui.sim.velocity_commands import MOST_WAITED

_ANY_NUMBER = NumberRule()
# The robot has the same limits. It gets a velocity and a wait, and might refuse only one of them.
_SPEEDS = NumberRule(-LARGEST_VALUE, LARGEST_VALUE)
_SECONDS = NumberRule(0.0, MOST_WAITED, low_open=True)


class Local(Struct, frozen=True):
    """An order that the app itself carries out: a switch by its name, any other by its method
    `order_NAME`."""

    name: str
    argument: str = ""


ConsoleCommand = Command | Action | Local


class OrderSpec(Struct, frozen=True):
    """One order: its syntax, its effect, and the function that reads its words.

    With an `action` the robot's engine carries it out, otherwise the app: see `Local`.
    """

    usage: str
    help: str
    read: "Callable[[OrderSpec, Sequence[str]], ConsoleCommand]"
    action: ActionName | None = None

    @property
    def name(self) -> str:
        """Name without the colon."""
        return self.usage.partition(" ")[0].removeprefix(":")

    @property
    def words(self) -> str:
        """Words written after the name."""
        return self.usage.partition(" ")[2]

    @property
    def needs_words(self) -> bool:
        """True if it cannot be given by its name alone."""
        return bool(self.words) and not self.words.startswith("[")


def _alone(order: OrderSpec, words: Sequence[str]) -> ConsoleCommand:
    if words:
        raise ConsoleCommandError("takes nothing after it")
    return Action(order.action) if order.action else Local(order.name)


def _each_number(words: Sequence[str], rule: NumberRule = _ANY_NUMBER) -> tuple[float, ...]:
    which = "each " if len(words) > 1 else ""
    try:
        numbers = tuple(rule.from_text(word) for word in words)
    except ValueError as error:
        raise ConsoleCommandError(f"{which}{error}") from None
    # A log with a larger one, even in an action that was refused, could not be read again.
    if any(abs(number) > LARGEST_NUMBER for number in numbers):
        raise ConsoleCommandError(f"{which}must be a number from {-LARGEST_NUMBER:g} to {LARGEST_NUMBER:g}")
    return numbers


def _numbers(order: OrderSpec, words: Sequence[str]) -> ConsoleCommand:
    assert order.action is not None  # a number is a command for the robot
    count = len(order.words.split())
    if len(words) != count:
        raise ConsoleCommandError(f"takes {'one number' if count == 1 else f'{count} numbers'}")
    return Action(order.action, _each_number(words))


def _seed(order: OrderSpec, words: Sequence[str]) -> ConsoleCommand:
    assert order.action is not None
    if len(words) != 1:
        raise ConsoleCommandError("takes one number")
    return Action(order.action, (SEEDS.from_text(words[0]),))


def _switch(order: OrderSpec, words: Sequence[str]) -> ConsoleCommand:
    """On or off. Without a word an order of the screen switches over, and `:bias` shows the bias."""
    if not words and not order.needs_words:
        return Local(order.name)
    if len(words) != 1 or words[0].lower() not in ("on", "off"):
        raise ConsoleCommandError("takes on or off")
    word = words[0].lower()
    return Action(order.action, (float(word == "on"),)) if order.action else Local(order.name, word)


def _pace(order: OrderSpec, words: Sequence[str]) -> ConsoleCommand:
    if len(words) != 1:
        raise ConsoleCommandError("takes one number, or off")
    return Local(order.name, f"{PACES.from_text(words[0]):g}")


def _velocity(order: OrderSpec, words: Sequence[str]) -> ConsoleCommand:
    # A person's velocity has a time limit: a robot that drives on would surprise people.
    if len(words) not in (3, 4):
        raise ConsoleCommandError("takes three numbers, and seconds T if not 1")
    velocity = _each_number(words[:3], _SPEEDS)
    try:
        seconds = _SECONDS.from_text(words[3] if len(words) == 4 else "1")
    except ValueError as error:
        raise ConsoleCommandError(f"T {error}") from None
    return Local(order.name, ";".join(f"{value:g}" for value in (*velocity, seconds)))


def _code(order: OrderSpec, words: Sequence[str]) -> ConsoleCommand:
    if len(words) > 1:
        raise ConsoleCommandError("takes one code")
    return Local(order.name, "".join(words))


def _why(order: OrderSpec, words: Sequence[str]) -> ConsoleCommand:
    if words and [word.lower() for word in words] != ["move"]:
        raise ConsoleCommandError("takes nothing after it, or move")
    return Local(order.name, "move" if words else "")


def _file(order: OrderSpec, words: Sequence[str]) -> ConsoleCommand:
    if not words:
        raise ConsoleCommandError(f"takes a {'serial port' if order.words == 'PORT' else 'file name'}")
    return Local(order.name, " ".join(words))


_ESCAPES = {"n": "\n", "r": "\r", "t": "\t", "\\": "\\"}


def _text(order: OrderSpec, words: Sequence[str]) -> ConsoleCommand:
    """Text for a line of bytes, as typed; quotes around it are left out, and \\n is a line end."""
    text = " ".join(words)
    if len(text) > 1 and text[0] == text[-1] and text[0] in "\"'":
        text = text[1:-1]
    if not text:
        raise ConsoleCommandError("takes a text")
    return Local(order.name, re.sub(r"\\([nrt\\])", lambda found: _ESCAPES[found[1]], text))


def _svg(order: OrderSpec, words: Sequence[str]) -> ConsoleCommand:
    chosen = _file(order, words)
    # An SVG that is called `maze.png` opens nowhere.
    if not words[-1].lower().endswith(".svg"):
        raise ConsoleCommandError("writes SVG: the name must end in .svg")
    return chosen


_ORDERS = (
    OrderSpec(":help [CODE]", "keys, orders and codes; or all about one code", _code),
    OrderSpec(":reset", "everything back to the start, same seed", _alone, ActionName.RESET),
    OrderSpec(":teleport X Y HEADING", "put the robot there", _numbers, ActionName.TELEPORT),
    OrderSpec(":block X Y", "put the block there", _numbers, ActionName.BLOCK),
    OrderSpec(":seed N", "back to the start with another seed", _seed, ActionName.SEED),
    OrderSpec(":noise on|off", "random errors of sensors and drives", _switch, ActionName.NOISE),
    OrderSpec(":bias [on|off]", "show the drive bias; random, or as in drive.csv", _switch, ActionName.BIAS),
    OrderSpec(":speed N", "simulated seconds a second", _numbers, ActionName.TIME_SCALE),
    OrderSpec(":pace N|off", "how fast movements are shown, times real speed", _pace),
    OrderSpec(":vv VX VY OMEGA [T]", "drive so fast, in/s and deg/s, for T (or 1) seconds", _velocity),
    OrderSpec(":stop", "stop the robot", _alone, ActionName.STOP),
    OrderSpec(":send TEXT", "send text to the board; \\n ends a line", _text),
    OrderSpec(":pins [BOARD]", "pins of a board, as its sketch sets them", _code),
    OrderSpec(":pause", "let commands wait", _alone, ActionName.PAUSE),
    OrderSpec(":resume", "continue after a pause", _alone, ActionName.RESUME),
    OrderSpec(":step", "while paused, let one command through", _alone),
    *(OrderSpec(f":{switch.name} [on|off]", switch.help, _switch) for switch in SWITCHES),
    OrderSpec(":shot FILE.svg", "a picture of the screen", _svg),
    OrderSpec(":save FILE", "write the log panel to a file", _file),
    OrderSpec(":copy", "copy the log panel to the clipboard", _alone),
    OrderSpec(":log FILE", "log the run from here on (or auto)", _file),
    OrderSpec(":why [move]", "why the run ended so, or (before, or with move) a movement", _why),
    OrderSpec(":report", "report of this run so far", _alone),
    OrderSpec(":try", "run a failed program again, with one change at a time", _alone),
    OrderSpec(":program", "last output and whole error of a program that has ended", _alone),
    OrderSpec(":web", "links to the page that shows this run in browsers", _alone),
    OrderSpec(":robot PORT", "drive the robot on a serial port", _file),
    OrderSpec(":simulator", "drive the simulated robot again", _alone),
    OrderSpec(":quit", "end", _alone),
)
CONSOLE_COMMANDS = {order.name: order for order in _ORDERS}
"""All orders by name, in the order of the help."""
BARE_WORDS = {"help": "help", "?": "help", "quit": "quit", "exit": "quit", "q": "quit"}
"""Words that are understood without a colon too, with the order that each means."""


def read_console_command(line: str, spec: SimulationSpec) -> ConsoleCommand:
    """The command or order of a typed line.

    Raises ConsoleCommandError for an unknown order, and for a line with more than one command, such as `u1
    u2`.
    """
    # Newcomers type `help` and `quit` first, before they know of the colon.
    text = line.strip()
    name, *words = text.removeprefix(":").split() or [""]
    known = BARE_WORDS.get(name.lower(), name.lower())
    if not text.startswith(":") and (name.lower() not in BARE_WORDS or len(words) > (known == "help")):
        return _one_command(parse_command(keyboard_text(text), "console"), spec)
    order = CONSOLE_COMMANDS.get(known)
    if order is None:
        hint = did_you_mean(name, CONSOLE_COMMANDS) or _other_order(known) or "; :help lists them"
        raise ConsoleCommandError(f":{cut(name, WORD)} is not an order{hint}")
    if order.read in (_text, _file, _svg):
        # As typed: a board may tell two blanks from one, and so do names of files.
        words = [each for each in (text.partition(name)[2].strip(),) if each]
    try:
        return order.read(order, words)
    except ValueError as error:
        raise ConsoleCommandError(f":{order.name} {error}; {order.usage}") from None


_OTHERS = {
    **dict.fromkeys(
        ("run", "start"), '; a program runs in a second terminal, or with simmer-tui --run "CMD ..."'
    ),
    **dict.fromkeys(("wq", "q!", "x", "end", "close"), "; type :quit"),
    **dict.fromkeys(("load", "config", "open"), "; type :quit, and then simmer-tui --config DIR"),
}
"""Orders of other programs, and what means the same here."""


def _other_order(name: str) -> str:
    return _OTHERS.get(name, "")


def _one_command(command: Command, spec: SimulationSpec) -> Command:
    """A single command: after its code only a separator and a value may follow.

    The protocol ignores text after a sensor's code and takes any separator, so `o1o2` would read o1 and
    `d1d2` drive 2 inches. A program may mean it; from a person it is a slip. An unknown code may be the real
    robot's own; text after it is not checked.
    """
    code, argument = command.code, command.argument
    is_sensor = any(sensor.code == code for sensor in spec.sensors)
    is_drive = any(row.code == code for row in spec.drive_rows)
    if argument is None or not (is_sensor or is_drive):
        return command
    is_number = isinstance(parse_value(argument), float)
    # The drive itself refuses one word that is no number, with a better message.
    is_one = is_number or (is_drive and len(argument.split()) <= 1)
    if command.text.strip()[2].isalnum() or not is_one:
        takes = f"{code} takes nothing after it" if is_sensor else f"{code}-V takes one number"
        meant = _meant(command, is_sensor)
        hint = f"did you mean {meant}?" if meant else "one command a line"
        raise ConsoleCommandError(f"{command.shown}: {takes}; {hint}")
    return command


def _meant(command: Command, is_sensor: bool) -> str:
    """The command that is within a line with more; empty if that is not evident."""
    rest = command.text.strip()[2:]
    if is_sensor:
        return "" if any(character.isalnum() for character in rest) else command.code
    number = meant_number(rest.strip(" -")) if not rest[:1].isalnum() else ""
    return f"{command.code}-{number}" if number else ""


def completions(line: str, spec: SimulationSpec) -> list[tuple[str, str]]:
    """Possible completions of a line, each with its meaning: orders after a colon, otherwise command
    codes."""
    if line.startswith(":"):
        return _order_completions(line)
    start = line.strip()[:2]
    codes = code_meanings(spec, all_rows=False)
    return [(code, meaning) for code, meaning in codes.items() if code.startswith(start)]


def _order_completions(line: str) -> list[tuple[str, str]]:
    name, space, rest = line[1:].partition(" ")
    name = name.lower()
    if space and name in CONSOLE_COMMANDS:
        spec = CONSOLE_COMMANDS[name]
        words = spec.words.strip("[]").split("|") if "|" in spec.words else []
        choices = [(f":{name} {word}", spec.help) for word in words if word.startswith(rest.lower())]
        return choices or [(f":{name}", _meaning(spec))]
    found = [order for order in CONSOLE_COMMANDS.values() if order.name.startswith(name)]
    if not found and not space:
        found = [CONSOLE_COMMANDS[each] for each in difflib.get_close_matches(name, CONSOLE_COMMANDS, n=3)]
    return [(f":{order.name}", _meaning(order)) for order in found]


def _meaning(order: OrderSpec) -> str:
    return f"{order.words} {order.help}".strip()


def completed(line: str, spec: SimulationSpec) -> str | None:
    """The line with its first completion, None if there is none to add."""
    found = (completion for completion, _ in completions(line, spec) if line.strip())
    return next((each for each in found if each.startswith(line) and each != line), None)
