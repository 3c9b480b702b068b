"""The line to type in place of one with a mistake, for the messages of the command line."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from simmer_tui import platform_has
from simmer_tui.config.examples import EXAMPLE
from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.config.sets import FILES, bundled_sets, has_set, set_in
from simmer_tui.program.program_command import (
    SCRIPTS,
    file_nearby,
    is_python,
    missing_program,
    run_option,
    starting_words,
)
from simmer_tui.runlog.writer import LOG, PACKED
from simmer_tui.sim.command import keyboard_text, typed_path

_NAME = "simmer-tui"
_COMMAND = re.compile(r"[A-Za-z]\d(?:[-=:, ]?\s*-?[\d.,]+)?")
"""A command for the robot: the code of a bundled set, perhaps with a value."""
_STARTS = "start run go open launch begin play tui ui gui app sim simulate simulator server serve simmer"
_MEANT = {
    **dict.fromkeys(_STARTS.split(), ""),
    **dict.fromkeys(("?", "/?", "/h", "/help", "-?", "man", "usage", "-help", "--h"), "help"),
    **dict.fromkeys(("version", "-v", "-V", "--v", "-version"), "--version"),
    **dict.fromkeys(("headless", "--headless", "--nogui", "--no-gui", "--no-tui", "--batch"), "--no-ui"),
    "-m": "--mission",
    "-r": "--run",
    "-p": "--port",
    "-c": "--config",
    "-s": "--seed",
    "config": "help check",
    "settings": "help settings",
    "create": "init DIR",
    "new": "init DIR",
    "validate": "check DIR",
    "test": "check DIR",
    "examples.py": "examples DIR",
    **dict.fromkeys(("compile", "verify"), "check DIR"),
    **dict.fromkeys(("upload", "flash"), "--sketch DIR"),
    **dict.fromkeys(("log", "logs", "runs"), "report"),
}
"""Words and options of other programs, and what means the same here."""
_ENDS = ("exit", "quit", "q", "stop", "end", "kill", ":q", ":quit", "close")
_COMPILED = {
    ".c": "gcc -o {stem} {file} -lm",
    ".cpp": "g++ -o {stem} {file}",
    ".cc": "g++ -o {stem} {file}",
    ".rs": "rustc {file}",
    ".java": "javac {file}",
}
"""The compilers of program texts."""
_DOCUMENTS = {
    ".ino": "is a sketch for a board. simmer-tui init my-robot --sketch {file} makes a robot of it, "
    "simmer-tui --serial PORT drives a real board",
    ".ipynb": "is a notebook. Start simmer-tui in this terminal, and run the notebook's cells beside it",
}
"""Files that nothing here starts."""


class _Program(NamedTuple):
    """A program among the words of a command line: its command, and the number of the words it takes."""

    command: str
    words: int


def advice(given: Sequence[str], unknown: Sequence[str], prog: str, *, takes_program: bool) -> str:
    """The message about words that are no command: what they are, and a line that works. Empty if that is not
    evident.

    Args:
        given: all words of the command line.
        unknown: those that the parser does not know, in order.
        prog: the command's own name.
        takes_program: True if it has the option `--run`.
    """
    first = unknown[0]
    shown = first
    if takes_program and "--run" not in given and (found := _program_of(unknown)):
        return _program_advice(found, given, unknown, prog)
    if prog != _NAME:
        return ""
    if first in _ENDS:
        return f'"{shown}": nothing runs here; the screen ends with :quit, a run without it with ctrl+C'
    if first in ("simmer-tui", "simmer_tui"):
        return f'"{shown}" is this program: type it once, {_line([_NAME, *_without(given, [first])])}'
    if first in ("run", "start") and len(unknown) == 1:
        program = run_option(f"python {EXAMPLE}")
        return f'"{shown}" is no command: {_NAME} starts the screen, {_NAME} {program} starts a program too'
    if first in _MEANT:
        line = " ".join(filter(None, (_NAME, _MEANT[first], _line(_without(given, unknown)))))
        return f'"{shown}" is no {_kind(first)}: type {line}'
    if text := robot_command(unknown):
        return f'"{text}" is a command for the robot: type {_NAME}, and {text} in its last line'
    return _file_advice(first, prog)


def is_meant(word: str) -> bool:
    """True if a word is known from other programs."""
    return word in _MEANT


def robot_command(words: Sequence[str]) -> str:
    """The command for the robot that some words are, `d1-3` or `d1 -3`; empty if they are none."""
    text = keyboard_text(" ".join(words[:2]))
    if not _COMMAND.fullmatch(text):
        text = keyboard_text(words[0])
    if not _COMMAND.fullmatch(text) or Path(words[0]).exists():
        return ""
    # The third character is the separator, a space too, as in the console.
    code, value = text[:2], text[3:].strip().replace(",", ".")
    return f"{code}-{value}" if value else code


def _kind(word: str) -> str:
    return "option here" if word.startswith(("-", "/")) else "command"


def _program_of(words: Sequence[str]) -> _Program | None:
    """The program in the first words, after a word such as `run` or an interpreter."""
    if words[0] in ("run", "start", "python3.exe") or words[0] in _STARTS.split():
        rest = _program_of(words[1:]) if len(words) > 1 else None
        return rest and _Program(rest.command, rest.words + 1)
    if is_python(words[0]) and len(words) > 1:
        return _Program(_line(words), len(words))
    # A path with spaces and without quotes comes in parts.
    for count in range(1, min(len(words), 6) + 1):
        name = " ".join(words[:count])
        path = Path(name)
        is_program = path.suffix.lower() in (*SCRIPTS, *_COMPILED, *_DOCUMENTS, ".js", ".exe")
        if (is_program and (path.is_file() or count == 1)) or (path.is_file() and os.access(path, os.X_OK)):
            return _Program(_line([*starting_words(path), *words[count:]]), len(words))
    return None


def _program_advice(found: _Program, given: Sequence[str], unknown: Sequence[str], prog: str) -> str:
    words = _split(found.command)
    file = next((word for word in words if Path(word).suffix and not is_python(word)), words[0])
    shown, suffix = Path(file).name, Path(file).suffix.lower()
    if suffix in _DOCUMENTS:
        return f'"{shown}" {_DOCUMENTS[suffix].format(file=typed_path(Path(file)))}'
    if suffix in _COMPILED:
        compiled = _COMPILED[suffix].format(file=file, stem=Path(file).stem)
        return f'"{shown}" must be compiled: {compiled}; then {prog} --run ./{Path(file).stem}'
    others = _without(given, unknown)
    line = " ".join(filter(None, (prog, _line(others), run_option(found.command))))
    if not missing_program(found.command):
        return f'"{shown}" is a program: type {line}'
    missing = f"there is no file {file} in {Path.cwd()}"
    if near := file_nearby(file):
        other = _line([*starting_words(near), *words[words.index(file) + 1 :]])
        return f"{missing}: type {' '.join(filter(None, (prog, _line(others), run_option(other))))}"
    if shown == EXAMPLE:
        folder = "my-programs"
        copied = run_option(f"python {folder}/{EXAMPLE}")
        return f"{missing}: {_NAME} examples {folder} writes one; then type {prog} {copied}"
    return f"{missing}: go to its folder with cd, and type {line}"


def _file_advice(word: str, prog: str) -> str:
    """The advice on a word that names a set, a file of one, or a log."""
    path, shown = Path(word), str(word)
    if word in bundled_sets():
        return f'"{shown}" is a configuration set: type {prog} --config {shown}'
    if path.is_dir() and has_set(folder := set_in(path)):
        option = "--sketch" if (folder / WIRING_FILE).is_file() else "--config"
        return f'"{shown}" is a configuration set: type {prog} {option} {_line([word])}'
    if path.is_dir() and any(path.glob("*.ino")):
        return f'"{shown}" {_DOCUMENTS[".ino"].format(file=_line([word]))}'
    if path.name in FILES and path.is_file():
        return f'"{shown}" is a file of a set: type {prog} --config {_line([str(path.parent)])}'
    if path.name.removesuffix(PACKED).endswith(LOG):
        return f'"{shown}" is a log: type {prog} replay {_line([word])}'
    return ""


def _without(given: Sequence[str], unknown: Iterable[str]) -> list[str]:
    """The given words without the unknown ones."""
    rest = list(given)
    for word in unknown:
        if word in rest:
            rest.remove(word)
    return rest


def _line(words: Sequence[str]) -> str:
    return platform_has.shell_line(words)


def _split(command: str) -> list[str]:
    return shlex.split(command, posix=platform_has.POSIX)
