"""Configuration sets: the files of a folder, read into specifications with every mistake listed.

In: CSV and TOML files, options of the command line, and foreign configurations.
Out: a frozen `Configuration`, or one error with all problems and their places.

`settings.py` has all settings and their options. `mission_toml.py` has the keys of a mission, and
`mission_plan.py` draws its values for one run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from simmer_tui.config.loader import Configuration

__all__ = ["load_default"]


def load_default() -> Configuration:
    """The bundled default set, unchanged."""
    # Imported here so that a part of this package can be imported without the rest.
    from simmer_tui.config.loader import load
    from simmer_tui.config.sets import bundled_folder

    return load(bundled_folder())
