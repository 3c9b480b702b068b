"""`from simmer_tui import load, Simulator, Robot, read_log`, and what importing costs."""

from __future__ import annotations

import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import simmer_tui
from simmer_tui import Robot, Simulator, load, read_log
from simmer_tui.config import load_default
from simmer_tui.errors import ConfigurationError
from simmer_tui.runlog.writer import RunLog

PUBLIC = ("config", "config.importer", "links.protocol", "report", "runlog", "sim", "trials")


def imported_by(statement: str) -> set[str]:
    """The top-level modules, besides those of the standard library, that a statement imports."""
    code = f"import sys\nbefore = set(sys.modules)\n{statement}\nprint(*set(sys.modules) - before)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {name.partition(".")[0] for name in done.stdout.split()} - sys.stdlib_module_names


def test_importing_it_and_the_client_takes_the_standard_library_only() -> None:
    assert imported_by("import simmer_tui") == {"simmer_tui"}
    assert imported_by("from simmer_tui import Robot") == {"simmer_tui"}


@pytest.mark.slow
def test_a_simulator_for_notebooks_needs_no_screen() -> None:
    assert imported_by("from simmer_tui import Simulator, load") & {"textual", "serial", "rich"} == set()


def test_without_a_specification_it_is_the_default_set() -> None:
    simulator = Simulator(seed=7)
    assert simulator.spec == load_default().simulation == load().simulation
    again = Simulator(load("default"), seed=7)
    commands = ["u1", "d1-3", "o1", "u3"]
    assert [simulator.execute(each).reply for each in commands] == [
        again.execute(each).reply for each in commands
    ]
    assert Simulator(again.spec, seed=8).execute("d1-3").pose != Simulator(seed=7).execute("d1-3").pose


def test_a_simulator_takes_a_set_by_its_name_too(folder: Path) -> None:
    assert Simulator("mission", seed=7).spec == load("mission").simulation
    assert Simulator(folder).spec == load(folder).simulation
    with pytest.raises(ConfigurationError, match="nowhere"):
        Simulator("nowhere")


def test_rays_take_nested_lists_which_the_types_say_too() -> None:
    """As in the README; mypy checks this file."""
    simulator = Simulator(seed=7)
    assert simulator.true_ranges([[9.5, 42.0, 0.0]]).shape == (1, 6)
    assert simulator.cast_rays([(9.5, 42.0)], [0.0]).shape == (1,)


def test_sets_are_loaded_by_name_and_by_folder(folder: Path) -> None:
    assert load("mission").mission is not None
    assert load(folder).simulation == load(str(folder)).simulation
    with pytest.raises(ConfigurationError, match="nowhere"):
        load("nowhere")


def test_a_log_is_read(tmp_path: Path) -> None:
    simulator = Simulator(seed=7)
    with RunLog(tmp_path / "run.jsonl", load(), simulator) as log:
        log(simulator.execute("u1"))
    with read_log(tmp_path / "run.jsonl") as read:
        assert read.header.seed == 7
        assert len(list(read)) == 1


def test_names_that_are_not_there_are_no_surprise() -> None:
    assert set(simmer_tui.__all__) <= set(dir(simmer_tui))
    assert Robot.__module__ == "simmer_tui.client"
    with pytest.raises(AttributeError, match="no attribute 'Robbot'"):
        _ = simmer_tui.Robbot  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_package_says_what_is_in_it(name: str) -> None:
    package = importlib.import_module(f"simmer_tui.{name}")
    names = getattr(package, "__all__", None) or [
        each.name for each in pkgutil.iter_modules(package.__path__)
    ]
    assert names
    for each in names:
        assert hasattr(package, each) or importlib.import_module(f"simmer_tui.{name}.{each}")
