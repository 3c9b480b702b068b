"""Reads an exchange with a real robot, recorded by `--record`: one JSON line for each piece."""

import json
from pathlib import Path

from simmer_tui.dialect.exchange import Exchanged
from simmer_tui.errors import ConfigurationError, Problem

# An hour of a robot that sends at 9600 baud has 60 MB of lines.
_LARGEST = 100_000_000
"""Largest file, bytes."""


def read_exchange(path: Path) -> tuple[float, list[Exchanged]]:
    """The rate of the line, bits a second (0 if it is not known), and the pieces.

    Raises ConfigurationError.
    """
    shown = str(path)
    try:
        if path.stat().st_size > _LARGEST:
            raise ConfigurationError([Problem(shown, f"is larger than {_LARGEST} bytes")])
        lines = path.read_text("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError([Problem(shown, f"cannot be read: {error}")]) from None
    baud, pieces = 0.0, list[Exchanged]()
    for number, text in enumerate(lines, 1):
        try:
            line = json.loads(text)
            if "baud" in line:
                baud = float(line["baud"])
                continue
            if "unsent" in line:
                _take_back(pieces, str(line["unsent"]).encode("latin-1"))
                continue
            from_robot = "from" in line
            data = str(line["from" if from_robot else "to"]).encode("latin-1")
            pieces.append(Exchanged(number, float(line["t"]), data, from_robot))
        except (ValueError, KeyError, TypeError, RecursionError):
            what = 'is no line of an exchange, such as {"t": 1.5, "to": "get\\n"}; --record FILE writes one'
            raise ConfigurationError([Problem(f"{shown}:{number}", what)]) from None
    return baud, pieces


def _take_back(pieces: list[Exchanged], data: bytes) -> None:
    """Remove the piece to the robot that was never sent."""
    for place in range(len(pieces) - 1, -1, -1):
        if not pieces[place].from_robot and pieces[place].data == data:
            del pieces[place]
            return
