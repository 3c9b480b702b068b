"""A folder with the default set, and ways to change it and to list its problems."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder, init_set
from simmer_tui.config.settings_file import Override
from simmer_tui.errors import ConfigurationError, Problem

Problems = Callable[..., list[str]]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the default set."""
    made = tmp_path / "set"
    init_set(made, bundled_folder())
    return made


@pytest.fixture
def edit(folder: Path) -> Callable[[str, str, str], None]:
    """Replace a text, which must be there, in one of the set's files."""

    def replace(name: str, old: str, new: str) -> None:
        text = (folder / name).read_text(encoding="utf-8")
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1), encoding="utf-8", newline="")

    return replace


@pytest.fixture
def problems(folder: Path) -> Problems:
    """The lines of all problems of the set; none if it loads."""

    def listed(overrides: Mapping[str, Override] | None = None) -> list[str]:
        found: Sequence[Problem] = ()
        try:
            load(folder, overrides)
        except ConfigurationError as error:
            found = error.problems
        lines = [str(problem) for problem in found]
        assert all(line.isprintable() for line in lines)
        return lines

    return listed
