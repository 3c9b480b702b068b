"""Logs of runs with events of every kind: their lines, what is read back from them, and all moments of their
replay are those that were kept."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.sets import find_set, init_set
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.link_delay import LinkDelay
from simmer_tui.run.belief_grid import grid_belief
from simmer_tui.run.events import (
    Action,
    ActionName,
    Belief,
    DisplayChanged,
    Event,
    Goal,
    MissionEvent,
    Notice,
    NoticeKind,
    OutputLine,
    ProgramEnded,
    Result,
    TwinReading,
    WireMessage,
)
from simmer_tui.run.state import State
from simmer_tui.runlog import encode, writer
from simmer_tui.runlog.index import EntryFlag, RunLogIndex
from simmer_tui.runlog.log_records import BrokenLine
from simmer_tui.runlog.playback import Playback
from simmer_tui.runlog.reader import Logged, LogReader
from simmer_tui.runlog.rerun import Rerun
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Pose, Simulator, Status, parse_command
from simmer_tui.sim.records import LidarScan
from tests.brief_events import brief, fields, sums
from tests.kept_numbers import assert_kept
from tests.manual_loop import ManualLoop

KEPT = Path(__file__).with_name("kept_logs.json")
OF_THE_MACHINE = ("mathematics", "program", "files", "settings", "start", "configuration")


class Run:
    """A run that is logged."""

    def __init__(
        self, configuration: Configuration, path: Path, *, timed: bool = False, link: bool = False
    ) -> None:
        """With a `link` messages take so long that answers come after later commands of others."""
        motion = replace(configuration.settings.motion, motion="timed" if timed else "instant")
        delays = replace(
            configuration.settings.link, latency=0.1 if link else 0.0, jitter=0.05 if link else 0.0
        )
        settings = replace(configuration.settings, motion=motion, link=delays)
        self.simulator = Simulator(configuration.simulation, 7)
        self.engine = Engine(self.simulator, timed=timed, link=LinkDelay(0.1, 0.05, 3) if link else None)
        self.loop = ManualLoop()
        self.engine.start(cast("Any", self.loop))
        self.log = RunLog(
            path,
            replace(configuration, settings=settings),
            self.simulator,
            mission=True,
            clock=lambda: 1.7e9 + 1.000456 * self.loop.now,
        )
        self.engine.watch(self.log)
        self.first, self.second = self.engine.session(), self.engine.session(answer_at_end=False)

    def send(self, *texts: str, second: bool = False, **fields: Any) -> None:
        for text in texts:
            command = replace(parse_command(text), **fields)
            (self.second if second else self.first).submit(command, lambda outcome: None)
        self.wait(0.0)

    def act(self, name: ActionName, *arguments: float) -> None:
        self.engine.perform(Action(name, arguments))

    def tell(self, *events: Event) -> None:
        for event in events:
            self.engine.tell(event)

    def wait(self, seconds: float) -> None:
        self.loop.run_until(self.loop.now + seconds)
        while self.engine.driving.waits and not self.engine.timed:
            self.loop.run_until(self.loop.now)

    def believe(self, number: int = -1, shape: tuple[int, int, int] = (6, 8, 1)) -> None:
        """Tell a pose with particles, or a grid whose best state is of this number."""
        now, pose = self.engine.now(), self.simulator.pose
        if number < 0:
            cloud = ((10.25, 41.0), (9.5, 42.0, -30.25)), ((1.0, 2.0),), ((3.0, 4.0, 5.5), (0.01, 7.0, 8.0))
            self.tell(Belief(now, Pose(9.75, 41.5, 2.25), pose, 1.5, cloud[number % 3], "a note"))
            return
        table = np.full(shape, 0.1)
        table.flat[number] = 3.0
        grid = grid_belief(table, (0.0, 0.0, 96.0, 48.0), 0.0, pose)
        self.tell(Belief(now, grid.best_pose, pose, grid.spread, grid=grid))


def instant(run: Run) -> None:
    run.tell(Notice(NoticeKind.CONNECTED, "client connected", "127.0.0.1:5"))
    run.tell(Notice(NoticeKind.HINT, "not logged"), MissionEvent(0.0, Result.UNDER_WAY, "it begins"))
    run.send("u1", "i1", "l1", "d1-3", "zz", "d1-x", "c1", "d1-0")
    run.send("g1", source="console")
    run.send("p1-1", "d1-9", "p1-0", "p1-1", "d1--2", "p1-0", "r1--40")
    run.believe()
    run.send("d1-60", "u1", "sc", "sc", "sc-90")
    run.tell(MissionEvent(run.simulator.time, Goal.REACHED, "there"))
    run.act(ActionName.TELEPORT, 30.0, 42.0, 90.0)
    run.act(ActionName.TELEPORT, -5.0, 42.0, 90.0)
    run.act(ActionName.TELEPORT, 54.0, 30.0, 0.0)
    run.act(ActionName.BLOCK, 40.0, 42.0)
    run.send("vv-6;0;20", "wt-0.7", "sc", "u1", "vv-6;0;20;0.4", "wt-1", "vr--30", "wt-0.3", "d1-1")
    for number in range(3):
        run.believe(number)
    run.send("u1", "s1-1.5")
    run.believe(7, (4, 8, 1))
    run.wait(0.25)
    run.act(ActionName.NOISE, 0.0)
    run.act(ActionName.BIAS, 0.0)
    run.send("d1-6", "o1")
    run.tell(
        WireMessage(run.simulator.time, "GO\r", False, "d1-3"), WireMessage(run.simulator.time, "ok", True)
    )
    run.tell(TwinReading(run.simulator.time, parse_command("u1"), "u1", math.nan, 4.5))
    run.tell(DisplayChanged(run.simulator.time, "rover", displays=(("one", "two"), ("\u00b0",))))
    run.tell(MissionEvent(run.simulator.time, Result.FAILED, "over", "it hit a wall"))
    run.act(ActionName.RESET)
    run.send("d1-2", "u1", "w1-2")
    run.act(ActionName.SEED, 9.0)
    run.send("d1-2", "u1", "vv-20;0;0", "wt-0.5")
    output = (OutputLine(0.5, "one"), OutputLine(0.75, "two"))
    run.tell(ProgramEnded(run.simulator.time, 3, "SIGHUP", True, "oh", "a.py:3", output, output[:1]))
    run.tell(Notice(NoticeKind.LEFT, "client left", advice=True))
    run.believe(5)
    run.believe(6)
    run.wait(0.1111)


def timed(run: Run) -> None:
    run.send("d1-9", "u1", second=True)
    run.wait(0.4)
    run.send("u2", "g1", "d1-3", second=True)
    run.wait(0.3)
    run.act(ActionName.BLOCK, 26.0, 41.5)
    run.wait(0.02)
    run.send("sc", "i1", second=True)
    run.wait(1.5)
    run.send("d1-20", "u1")
    run.wait(0.5)
    run.believe()
    run.send("u1", second=True)
    run.act(ActionName.TIME_SCALE, 2.0)
    run.wait(0.5)
    run.act(ActionName.STOP)
    run.send("r1-90", "w1-30")
    run.wait(0.1)
    run.act(ActionName.PAUSE)
    run.send("u3", second=True)
    run.wait(1.0)
    run.act(ActionName.RESUME)
    run.wait(0.3)
    run.engine.refuse(replace(parse_command("xx"), stops=True))
    run.send(" xx-3", second=True, stops=True)
    run.wait(0.5)
    run.act(ActionName.TELEPORT, 54.0, 30.0, 0.0)
    run.send("vv-4;0;30", "wt-0.5", "u1")
    run.wait(0.2)
    run.send("sc", second=True)
    run.wait(0.25)
    run.send("r1-9", "vx-3")
    run.wait(0.2)
    run.act(ActionName.TELEPORT, 18.0, 42.0, 0.0)
    run.send("d1-4", "u1")
    run.wait(1.0)
    run.send("d1--1", "u1")
    run.wait(0.16)  # over a link it has ended and is not answered yet
    run.act(ActionName.TELEPORT, 19.0, 42.0, 0.0)
    run.wait(0.3)
    run.send("d1-4", "u1")
    run.wait(0.2)
    run.act(ActionName.RESET)
    run.send("d1-30", "u1")
    run.wait(0.7)


def beliefs(run: Run) -> None:
    """Large grids, without their cells where they come too soon after another, before what they led to."""

    def believe(*numbers: int) -> None:
        for number in numbers:
            run.believe(number)

    believe(1, 2)
    run.send("vx-3", "wt-0.2")
    believe(3)
    run.send("wt-0.2", "u1")
    believe(4, 5)
    run.send("vx-0", "u1", "d1-60")
    believe(6)
    run.tell(MissionEvent(run.simulator.time, Goal.REACHED, "there"))
    believe(7)
    run.tell(MissionEvent(run.simulator.time, Result.SUCCESS, "done"))
    believe(8, 9)
    run.act(ActionName.RESET)
    believe(10, 11)
    run.act(ActionName.TELEPORT, 30.0, 42.0, 90.0)
    run.send("vx-6", "wt-0.4")
    believe(12)
    run.send("wt-1")
    run.act(ActionName.TELEPORT, -5.0, 42.0, 90.0)
    run.act(ActionName.BLOCK, 40.0, 42.0)
    believe(13)
    run.tell(ProgramEnded(run.simulator.time, 0))
    run.send("u1", "d1-1", "u1", "r1-20", "u1")


def real(run: Run) -> None:
    """Commands that a real robot was sent, with its answers, and those that it did not answer."""
    for text, status in (("d1-3", Status.DONE), ("u1", Status.READING), ("u1", Status.UNANSWERED)):
        done = run.engine.mirror(parse_command(text))
        run.tell(
            replace(done, status=status, reply=4.25, reason="no answer" if status == "unanswered" else "")
        )
    run.tell(replace(run.engine.peek(parse_command("sc")), status=Status.UNANSWERED, reply=math.nan))
    run.tell(replace(run.engine.mirror(parse_command("d1-2")), status=Status.UNANSWERED, trajectory=None))
    run.send("d1-1", "u1", "sc")
    done = run.engine.peek(parse_command("sc"))
    assert done.reading is not None
    # Its lidar has other rays than that of the set.
    rays = LidarScan(5, np.arange(5.0), np.arange(5) * 72.0, np.empty(0), np.empty((0, 3)))
    run.tell(replace(done, reply=0.0, reading=replace(done.reading, true=0.0, scan=rays)))


RUNS: dict[str, tuple[Callable[[Run], None], dict[str, bool]]] = {
    "instant": (instant, {}),
    "timed": (timed, {"timed": True}),
    "timed over a link": (timed, {"timed": True, "link": True}),
    "beliefs": (beliefs, {}),
    "real": (real, {}),
}


@pytest.fixture(scope="module")
def configuration(tmp_path_factory: pytest.TempPathFactory) -> Configuration:
    """The set with a gripper, and a lidar and a solid block beside it."""
    folder = tmp_path_factory.mktemp("lidar") / "set"
    init_set(folder, find_set("mission"))
    path = folder / "sensors.csv"
    head, *rows = path.read_text().splitlines()
    rows = [f"{row},," for row in rows] + ["lidar1,sc,1,1.5,-0.5,4,20,0.01,,,,12,0.01"]
    path.write_text("\n".join([f"{head},Rays,Resolution", *rows]))
    settings = folder / "settings.toml"
    settings.write_text(settings.read_text().replace("block_solid = false", "block_solid = true"))
    return load(folder)


@pytest.fixture(scope="module")
def logs(configuration: Configuration, tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Path]]:
    """A log of each run, with a checkpoint after few lines."""
    folder = tmp_path_factory.mktemp("logs")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(writer, "CHECKPOINT_EVERY", 9)
        patched.setattr(encode, "LARGE_GRID", 40)
        for name, (happen, how) in RUNS.items():
            run = Run(configuration, folder / name, **how)
            happen(run)
            run.log.close()
        yield {name: folder / name for name in RUNS}


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


@pytest.mark.parametrize("name", RUNS)
def test_the_lines_are_those_that_were_kept(logs: dict[str, Path], name: str) -> None:
    header, *rest = lines(logs[name])
    header = {key: value for key, value in header.items() if key not in OF_THE_MACHINE}
    assert_kept([header, *rest], KEPT, f"lines, {name}")


@pytest.mark.parametrize("name", RUNS)
def test_the_events_are_those_that_were_kept(logs: dict[str, Path], name: str) -> None:
    with LogReader(logs[name]) as log:
        found = [read_back(each) for each in log]
    assert_kept(found, KEPT, f"events, {name}")


@pytest.mark.parametrize("name", RUNS)
def test_the_index_is_the_one_that_was_kept(logs: dict[str, Path], name: str) -> None:
    with RunLogIndex(logs[name]) as log:
        entries = [
            [int(log.flags_of(i)), *map(brief, (log.time_of(i), log.time_of(i), log.zero_of(i)))]
            for i in range(log.count)
        ]
        found: list[Any] = [log.count, brief(log.duration), log.note, entries]
        for flag in EntryFlag:
            found.append([log.find_all(flag), log.find_all(flag, 10, 30), log.find_all(flag, 7)])
            found.append(
                [(log.find_next(i, flag), log.find_previous(i, flag)) for i in range(-2, log.count, 9)]
            )
        found.append([log.find_time(log.duration * step / 20) for step in range(-1, 22)])
    assert_kept(found, KEPT, f"index, {name}")


def damaged(path: Path) -> Path:
    """A copy of a log in which some lines are broken, and some do not fit those before."""
    lines = path.read_text().splitlines()
    for number in range(9, len(lines), 7):
        lines[number] = lines[number][:30]
    for number in range(4, len(lines), 11):
        lines[number] = lines[number].replace('"cmd":"u1"', '"cmd":"q9"').replace('"cmd":"d1-', '"cmd":"q9-')
    checkpoints = [number for number, line in enumerate(lines) if '"kind":"checkpoint"' in line]
    for number in checkpoints[1::2]:
        lines[number] = "{}"
    copy = path.with_name("damaged")
    copy.write_text("\n".join(lines) + "\n")
    return copy


def read_back(each: Logged | BrokenLine) -> list[Any]:
    if isinstance(each, BrokenLine):
        return [each.line, each.reason[:9]]
    return [each.line, brief(each.real_time - 1.7e9), brief(each.event)]


def shown(state: State) -> list[Any]:
    """A state in short; of what has its own event, only when it was."""
    sensors = {
        code: [brief(row.reading.value), len(row.history), brief(row.time)]
        for code, row in state.sensors.items()
    }
    others = {
        "spec",
        "bias",
        "path",
        "sensors",
        "twins",
        "last",
        "ended",
        "movement",
        "belief",
        "mission",
        "contact_points",
        "spent",
    }
    plain = fields(state, *others)
    events = [
        None if each is None else brief(each.time) for each in (state.last, state.ended, state.movement)
    ]
    belief = None if state.belief is None else [brief(state.belief.pose), brief(state.belief.grid)]
    return [
        plain,
        sums(state.contact_points),
        sums(state.path),
        brief(state.mission and state.mission.result),
        events,
        belief,
        sensors,
    ]


@pytest.mark.parametrize(
    ("name", "look_back"),
    [("instant", 5), ("timed", 5), ("beliefs", 3), ("instant, damaged", 400)],
)
def test_the_moments_of_a_replay_are_those_that_were_kept(
    logs: dict[str, Path], name: str, look_back: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("simmer_tui.runlog.playback.LOOK_BACK", look_back)
    monkeypatch.setattr("simmer_tui.runlog.playback.SKIP", 3 * look_back)
    path = damaged(logs["instant"]) if "damaged" in name else logs[name]
    with RunLogIndex(path) as log:
        playback, found = Playback(log), []
        steps = 45
        for step in (*range(-1, steps + 2, 4), *range(steps, 0, -6), 3, 40, 41, 5, 4, 44):
            elapsed = log.duration * step / steps
            entry = log.find_time(elapsed)
            state = playback.state_at(entry, elapsed)
            found.append([entry, shown(state)])
        for entry in (-1, 0, 20, 22, 21, 21, *range(log.count - 1, 22, -9), 3):
            found.append([entry, shown(playback.state_at(entry))])
            found.append([entry, shown(playback.state_at(entry, log.time_of(max(entry, 0))))])
            found.append([entry, shown(playback.state_when(entry, 1.25))])
        told = [*playback.events(20, 29), *playback.events(-3, 2), *playback.events(log.count - 1, 999)]
        found.append([read_back(each) for each in told])
        found.append([each.line for each in playback.events(0, 999) if isinstance(each, BrokenLine)])
    assert_kept(found, KEPT, f"replay, {name}, {look_back}")


@pytest.mark.parametrize("name", ["instant", "timed", "timed over a link", "beliefs"])
def test_a_log_runs_again(logs: dict[str, Path], name: str) -> None:
    with Rerun(logs[name]) as run:
        positions = list(run.steps())
        assert (run.difference, run.notes) == (None, [])
        assert_kept([run.commands, run.actions, len(positions)], KEPT, f"rerun, {name}")
        assert positions == sorted(positions)
        assert positions[-1] == run.size
