"""Imported by Python at the start of a program that the simulator runs: sets its clock and its serial port.
Then it runs any other sitecustomize."""

from __future__ import annotations

import importlib
import importlib.machinery
import os
import sys

_HERE = os.path.dirname(os.path.abspath(__file__))  # noqa: PTH100, PTH120 - pathlib would cost every start 10 ms


def _run_next() -> None:
    """Run the sitecustomize that ours hides: Debian has one, and virtual environments may."""
    path = [each for each in sys.path if os.path.abspath(each) != _HERE]  # noqa: PTH100
    spec = importlib.machinery.PathFinder.find_spec("sitecustomize", path)
    if spec is not None and spec.loader is not None:
        # Not by importlib.util, whose import takes time.
        module = type(sys)(spec.name)
        module.__spec__, module.__file__ = spec, spec.origin
        spec.loader.exec_module(module)


def _give_way(before: set[str]) -> None:
    """Forget modules that were imported since, if a file of the program has the name of one: the program then
    imports its own file, as without this."""
    # Python before 3.10 does not tell the program's name here.
    words = getattr(sys, "orig_argv", ["", ""])[1:]
    script = next((each for each in words if each.endswith(".py")), "")
    folder = os.path.dirname(script) or os.curdir  # noqa: PTH120
    try:
        own = {os.path.splitext(each)[0] for each in os.listdir(folder) if each.endswith(".py")}  # noqa: PTH122, PTH208
    except OSError:
        return
    for name in set(sys.modules) - before:
        if name.partition(".")[0] in own:
            del sys.modules[name]


def _write_stacks(path: str) -> None:
    """Write all stacks to a file when the simulator ends the program: it tells where the program was."""
    import faulthandler

    try:
        file = open(path, "ab", 0)  # noqa: PTH123, SIM115 - open as long as the program runs
    except OSError:  # a sandbox does not see it
        return
    # 15 is SIGTERM: the module signal takes a millisecond. It ends the program after that, as without us.
    if sys.platform != "win32":
        faulthandler.register(15, file, all_threads=True, chain=True)


_before = set(sys.modules)
# Children of the program are not asked.
_stacks = os.environ.pop("SIMMER_STACK_FILE", "")
if _stacks:
    _write_stacks(_stacks)
if os.environ.get("SIMMER_CLOCK_PORT"):
    importlib.import_module("simmer_clock").install()
if os.environ.get("SIMMER_DIALECT_PORT"):
    importlib.import_module("simmer_serial").install()
_give_way(_before)
_run_next()
