"""Estimates of `simmer-tui calibrate` for robots whose parameters are known here and hidden from it.

    python benchmarks/bench_calibrate.py [--quick] [--robots N] [--json FILE]
        [--parts learn,check,faults,guided,missions]

Each robot has parameters of its own, drawn about the default set, and is driven to and fro through the
course's maze by a program that polls all sensors after each of 400 movements (--movements). Every goal is
printed with the figure reached. --parts missions runs solve.py in the calibrated simulators and in the
hidden ones, 420 missions a side (about an hour of one core, 4 s a mission); with --keep FILE the robots that
another part has learned are taken from there.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from msgspec.structs import replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in simmer-tui calibrate, before numpy is imported
import numpy as np
from msgspec import structs

sys.path.insert(0, str(Path(__file__).resolve().parent))
from emulated_robots import Oddities, Session, draw_robot, placed, record, set_with, wandering

from simmer_tui.calibrate.change_detection import check_robot
from simmer_tui.calibrate.estimates import ParameterEstimate, estimates_of
from simmer_tui.calibrate.fit import Fit, fit
from simmer_tui.calibrate.guided import WANTED, SessionPlanner, drive_guided, guided_run
from simmer_tui.calibrate.measured_run import read_runs
from simmer_tui.calibrate.parameters import main_axis
from simmer_tui.calibrate.prediction import follow, held_back
from simmer_tui.calibrate.written_set import knowledge_of, learned_spec, write_texts
from simmer_tui.config.importer.set_writer import drive_csv_text, sensors_csv_text
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.errors import CalibrationError
from simmer_tui.sim.sensors import ParameterKind
from simmer_tui.sim.sensors.base import OFFSET
from simmer_tui.sim.specs import Axes, SensorSpec, SimulationSpec
from simmer_tui.trials.folder import TrialFolder

ROOT = Path(__file__).resolve().parent.parent
CODES = ("u1", "u2", "u3", "u4", "u5", "c1", "o1", "o2", "o3", "o4", "g1", "t1")
LATENCY = 0.01
WORST = 1.3
"""Greatest allowed errors of predictions of any robot, as multiples of those with the true set."""
DIRECTIONS = (ParameterKind.BIAS, ParameterKind.GAIN, ParameterKind.ANGLE, ParameterKind.DRIFT)


@dataclass
class Learned:
    """One robot: its true set, and the fit or the reason why there is none."""

    number: int
    configured: SimulationSpec
    hidden: SimulationSpec
    found: Fit | None = None
    estimates: tuple[ParameterEstimate, ...] = ()
    refused: str = ""
    seconds: float = 0.0
    commands: int = 0
    ratios: dict[tuple[str, int], float] = field(default_factory=dict)
    before: dict[tuple[str, int], float] = field(default_factory=dict)


@dataclass
class Goal:
    """A goal, and the figure reached."""

    name: str
    reached: str
    met: bool


class Report:
    def __init__(self) -> None:
        self.goals: list[Goal] = []

    def say(self, name: str, reached: str, met: bool) -> None:
        self.goals.append(Goal(name, reached, met))
        print(f"  {'met   ' if met else 'MISSED'} {name}: {reached}", flush=True)


def learn(
    number: int, movements: int, folder: Path, *, default: bool = False, oddities: Oddities | None = None
) -> Learned:
    """Draw a robot, drive it, learn it."""
    random = np.random.default_rng((7, number))
    base = load(bundled_folder()).simulation
    configured, hidden = placed(base, random)
    hidden = replace(hidden, randbias=False) if default else draw_robot(random, hidden)
    log = folder / f"robot{number}{'d' * default}.jsonl"
    robot = record(
        log,
        set_with(configured),
        hidden,
        number,
        wandering(movements, number, CODES),
        oddities=oddities,
        latency=LATENCY,
    )
    learned = Learned(number, configured, hidden, commands=robot.simulator.commands)
    begun = time.process_time()
    try:
        run = read_runs([log])
        learned.found = fit(run)
        held = held_back(learned.found)
    except CalibrationError as error:
        learned.refused = str(error)
        return learned
    learned.estimates = estimates_of(learned.found)
    learned.seconds = time.process_time() - begun
    if held is not None:
        early = held.learned
        last = early.run.stops - 1
        truth = follow(run, learned.found, last, *early.space.of(learned.hidden), early.state).errors
        for each in held.errors:
            best = float(np.median(truth.get((each.kind, each.ahead), 0.0)))
            if best > 0:
                learned.ratios[each.kind.name, each.ahead] = each.after / best
                learned.before[each.kind.name, each.ahead] = each.before / best
    return learned


def true_value(estimate: ParameterEstimate, hidden: SimulationSpec) -> float:
    """Value of an estimated parameter in the hidden set, in its unit."""
    if estimate.owner == "link":
        return LATENCY
    rows: dict[str, Any] = {each.kind.value: each for each in hidden.drives}
    rows |= {each.id: each for each in hidden.sensors}
    value: Any = rows[estimate.owner]
    # Its sensors are mounted where the set has them.
    if estimate.field == OFFSET:
        return 0.0
    for part in estimate.field.split("."):
        value = getattr(value, part)
    return float(value)


def coverage(robots: list[Learned], report: Report) -> None:
    """Report the shares of 95 % intervals that contain the truth."""
    hits: dict[str, list[bool]] = defaultdict(list)
    worst = 1.0
    for robot in robots:
        mine = []
        for each in robot.estimates:
            if not each.identified:
                continue
            held = each.low - 1e-12 <= true_value(each, robot.hidden) <= each.high + 1e-12
            sort = str(each.parameter.kind) if each.parameter is not None else each.label
            hits[sort].append(held)
            if each.parameter is not None:
                mine.append(held)
        worst = min(worst, float(np.mean(mine)))
    places = [hit for sort in DIRECTIONS for hit in hits[str(sort)]]
    sizes = hits[str(ParameterKind.NOISE)]
    for name, group in (("biases, gains, angles", places), ("error sizes", sizes)):
        share = float(np.mean(group))
        report.say(
            f"95 % intervals of {name} hold the truth in 90 to 99 %", f"{share:.1%}", 0.9 <= share <= 0.99
        )
    report.say("in every robot at least 75 %", f"least {worst:.1%}", worst >= 0.75)
    for sort, group in sorted(hits.items()):
        print(f"         {sort}: {np.mean(group):.1%} of {len(group)}")


def accuracy(robots: list[Learned], report: Report) -> None:
    """Report the errors of biases, and their standard errors beside the least possible ones."""
    near: list[bool] = []
    spreads: dict[str, list[float]] = defaultdict(list)
    for robot in robots:
        found = robot.found
        assert found is not None, "it was learned"
        counts = np.bincount([m.drive for m in found.run.movements], minlength=len(found.run.spec.drives))
        for index, parameter in enumerate(found.space.parameters):
            if parameter.kind is not ParameterKind.BIAS or not found.identified[index]:
                continue
            truth, value = parameter.value_in(robot.hidden), float(found.state.parameters[index])
            spread = float(found.standard_errors[index])
            near.append(abs(value - truth) <= max(0.1 * abs(truth), 2 * spread))
            if not parameter.drive:
                continue
            drive = robot.hidden.drives[parameter.index]
            axis = parameter.field[-1]
            if axis == main_axis(drive.kind):
                error = getattr(drive.error, axis)
                spreads["main"].append(spread / (error / np.sqrt(counts[parameter.index])))
            elif axis == "r":
                spreads["turn"].append(spread)
            elif not drive.kind.turns:
                spreads["other"].append(spread)
    share = float(np.mean(near))
    report.say("biases within 10 % or 2 standard errors: at least 93 %", f"{share:.1%}", share >= 0.93)
    for name, most, words in (
        ("main", 1.3, "main axis, times P / sqrt(n)"),
        ("other", 0.004, "other axis"),
        ("turn", 0.004, "degrees an inch"),
    ):
        middle = float(np.median(spreads[name]))
        report.say(f"median standard error, {words}: at most {most}", f"{middle:.4g}", middle <= most)


def predictions(robots: list[Learned], report: Report, what: str) -> None:
    """Report errors of predictions, compared with those of the true set."""
    keys = sorted({key for robot in robots for key in robot.ratios})
    middles, above = [], []
    for kind, ahead in keys:
        ratios = [robot.ratios[kind, ahead] for robot in robots if (kind, ahead) in robot.ratios]
        before = [robot.before[kind, ahead] for robot in robots if (kind, ahead) in robot.before]
        middle, most = float(np.median(ratios)), max(ratios)
        middles.append(middle)
        above += [
            f"robot {robot.number}: {kind} {ahead} ahead {robot.ratios[kind, ahead]:.2f}"
            for robot in robots
            if robot.ratios.get((kind, ahead), 0.0) > WORST
        ]
        print(
            f"         {kind} {ahead} ahead: median {middle:.3f}, largest {most:.3f} "
            f"(the set it began with: {np.median(before):.2f})"
        )
    report.say(
        f"{what}: median ratio of each kind at most 1.05", f"largest {max(middles):.3f}", max(middles) <= 1.05
    )
    report.say(f"{what}: no robot above {WORST}", ", ".join(above) or "none", not above)


def learn_part(options: argparse.Namespace, folder: Path, report: Report) -> list[Learned]:
    """Learn robots, and judge what was learned."""
    print(f"learn: {options.robots} robots, {options.movements} movements each")
    robots = []
    for number in range(options.robots):
        robots.append(learn(number, options.movements, folder))
        robot = robots[-1]
        print(f"  robot {number}: {robot.refused or f'{robot.seconds:.1f} s'}", flush=True)
    refused = [robot for robot in robots if robot.refused]
    most = max(1, options.robots // 30)
    report.say("at most 1 log in 30 refused", f"{len(refused)} of {len(robots)}", len(refused) <= most)
    good = [robot for robot in robots if robot.found is not None]
    coverage(good, report)
    accuracy(good, report)
    predictions(good, report, "drawn robots")
    rate = max(robot.seconds / robot.commands for robot in good) * 5000
    report.say(
        "a log of 5,000 commands in at most 20 s",
        f"{rate:.1f} s of one core, held-back readings included",
        rate <= 20,
    )
    defaults = [
        learn(number, options.movements, folder, default=True)
        for number in range(max(options.robots // 5, 1))
    ]
    predictions([each for each in defaults if each.found is not None], report, "the default set's robot")
    return robots


CHANGES = ("main", "turn", "rot", "angle", "range bias", "range gain", "encoder", "gyro", "compass")


def change(spec: SimulationSpec, what: str, random: np.random.Generator) -> tuple[SimulationSpec, str]:
    """A robot of which one part has changed, and the part's ID."""
    sign = float(random.choice((-1, 1)))
    if what in ("main", "turn", "rot"):
        kinds = [k for k, d in enumerate(spec.drives) if d.kind.turns == (what == "rot")]
        index = int(random.choice(kinds))
        drive = spec.drives[index]
        axis = "r" if what != "main" else main_axis(drive.kind)
        amount = {"main": 0.07, "turn": 0.3, "rot": 0.03}[what]
        bias: Axes = structs.replace(drive.bias, **{axis: getattr(drive.bias, axis) + sign * amount})
        drives = list(spec.drives)
        drives[index] = replace(drive, bias=bias)
        return replace(spec, drives=tuple(drives)), drive.kind.value
    prefix = {"encoder": ("odom",), "gyro": ("gyro",), "compass": ("comp",)}.get(what, ("ultra", "tof"))
    index = int(random.choice([k for k, s in enumerate(spec.sensors) if s.kind.name in prefix]))
    sensor = spec.sensors[index]
    changed: SensorSpec
    match what:
        case "angle":
            changed = replace(sensor, rotation=sensor.rotation + sign * 5.0)
        case "range bias":
            changed = replace(sensor, bias=sensor.bias + sign * 0.5)
        case "range gain":
            changed = replace(sensor, gain=sensor.gain * (1 + sign * 0.05))
        case "compass":
            changed = replace(sensor, bias=sensor.bias + sign * 6.0)
        case _:
            changed = replace(sensor, gain=sensor.gain * (1 + sign * 0.03))
    sensors = list(spec.sensors)
    sensors[index] = changed
    return replace(spec, sensors=tuple(sensors)), sensor.id


