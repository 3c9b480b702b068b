"""`simmer-tui trials --why`: failed runs again, with one change at a time."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs
from msgspec.structs import replace

from simmer_tui.cli.trials_command import run_trials
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.nominal import nominal_of
from simmer_tui.config.sets import bundled_sets, init_set
from simmer_tui.sim import ObservingSensor, columns
from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.rules import NumberRule
from simmer_tui.sim.specs import Axes, SensorSpec
from simmer_tui.trials import explanations
from simmer_tui.trials.chance_control import ChanceControl
from simmer_tui.trials.explanations import ChangedRun, explained
from simmer_tui.trials.intervals import PairCounts
from simmer_tui.trials.interventions import UNCHANGED, ChangedPart, Intervention, interventions
from simmer_tui.trials.sweep import files_at
from simmer_tui.trials.trial import Trial, TrialResult, prepare

# From the start of the bundled set, the wall ahead of u1 is 35.5 in away.
BY_U1 = """
said = robot.read("u1")
robot.read("u2")
with open(os.environ["STARTED"], "a") as file:
    file.write(f"{number} ")
sys.exit(abs(said - 35.5) > 3)
"""


class Started:
    """A set of two trials with a biased u1, by which the program decides."""

    def __init__(self, folder: Path, command: str, printed: pytest.CaptureFixture[str]) -> None:
        self.folder = folder
        self._command = command
        self._printed = printed

    def run(self, *options: str) -> tuple[dict[str, Any], str]:
        """The answer as JSON, and what was told meanwhile."""
        self._printed.readouterr()
        out = ("--out", str(self.folder / "out"), "--jobs", "2", "--json")
        run_trials([*options, *out])
        answer, told = self._printed.readouterr()
        return json.loads(answer), told

    def begin(self, *options: str) -> tuple[dict[str, Any], str]:
        at = ("--config", str(self.folder / "biased"), "--run", self._command, "--runs", "2", "--seed", "1")
        return self.run(*at, *options)

    def printed(self) -> str:
        """Messages since the last look."""
        return self._printed.readouterr().err

    @property
    def programs(self) -> list[int]:
        """The numbers that programs were given, each a run."""
        return sorted(map(int, (self.folder / "started.txt").read_text().split()))


@pytest.fixture
def trials(
    tmp_path: Path,
    program: Callable[[str], str],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> Started:
    folder = tmp_path / "biased"
    init_set(folder, bundled_sets()["default"])
    for name, value in {"u1.bias": "6", "u1.percent_error": "0"}.items():
        for file, text in files_at({name: value}, folder).items():
            (folder / file).write_text(text)
    monkeypatch.setenv("STARTED", str(tmp_path / "started.txt"))
    return Started(tmp_path, program(BY_U1), capfd)


@pytest.mark.slow
def test_true_readings_of_one_sensor_explain_a_run_that_they_save(
    trials: Started, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(explanations, "REPEATS", 6)
    answer, told = trials.begin("--why", "1")
    [why] = answer["why"]
    assert why["run"] == 1
    assert why["text"] == (
        "Run 1 succeeds with true readings of u1. The likely cause is the sensor. "
        "With other random errors 6 of 6 runs succeed, unchanged 0 of 6 (p = 0.031)."
    )
    [control] = answer["control"]
    assert (control["change"], control["runs"]) == ("true readings of u1", 6)
    assert (control["succeeded"], control["unchanged"]) == (6, 0)
    assert "run 1 succeeds with true readings of u1" in told
    assert "run 1 fails with nothing changed and other errors (6)" in told
    changed = {each["change"]: each["succeeded"] for each in answer["interventions"] if not each["repeat"]}
    assert not changed.pop(UNCHANGED)
    assert {change for change, succeeded in changed.items() if succeeded} == {
        "true readings of u1",
        "true readings of all sensors",
        "exact sensors and drives",
    }
    assert "true readings of u2" in changed
    assert not any("u3" in change for change in changed), "a sensor that was not read"
    assert (
        "true readings of u1. The likely cause is the sensor"
        in (trials.folder / "out/report.html").read_text()
    )
    assert not list((trials.folder / "out/why").glob("*.jsonl.gz"))


@pytest.mark.slow
def test_what_was_run_again_is_not_run_twice(trials: Started, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(explanations, "REPEATS", 1)
    answer, _ = trials.begin()
    assert answer.get("why", []) == []
    assert trials.programs == [1, 2]
    first, _ = trials.run("--resume", "--why", "1")
    done = trials.programs
    assert done.count(1) == 1 + len(first["interventions"])
    assert done.count(2) == 1
    results = trials.folder / "out/why/results.jsonl"
    whole = results.read_bytes()
    last = whole.rstrip(b"\n").rfind(b"\n") + 1
    results.write_bytes(whole[: last + 20])  # as a crash leaves it
    again, _ = trials.run("--resume", "--why", "1")
    assert trials.programs == sorted([*done, 1]), "the one that was cut off is done again"
    assert again["why"] == first["why"]
    assert results.read_bytes() == whole
    both, _ = trials.run("--resume", "--why")
    assert [each["run"] for each in both["why"]] == [1, 2]


def test_a_sweep_is_not_explained(trials: Started) -> None:
    code = run_trials(
        ["--run", "true", "--why", "--vary", "u1.bias=0,6", "--out", str(trials.folder / "out")]
    )
    assert code == 2
    assert trials.printed().startswith("simmer-tui trials: --why is for one program as it is")


@pytest.mark.parametrize(
    "option", [("--why",), pytest.param(("--sure", "0.9", "--require", "0.5"), marks=pytest.mark.slow)]
)
def test_a_sweep_is_refused_before_its_runs_go_on(trials: Started, option: tuple[str, ...]) -> None:
    out = ("--out", str(trials.folder / "out"))
    trials.begin("--vary", "u1.bias=0,6")
    assert run_trials(["--resume", "--runs", "3", *option, *out]) == 2
    assert f"simmer-tui trials: {option[0]} is for one program as it is" in trials.printed()
    assert len(trials.programs) == 4, "no run was added"


# -- the changes -----------------------------------------------------------------------------------


@pytest.fixture
def mission() -> Configuration:
    return load(bundled_sets()["mission"])


def by_change(found: list[Intervention]) -> dict[str, Intervention]:
    return {each.change: each for each in found}


def test_each_intervention_changes_one_thing(mission: Configuration) -> None:
    found = by_change(interventions(mission, read={"ultra1", "gyro1"}))
    assert list(found) == [
        UNCHANGED,
        "true readings of u1",
        "true readings of g1",
        "true readings of all sensors",
        "no noise of the drives",
        "no bias of the drives",
        "exact drives",
        "exact sensors and drives",
        "no link delay",
        "no time for readings and link",
        "the start pose known",
    ]
    old, new = mission.simulation, found["true readings of u1"].configuration.simulation
    assert [each for each in new.sensors if each not in old.sensors] == [replace(old.sensors[0], error=0.0)]
    assert replace(new, sensors=old.sensors) == old
    quiet = found["no noise of the drives"].configuration.simulation
    assert quiet.randbias
    assert all(each.error == Axes() for each in quiet.drives)
    fair = found["no bias of the drives"].configuration.simulation
    assert not fair.randbias
    assert [each.error for each in fair.drives] == [each.error for each in old.drives]
    fast = found["no time for readings and link"].configuration.simulation
    assert all(each.read_time == 0.0 for each in fast.sensors)


def test_true_readings_have_no_error_of_any_column(mission: Configuration) -> None:
    """A kind of sensor with an error column of its own included: the columns say which are errors."""

    class OdourSpec(SensorSpec, frozen=True, kw_only=True):
        wind: float = 0.5

    class Odour(ObservingSensor):
        name = "odour"
        spec_type = OdourSpec
        columns = (
            columns.BIAS,
            columns.GAIN,
            CsvColumn(NumberRule(), name="Wind", field="wind", is_error=True),
        )

    faults = {"error": 0.1, "absolute_error": 0.2, "bias": 1.0, "drift": 0.1, "dropout": 0.1, "outlier": 0.1}
    u1 = replace(mission.simulation.sensors[0], **faults, cross_talk=0.5)
    compass = next(each for each in mission.simulation.sensors if each.kind.has("hard_iron"))
    compass = replace(compass, hard_iron=4.0, soft_iron=2.0)
    gyro = next(each for each in mission.simulation.sensors if each.kind.has("random_walk"))
    odour = OdourSpec(kind=Odour, number=1, code="o1", bias=2.0, gain=1.0)
    sensors = (u1, compass, replace(gyro, random_walk=0.3), odour)
    faulty = replace(mission, simulation=replace(mission.simulation, sensors=sensors))
    exact = by_change(interventions(faulty))["true readings of all sensors"].configuration.simulation.sensors
    assert exact[0] == replace(u1, **dict.fromkeys((*faults, "cross_talk"), 0.0))
    assert (exact[1].hard_iron, exact[1].soft_iron, exact[2].random_walk) == (0.0, 0.0, 0.0)
    assert exact[3] == replace(odour, bias=0.0, wind=0.0)


def test_sensors_and_drives_become_those_of_the_nominal_set(mission: Configuration) -> None:
    nominal = nominal_of(mission)
    old = mission.simulation
    u2, u4 = old.sensors[1], old.sensors[3]
    swapped = [*old.sensors]
    swapped[1], swapped[3] = replace(u2, code="u4"), replace(u4, code="u2")
    turned = [replace(each, gain=-1.0) if each.kind.turns else each for each in old.drives]
    faulty = replace(mission, simulation=replace(old, sensors=tuple(swapped), drives=tuple(turned)))
    found = by_change(interventions(faulty, nominal, read={"ultra2", "ultra4"}, suspects=("u2", "u4")))
    assert "true readings of all sensors" not in found, "it would be the same as of both"
    made = found["true readings of u2 and u4"]
    places = {each.code: each.rotation for each in made.configuration.simulation.sensors}
    assert (places["u2"], places["u4"]) == (u2.rotation, u4.rotation)
    drives = found["no bias of the drives"].configuration.simulation.drives
    assert all(each.gain == 1.0 for each in drives)


# -- what they say ---------------------------------------------------------------------------------

CHANGES = {
    UNCHANGED: (ChangedPart.NOTHING, ()),
    "true readings of u1": (ChangedPart.SENSOR, ("u1",)),
    "true readings of u2": (ChangedPart.SENSOR, ("u2",)),
    "true readings of all sensors": (ChangedPart.SENSORS, ("u1", "u2")),
    "no noise of the drives": (ChangedPart.NOISE, ()),
    "exact drives": (ChangedPart.DRIVES, ()),
}


def changed(*saving: str, by_chance: int = 0) -> list[ChangedRun]:
    """Runs with each change, and ten with other errors: so many succeed unchanged, all with what saved it."""
    own = [
        ChangedRun(run=7, change=name, part=part, codes=codes, succeeded=name in saving, text="")
        for name, (part, codes) in CHANGES.items()
    ]
    return own + [
        structs.replace(each, repeat=repeat, succeeded=each.succeeded or repeat <= by_chance)
        for each in own
        if each.succeeded or each.change == UNCHANGED
        for repeat in range(1, 11)
    ]


SURE = "ith other random errors 10 of 10 runs succeed, unchanged 0 of 10 (p = "


@pytest.mark.parametrize(
    ("saving", "text", "confirmed"),
    [
        ((), "fails with each of 5 changes. The likely cause is the program itself.", False),
        (
            ("true readings of u1", "true readings of all sensors"),
            f"succeeds with true readings of u1. The likely cause is the sensor. W{SURE}0.002).",
            True,
        ),
        (
            ("true readings of u2",),
            f"succeeds with true readings of u2. The likely cause is the sensor. W{SURE}0.002).",
            False,
        ),
        (
            ("no noise of the drives", "exact drives"),
            f"succeeds with no noise of the drives. The likely cause is drive noise. W{SURE}0.002).",
            False,
        ),
        (
            ("true readings of u1", "no noise of the drives"),
            "succeeds with true readings of u1 or no noise of the drives. These cannot be distinguished. "
            f"True readings of u1: w{SURE}0.0039). No noise of the drives: w{SURE}0.0039).",
            None,
        ),
        ((UNCHANGED,), "succeeds when repeated unchanged: the program does not repeat exactly.", None),
    ],
)
def test_what_saves_a_run_confirms_its_verdict_or_not(
    made_result: Callable[..., TrialResult], saving: tuple[str, ...], text: str, confirmed: bool | None
) -> None:
    cause = {"kind": "sensor wrong", "sure": "likely", "culprits": ["u1"]}
    result = made_result(7, 1, success=False, verdict={"cause": cause})
    told = explained(result, changed(*saving))
    assert (told.text, told.confirmed, told.suspected) == (f"Run 7 {text}", confirmed, "sensor wrong")


def test_what_succeeds_as_often_unchanged_saved_a_run_perhaps_by_chance(
    made_result: Callable[..., TrialResult],
) -> None:
    cause = {"kind": "sensor wrong", "sure": "likely", "culprits": ["u1"]}
    result = made_result(7, 1, success=False, verdict={"cause": cause})
    told = explained(result, changed("true readings of u1", by_chance=6))
    assert told.text == (
        "Run 7 succeeds with true readings of u1, perhaps by chance. "
        "With other random errors 10 of 10 runs succeed, unchanged 6 of 10 (p = 0.12)."
    )
    assert told.confirmed is None
    [control] = told.controls
    assert (control.successes, control.unchanged, control.is_sure) == (10, 6, False)


def test_a_run_that_was_not_repeated_says_so(made_result: Callable[..., TrialResult]) -> None:
    result = made_result(7, 1, success=False, verdict={"cause": {"kind": "sensor wrong", "sure": "likely"}})
    own = [each for each in changed("true readings of u1") if not each.repeat]
    told = explained(result, own)
    assert told.text == (
        "Run 7 succeeds with true readings of u1. That has not been repeated yet and may be chance."
    )
    assert told.confirmed is None


def test_other_errors_keep_the_mission(mission: Configuration) -> None:
    own = Trial(
        number=1, seed=5, configuration=mission, maze="", command="x", fixed_ports=False, time_limit=9.0
    )
    (first, plan), (second, same_plan) = prepare(own), prepare(dataclasses.replace(own, errors_seed=8))
    assert plan == same_plan
    assert (first.settings.seed, second.settings.seed) == (5, 8)
    assert structs.replace(second.settings, seed=5) == first.settings


def test_a_certain_verdict_needs_no_confirmation(made_result: Callable[..., TrialResult]) -> None:
    cause = {"kind": "drive error", "sure": "certain", "culprits": []}
    result = made_result(7, 1, success=False, verdict={"cause": cause})
    told = explained(result, changed("no noise of the drives"))
    assert (told.suspected, told.confirmed) == ("", None)


# -- one change more -------------------------------------------------------------------------------


def test_noise_and_bias_are_told_from_the_gain_of_a_sensor(mission: Configuration) -> None:
    u1, *rest = mission.simulation.sensors
    wrong = replace(u1, gain=1.3, bias=2.0)
    faulty = replace(mission, simulation=replace(mission.simulation, sensors=(wrong, *rest)))
    found = by_change(interventions(faulty, nominal_of(mission), read={u1.id, rest[0].id}))
    without = found["no noise and bias of u1"].configuration.simulation.sensors[0]
    assert without == replace(wrong, error=0.0, bias=0.0)
    assert found["true readings of u1"].configuration.simulation.sensors[0] == replace(u1, error=0.0)
    assert f"no noise and bias of {rest[0].code}" not in found, "its true readings are the same"


def test_more_time_is_given_to_a_run_that_had_too_little(mission: Configuration) -> None:
    assert mission.mission is not None
    assert "twice the time" not in by_change(interventions(mission))
    longer = by_change(interventions(mission, time_was_up=True))["twice the time"].configuration
    assert longer.simulation == mission.simulation
    assert longer.mission == replace(mission.mission, time_limit=2 * mission.mission.time_limit)


def test_a_start_pose_is_given_with_the_same_mission(mission: Configuration) -> None:
    change = by_change(interventions(mission))["the start pose known"]
    trial = Trial(
        number=1, seed=5, configuration=mission, maze="", command="", fixed_ports=False, time_limit=1.0
    )
    _, plan = prepare(trial)
    _, given = prepare(dataclasses.replace(trial, tells_start=change.tells_start))
    assert plan is not None
    assert given == replace(plan, start_known=True)
    spec = mission.mission
    assert spec is not None
    known = replace(mission, mission=replace(spec, start=(9.0, 42.0), heading=90.0))
    assert "the start pose known" not in by_change(interventions(known)), "it is known already"


@pytest.mark.parametrize(
    ("first", "second", "more", "decided"),
    [(0, 9, 1, True), (0, 8, 2, False), (1, 3, 3, True), (1, 3, 6, False), (0, 0, 5, True), (0, 0, 6, False)],
)
def test_repeats_end_when_the_rest_cannot_change_the_answer(
    first: int, second: int, more: int, decided: bool
) -> None:
    control = ChanceControl("true readings of u1", PairCounts(0, first, second, 1), 1)
    assert control.is_decided(more) is decided


def test_noise_that_saves_a_run_by_chance_does_not_hide_its_sensor(
    made_result: Callable[..., TrialResult],
) -> None:
    """Noise and bias are a part of true readings: which of the two saves it is known after the repeats."""

    def told(noisy: int) -> str:
        runs = changed("true readings of u1")
        saved = {"part": ChangedPart.SENSOR_ERRORS, "codes": ("u1",), "change": "no noise and bias of u1"}
        own = [each for each in runs if each.change == "true readings of u1"]
        more = [structs.replace(each, **saved, succeeded=each.repeat <= noisy) for each in own]
        return explained(made_result(7, 1, success=False), [*runs, *more]).text

    assert told(0).startswith("Run 7 succeeds with true readings of u1. The likely cause is the sensor.")
    both = told(10)
    assert both.startswith(
        "Run 7 succeeds with no noise and bias of u1. The likely cause is the noise and bias"
    )
