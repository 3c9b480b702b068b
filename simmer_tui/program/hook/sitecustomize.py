"""Imported by Python at the start of a program that the simulator runs: sets its clock and its serial port.
Then it runs any other sitecustomize."""

from __future__ import annotations

import importlib
import importlib.machinery
import importlib.util
import os
import sys

_HERE = os.path.dirname(os.path.abspath(__file__))  # noqa: PTH100, PTH120 - pathlib would cost every start 10 ms


def _run_next() -> None:
    """Run the sitecustomize that ours hides: Debian has one, and virtual environments may."""
    path = [each for each in sys.path if os.path.abspath(each) != _HERE]  # noqa: PTH100
    spec = importlib.machinery.PathFinder.find_spec("sitecustomize", path)
    if spec is not None and spec.loader is not None:
        spec.loader.exec_module(importlib.util.module_from_spec(spec))


if os.environ.get("SIMMER_CLOCK_PORT"):
    importlib.import_module("simmer_clock").install()
if os.environ.get("SIMMER_DIALECT_PORT"):
    importlib.import_module("simmer_serial").install()
_run_next()
