"""Exchanges of several senders with one robot, on a clock that the test moves: every event and answer is
the one that was kept."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.robot import driving
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.link_delay import LinkDelay
from simmer_tui.robot.sessions import Session
from simmer_tui.run.events import Action, ActionName, CommandResult, Event
from simmer_tui.sim import SimulationSpec, Simulator, parse_command
from simmer_tui.sim.sensors import Lidar, LidarSpec
from tests.brief_events import brief
from tests.kept_numbers import assert_kept
from tests.manual_loop import ManualLoop

KEPT = Path(__file__).with_name("kept_exchanges.json")


class Bench:
    """An engine and what happened, each with the time of the loop's clock."""

    def __init__(
        self, spec: SimulationSpec, *, link: bool = False, pace: float = 0.0, **options: Any
    ) -> None:
        self.loop = ManualLoop()
        self.simulator = Simulator(spec, seed=3)
        delay = LinkDelay(0.06, 0.04, 3) if link else None
        self.engine = Engine(self.simulator, link=delay, **options)
        self.happened: list[Any] = []
        self.engine.watch(lambda event: self._note("", event))
        if pace:
            throttle = self.engine.paced(cast("Any", self.loop), pace)
            throttle.watchers.add(lambda event: self._note("shown", type(event).__name__))
        self.engine.start(cast("Any", self.loop))
        self.sessions = {
            "a": self.engine.session(),
            "b": self.engine.session(answer_at_end=False, lane="crowd"),
        }

    def _note(self, who: str, what: Event | Any) -> None:
        told = brief(what)
        if isinstance(what, CommandResult) and who:
            told = f"{what.number} {what.status}"
        self.happened.append([brief(self.loop.now - 100.0), who, told])

    def send(self, who: str, *texts: str, source: str = "client", stops: bool = False) -> None:
        for text in texts:
            command = replace(parse_command(text, source), stops=stops)
            self.session(who).submit(command, lambda outcome: self._note(f"to {who}", outcome))

    def session(self, who: str) -> Session:
        return self.sessions[who]

    def stop(self, who: str) -> None:
        self.send(who, "xx", stops=True)

    def act(self, name: ActionName, *arguments: float) -> None:
        self.engine.perform(Action(name, arguments))

    def leave(self, who: str) -> None:
        self.session(who).close()
        self.sessions[who] = self.engine.session()

    def wait(self, seconds: float, late: float = 0.0) -> None:
        self.loop.run_until(self.loop.now + seconds, late)
        clock = [self.engine.present, self.engine.now(), self.engine.shown_time()]
        pose = brief(self.simulator.pose)
        waiting = [self.engine.has_waiting, self.engine.halted, self.engine.halts, self.engine.exchanges]
        driving_now = [self.engine.driving.drives, self.engine.driving.waits, self.engine.driving.first_over]
        self.happened.append([brief(clock), pose, waiting, brief(driving_now)])


def drives_and_readings(bench: Bench) -> None:
    bench.send("a", "u1", "d1-3", "u2", "r1-40", "zz", "d1-x", "o1")
    bench.send("b", "u3", "w1-2", "g1")
    bench.send("b", "u1", source="console")
    bench.wait(0.04)
    bench.send("b", "d1-1", "c1")
    bench.wait(0.3)
    bench.send("a", "w1-30", "u1")
    bench.wait(0.2, 0.01)
    bench.send("b", "u4", source="keys")
    bench.wait(3.0)
    bench.send("a", "d1-0", "u1")
    bench.wait(20.0)


def stops(bench: Bench) -> None:
    bench.stop("b")
    bench.send("a", "d1-20", "d1-4", "u1")
    bench.wait(0.5)
    bench.stop("b")
    bench.send("a", "d1-1")
    bench.wait(0.05)
    bench.wait(0.3)
    bench.stop("a")
    bench.stop("a")
    bench.send("b", "vv-3;0;10", "wt-2", "vv-2;0;0")
    bench.wait(0.4)
    bench.send("b", "u1", "d1-3")
    bench.stop("a")
    bench.send("b", "u1")
    bench.wait(0.1)
    bench.send("b", "d1-6")
    bench.wait(0.3)
    bench.stop("b")
    bench.leave("b")
    bench.wait(5.0)
    bench.send("a", "u2")
    bench.send("b", "d1-2")
    bench.wait(0.15)
    bench.stop("a")
    bench.send("a", "u1", "u3")
    bench.wait(0.12)
    bench.wait(2.0)


def velocities(bench: Bench) -> None:
    bench.act(ActionName.TELEPORT, 45.0, 30.0, 0.0)
    bench.send("a", "vv-6;0;20", "wt-0.7", "u1", "vv-6;0;20", "wt-0.3")
    bench.wait(1.5)
    bench.send("a", "vr--60", "wt-1")
    bench.send("b", "u2", "wt-0.25", "u2")
    bench.wait(0.1)
    bench.wait(1.1)
    bench.send("a", "vv-6;0;0;0.5", "wt-1", "vx-8", "wt-1.2", "vx-0")
    bench.wait(4.0)
    bench.act(ActionName.TELEPORT, 45.0, 30.0, 0.0)
    bench.send("b", "vv-2;0.5;5")
    bench.send("a", "vv-1;-0.5;-5", "u1")
    bench.leave("b")
    bench.wait(0.4)
    bench.send("a", "wt-3")
    bench.wait(0.3)
    bench.leave("a")
    bench.send("a", "vx-2", "d1-2", "u1")
    bench.wait(4.0)


