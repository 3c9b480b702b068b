"""Sensors and drives that were not as they should be, kept with each run of a set of trials."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.cli.trials_command import run_trials
from simmer_tui.config.sets import bundled_sets, init_set
from simmer_tui.report.finding import Basis, Finding, FindingKind, plain_findings
from simmer_tui.trials.failures import findings_tables
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.sweep import files_at
from simmer_tui.trials.trial import TrialResult

READS = 'for turn in range(12):\n    robot.read("u1")\n    robot.drive("r1", 30)\nsys.exit(number - 1)\n'


def test_findings_of_every_run_are_kept_and_told(
    tmp_path: Path, program: Callable[[str], str], capfd: pytest.CaptureFixture[str]
) -> None:
    folder, out = tmp_path / "biased", tmp_path / "out"
    init_set(folder, bundled_sets()["default"])
    for file, text in files_at({"u1.bias": "3"}, folder).items():
        (folder / file).write_text(text)
    options = ["--config", str(folder), "--run", program(READS), "--runs", "2", "--jobs", "1", "--json"]
    assert run_trials([*options, "--seed", "1", "--out", str(out)]) == 0
    answer: dict[str, Any] = json.loads(capfd.readouterr().out)
    results = TrialFolder.read(out).done
    assert [result.success for result in results] == [True, False], "findings do not ask how it ended"
    for result in results:
        [found] = result.findings
        assert (found["of"], found["kind"], found["basis"]) == ("u1", "offset", "nominal")
        assert found["value"] == pytest.approx(3.0, abs=0.5)
        assert found["text"] in [each["text"] for each in answer["findings"] if each["run"] == result.number]
    [device] = answer["devices"]
    assert (device["of"], device["runs"], device["share"], device["which"]) == ("u1", 2, 1.0, [1, 2])
    assert device["text"] in (out / "report.html").read_text()


def test_devices_of_most_runs_stand_first(made_result: Callable[..., TrialResult]) -> None:
    def found(of: str, value: float) -> Finding:
        return Finding(of, FindingKind.OFFSET, value, value - 0.1, value + 0.1, "in", 9, Basis.SET, f"{of}!")

    all_found = {1: [found("u2", 2.0)], 2: [], 3: [found("u1", 3.0)], 4: [found("u1", 5.0)]}
    results = [
        made_result(number, 1, success=True, findings=plain_findings(each))
        for number, each in all_found.items()
    ]
    devices, listed = findings_tables(results)
    assert [(row["of"], row["median"], row["runs"], row["which"]) for row in devices.objects()] == [
        ("u1", 4.0, 2, [3, 4]),
        ("u2", 2.0, 1, [1]),
    ]
    assert [row["run"] for row in listed.objects()] == [1, 3, 4]
