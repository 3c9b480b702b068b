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


if os.environ.get("SIMMER_CLOCK_PORT"):
    importlib.import_module("simmer_clock").install()
if os.environ.get("SIMMER_DIALECT_PORT"):
    importlib.import_module("simmer_serial").install()
_run_next()
