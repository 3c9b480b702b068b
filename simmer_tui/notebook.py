"""The names of `from simmer_tui import ...`: sets by name, a simulator, and logs, in a line each."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from msgspec.structs import replace

from simmer_tui import sim
from simmer_tui.config import load_default, variables
from simmer_tui.config import loader as set_loader
from simmer_tui.config.device_trust import TRUST, DeviceTrust
from simmer_tui.config.loader import Configuration
from simmer_tui.config.maze_csv import read_cells
from simmer_tui.config.sets import find_set
from simmer_tui.config.settings_file import Override
from simmer_tui.document.as_html import embedded
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.report.page import report_page
from simmer_tui.report.run_statistics import report_of
from simmer_tui.runlog.reader import LogReader


def load(name_or_folder: str | Path | None = None, *, trust_devices: bool = False) -> Configuration:
    """A configuration set: a folder, a bundled set by name (`"mission"`), or the default set. With
    `trust_devices` its own devices/*.py run without having been trusted before.

    Raises ConfigurationError, which lists every mistake.
    """
    if name_or_folder is None:
        return load_default()
    token = TRUST.set(DeviceTrust(everything=True)) if trust_devices else None
    try:
        return set_loader.load(find_set(str(name_or_folder)))
    finally:
        if token is not None:
            TRUST.reset(token)


def configuration_from_environment(environment: Mapping[str, str]) -> Configuration:
    """The set that the environment of a program names: SIMMER_CONFIG, else `config` in the working
    directory, else the default set. SIMMER_DRIVE_PROFILE and SIMMER_SENSOR_PROFILE give its profiles,
    SIMMER_MAZE its maze. Raises ConfigurationError."""
    profiles = {"drive_profile": variables.DRIVE_PROFILE, "sensor_profile": variables.SENSOR_PROFILE}
    overrides = {
        name: Override(variable, value)
        for name, variable in profiles.items()
        if (value := environment.get(variable))
    }
    configuration = set_loader.load(find_set(environment.get(variables.SET) or None), overrides)
    maze = environment.get(variables.MAZE)
    if not maze:
        return configuration
    problems: list[Problem] = []
    cells = read_cells(Path(maze), problems)
    if cells is None:
        raise ConfigurationError(problems)
    simulation = replace(configuration.simulation, maze=sim.MazeSpec(cells))
    return replace(configuration, simulation=simulation)


class NotebookSimulator(sim.Simulator):
    """The simulator of notebooks: without a specification it has the default set. `simmer_tui.Simulator`.

    simulator = Simulator(seed=7)
    simulator.execute("d1-3").pose
    """

    def __init__(
        self, spec: Configuration | sim.SimulationSpec | str | Path | None = None, seed: int = 0
    ) -> None:
        """`spec` may be a whole configuration, as `load` gives it, or its name or folder; only its simulation
        is used. All random draws follow from `seed`. Raises PlacementError if robot or block stand in a wall,
        ValueError for a seed that is none."""
        if spec is None or isinstance(spec, str | Path):
            spec = load(spec)
        super().__init__(spec.simulation if isinstance(spec, Configuration) else spec, seed)


class Log(LogReader):
    """A run log: its `header`, and an iterator of its entries; a context manager that closes it. A
    notebook shows it as the page that `simmer-tui report --html` writes, which plays the run."""

    def _repr_html_(self) -> str:
        with LogReader(self.path) as log:  # from the beginning, however far this one has been read
            return embedded(report_page(report_of(log), self.path.name))


def read_log(path: str | Path) -> Log:
    """A run log to look through, or to look at: a `Log`. Raises RunLogError."""
    return Log(Path(path))