def check_part(options: argparse.Namespace, folder: Path, report: Report, robots: list[Learned]) -> None:
    """Check unchanged robots twice each, and changed ones."""
    good = [robot for robot in robots if robot.found is not None]
    alarms, unchanged, right, refused = 0, 0, [], 0
    by_change: dict[str, list[bool]] = defaultdict(list)
    for robot in good:
        assert robot.found is not None, "it was learned"
        knowledge = knowledge_of(robot.found, robot.estimates)
        spec = learned_spec(robot.found.run.spec, robot.estimates)
        configuration = replace(robot.found.run.configuration, simulation=spec)
        random = np.random.default_rng((11, robot.number))
        jobs = [("", robot.hidden, "")] * 2
        for k in (0, 1, 2):
            what = CHANGES[(3 * robot.number + k) % len(CHANGES)]
            jobs.append((what, *change(robot.hidden, what, random)))
        for k, (what, hidden, part) in enumerate(jobs):
            configured, hidden = placed(hidden, random)
            log = folder / f"check{robot.number}_{k}.jsonl"
            seed = 1000 + 10 * robot.number + k
            record(log, set_with(configured), hidden, seed, wandering(100, seed, CODES), latency=LATENCY)
            try:
                parts = check_robot(read_runs([log]), configuration, knowledge)
            except CalibrationError as error:
                refused += 1
                print(f"  robot {robot.number} {what}: {error}")
                if what:
                    right.append(False)
                    by_change[what].append(False)
                continue
            named = [each.owner for each in parts if each.changed]
            if what:
                by_change[what].append(named[:1] == [part])
                right.append(named[:1] == [part])
                if named != [part]:
                    print(f"  robot {robot.number}: {what} of {part}, named {named}", flush=True)
            else:
                unchanged += 1
                alarms += bool(named)
                if named:
                    print(f"  robot {robot.number}: unchanged, named {named}", flush=True)
    for what, group in by_change.items():
        print(f"         {what}: {sum(group)} of {len(group)}")
    share = float(np.mean(right))
    report.say("the changed part named right in at least 90 %", f"{share:.1%} of {len(right)}", share >= 0.9)
    report.say(
        "false alarms in at most 6 of 60 unchanged robots",
        f"{alarms} of {unchanged}",
        alarms <= unchanged / 10,
    )
    if refused:
        print(f"         {refused} logs refused")


