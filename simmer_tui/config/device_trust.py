"""Trust in device files, by the SHA-256 of their content, stored for each user.

A device file is code by the author of the set, and it runs with the rights of the user. So it runs only if
the user has confirmed exactly this content, or trusts all files for one command.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable
from contextvars import ContextVar
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct

from simmer_tui import platform_has
from simmer_tui.config.given_path import opened_at_once
from simmer_tui.errors import Problem

if TYPE_CHECKING:  # every command imports this, and few sets have devices
    from simmer_tui.config.device_file import DeviceFile

OPTION = "--trust-devices"
"""The option that trusts all device files of one command."""
VARIABLE = "SIMMER_TRUSTED_DEVICES"
"""The environment variable with the hashes that a run trusts, separated by commas, for its program."""
_FILE = "trusted-devices.txt"
_HASH = re.compile(r"[0-9a-f]{64}\b")
# A line has some 150 bytes: thousands of files.
_LARGEST = 1_000_000
"""Largest file of hashes that is read, bytes."""


class DeviceUse(StrEnum):
    """The use that a command makes of a set's device files."""

    RUN = "run"
    """They run; one that is not trusted is a mistake of the set."""
    CHECK = "check"
    """They run if they are already trusted, else they are parsed."""
    PARSE = "parse"
    """They are parsed, never run: the command reads no sensor."""
    GIVEN = "given"
    """Their kinds come from another source: a log or files that were read before."""


class DeviceTrust(Struct, frozen=True):
    """The trust of one command: in `everything`, or in stored hashes. `ask` shows the user path, hash and
    first lines of a file, and may get a yes."""

    everything: bool = False
    ask: Callable[[DeviceFile, Path], bool] | None = None


TRUST: ContextVar[DeviceTrust] = ContextVar("TRUST", default=DeviceTrust())  # noqa: B039 - frozen
"""The trust of the present command."""


def is_trusted(file: DeviceFile, directory: Path, *, asks: bool = True) -> bool:
    """True if a device file of a set may run. A yes to the question is stored."""
    trust = TRUST.get()
    if trust.everything or file.sha256 in os.environ.get(VARIABLE, "") or file.sha256 in trusted_hashes():
        return True
    if not asks or trust.ask is None or not trust.ask(file, directory):
        return False
    remember(file, directory)
    return True


def untrusted(file: DeviceFile, place: str) -> Problem:
    """The problem with a file that may not run, which the setting at a place names."""
    what = (
        f"{file.path} (SHA-256 {file.sha256[:16]}...) is code of this set that you have not trusted yet. "
        f"Read it, then run the set on a terminal, which asks, or add {OPTION}"
    )
    return Problem(place, what)


def trust_file() -> Path:
    """The file with the hashes, in the user's data folder."""
    return platform_has.data_folder() / _FILE


def trusted_hashes() -> frozenset[str]:
    """The hashes that the user trusts; empty if there is no file."""
    try:
        with opened_at_once(trust_file()) as file:
            if not _is_own(os.fstat(file.fileno())):
                return frozenset()
            text = file.read(_LARGEST).decode("utf-8", "replace")
    except OSError:
        return frozenset()
    return frozenset(found[0] for line in text.splitlines() if (found := _HASH.match(line)))


def _is_own(status: os.stat_result) -> bool:
    """True for a file that only this user, or the machine's administrator, can have written."""
    if not stat.S_ISREG(status.st_mode):
        return False
    if not hasattr(os, "geteuid"):
        return True  # Windows itself restricts data folders to their users
    return status.st_uid in (0, os.geteuid()) and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def remember(file: DeviceFile, directory: Path) -> None:
    """Store the hash of a file, with a note for people. If it cannot be stored, the question is asked
    again."""
    path = trust_file()
    line = f"{file.sha256}  {file.path} in {directory.resolve()}\n"
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        if path.exists() and not _is_own(path.stat()):
            # Another user may have written its lines, so none of them is kept.
            path.unlink()
        if path.exists() and not path.read_bytes().endswith(b"\n"):
            line = f"\n{line}"  # behind a line that was cut off
        # For the user only: write access here decides which code runs.
        with open(os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600), "ab") as kept:  # noqa: PTH123
            kept.write(line.encode())
    except OSError:
        return
