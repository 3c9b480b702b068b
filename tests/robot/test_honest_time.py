"""Time that reading and the link take: in instant motion and in timed, told, logged and run again."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from msgspec.structs import replace
from rich.console import Console

from simmer_tui.cli.log_reports import build_report
from simmer_tui.config.loader import Configuration, Override, load
from simmer_tui.config.sets import bundled_folder, init_set
from simmer_tui.document.as_terminal import print_document
from simmer_tui.report.content import report_document
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.link_delay import LinkDelay
from simmer_tui.robot.sessions import Session
from simmer_tui.run.events import Action, ActionName, CommandResult, Event, MovementEnded
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import State, checkpoint_of
from simmer_tui.runlog.reader import Logged, LogReader
from simmer_tui.runlog.rerun import Rerun
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator, parse_command
from simmer_tui.sim.command import Command
from tests.stepped_clock import Clock

READ = 0.06


@dataclass
class Run:
    """A run that is logged, on a clock."""

    clock: Clock
    log: Path
    configuration: Configuration
    events: list[Event] = field(default_factory=list)
    answers: list[tuple[float, CommandResult]] = field(default_factory=list)

    def __post_init__(self) -> None:
        settings = self.configuration.settings
        link, motion = settings.link, settings.motion
        self.simulator = Simulator(self.configuration.simulation, 3)
        self.engine = Engine(
            self.simulator,
            timed=motion.motion == "timed",
            time_scale=motion.time_scale,
            link=LinkDelay(link.latency, link.jitter, 3) if link.latency or link.jitter else None,
        )
        self.reducer = Reducer(checkpoint_of(self.simulator))
        self.engine.watch(self.reducer.apply)
        self.engine.watch(self.events.append)
        self.engine.watch(RunLog(self.log, self.configuration, self.simulator, clock=lambda: 0.0))
        self.engine.start(self.clock)
        self.began = self.clock.time()

    def session(self, *, answer_at_end: bool = True) -> Session:
        return self.engine.session(answer_at_end=answer_at_end)

    def send(self, session: Session, *texts: str, source: str = "client") -> None:
        for text in texts:
            command = parse_command(text, source)
            if text == "xx":
                command = Command(text, text, source=source, stops=True)
            session.submit(command, lambda outcome: self.answers.append((self.clock.time(), outcome)))

    @property
    def answered(self) -> list[tuple[float, str]]:
        return [(round(when - self.began, 6), outcome.command.text) for when, outcome in self.answers]

    @property
    def state(self) -> State:
        return self.reducer.at(self.engine.now())

    def again(self) -> int:
        """Run it again; how many commands came out the same, all of them."""
        with Rerun(self.log) as rerun:
            for _ in rerun.steps():
                pass
            assert rerun.difference is None, str(rerun.difference)
            return rerun.commands


def configured(tmp_path: Path, *, read_time: float = READ, **options: object) -> Configuration:
    """The default set with a Read Time for the ultrasonic sensors."""
    directory = tmp_path / "set"
    if not directory.exists():
        init_set(directory, bundled_folder())
        path = directory / "sensors.csv"
        header, *rows = path.read_text(encoding="utf-8").splitlines()
        ultra = [f"{row},{read_time if row.startswith('ultra') else ''}" for row in rows]
        path.write_text("\n".join([f"{header},Read Time (s)", *ultra]) + "\n", encoding="utf-8")
    overrides = {name.replace("__", "."): Override(name, value) for name, value in options.items()}
    return load(directory, overrides)


def test_without_any_of_it_nothing_changes(clock: Clock, tmp_path: Path) -> None:
    configuration = load(bundled_folder(), {})
    assert (configuration.settings.link.latency, configuration.settings.link.jitter) == (0.0, 0.0)
    run = Run(clock, tmp_path / "run", configuration)
    run.send(run.session(), "u1", "d1-3", "xx", "u1", "zz")
    for outcome in (outcome for _, outcome in run.answers):
        assert outcome.link == 0.0
        assert outcome.taken in (None, outcome.time) or outcome.trajectory is not None
    assert all(event.answers for event in run.events if isinstance(event, MovementEnded))
    assert not any("taken" in line or '"link":0.' in line for line in run.log.read_text().splitlines()[1:])
    assert run.state.spent.reading == run.state.spent.link == 0.0


def test_in_instant_motion_simulated_time_moves_on(clock: Clock, tmp_path: Path) -> None:
    run = Run(clock, tmp_path / "run", configured(tmp_path))
    run.send(run.session(), "u1", "o1", "u1")
    assert [round(outcome.time, 9) for _, outcome in run.answers] == [READ, READ, 2 * READ]
    assert [outcome.taken for _, outcome in run.answers] == [0.0, None, READ]
    assert run.state.spent.by_sensor == {"u1": 2 * READ}
    assert run.again() == 3


def test_the_link_takes_its_time_each_way(clock: Clock, tmp_path: Path) -> None:
    configuration = configured(tmp_path, link__latency=0.015)
    run = Run(clock, tmp_path / "run", configuration)
    session = run.session()
    run.send(session, "o1")
    outcome = run.answers[-1][1]
    assert (outcome.taken, outcome.time, outcome.link) == (0.015, 0.03, 0.03)
    run.send(session, "u1")
    outcome = run.answers[-1][1]
    assert outcome.time == pytest.approx(0.03 + 0.03 + READ)
    before = outcome.time
    run.send(session, "d1-3", "xx", "zz")
    ended = next(event for event in run.events if isinstance(event, MovementEnded))
    done, stopped, unknown = (outcome for _, outcome in run.answers[-3:])
    assert not ended.answers
    assert ended.trajectory.start_time == pytest.approx(before + 0.015)
    assert done.time == pytest.approx(ended.time + 0.015)
    assert (done.link, stopped.link, unknown.link) == (0.03, 0.03, 0.03)
    assert stopped.time == pytest.approx(done.time + 0.03)
    run.send(session, "o1", source="console")
    assert run.answers[-1][1].link == 0.0
    spent = run.state.spent
    assert spent.link == pytest.approx(5 * 0.03)
    assert spent.driving + spent.link + spent.reading == pytest.approx(run.simulator.time)
    assert run.again() == 6


def test_jitter_comes_from_the_seed_and_restarts_with_the_run(clock: Clock, tmp_path: Path) -> None:
    configuration = configured(tmp_path, link__latency=0.01, link__jitter=0.02)
    run = Run(clock, tmp_path / "run", configuration)
    session = run.session()
    run.send(session, *["o1"] * 20)
    clock.pass_by(1.0)
    first = [outcome.link for _, outcome in run.answers]
    assert all(0.02 <= link < 0.06 for link in first)
    assert len(set(first)) == 20
    run.engine.perform(Action(ActionName.RESET))
    run.send(session, *["o1"] * 20)
    clock.pass_by(1.0)
    assert [outcome.link for _, outcome in run.answers][20:] == first
    assert run.again() == 40


def test_in_timed_motion_a_reading_really_takes_its_time(clock: Clock, tmp_path: Path) -> None:
    configuration = configured(tmp_path, motion__motion="timed", motion__time_scale=2.0)
    run = Run(clock, tmp_path / "run", configuration)
    program, person = run.session(), run.session(answer_at_end=False)
    run.send(program, "u1", "o1", "d1-2")
    run.send(person, "u3", source="console")
    assert run.answers == []
    clock.pass_by(READ / 2 + 0.001)
    assert run.answered == [(READ / 2, "u1"), (READ / 2, "u3"), (READ / 2, "o1")] or run.answered == [
        (READ / 2, "u1"),
        (READ / 2, "o1"),
        (READ / 2, "u3"),
    ]
    run.send(person, "o2", source="console")
    assert run.answered[-1][1] == "o2", "a person's reading does not wait for the drive"
    clock.pass_by(5.0)
    assert run.answered[-1][1] == "d1-2"
    assert run.again() == 5


def test_in_timed_motion_the_link_really_takes_its_time(clock: Clock, tmp_path: Path) -> None:
    configuration = configured(tmp_path, motion__motion="timed", link__latency=0.1)
    run = Run(clock, tmp_path / "run", configuration)
    session = run.session()
    run.send(session, "o1")
    clock.pass_by(0.15)
    assert run.answers == []
    clock.pass_by(0.06)
    assert run.answered == [(0.2, "o1")]
    run.send(session, "r1-60", "xx")
    clock.pass_by(0.05)
    assert not run.simulator.moving
    clock.pass_by(0.06)
    clock.pass_by(2.0)
    assert [text for _, text in run.answered] == ["o1", "r1-60", "xx"]
    assert run.answers[1][1].link == pytest.approx(0.2)
    assert run.again() == 3


def test_a_pause_holds_up_what_is_on_its_way(clock: Clock, tmp_path: Path) -> None:
    run = Run(clock, tmp_path / "run", configured(tmp_path, motion__motion="timed", link__latency=0.1))
    session = run.session()
    run.send(session, "u1")
    clock.pass_by(0.05)
    run.engine.perform(Action(ActionName.PAUSE))
    clock.pass_by(10.0)
    assert run.answers == []
    run.engine.step()
    run.engine.perform(Action(ActionName.RESUME))
    clock.pass_by(1.0)
    assert [text for _, text in run.answered] == ["u1"]
    run.send(session, "u1", "o1")
    run.engine.perform(Action(ActionName.RESET))
    clock.pass_by(1.0)
    assert [text for _, text in run.answered] == ["u1", "u1", "o1"]
    assert run.again() >= 3


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize("motion", ["instant", "timed"])
@pytest.mark.parametrize("seed", range(4))
def test_random_runs_come_out_the_same(tmp_path: Path, clock: Clock, motion: str, seed: int) -> None:
    import random

    configuration = configured(tmp_path, motion__motion=motion, link__latency=0.02, link__jitter=0.05)
    run = Run(clock, tmp_path / "run", configuration)
    rng = random.Random(seed)
    program, packets, person = (
        run.session(),
        run.session(answer_at_end=False),
        run.session(answer_at_end=False),
    )
    sessions = ((program, "client"), (packets, "packets"), (person, "console"))
    for _ in range(120):
        session, source = rng.choice(sessions)
        texts = ("u1", "u3", "o1", "g1", "c1", "d1-2", "w1-3", "s1-3", "r1-20", "xx", "zz")
        run.send(session, *rng.choices(texts, k=rng.randint(1, 3)), source=source)
        if rng.random() < 0.06:
            run.engine.perform(Action(rng.choice((ActionName.STOP, ActionName.RESET, ActionName.NOISE)), ()))
        clock.pass_by(rng.random() * 0.2)
    clock.pass_by(60.0)
    assert run.again() > 100
    with LogReader(run.log) as log:
        back = [each.event for each in log if isinstance(each, Logged)]
    told = [event for event in run.events if isinstance(event, CommandResult)]
    read_back = [event for event in back if isinstance(event, CommandResult)]
    assert [(each.number, each.time, each.link) for each in read_back] == [
        (each.number, each.time, each.link) for each in told
    ]
    for one, other in zip(told, read_back, strict=True):
        assert other.before == one.before, (one, other)
    reducer = Reducer(log.header.checkpoint(configuration))
    for event in back:
        reducer.apply(event)
    live, again = run.reducer.at().spent, reducer.at().spent
    assert (again.driving, again.link, dict(again.by_sensor)) == (
        live.driving,
        live.link,
        dict(live.by_sensor),
    )


def test_the_report_says_where_the_time_went(clock: Clock, tmp_path: Path) -> None:
    run = Run(clock, tmp_path / "run", configured(tmp_path, link__latency=0.015))
    run.send(run.session(), "u1", "u1", "u3", "d1-10")
    report = build_report(run.log)
    with (tmp_path / "report.txt").open("w+") as file:
        print_document(report_document(report, "x"), Console(file=file, width=100))
        file.seek(0)
        text = file.read()
    assert "Where the time went" in text
    lines = [line.split() for line in text.splitlines()]
    rows = [line for line in lines if line[:1] in (["reading"], ["driving"], ["on"])]
    assert [row[0] for row in rows] == ["driving", "reading", "reading", "on"]
    assert rows[1][1] == "u1"


@pytest.mark.slow
def test_a_line_that_sums_up_knows_where_the_time_went(clock: Clock, tmp_path: Path) -> None:
    run = Run(clock, tmp_path / "run", configured(tmp_path, link__latency=0.015))
    run.send(run.session(), *["u1", "d1-1", "s1-1"] * 300)
    clock.pass_by(1.0)
    states = [json.loads(line) for line in run.log.read_text().splitlines() if '"kind":"checkpoint"' in line]
    assert states
    assert states[-1]["reading"]["u1"] > 1.0
    assert states[-1]["link"] > 1.0
    assert replace(run.state.spent, link=0.0).driving > 1.0