def faults_part(options: argparse.Namespace, folder: Path, report: Report) -> None:
    """Learn robots with faults that are not in the model."""
    for name, oddities in (
        ("wheels lose 5 % on every other cell", Oddities(slip=0.05)),
        ("2 % of ranges are the reading before", Oddities(stale=0.02)),
        ("both", Oddities(slip=0.05, stale=0.02)),
    ):
        sub = folder / name.replace(" ", "_").replace("%", "percent")
        sub.mkdir()
        robots = [
            learn(number, options.movements, sub, oddities=oddities) for number in range(options.faulty)
        ]
        print(f"faults: {name}: {sum(bool(r.refused) for r in robots)} of {len(robots)} refused")
        good = [robot for robot in robots if robot.found is not None]
        if good:
            seen = Report()
            coverage(good, seen)
            predictions(good, seen, name)


def guided_part(options: argparse.Namespace, folder: Path, report: Report) -> None:
    """Guided sessions, with a robot that a person has placed exactly."""
    counts, contacts, told, held = [], 0, [], []
    reached: dict[str, list[float]] = defaultdict(list)
    for number in range(options.guided):
        random = np.random.default_rng((13, number))
        configured, hidden = placed(load(bundled_folder()).simulation, random)
        x, y = np.array(configured.bot_center) + random.uniform(-0.25, 0.25, 2)
        heading = configured.bot_rot + float(np.clip(random.normal(0.0, 1.0), -2.0, 2.0))
        hidden = draw_robot(random, replace(hidden, bot_center=(float(x), float(y)), bot_rot=heading))
        configuration = set_with(configured)
        guide = SessionPlanner(configuration, random)
        log = folder / f"guided{number}.jsonl"

        async def program(session: Session, guide: SessionPlanner = guide, log: Path = log) -> None:
            async def learn_so_far() -> Fit | None:
                try:
                    return fit(guided_run(read_runs([log])))
                except CalibrationError:
                    return None

            await drive_guided(session.ask, guide, learn_so_far, session.robot.clock)

        robot = record(log, configuration, hidden, number, program, latency=LATENCY)
        contacts += robot.simulator.contacts
        counts.append(guide.count)
        found = guide.fit
        told.append(found is not None and bool(found.identified.all()))
        for name, value in guide.reached.items():
            reached[name].append(value)
        if found is not None:
            truth, _ = found.space.of(hidden)
            off = np.abs(found.state.parameters - truth) / found.standard_errors
            held += (off[found.identified] < 1.96).tolist()
        figures = ", ".join(f"{name} {value:.3g}" for name, value in guide.reached.items())
        print(f"  session {number}: {guide.count} movements, {figures} {guide.stuck}", flush=True)
    report.say("guided: at most 150 movements", f"{min(counts)} to {max(counts)}", max(counts) <= 150)
    report.say("guided: every part told", f"{sum(told)} of {len(told)}", all(told))
    for name, most in WANTED.items():
        middle = float(np.median(reached[name]))
        report.say(f"guided: median standard error, {name}: at most {most}", f"{middle:.4g}", middle <= most)
    report.say("guided: no wall is touched", f"{contacts} contacts", contacts == 0)
    print(f"         intervals hold the truth: {np.mean(held):.1%} of {len(held)}")


