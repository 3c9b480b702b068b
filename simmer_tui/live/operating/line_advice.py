"""Advice on a line of the console that the robot does not know: what it is, and the line that works."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import PurePath

from simmer_tui.live.operating.orders import CONSOLE_COMMANDS
from simmer_tui.program.program_command import SCRIPTS, is_python, run_option
from simmer_tui.sim.command import WORD, cut, keyboard_text, meant_number
from simmer_tui.sim.specs import SimulationSpec
from simmer_tui.sim.unknown_codes import movement_in_words

_TERMINAL = (
    "bash cat cd clear cls dir g++ gcc git ipython java julia ls make matlab mkdir node octave pip rm sudo"
)
_SHELL = frozenset((*_TERMINAL.split(), "simmer-tui", "simmer_tui"))
"""Programs that people start in a terminal."""
_ENDS = frozenset(("exit", "quit", "bye", "end", "close", "logout"))
_AROUND = re.compile(r"[\s\"'\[\](){};.!]")
"""Characters that a program has around a command."""
_PROGRAM_LINE = re.compile(r"[\w.]+\s*(?:=[^=]|\()|(?:import|from|for|while|if|def|print)\b|%|#|//")


def line_advice(text: str, spec: SimulationSpec) -> str:
    """The advice on a typed line; empty if it is not evident what was meant."""
    line = keyboard_text(text.strip())
    words = line.split()
    if not words:
        return ""
    name = words[0].lower().strip("():;!?.")
    known = _codes(spec)
    if name in _ENDS:
        return f"{cut(words[0], WORD)}: type :quit to end"
    if _PROGRAM_LINE.match(line) and not _known(_AROUND.sub("", line), known):
        return "a line of a program: programs run in a second terminal; here u1, for example"
    if name in CONSOLE_COMMANDS:
        return f"{name} is an order: type :{cut(' '.join([name, *words[1:]]))}"
    if name in ("run", "start") or _is_program(words):
        return _program_advice(words)
    compact = _AROUND.sub("", line)
    if meant := _known(compact, known):
        return f"{cut(line, WORD)} is no command; did you mean {cut(meant, WORD)}?"
    if meant := movement_in_words(words, spec):
        return f"{cut(words[0], WORD)} is no command; did you mean {meant}?"
    return ""


def _codes(spec: SimulationSpec) -> dict[str, bool]:
    """The codes of the enabled sensors and drives; true for those that take a value."""
    codes = {sensor.code: False for sensor in spec.sensors if sensor.enabled}
    return codes | {row.code: True for row in spec.drive_rows if row.enabled}


def _is_program(words: Iterable[str]) -> bool:
    first, *rest = words
    return (
        first.lower() in _SHELL
        or PurePath(first).suffix.lower() in SCRIPTS
        or (is_python(first) and bool(rest or len(first) > 2))
    )


def _program_advice(words: list[str]) -> str:
    if words[0].lower() in ("run", "start"):
        words = words[1:]
    if words and PurePath(words[0]).suffix.lower() == ".py":
        words = ["python", *words]
    line = " ".join(words)
    if words and is_python(words[0]) and len(words) > 1:
        return f"a line for a second terminal, or: simmer-tui {cut(run_option(line))}"
    if words and words[0].lower() not in ("simmer-tui", "simmer_tui"):
        return f"{cut(line, WORD)} is for a terminal: open a second one and type it there"
    if len(words) > 1:
        return f"type :quit, and then {cut(line)} in the terminal"
    return 'a program runs in a second terminal, or with simmer-tui --run "python PROGRAM.py"'


def _known(compact: str, known: dict[str, bool]) -> str:
    """The command with a known code that is within a line; empty if there is none."""
    for code in (compact[:2], compact[:2].lower()):
        value = compact[2:]
        if code in known and not known[code] and not value:
            return code
        if code in known and known[code] and (number := meant_number(value.removeprefix("-"))):
            return f"{code}-{number}"
    return ""
