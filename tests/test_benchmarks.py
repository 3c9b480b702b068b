"""The benchmarks run, whatever they measure here: what is never run rots."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"
SECONDS = 600.0
"""Of any of them: one that hangs is told of by what it has said so far."""


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(path.name for path in BENCHMARKS.glob("bench_*.py")))
def test_a_benchmark_gives_its_figures(name: str, tmp_path: Path) -> None:
    figures = tmp_path / "figures.json"
    command = [sys.executable, str(BENCHMARKS / name), "--quick", "--json", str(figures)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=SECONDS)
    assert "Traceback" not in done.stderr, done.stderr
    assert figures.exists(), done.stderr
    assert json.loads(figures.read_text()), "it may miss its goal on a busy machine, but it measures"