def missions_part(options: argparse.Namespace, folder: Path, report: Report, robots: list[Learned]) -> None:
    """solve.py, which knows the bundled mission's set, in hidden simulators and in calibrated ones."""
    wins: dict[str, list[bool]] = {"hidden": [], "calibrated": []}
    for robot in robots:
        if robot.found is None:
            continue
        calibrated = learned_spec(robot.found.run.spec, robot.estimates)
        for name, like in (("hidden", robot.hidden), ("calibrated", calibrated)):
            place, out = folder / f"set{robot.number}_{name}", folder / f"runs{robot.number}_{name}"
            write_mission_set(place, like)
            command = [
                *(sys.executable, "-m", "simmer_tui", "trials"),
                *("--run", f"{sys.executable} {ROOT / 'scripts' / 'solve.py'}", "--config", str(place)),
                *("--runs", str(options.missions), "--jobs", "1"),
                *("--seed", str(robot.number), "--out", str(out)),
            ]
            done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
            if not (out / "trials.csv").is_file():
                raise RuntimeError(f"trials failed: {done.stderr}")
            wins[name] += [each.success for each in TrialFolder.read(out).done]
        so_far = ", ".join(f"{name} {np.mean(each):.1%}" for name, each in wins.items())
        print(f"  robot {robot.number}: {so_far} of {len(wins['hidden'])} so far", flush=True)
    rates = {name: float(np.mean(each)) for name, each in wins.items()}
    apart = abs(rates["hidden"] - rates["calibrated"])
    report.say(
        "solve.py succeeds as often in calibrated simulators as in hidden ones, within 10 points",
        f"hidden {rates['hidden']:.1%}, calibrated {rates['calibrated']:.1%} of {len(wins['hidden'])} each",
        apart <= 0.10,
    )


