"""The access token of a run, kept from other users of the machine, who can read every command line (`ps`).

A file or the environment variable SIMMER_TOKEN gives it without a command line. A token on the command line
is overwritten there (Linux).
"""

from __future__ import annotations

import os
from pathlib import Path

from simmer_tui import platform_has
from simmer_tui.config.settings_file import Override
from simmer_tui.errors import ConfigurationError, Problem, reason_of
from simmer_tui.links.access import LONGEST_TOKEN
from simmer_tui.links.processes import StatField, stat_of

_TOKEN = "server.token"
"""The setting."""
_OPTION = "--token-file"


def add_token_of(path: Path, overrides: dict[str, Override]) -> None:
    """Use the first line of a file as the token. Raises ConfigurationError if it is none, or if the command
    line has another one."""
    if _TOKEN in overrides:
        raise _refused("and --token both give the token: leave one of them out")
    shown = str(path)
    try:
        with path.open("rb") as file:
            line = file.readline(LONGEST_TOKEN + 2)
        word = line.decode().strip()
    except OSError as error:
        raise _refused(f"{shown} cannot be read: {reason_of(error)}") from None
    except ValueError:
        raise _refused(f"{shown} is no text in UTF-8") from None
    if not word or len(line.rstrip(b"\r\n")) > LONGEST_TOKEN:
        raise _refused(f"the first line of {shown} is no token of 1 to {LONGEST_TOKEN} bytes")
    overrides[_TOKEN] = Override(_OPTION, word)


def _refused(what: str) -> ConfigurationError:
    return ConfigurationError([Problem(_OPTION, what)])


def hide_from_command_line(word: str) -> None:
    """Overwrite a text in this process's command line, where it is an argument or follows `=`."""
    if not platform_has.LINUX or not word:
        return
    # Imported here because only runs with a token need it.
    import ctypes

    try:
        fields = stat_of("self")
        arguments = Path("/proc/self/cmdline").read_bytes()
    except OSError:
        return  # no /proc: nobody else can read the command line there either
    begin, end = int(fields[StatField.ARGUMENTS_BEGIN]), int(fields[StatField.ARGUMENTS_END])
    if not begin or end - begin < len(arguments):  # 0: not reported
        return
    given, place = os.fsencode(word), begin
    for argument in arguments.split(b"\0"):
        if argument == given or argument.endswith(b"=" + given):
            ctypes.memset(place + len(argument) - len(given), ord("*"), len(given))
        place += len(argument) + 1
