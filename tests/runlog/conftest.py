"""Makes logs of real runs: instant ones, and timed ones under a clock that the test sets."""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import pytest
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.config.loader import Configuration
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.sessions import Session
from simmer_tui.run.events import Action, ActionName, Belief, Event, Notice, NoticeKind
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import State, checkpoint_of
from simmer_tui.runlog.writer import LineFile, RunLog
from simmer_tui.sim import Pose, Simulator, parse_command
from tests.manual_loop import ManualLoop

READS = ("u1", "u3", "i1", "c1", "o1", "g1", "t1")
MOVES = ("d1-3", "w1-2.5", "a1-4", "s1-9", "r1-40", "r1--75", "d1-0")
BAD = ("zz", "d1-x", "", "d1-1e9", 'u"\\\x00\ud800é')


@dataclass
class Run:
    """A logged run in progress."""

    path: Path
    simulator: Simulator
    engine: Engine
    log: RunLog
    session: Session
    loop: ManualLoop
    reducer: Reducer
    clock: Callable[[], float]
    events: list[Event] = field(default_factory=list)
    """Events that the engine has told."""
    moments: list[tuple[int, float, State]] = field(default_factory=list)
    """Moments looked at: the log's newest entry, simulated time, and how the run stood."""

    def look(self) -> None:
        """Note how the run stands now."""
        now = self.engine.now()
        self.moments.append((self.log.lines - 2, now, self.reducer.at(now)))

    def send(self, *texts: str) -> None:
        for text in texts:
            self.session.submit(parse_command(text), lambda outcome: None)
        self.loop.run_until(self.loop.now)  # after a slice of commands the loop has its turn

    def perform(self, name: ActionName, *arguments: float) -> None:
        self.engine.perform(Action(name, arguments))

    def believe(self, x: float = 1.0) -> None:
        now, pose = self.engine.now(), self.simulator.pose
        believed = Pose(pose.x + x, pose.y, pose.heading)
        self.engine.tell(Belief(now, believed, pose, 0.5, ((1.0, 2.0),), "half \ud800 a pair"))


StartRun = Callable[..., Run]


def log_of(
    configuration: Configuration, simulator: Simulator, on_stop: Callable[[str], None] = lambda why: None
) -> Callable[[Path, Callable[[Path], LineFile]], RunLog]:
    """Begins a log of a run, as `SavedRun` takes it."""
    return lambda path, file: RunLog(path, configuration, simulator, on_stop=on_stop, file=file)


@pytest.fixture(scope="session")
def configuration() -> Configuration:
    return load_default()


@pytest.fixture
def start_run(tmp_path: Path, configuration: Configuration) -> Iterator[StartRun]:
    """Starts a run with seed 7 that is logged to a new file."""
    numbers = itertools.count()
    logs = ExitStack()

    def start(
        *, timed: bool = False, answer_at_end: bool = True, on_stop: Callable[[str], None] = lambda why: None
    ) -> Run:
        path = tmp_path / f"run{next(numbers)}.jsonl"
        simulator = Simulator(configuration.simulation, 7)
        clock = lambda: 1.7e9 + simulator.time  # noqa: E731
        engine = Engine(simulator, timed=timed)
        loop = ManualLoop()
        engine.start(cast("Any", loop))
        motion = replace(configuration.settings.motion, motion="timed" if timed else "instant")
        set_up = replace(configuration, settings=replace(configuration.settings, motion=motion))
        log = logs.enter_context(RunLog(path, set_up, simulator, on_stop=on_stop, clock=clock))
        reducer = Reducer(checkpoint_of(simulator))
        session = engine.session(answer_at_end=answer_at_end)
        run = Run(path, simulator, engine, log, session, loop, reducer, clock)
        for watcher in (reducer.apply, log, run.events.append):
            engine.watch(watcher)
        return run

    with logs:
        yield start


@pytest.fixture
def varied_log(start_run: StartRun) -> Path:
    """A short instant run with a line of every kind but the twin's."""
    run = start_run()
    run.engine.tell(Notice(NoticeKind.CONNECTED, "client connected", "127.0.0.1:5"))
    run.send(*READS, "d1-3", "zz", "d1-x", "u1", "d1-60", "u1")
    run.believe()
    run.perform(ActionName.TELEPORT, 30.0, 42.0, 90.0)
    run.perform(ActionName.TELEPORT, -5.0, 42.0, 90.0)
    run.send("u1", "r1-45")
    run.perform(ActionName.NOISE, 0.0)
    run.send("u1")
    run.perform(ActionName.RESET)
    run.send("d1-2", "u1")
    run.engine.tell(Notice(NoticeKind.LEFT, "client left"))
    run.log.close()
    return run.path


@pytest.fixture
def random_run(start_run: StartRun) -> Callable[..., Run]:
    """A run of random commands, actions and waits, from a seed."""

    def make(seed: int, *, timed: bool, answer_at_end: bool = True, steps: int = 150) -> Run:
        chance = random.Random(seed)
        run = start_run(timed=timed, answer_at_end=answer_at_end)
        reader = run.engine.session(answer_at_end=False)
        run.perform(ActionName.BLOCK, 30.0, 45.0)
        for _ in range(steps):
            run.look()
            kind = chance.random()
            if kind < 0.35:
                run.send(chance.choice(MOVES))
            elif kind < 0.6:
                reader.submit(parse_command(chance.choice(READS), "console"), lambda outcome: None)
            elif kind < 0.7:
                run.send(chance.choice(BAD + READS))
            elif kind < 0.72:
                run.believe()
            elif kind < 0.8:
                run.perform(*_random_action(chance))
            elif kind < 0.83:
                stop = replace(parse_command("xx", "packets"), stops=True)
                run.session.submit(stop, lambda outcome: None)
            elif timed:
                run.loop.run_until(
                    run.loop.now + chance.choice((0.0, 0.05, 0.4, 2.0)), chance.choice((0, 0.01))
                )
        run.perform(ActionName.RESUME)
        run.loop.run_until(run.loop.now + 1e4)
        run.look()
        run.log.close()
        return run

    return make


def _random_action(chance: random.Random) -> tuple[Any, ...]:
    return chance.choice(
        (
            (ActionName.RESET,),
            (ActionName.SEED, chance.randrange(100)),
            (ActionName.STOP,),
            (ActionName.TELEPORT, 30.0, 42.0, chance.uniform(-180, 180)),
            (ActionName.TELEPORT, 0.0, 0.0, 0.0),
            (ActionName.BLOCK, chance.uniform(20, 36), 44.0),
            (ActionName.NOISE, chance.randrange(2)),
            (ActionName.BIAS, chance.randrange(2)),
            (ActionName.PAUSE,),
            (ActionName.RESUME,),
            (ActionName.RESUME,),
            (ActionName.TIME_SCALE, chance.choice((0.5, 3.0))),
        )
    )
