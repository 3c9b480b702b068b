"""The command of a run's program, as its log keeps it, and the seal of the user who gave it.

A log may come from anybody, and a command runs with the rights of its user. So a log also has a seal: a code
of the command under a secret key of the user (HMAC-SHA256). Nobody else can make it, and it fits no other
command. It says nothing about the key.
"""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

import msgspec

from simmer_tui import platform_has
from simmer_tui.config.given_path import opened_at_once

_KEY_FILE = "seal-key"
# As long as the codes of SHA-256: a longer one makes them no safer.
_KEY_BYTES = 32
_SECRET = re.compile("token|password|passwd|secret|api-?_?key", re.IGNORECASE)
"""Name of an option or variable whose value is a secret."""
_IN_URL = re.compile(r"://[^/\s]*:[^/\s]*@")
"""A user's name and password in a URL."""


class RunCommand(msgspec.Struct, frozen=True, omit_defaults=True):
    """The command `line` of `--run`, and the `folder` in which it ran. `line` is empty if it held a secret.
    `seal` is that of the user who gave it; empty without a data folder."""

    folder: str
    line: str = ""
    seal: str = ""

    @property
    def is_sealed_here(self) -> bool:
        """True if this user gave the command to this simulator."""
        key = _read_key()
        if not (key and self.line and self.seal):
            return False
        import hmac

        return hmac.compare_digest(_seal(key, self.line, self.folder), self.seal.encode("utf-8", "replace"))


def run_command(line: str, token: str = "") -> RunCommand:
    """The command of a program that starts now, in the working directory, sealed.

    Args:
        line: The command, as it was given.
        token: The access token of the run, which no log keeps.
    """
    folder = str(Path.cwd())
    if (token and token in line) or _holds_secret(line):
        return RunCommand(folder)
    key = _read_key() or _made_key()
    return RunCommand(folder, line, _seal(key, line, folder).decode() if key else "")


def _holds_secret(line: str) -> bool:
    """True if a value of a command seems to be a secret."""
    words = (word.strip("\"'") for word in line.split())
    names = (word.partition("=")[0] for word in words if word.startswith("-") or "=" in word)
    return any(map(_SECRET.search, names)) or _IN_URL.search(line) is not None


def _seal(key: bytes, line: str, folder: str) -> bytes:
    # Imported here because few runs have a command.
    import hashlib
    import hmac

    text = msgspec.json.encode([line, folder])
    return hmac.new(key, text, hashlib.sha256).hexdigest().encode()


def _key_file() -> Path:
    return platform_has.data_folder() / _KEY_FILE


def _read_key() -> bytes:
    """The user's key; empty if there is none, or if another user could have read or written it."""
    try:
        with opened_at_once(_key_file()) as file:
            if not _is_private(os.fstat(file.fileno())):
                return b""
            key = file.read(_KEY_BYTES + 1)
    except OSError:
        return b""
    return key if len(key) == _KEY_BYTES else b""


def _is_private(status: os.stat_result) -> bool:
    """True for a file that only this user can have read or written."""
    if not stat.S_ISREG(status.st_mode):
        return False
    if not hasattr(os, "geteuid"):
        return True  # Windows itself restricts data folders to their users
    return status.st_uid == os.geteuid() and not status.st_mode & (stat.S_IRWXG | stat.S_IRWXO)


def _made_key() -> bytes:
    """A new key; empty if it cannot be kept."""
    path = _key_file()
    key = os.urandom(_KEY_BYTES)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        if path.exists():
            path.unlink()  # it is no key of this user's
        descriptor = os.open(path, flags, 0o600)
        try:
            written = os.write(descriptor, key)
        finally:
            os.close(descriptor)
    except OSError:  # another run has made one at the same moment, or the folder cannot be written
        return _read_key()
    return key if written == len(key) else b""
