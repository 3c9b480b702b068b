"""The C++ compiler of this machine: g++ or clang of the system, else the package ziglang."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

from msgspec import Struct

from simmer_tui import platform_has

_NAMES = ("g++", "clang++", "c++")
"""Compilers of the system, the first one that is there is used."""
NO_COMPILER = (
    "no C++ compiler was found. Install g++ (Debian: apt install g++; macOS: xcode-select --install), "
    "or: pip install ziglang"
)
_ZIG_CACHE = "ZIG_GLOBAL_CACHE_DIR"
_CACHE_FOLDERS = ("XDG_CACHE_HOME", "HOME", "LOCALAPPDATA")
"""Variables by which ziglang finds a folder for its cache."""
# A first run of ziglang fills its cache: for 150 s, and for more than 600 on a busy machine. A compiler
# that hangs must end.
COMPILE_LIMIT = 1800.0
"""Real seconds that one run of a compiler may take."""


class Compiler(Struct, frozen=True, dict=True):
    """A C++ compiler by its command."""

    command: tuple[str, ...]

    @cached_property
    def name(self) -> str:
        """Its name for people. The command's own may be that of another: macOS calls its clang g++."""
        if self.is_package:
            return "ziglang"
        told = self.version
        return "clang++" if "clang" in told else "g++" if told else Path(self.command[0]).stem

    @property
    def is_package(self) -> bool:
        """True for that of the package ziglang."""
        return len(self.command) > 1

    @property
    def is_gcc(self) -> bool:
        """True for GNU's; clang and ziglang share their options."""
        return self.name == "g++"

    @cached_property
    def identity(self) -> str:
        """A text that changes with the compiler, for the cache."""
        program = Path(self.command[0])
        try:
            state = program.stat()
        except OSError:
            return " ".join(self.command)
        return f"{' '.join(self.command)} {state.st_size} {state.st_mtime_ns}"

    def run(self, arguments: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
        """Run it in a folder. Raises OSError and TimeoutExpired."""
        return subprocess.run(
            [*self.command, *arguments],
            cwd=folder,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            # Its messages are read here, in English.
            env=os.environ | {"LC_ALL": "C"} | (_zig_cache() if self.is_package else {}),
            stdin=subprocess.DEVNULL,
            timeout=COMPILE_LIMIT,
            check=False,
        )

    @property
    def version(self) -> str:
        """The first line that it prints about itself; empty if it does not run."""
        try:
            lines = self.run(["--version"], Path.cwd()).stdout.splitlines()
        except (OSError, subprocess.SubprocessError):
            return ""
        return lines[0] if lines else ""


def _zig_cache() -> dict[str, str]:
    """The variable for ziglang's cache, where it finds no folder for it by itself: it needs a home directory
    that can be written."""
    has_folder = any(os.environ.get(name) for name in (_ZIG_CACHE, *_CACHE_FOLDERS))
    if has_folder and not platform_has.home_notice():
        return {}
    return {_ZIG_CACHE: os.environ.get(_ZIG_CACHE) or str(platform_has.data_folder() / "ziglang")}


def find_compiler() -> Compiler | None:
    """The compiler to use; None if there is none."""
    for name in _NAMES:
        program = shutil.which(name)
        if program is not None:
            return Compiler((program,))
    if importlib.util.find_spec("ziglang") is not None:
        return Compiler((sys.executable, "-m", "ziglang", "c++"))
    return None


def links_at_fixed_addresses() -> bool:
    """True if a program can be linked at fixed addresses, so that an address names a line."""
    return platform_has.LINUX
