"""The folder that is first on the path of a Python program: it replaces the program's clock and serial
port."""

import os
from collections.abc import Mapping
from pathlib import Path

FOLDER = Path(__file__).resolve().parent / "hook"
"""The folder with our sitecustomize.py."""
HOOKED = ("SIMMER_CLOCK_PORT", "SIMMER_DIALECT_PORT")
"""Variables of programs that need it."""
_PATH = "PYTHONPATH"


def with_hook(environment: Mapping[str, str], folder: str = str(FOLDER)) -> dict[str, str]:
    """The variables of a program; if it needs the folder, with that in front of its path.

    Args:
        environment: All its variables.
        folder: Where it sees our folder.
    """
    if not any(name in environment for name in HOOKED):
        return dict(environment)
    given = environment.get(_PATH, "")
    before = [each for each in given.split(os.pathsep) if each != folder] if given else []
    return {**environment, _PATH: os.pathsep.join([folder, *before])}
