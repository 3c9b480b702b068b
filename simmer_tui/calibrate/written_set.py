"""The result as a configuration set: files of the set that ran, with what was learned in their place.

Sources stand beside the figures: in settings.toml as comments, in the CSV files in a last column without
a name, where the loader lets people keep notes.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simmer_tui.calibrate.estimates import ParameterEstimate
from simmer_tui.calibrate.fit import Fit
from simmer_tui.calibrate.parameters import with_values
from simmer_tui.config import drive_csv, sensors_csv, settings_file
from simmer_tui.config.settings import all_settings, value_of
from simmer_tui.config.settings_file import settings_text
from simmer_tui.errors import CalibrationError, ConfigurationError, Problem
from simmer_tui.importer.set_writer import drive_csv_text, sensors_csv_text
from simmer_tui.sim.command import escape
from simmer_tui.sim.sensors import Sort
from simmer_tui.sim.specs import SimulationSpec

KNOWLEDGE = "calibration.json"
"""The file with estimates and their covariance, for `simmer-tui calibrate --check`."""
PAGE = "calibration.html"
_DIGITS = 5
"""Significant digits in the files: estimates are seldom known to four."""
_PROFILES = {"sensor_profile": (), "drive_profile": "", "link_profile": "", "realistic": False}
"""Settings without profiles: their values are in the CSV files now."""
_OF_THE_RUN = {"sim": True, "randbias": False}


def learned_spec(spec: SimulationSpec, estimates: Sequence[ParameterEstimate]) -> SimulationSpec:
    """The specification with every parameter that was identified."""
    rows = {each.kind.value: (True, i) for i, each in enumerate(spec.drives)}
    rows |= {each.id: (False, i) for i, each in enumerate(spec.sensors)}
    return with_values(
        spec,
        (
            (*rows[each.owner], each.field, _within(each.field, float(f"{each.value:.{_DIGITS}g}")))
            for each in estimates
            if each.identified and each.owner in rows
        ),
    )


def _within(field: str, value: float) -> float:
    """Shares and standard deviations within what sensors.csv allows."""
    return min(max(value, 0.0), 1.0) if field in ("error", "dropout", "outlier") else value


def set_texts(fit: Fit, estimates: Sequence[ParameterEstimate]) -> dict[str, str]:
    """The files of the set by name."""
    run = fit.run
    spec = learned_spec(run.spec, estimates)
    texts = dict(run.configuration.files)
    source = f"calibrated from {', '.join(run.names)}"
    notes = _notes(estimates, source)
    texts[drive_csv.FILE] = _noted(drive_csv_text(spec.drives, spec.gripper), notes)
    texts[sensors_csv.FILE] = _noted(sensors_csv_text(spec.sensors), notes)
    texts[settings_file.FILE] = _settings(fit, estimates, source)
    texts[KNOWLEDGE] = knowledge_text(fit, estimates)
    return texts


def _notes(estimates: Sequence[ParameterEstimate], source: str) -> dict[str, str]:
    """Notes on rows, by ID: intervals and the logs they are from, or why there is no estimate."""
    told: dict[str, list[str]] = {}
    unidentified: dict[str, dict[str, list[str]]] = {}
    for each in estimates:
        if each.identified:
            _, low, high = each.shown
            unit = f" {each.unit}" if each.unit else ""
            told.setdefault(each.owner, []).append(f"{each.label} {low} to {high}{unit}")
        else:
            unidentified.setdefault(each.owner, {}).setdefault(each.why_not, []).append(each.label)
    notes = {owner: [f"{source}; 95 % intervals: {'; '.join(said)}"] for owner, said in told.items()}
    for owner, reasons in unidentified.items():
        parts = [f"{', '.join(labels)} as before: {why}" for why, labels in reasons.items()]
        notes[owner] = [*notes.get(owner, []), *parts]
    return {owner: "; ".join(said) for owner, said in notes.items()}


def _noted(text: str, notes: dict[str, str]) -> str:
    """A CSV file with notes in a last column without a name."""
    rows = list(csv.reader(io.StringIO(text)))
    made = io.StringIO()
    writer = csv.writer(made, lineterminator="\n")
    for number, row in enumerate(rows):
        writer.writerow([*row, notes.get(row[0], "") if number else ""])
    return made.getvalue()


def _settings(fit: Fit, estimates: Sequence[ParameterEstimate], source: str) -> str:
    configuration = fit.run.configuration
    values: dict[str, Any] = {
        item.name: value_of(configuration.settings, item.name) for item in all_settings()
    }
    values |= _PROFILES | _OF_THE_RUN
    # It says how this robot is: where that is otherwise than the set it was driven by, nothing is wrong.
    values["nominal"] = ""
    comments = {"randbias": f"{source}: the biases of drive.csv are this robot's own."}
    latency = next((each for each in estimates if each.owner == "link"), None)
    if latency is not None and latency.identified:
        values["link.latency"] = float(f"{latency.value:.3g}")
        _, low, high = latency.shown
        comments["link.latency"] = f"{source}: {low} to {high} s."
    lines: list[str] = []
    table = ""
    for line in settings_text(values).splitlines():
        if line.startswith("["):
            table = f"{line.strip('[]')}."
        key = table + line.partition(" = ")[0]
        if " = " in line and key in comments:
            lines.append(f"# {comments[key]}")
        lines.append(line)
    return "\n".join(lines) + "\n"


def knowledge_text(fit: Fit, estimates: Sequence[ParameterEstimate]) -> str:
    """The estimates by name, with the covariance of the identified parameters."""
    told = np.flatnonzero(fit.identified)
    names = [fit.space.parameters[i].name for i in told]
    covariance = fit.covariance[np.ix_(told, told)]
    return json.dumps(
        {
            "logs": list(fit.run.names),
            "misfits": [each.text for each in fit.misfits],
            "parameters": names,
            # Offsets are counted from where the set that is written has the sensors.
            "values": [
                0.0 if fit.space.parameters[i].sort is Sort.OFFSET else float(fit.state.parameters[i])
                for i in told
            ],
            "covariance": [[float(f"{v:.6g}") for v in row] for row in covariance],
            "noise_scales": {
                each.parameter.name: [each.value, each.low, each.high]
                for each in estimates
                if each.identified and each.parameter is not None and each.parameter.sort is Sort.NOISE
            },
            "shares": {
                f"{each.owner} {each.label}": [each.value, each.low, each.high]
                for each in estimates
                if each.identified and each.parameter is None
            },
        },
        indent=1,
    )


def write_files(texts: dict[str, str], directory: Path) -> None:
    """Write files into a folder, which is made if need be. Raises ConfigurationError, before anything
    is written, if one is there already, or if the folder cannot be written."""
    shown = escape(str(directory), 200)
    present = [name for name in texts if (directory / name).exists()]
    if present:
        what = f"has {', '.join(sorted(present))} already; nothing is overwritten, name another folder"
        raise ConfigurationError([Problem(shown, what)])
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (directory / name).write_bytes(text.encode("utf-8", "surrogatepass"))
    except OSError as error:
        raise ConfigurationError([Problem(shown, f"cannot be written: {error.strerror or error}")]) from None


def read_knowledge(directory: Path) -> dict[str, Any]:
    """The estimates that `knowledge_text` wrote into a set.

    Raises:
        CalibrationError: if the file is not there or damaged.
    """
    path = directory / KNOWLEDGE
    shown = escape(str(path), 200)
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        names, values = found["parameters"], np.array(found["values"], float)
        covariance = np.array(found["covariance"], float)
        if values.shape != (len(names),) or covariance.shape != (len(names), len(names)):
            raise ValueError("its parts are of different sizes")
    except OSError as error:
        raise CalibrationError(
            f"{shown} cannot be read ({error.strerror or error}); --check takes a set that "
            "simmer-tui calibrate wrote"
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        raise CalibrationError(f"{shown} is damaged: {escape(str(error), 120)}") from None
    return dict(found)
