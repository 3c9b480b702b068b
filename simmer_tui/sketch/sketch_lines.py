"""Lines of a compiled sketch by the addresses in it, as addr2line tells them."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

from simmer_tui.sim.command import cut
from simmer_tui.sketch.build import RUNTIME_NAME
from simmer_tui.sketch.compiler import links_at_fixed_addresses

ADDRESS_TOOL = "addr2line"
"""The command of binutils that knows lines."""
_LONGEST_NAME = 100
"""Characters of a file's name that are shown: a sketch can say any."""
_LONGEST_LOOK = 5.0
"""Real seconds for a look; it takes milliseconds."""


class SketchLines:
    """The lines of one compiled sketch. Each is looked up once."""

    def __init__(self, program: Path) -> None:
        self._program = program
        self._lines: dict[int, str] = {}

    def line_of(self, place: int) -> str:
        """The line of the sketch, `robot.ino:12`, at the address of a block; empty if it is not known."""
        found = self._lines.get(place)
        if found is None:
            found = ""
            if place and links_at_fixed_addresses():
                found = _own_line(self._told(place - 1))
            self._lines[place] = found
        return found

    def _told(self, address: int) -> str:
        """The answer of the tool about an address: lines, the innermost function first. Empty without one."""
        tool = shutil.which(ADDRESS_TOOL)
        if tool is None:
            return ""
        try:
            done = subprocess.run(
                [tool, "-i", "-e", str(self._program), hex(address)],
                capture_output=True,
                text=True,
                timeout=_LONGEST_LOOK,
                check=False,
            )
        except (OSError, subprocess.SubprocessError):
            return ""
        return done.stdout


def _own_line(told: str) -> str:
    # A function of the runtime or of C++ that was inlined comes before the line that calls it.
    own = [each for each in told.splitlines() if RUNTIME_NAME not in each and "?" not in each]
    own = [each for each in own if "/include/c++/" not in each] or own
    found = re.match(r"(?:.*/)?([^/:]+?)(?:(?<=\.ino)\.cpp)?:(\d{1,7})\b", own[0]) if own else None
    return f"{cut(found[1], _LONGEST_NAME)}:{found[2]}" if found else ""
