"""The whole report of a robot that calibration was not tuned to, as it was kept, and what checks, sessions
and predictions make of a fit."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs
from scipy import stats

from benchmarks.emulated_robots import draw_robot, placed, record, set_with, wandering
from simmer_tui.calibrate import change_detection
from simmer_tui.calibrate.change_detection import judged, require_one_robot
from simmer_tui.calibrate.effects import SHORTFALL
from simmer_tui.calibrate.estimates import estimates_of
from simmer_tui.calibrate.fit import Fit, Progress
from simmer_tui.calibrate.guided import WANTED, SessionPlanner, drive_guided, guided_run, where_to_put
from simmer_tui.calibrate.measured_run import MeasuredRun, read_runs
from simmer_tui.calibrate.model_check import Misfit
from simmer_tui.calibrate.parameters import main_axis
from simmer_tui.calibrate.prediction import HeldBack, widened
from simmer_tui.calibrate.result_page import result_page
from simmer_tui.calibrate.written_set import knowledge_of, read_knowledge
from simmer_tui.cli.main import main
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.document.as_html import html_page
from simmer_tui.errors import CalibrationError
from simmer_tui.sim.sensors import ParameterKind, Ultrasonic
from simmer_tui.sim.specs import DriveSpec
from tests.calibrate.conftest import CODES
from tests.kept_numbers import assert_kept

KEPT = Path(__file__).with_name("kept_reports.json")
ALL_CODES = (*CODES, "u5", "t1")


def log_of(folder: Path, seed: int, movements: int) -> str:
    """The name of the log of a drawn robot, all of whose sensors are read at each stop."""
    random = np.random.default_rng(seed)
    configured, hidden = placed(load(bundled_folder()).simulation, random)
    program = wandering(movements, seed, ALL_CODES)
    name = f"{seed}.jsonl"
    record(folder / name, set_with(configured), draw_robot(random, hidden), seed, program, latency=0.03)
    return name


def said_by(*arguments: str) -> tuple[int, list[str]]:
    """Exit code and output of a command, line by line."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        code = main(["calibrate", *arguments])
    return code, [line.rstrip() for line in out.getvalue().splitlines()]


def words(page: str) -> list[str]:
    """Texts of a page, without its style, its scripts and pictures."""
    bare = re.sub(r"(?s)<(style|script|head|svg)\b.*?</\1>", "", page)
    return [text for text in map(str.strip, re.split(r"<[^>]*>", bare)) if text]


@pytest.mark.slow  # a shorter log takes no less; test_learning.py keeps a report of another robot
def test_a_report_of_an_unknown_robot_is_that_which_was_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, lines = said_by(log_of(tmp_path, 909, 12), "--out", "made")
    assert code == 0
    made = tmp_path / "made"
    files = {name: (made / name).read_text("utf-8").splitlines() for name in ("drive.csv", "sensors.csv")}
    settings = (made / "settings.toml").read_text("utf-8").splitlines()
    assert settings[settings.index("randbias = false") - 1] == (
        "# calibrated from 909.jsonl: the biases of drive.csv are this robot's own."
    )
    assert {"sim = true", 'nominal = ""', "realistic = false", 'drive_profile = ""'} <= set(settings)
    knowledge = json.loads((made / "calibration.json").read_text("utf-8"))
    variances = np.diag(knowledge.pop("covariance"))
    found = {
        "answer": lines,
        "files": files,
        "knowledge": knowledge,
        "variances": variances,
        "page": words((made / "calibration.html").read_text("utf-8")),
    }
    assert str(tmp_path) not in str(found)
    assert_kept(found, KEPT, "calibrated")


