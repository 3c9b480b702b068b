"""The benchmarks run, whatever they measure here: what is never run rots."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"
SECONDS = 1100.0
"""Of any of them: one that hangs is told of by what it has said so far."""


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(path.name for path in BENCHMARKS.glob("bench_*.py")))
def test_a_benchmark_gives_its_figures(name: str, tmp_path: Path) -> None:
    figures = tmp_path / "figures.json"
    command = [sys.executable, str(BENCHMARKS / name), "--quick", "--json", str(figures)]
    # What it started ends with it: a simulator that is left behind slows all tests after it.
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True) as benchmark:
        try:
            _, told = benchmark.communicate(timeout=SECONDS)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(benchmark.pid, signal.SIGKILL)
    assert "Traceback" not in told, told
    assert figures.exists(), told
    assert json.loads(figures.read_text()), "it may miss its goal on a busy machine, but it measures"
