"""SimMeR-TUI: a simulator for mechatronics robots, driven over TCP or from a terminal.

The front door, for notebooks and programs:

    from simmer_tui import Robot, Simulator, load, read_log

    simulator = Simulator(seed=7)                # the default set; or Simulator(load("my-robot"), seed=7)
    simulator.execute("u1").reply
    with read_log("run.jsonl") as log:           # what --log wrote
        entries = list(log)
    with Robot() as robot:                       # a simulator that runs, or the real robot behind it
        robot.read("u1")

Importing this package loads nothing but the standard library, and the client in `simmer_tui.client`
stays as light as that: each name is imported when it is first asked for.
"""

from __future__ import annotations

from simmer_tui.version import __version__

TYPE_CHECKING = False  # as in typing, which costs more to import than all of this
if TYPE_CHECKING:
    from simmer_tui.client import Robot
    from simmer_tui.notebook import NotebookSimulator as Simulator
    from simmer_tui.notebook import load, read_log

__all__ = ["Robot", "Simulator", "__version__", "load", "read_log"]

_HOMES = {
    "Robot": ("simmer_tui.client", "Robot"),
    "Simulator": ("simmer_tui.notebook", "NotebookSimulator"),
    "load": ("simmer_tui.notebook", "load"),
    "read_log": ("simmer_tui.notebook", "read_log"),
}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    module, defined = _HOMES[name]
    value: object = getattr(import_module(module), defined)
    globals()[name] = value  # asked for once
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