def test_a_report_without_changes_and_predictions_is_that_which_was_kept(found: Fit) -> None:
    """Of a robot that the model does not fit, from logs and a set with long names, cut at 200 and 400."""
    misfit = Misfit(SHORTFALL.name, "up", 0.2, 0.1, 0.3, "in", 2e-4, SHORTFALL.phrase)
    configuration = structs.replace(found.run.configuration, name="s" * 390)
    run = replace(found.run, names=("n" * 150, "m" * 150), configuration=configuration)
    fit = replace(found, run=run, misfits=(misfit,))
    same = replace(estimates_of(found)[0], value=0.5, low=0.0, high=1.0, present=0.5)
    assert_kept(words(html_page(result_page(fit, [same], None))), KEPT, "unchanged")
    many = [replace(same, label=f"bias {number}", present=2.0) for number in range(11)]
    for count, notes in ((10, []), (11, ["1 more, under All parameters."])):
        page = words(html_page(result_page(fit, many[:count], None)))
        assert [each for each in page if "more, under" in each] == notes


# -- logs of one robot ---------------------------------------------------------------------------------


def with_offsets_of_the_set(found: Fit) -> Fit:
    """The fit of the robot as the written set has it: sensors are where they were found."""
    offsets = [each.kind is ParameterKind.OFFSET for each in found.space.parameters]
    parameters = np.where(offsets, 0.0, found.state.parameters)
    return replace(found, state=replace(found.state, parameters=parameters))


@pytest.mark.parametrize(("factor", "refused"), [(0.99, False), (1.01, True)])
def test_logs_are_of_two_robots_if_chance_has_less_than_one_in_a_thousand(
    found: Fit, monkeypatch: pytest.MonkeyPatch, factor: float, refused: bool
) -> None:
    """The longest run is fitted first, by the wide priors; the others by those of a known robot."""
    same = with_offsets_of_the_set(found)
    column = found.space.column(False, 0, "bias")

    def off_by(amount: float) -> Fit:
        parameters = same.state.parameters.copy()
        parameters[column] += amount
        return replace(same, state=replace(same.state, parameters=parameters))

    knowledge = knowledge_of(found, estimates_of(found))
    parts = {each.owner: each for each in judged(off_by(0.1), knowledge)}
    freedom = len(parts["ultra1"].figures)
    size = stats.chi2.isf(parts["ultra1"].probability, freedom) / 0.1**2
    limit = np.sqrt(stats.chi2.isf(0.001 / len(parts), freedom) / size)
    long = found.run
    short = replace(long.before_stop(20), names=("short",))
    lost = replace(long.before_stop(10), names=("lost",))
    asked: list[tuple[str, int, float]] = []

    def fit(
        run: MeasuredRun, *, seed: int = 0, prior_scale: float = 1.0, progress: Progress | None = None
    ) -> Fit:
        asked.append((run.names[0], seed, prior_scale))
        if run.names == lost.names:
            raise CalibrationError("no path")
        return found if run.names == long.names else off_by(factor * limit)

    monkeypatch.setattr(change_detection, "fit", fit)
    said = ""
    try:
        require_one_robot([lost, long, short], 5)
    except CalibrationError as error:
        said = str(error)
    assert asked == [(long.names[0], 5, 1.0), ("lost", 0, 0.3), ("short", 0, 0.3)]
    expected = (
        f"short is of another robot than {long.names[0]}, or the robot has changed in between: ultra1 "
        "differ; calibrate each by itself"
    )
    assert said == (expected if refused else "")