def write_mission_set(place: Path, like: SimulationSpec) -> None:
    """The bundled mission with a robot's own drives and sensors."""
    mission = load(bundled_folder() / "mission")
    sensors = {each.id: each for each in like.sensors}
    drives = {each.kind: each for each in like.drives}
    spec = mission.simulation
    texts = dict(mission.files)
    texts["sensors.csv"] = sensors_csv_text(tuple(sensors.get(each.id, each) for each in spec.sensors))
    texts["drive.csv"] = drive_csv_text(tuple(drives[each.kind] for each in spec.drives), spec.gripper)
    assert "randbias = true" in texts["settings.toml"], "biases are drawn there"
    texts["settings.toml"] = texts["settings.toml"].replace("randbias = true", "randbias = false")
    write_texts(texts, place)


def main() -> int:
    """Run the parts asked for; returns 1 if a goal was missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--quick", action="store_true", help="2 robots with 150 movements")
    parser.add_argument("--robots", type=int, default=30)
    parser.add_argument("--movements", type=int, default=400)
    parser.add_argument("--faulty", type=int, default=6, help="robots with each fault")
    parser.add_argument("--guided", type=int, default=10, help="guided sessions")
    parser.add_argument("--missions", type=int, default=14, help="missions a robot and side")
    parser.add_argument("--parts", default="learn,check,faults,guided")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--keep", type=Path, help="keep what was learned in this file, or take it from there")
    options = parser.parse_args()
    if options.quick:
        options.robots, options.movements, options.faulty, options.guided = 2, 150, 1, 1
    parts = options.parts.split(",")
    report = Report()
    folder = Path(tempfile.mkdtemp(prefix="calibrate-"))
    try:
        robots: list[Learned] = []
        if options.keep is not None and options.keep.exists():
            robots = pickle.loads(options.keep.read_bytes())
        elif {"learn", "check", "missions"} & set(parts):
            robots = learn_part(options, folder, report)
            if options.keep is not None:
                options.keep.write_bytes(pickle.dumps(robots))
        if "check" in parts:
            check_part(options, folder, report, robots)
        if "faults" in parts:
            faults_part(options, folder, report)
        if "guided" in parts:
            guided_part(options, folder, report)
        if "missions" in parts:
            missions_part(options, folder, report, robots)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    if options.json is not None:
        options.json.write_text(json.dumps([vars(goal) for goal in report.goals], indent=1))
    return 0 if all(goal.met for goal in report.goals) else 1


if __name__ == "__main__":
    sys.exit(main())
