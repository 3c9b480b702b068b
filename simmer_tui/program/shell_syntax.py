"""A shell's syntax in the command of a program, which is started without a shell."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator

from simmer_tui import platform_has

# POSIX.1-2024, 2.4 to 2.7 and 2.9.3: operators, redirections, substitutions; cmd.exe has the same operators.
# A single & or ; inside a word is left to the program: addresses have them.
_OPERATOR = re.compile(r"&&|\|\|?|\d*>>|\d*>&?|\d*<<?|(?<=\s)&$|;(?=\s|$)|`|\$[({A-Za-z_]")
_OPERATOR_OF_WINDOWS = re.compile(r"&&|\|\|?|\d*>>|\d*>&?|<|(?<=\s)&(?=\s|$)|%[A-Za-z_]+%")
_HOME = re.compile(r"(?<=\s)~(?=/|\s|$)")
_ASSIGNMENT = re.compile(r"[A-Za-z_][A-Za-z0-9_]*=")
# Those of POSIX.1-2024 and of bash that no file on the path replaces.
_BUILT_IN = frozenset(
    (".", "alias", "cd", "eval", "exec", "export", "set", "source", "ulimit", "umask", "unset")
)
_BUILT_IN_OF_WINDOWS = frozenset(
    ("call", "cd", "chdir", "copy", "dir", "echo", "pushd", "set", "start", "type")
)
_SHELLS_OF_WINDOWS = frozenset(("cmd", "powershell", "pwsh"))


def shell_syntax(command: str, *, windows: bool = not platform_has.POSIX) -> str:
    """The first piece of a command that only a shell understands; empty if there is none. Quoted text is the
    program's."""
    bare = _without_quoted(command, windows=windows).strip()
    first = bare.split(maxsplit=1)[0] if bare else ""
    if windows:
        if first.lower().removesuffix(".exe") in _SHELLS_OF_WINDOWS:
            return ""  # its quotes are not the usual ones
        if first.lower() in _BUILT_IN_OF_WINDOWS:
            return first
        found = _OPERATOR_OF_WINDOWS.search(bare)
        return found[0] if found else ""
    if first in _BUILT_IN:
        return first
    if _ASSIGNMENT.match(first):
        return first.partition("=")[0] + "="
    found = _OPERATOR.search(bare) or _HOME.search(f" {bare}")
    return found[0] if found else ""


def shell_command(command: str, *, windows: bool = not platform_has.POSIX) -> str:
    """The command that has a shell carry out another one."""
    if windows:
        return f'cmd /s /c "{command.strip()}"'
    return f"bash -c {shlex.quote(command.strip())}"


def shell_problem(command: str, *, windows: bool = not platform_has.POSIX) -> str:
    """The reason why a command of --run needs a shell, and the option to type; empty if it needs none."""
    found = shell_syntax(command, windows=windows)
    if not found:
        return ""
    typed = _quoted(shell_command(command, windows=windows), windows=windows)
    return f"{found} is a shell's, and no shell is used; type --run {typed}"


def _quoted(command: str, *, windows: bool) -> str:
    """A command as one word for the shell in which it is typed."""
    if windows:
        return '"' + command.replace('"', '\\"') + '"'
    # Readable where double quotes change nothing in it.
    return shlex.quote(command) if re.search(r'["$`\\!]', command) else f'"{command}"'


def _without_quoted(command: str, *, windows: bool) -> str:
    """A command with a letter in place of every quoted or escaped character, and of the quotes."""
    return "".join(_bare(command, '"' if windows else "\"'", "" if windows else "\\"))


def _bare(command: str, quotes: str, escape: str) -> Iterator[str]:
    quote, characters = "", iter(command)
    for character in characters:
        if character == escape and quote != "'":
            next(characters, "")
            yield "xx"
        elif quote:
            quote = "" if character == quote else quote
            yield "x"
        elif character in quotes:
            quote = character
            yield "x"
        else:
            yield character