def test_a_check_takes_the_maze_from_the_log_and_the_robot_from_the_set(
    found: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = found.run.configuration
    there = structs.replace(
        here.simulation,
        drives=tuple(structs.replace(each, speed=9.0) for each in here.simulation.drives),
        bot_rot=77.0,
        randbias=True,
    )
    seen: list[MeasuredRun] = []

    def fit(run: MeasuredRun, **_: object) -> Fit:
        seen.append(run)
        return found

    monkeypatch.setattr(change_detection, "fit", fit)
    knowledge = knowledge_of(found, estimates_of(found))
    change_detection.check_robot(found.run, structs.replace(here, simulation=there), knowledge)
    (run,) = seen
    assert run.spec == structs.replace(here.simulation, drives=there.drives, randbias=False)
    fewer = structs.replace(there, drives=there.drives[1:])
    with pytest.raises(CalibrationError, match=r"the log's drives \(w1, s1, a1, d1, r1\) are not those of"):
        change_detection.check_robot(found.run, structs.replace(here, simulation=fewer), knowledge)


KNOWN = {"parameters": ["up x-axis bias"], "values": [0.1], "covariance": [[0.01]]}


@pytest.mark.parametrize(
    "changed",
    [
        {"values": []}, {"values": [0.1, 0.2]}, {"covariance": []}, {"covariance": [[]]},
        {"covariance": [[0.01, 0.0]]}, {"parameters": []},
    ],
)  # fmt: skip
def test_what_was_learned_is_read_if_its_parts_fit(tmp_path: Path, changed: dict[str, object]) -> None:
    path = tmp_path / "calibration.json"
    with pytest.raises(CalibrationError) as refusal:
        read_knowledge(tmp_path)
    assert str(refusal.value) == (
        f"{path} cannot be read (No such file or directory); --check takes a set that simmer-tui calibrate "
        "wrote"
    )
    path.write_text(json.dumps(KNOWN))
    found = read_knowledge(tmp_path)
    assert (found.parameters, found.values, found.covariance) == (("up x-axis bias",), (0.1,), ((0.01,),))
    path.write_text(json.dumps({**KNOWN, **changed}))
    with pytest.raises(CalibrationError) as refusal:
        read_knowledge(tmp_path)
    assert str(refusal.value) == f"{path} is damaged: its parts are of different sizes"


# -- a guided session that has estimates ---------------------------------------------------------------


def test_a_session_with_estimates_asks_for_what_was_kept(found: Fit) -> None:
    guide = SessionPlanner(found.run.configuration, np.random.default_rng(3))
    for code in ("w1", "d1", "d1", "r1", "r1", "r1"):
        drive = next(each for each in guide.drives if each.code == code)
        guide.made(drive, 1.0, True)
        guide.settled()
    guide.learned(found)
    asked: list[tuple[str, float]] = []
    while len(asked) < 24 and (move := guide.next_move()) is not None:
        number = len(asked)
        asked.append((move[0].code, move[1]))
        guide.made(*move, number % 6 != 3)
        guide.seen("u1", 10.0 + number, 1.0 * number)
        guide.seen("u1", 12.0 + number, 1.0 * number)
        guide.settled()
    session = {
        "asked": asked,
        "stuck": guide.stuck,
        "pose": structs.astuple(guide.pose),
        "reached": guide.reached,
        "done": guide.done,
        "counts": dict(guide.counts),
        "where": where_to_put(guide),
        "spread": [chain.spread for chain in guided_run(found.run).chains],
    }
    assert_kept(session, KEPT, "session")


def test_a_session_ends_at_its_goals_or_its_last_movement(found: Fit) -> None:
    guide = SessionPlanner(found.run.configuration, np.random.default_rng(3), most=9)
    assert guide.reached == dict.fromkeys(WANTED, np.inf)
    assert not guide.done
    space, drives = found.space, found.run.spec.drives
    offsets = np.array([each.kind is ParameterKind.OFFSET for each in space.parameters])

    def done(told: bool = True, **spreads: float) -> bool:
        errors = np.full(len(space.parameters), 99.0)
        for number, each in enumerate(space.parameters):
            if each.drive and each.field == f"bias.{main_axis(drives[each.index].kind)}":
                errors[number] = spreads.get("main", 0.01)
            elif each.kind is ParameterKind.ANGLE:
                errors[number] = spreads.get("angle", 0.3)
            elif not each.drive and each.field == "bias" and each.unit == "in":
                errors[number] = spreads.get("range", 0.03)
        guide.fit = replace(found, standard_errors=errors, identified=~offsets if told else offsets)
        return guide.done

    assert done()
    assert guide.reached == {"main": 0.01, "angle": 0.3, "range": 0.03}
    assert not done(told=False)
    assert not done(main=0.0101)
    assert not done(angle=0.301)
    assert not done(range=0.0301)
    guide.count = 8
    assert not done(range=0.0301)
    guide.count = 9
    assert guide.done
    guide.fit = None
    assert guide.done


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("ends", ["done", "stuck"])
def test_a_session_shows_its_steps_until_it_ends(
    found: Fit, monkeypatch: pytest.MonkeyPatch, ends: str
) -> None:
    """A reading is asked for again until it is answered; estimates are made after 20 movements."""
    monkeypatch.setattr("simmer_tui.calibrate.guided._WAIT", 0.0)
    steps = iter(range(22))

    class Guide(SessionPlanner):
        def looks(self) -> list[str]:
            return ["u1"]

        def next_move(self) -> tuple[DriveSpec, float] | None:
            drive = next(each for each in self.drives if each.code == "r1")
            return (drive, 0.25) if next(steps, None) is not None else None

    guide = Guide(found.run.configuration, np.random.default_rng(1), most=21 if ends == "done" else 99)
    answers = iter([float("nan"), float("nan"), 9.0])
    shown: list[str] = []
    learned: list[int] = []

    async def ask(text: str) -> float:
        return next(answers, 9.0)

    async def learn() -> Fit | None:
        learned.append(guide.count)
        return None

    asyncio.run(drive_guided(ask, guide, learn, lambda: 1.0, shown.append))
    waits = ["the robot does not answer u1; waiting for it"] * 2
    moves = 21 if ends == "done" else 22
    turns = ["r1-0.25"] * moves
    assert shown == [*waits, *turns[:20], "estimating", *turns[20:]]
    assert learned == [20]
    assert guide.count == moves


# -- predictions ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("score", [1.2, 4.0])
def test_a_factor_below_one_narrows_nothing(found: Fit, score: float) -> None:
    """Nine in ten are right with this factor, but more are far off than chance allows."""
    scores = np.where(np.arange(100) < 80, score, 9.0)
    wide = widened(found, HeldBack(10, found, (), {Ultrasonic: np.where(scores < 9.0, score, 4.0)}))
    factor = wide.misfits[-1].value
    assert wide.noise_scale_errors == pytest.approx(max(factor, 1.0) * found.noise_scale_errors)
    assert wide.covariance == pytest.approx(max(factor, 1.0) ** 2 * found.covariance)


# -- reading logs --------------------------------------------------------------------------------------


def test_what_is_read_of_two_logs_is_that_which_was_kept(tmp_path: Path) -> None:
    """Of a log and the same with another start, in which some movements were not answered: one is followed by
    another movement, one by readings, one by the second log, and one is the last."""
    name = log_of(tmp_path, 101, 5)
    header, *lines = (tmp_path / name).read_text("utf-8").splitlines()
    answers = [number for number, line in enumerate(lines) if '"reply":"inf","status":"done"' in line]
    moves = [number for number, line in enumerate(lines) if '"kind":"plan"' in line]
    left_out = {answers[2], *range(answers[0], moves[1]), *range(answers[4], len(lines))}
    lines[answers[1]] = lines[answers[1]].replace('"status":"done"', '"status":"unanswered"')
    lines[answers[1]] = lines[answers[1]].replace('"reply":"inf"', '"reply":"nan"')
    kept = [line for number, line in enumerate(lines) if number not in left_out]
    paths = [tmp_path / "one.jsonl", tmp_path / "other.jsonl"]
    later = header.replace('"real":1800000000.0', '"real":1800000100.0').replace("08:00:00", "08:01:40")
    assert later != header
    for path, begin in zip(paths, (header, later), strict=True):
        path.write_text("\n".join([begin, *kept]) + "\n", "utf-8")
    run = read_runs(paths)
    assert [each.certain for each in run.movements] == [False, False, True, True, False] * 2
    found = {
        "movements": [(m.drive, m.value, m.line, m.took) for m in run.movements],
        "readings": {
            code: (each.stops, each.values, each.times, each.gaps) for code, each in run.readings.items()
        },
        "chains": [(structs.astuple(each.start), each.line, each.spread) for each in run.chains],
        "rest": (run.block_moved_at, run.simulated, len(run.notes)),
    }
    assert_kept(found, KEPT, "read")
