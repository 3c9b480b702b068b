"""What people may type or choose: commands to the robot, and orders that start with a colon."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from simmer_tui.errors import ConsoleCommandError
from simmer_tui.events import Action, ActionName
from simmer_tui.pacer import FASTEST, SLOWEST
from simmer_tui.sim.command import Command, escape, parse_command, parse_value
from simmer_tui.sim.rules import NumberOrOffRule, NumberRule, did_you_mean
from simmer_tui.sim.specs import SimulationSpec


@dataclass(frozen=True, slots=True)
class Local:
    """Something the app itself does: `help`, `quit`, `shot`, `save`, `bias`, `plot_robot` ..."""

    name: str
    argument: str = ""


ConsoleCommand = Command | Action | Local


@dataclass(frozen=True, slots=True)
class OrderSpec:
    """One order: its name, how it is written, what it does, and how its words are understood."""

    name: str
    usage: str
    help: str
    read: Callable[[Sequence[str]], ConsoleCommand]

    @property
    def words(self) -> str:
        """What is written after the name."""
        return self.usage.partition(" ")[2]

    @property
    def needs_words(self) -> bool:
        """Whether it cannot be given by its name alone."""
        return bool(self.words) and not self.words.startswith("[")


def _numbers(name: ActionName, count: int) -> Callable[[Sequence[str]], ConsoleCommand]:
    def read(words: Sequence[str]) -> ConsoleCommand:
        if len(words) != count:
            raise ConsoleCommandError(f"takes {count} numbers" if count != 1 else "takes one number")
        try:
            return Action(name, tuple(NumberRule().from_text(word) for word in words))
        except ValueError as error:
            raise ConsoleCommandError(f"each {error}") from None

    return read


def _is_on(words: Sequence[str]) -> bool:
    if len(words) != 1 or words[0].lower() not in ("on", "off"):
        raise ConsoleCommandError("takes on or off")
    return words[0].lower() == "on"


def _switch(name: ActionName) -> Callable[[Sequence[str]], ConsoleCommand]:
    return lambda words: Action(name, (float(_is_on(words)),))


def _view(name: str) -> Callable[[Sequence[str]], ConsoleCommand]:
    """A switch of the screen; without a word it changes over."""
    return lambda words: Local(name, ("on" if _is_on(words) else "off") if words else "")


def _bias(words: Sequence[str]) -> ConsoleCommand:
    return _switch(ActionName.BIAS)(words) if words else Local("bias")


def _plain(order: ConsoleCommand) -> Callable[[Sequence[str]], ConsoleCommand]:
    def read(words: Sequence[str]) -> ConsoleCommand:
        if words:
            raise ConsoleCommandError("takes nothing after it")
        return order

    return read


def _pace(words: Sequence[str]) -> ConsoleCommand:
    if len(words) != 1:
        raise ConsoleCommandError("takes one number, or off")
    try:
        return Local("pace", f"{NumberOrOffRule(SLOWEST, FASTEST).from_text(words[0]):g}")
    except ValueError as error:
        raise ConsoleCommandError(str(error)) from None


def _help(words: Sequence[str]) -> ConsoleCommand:
    if len(words) > 1:
        raise ConsoleCommandError("takes one code")
    return Local("help", "".join(words))


def _file(name: str, *, required: bool) -> Callable[[Sequence[str]], ConsoleCommand]:
    def read(words: Sequence[str]) -> ConsoleCommand:
        if required and not words:
            raise ConsoleCommandError("takes a file name")
        return Local(name, " ".join(words))

    return read


CONSOLE_COMMANDS = {
    spec.name: spec
    for spec in (
        OrderSpec("help", ":help [CODE]", "keys, orders and codes; or all about one code", _help),
        OrderSpec(
            "reset", ":reset", "everything back to the start, same seed", _plain(Action(ActionName.RESET))
        ),
        OrderSpec(
            "teleport",
            ":teleport X Y HEADING",
            "put the robot there",
            _numbers(ActionName.TELEPORT, 3),
        ),
        OrderSpec("block", ":block X Y", "put the block there", _numbers(ActionName.BLOCK, 2)),
        OrderSpec("seed", ":seed N", "back to the start with another seed", _numbers(ActionName.SEED, 1)),
        OrderSpec("noise", ":noise on|off", "random errors of sensors and drives", _switch(ActionName.NOISE)),
        OrderSpec("bias", ":bias [on|off]", "show the drive bias; random, or as in drive.csv", _bias),
        OrderSpec("speed", ":speed N", "simulated seconds a second", _numbers(ActionName.SPEED, 1)),
        OrderSpec("pace", ":pace N|off", "how fast movements are shown, times real speed", _pace),
        OrderSpec("stop", ":stop", "stop the robot", _plain(Action(ActionName.STOP))),
        OrderSpec("pause", ":pause", "let commands wait", _plain(Action(ActionName.PAUSE))),
        OrderSpec("resume", ":resume", "go on after a pause", _plain(Action(ActionName.RESUME))),
        OrderSpec("step", ":step", "while paused, let one command through", _plain(Local("step"))),
        OrderSpec("plot_robot", ":plot_robot [on|off]", "draw the maze and the robot", _view("plot_robot")),
        OrderSpec("plot_sense", ":plot_sense [on|off]", "draw what the sensors see", _view("plot_sense")),
        OrderSpec("trail", ":trail [on|off]", "draw the last movements", _view("trail")),
        OrderSpec("truth", ":truth [on|off]", "true values beside readings", _view("truth")),
        OrderSpec("shot", ":shot FILE.svg", "a picture of the screen", _file("shot", required=True)),
        OrderSpec("save", ":save FILE", "write the log panel to a file", _file("save", required=True)),
        OrderSpec("copy", ":copy", "copy the log panel to the clipboard", _plain(Local("copy"))),
        OrderSpec("log", ":log FILE", "log the run from here on (or auto)", _file("log", required=True)),
        OrderSpec("why", ":why", "why the last movement ended as it did", _plain(Local("why"))),
        OrderSpec("report", ":report", "what this run amounts to so far", _plain(Local("report"))),
        OrderSpec("robot", ":robot PORT", "drive the robot on a serial port", _file("robot", required=True)),
        OrderSpec("simulator", ":simulator", "drive the simulated robot again", _plain(Local("simulator"))),
        OrderSpec("quit", ":quit", "end", _plain(Local("quit"))),
    )
}


BARE_WORDS = {"help": "help", "quit": "quit", "exit": "quit"}
"""Words that are understood without a colon too, and the order each stands for."""


def read_console_command(line: str, spec: SimulationSpec) -> ConsoleCommand:
    """What a typed line asks for. Raises ConsoleCommandError for a colon order that is none, and for a
    line that would be done in part only, such as `u1 u2`: a line is one command."""
    text = line.strip()
    name, *words = text.removeprefix(":").split() or [""]
    known = BARE_WORDS.get(name.lower(), name.lower())
    if not text.startswith(":") and (name.lower() not in BARE_WORDS or len(words) > (known == "help")):
        return _one_command(parse_command(text, "console"), spec)
    order = CONSOLE_COMMANDS.get(known)
    if order is None:
        hint = did_you_mean(name, CONSOLE_COMMANDS) or "; :help lists them"
        raise ConsoleCommandError(f":{escape(name, 20)} is not an order{hint}")
    try:
        return order.read(words)
    except ConsoleCommandError as error:
        raise ConsoleCommandError(f":{order.name} {error}; {order.usage}") from None


def _one_command(command: Command, spec: SimulationSpec) -> Command:
    """A command, if its code is followed by nothing but a separator and a value.

    The protocol ignores what follows a sensor's code and takes any separator, so `o1o2` would read o1
    and `d1d2` drive 2 inches: from a program it is what the program says, from a person a slip. A code
    that there is not may be the real robot's own; what follows it is left alone.
    """
    code, argument = command.code, command.argument
    is_sensor = any(sensor.code == code for sensor in spec.sensors)
    is_drive = any(drive.code == code for drive in spec.drives)
    is_drive = is_drive or (spec.gripper is not None and spec.gripper.code == code)
    if argument is None or not (is_sensor or is_drive):
        return command
    is_number = isinstance(parse_value(argument), float)
    # One word that is no number is refused by the drive itself, which says what is wrong with it.
    is_one = is_number or (is_drive and len(argument.split()) <= 1)
    if command.text.strip()[2].isalnum() or not is_one:
        takes = f"{code} takes nothing after it" if is_sensor else f"{code}-V takes one number"
        raise ConsoleCommandError(f"{command.shown}: {takes}; one command a line")
    return command


def completions(line: str, spec: SimulationSpec) -> list[tuple[str, str]]:
    """What a line may become, each with its meaning: orders after a colon, else command codes."""
    if line.startswith(":"):
        return _order_completions(line)
    start = line.strip()[:2]
    codes = [(s.code, s.id) for s in spec.sensors if s.enabled]
    codes += [(d.code, d.kind.meaning) for d in spec.drives if d.enabled]
    if spec.gripper is not None and spec.gripper.enabled:
        codes.append((spec.gripper.code, "gripper: 1 closes, 0 opens"))
    return [(code, meaning) for code, meaning in codes if code.startswith(start)]


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
    if not line.strip():
        return None
    for completion, _ in completions(line, spec):
        if completion.startswith(line) and completion != line:
            return completion
    return None