def people(bench: Bench) -> None:
    bench.send("a", "u1", "d1-12", "u2", "d1-1")
    bench.wait(0.6)
    bench.act(ActionName.PAUSE)
    bench.send("b", "u1", "u3", "u4")
    bench.wait(1.0)
    bench.engine.step()
    bench.wait(0.2)
    bench.engine.step()
    bench.engine.step()
    bench.wait(0.2)
    bench.act(ActionName.TIME_SCALE, 2.0)
    bench.act(ActionName.RESUME)
    bench.wait(0.5)
    bench.send("b", "d1-1", "u1")
    bench.act(ActionName.PAUSE)
    for _ in range(4):
        bench.engine.step()
        bench.wait(0.1)
    bench.act(ActionName.RESUME)
    bench.engine.step()
    bench.act(ActionName.BLOCK, 40.0, 42.0)
    bench.send("a", "d1-6")
    bench.wait(0.2)
    bench.act(ActionName.TELEPORT, 18.0, 42.0, 10.0)
    bench.act(ActionName.TELEPORT, 0.0, 0.0, 0.0)
    bench.send("a", "vv-3;0;0", "wt-2")
    bench.wait(0.5)
    bench.act(ActionName.PAUSE)
    bench.engine.step()
    bench.send("a", "wt-1", "u1")
    for _ in range(4):
        bench.engine.step()
        bench.wait(0.1)
    bench.act(ActionName.STOP)
    bench.act(ActionName.RESUME)
    bench.send("a", "d1-3", "u1")
    bench.wait(0.2)
    bench.act(ActionName.SEED, 9.0)
    bench.send("a", "u1", "d1-2", "vv-1;0;0", "wt-1")
    bench.wait(0.4)
    bench.act(ActionName.RESET)
    bench.send("b", "u1", "d1-1")
    bench.wait(3.0)
    bench.engine.drop("c:1")
    bench.wait(3.0)


def a_real_robot(bench: Bench) -> None:
    """The calls for a real robot and for the replay of another run's beginning."""
    engine, note = bench.engine, bench._note
    engine.before_drive = lambda: note("before a drive", "")
    for text in ("u1", "d1-3", "wt-1", "vv-2;0;0", "u2", "zz"):
        note("mirrored", engine.mirror(parse_command(text)))
        bench.wait(0.1)
    note("peeked", engine.peek(parse_command("u1")))
    engine.finish_movement()
    engine.mirror(parse_command("d1-2"))
    bench.wait(0.1)
    engine.finish_movement()
    bench.wait(0.1)
    note("refused", engine.refuse(replace(parse_command("d1-3"), stops=True)))
    bench.happened.append([engine.draw_link(3), engine.draw_link(1)])
    engine.restart_link()
    bench.happened.append([engine.draw_link(1)])
    engine.call_at(engine.now() + 0.5, lambda: note("called", "late"))
    engine.call_at(engine.now() + 0.2, lambda: note("called", "soon"))
    bench.send("a", "d1-3", "u1")
    bench.wait(1.0)
    engine.cut_waits(bench.session("a"))
    bench.send("a", "wt-3", "u1")
    bench.wait(0.1)
    note("halted", engine.halt(parse_command("xx"), 0.2, 0.1))
    bench.wait(0.2)
    note("halted", engine.halt(parse_command("xx")))
    bench.wait(4.0)
    bench.send("a", "d1-3")
    bench.loop.now += 5.0  # its timer is late
    bench.send("b", "u1", "d1-1")
    bench.wait(1.0)


SCRIPTS: dict[str, Callable[[Bench], None]] = {
    each.__name__: each for each in (drives_and_readings, stops, velocities, people, a_real_robot)
}
MODES: dict[str, dict[str, Any]] = {
    "instant": {},
    "instant over a link, at a pace": {"link": True, "pace": 4.0},
    "instant with pauses on a slow computer": {"step_time": 0.03},
    "timed": {"timed": True},
    "timed on a slow computer": {"timed": True, "time_scale": 2.0},
    "timed over a link": {"timed": True, "link": True},
    "timed, fast": {"timed": True, "time_scale": 4.0, "step_time": 0.02, "link": True},
}


@pytest.fixture(scope="module")
def spec() -> SimulationSpec:
    """The default robot with sensors that take time, a lidar, a solid block, and velocities that time out."""
    spec = load_default().simulation
    sensors = tuple(
        replace(each, read_time={"u1": 0.05, "u2": 0.4, "g1": 0.01}.get(each.code, 0.0))
        for each in spec.sensors
    )
    lidar = LidarSpec(kind=Lidar, number=1, code="sc", rays=12, scan_rate=5.0)
    return replace(
        spec, sensors=(*sensors, lidar), velocity_timeout=1.5, block_solid=True, block_center=(66.0, 42.0)
    )


QUICK = ("instant", "timed", "timed on a slow computer", "timed, fast", "instant over a link, at a pace")
"""Modes that are quick: between them, each option. The last two are for the script that takes longest too."""


@pytest.mark.parametrize(
    ("script", "mode"),
    [
        pytest.param(
            script, mode, marks=[pytest.mark.slow] * (mode not in QUICK[3 * (script == "velocities") :])
        )
        for script in SCRIPTS
        for mode in MODES
    ],
)
def test_an_exchange_is_the_one_that_was_kept(
    script: str, mode: str, spec: SimulationSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    # However busy the machine is: all that there is to compute takes no slice of time, or each event does.
    monkeypatch.setattr(driving, "SLICE_SECONDS", -1.0 if "slow" in mode else math.inf)
    bench = Bench(spec, **MODES[mode])
    SCRIPTS[script](bench)
    assert_kept(bench.happened, KEPT, f"{script}, {mode}")
