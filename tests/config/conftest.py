"""Lists the problems of a set."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

from simmer_tui.config.loader import load
from simmer_tui.config.settings_file import Override
from simmer_tui.errors import ConfigurationError, Problem

Problems = Callable[..., list[str]]


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
