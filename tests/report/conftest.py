"""Makes logs to report on."""

from __future__ import annotations

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
from simmer_tui.robot.link_delay import LinkDelay
from simmer_tui.run.events import Action, ActionName, Belief, Notice, NoticeKind
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import CommandResult, Pose, Simulator, parse_command
from tests.manual_loop import ManualLoop


@dataclass
class Run:
    """A run that is logged to `path`."""

    path: Path
    simulator: Simulator
    engine: Engine
    loop: ManualLoop
    answer_at_end: bool = True
    outcomes: list[CommandResult] = field(default_factory=list)

    def send(self, *texts: str) -> None:
        session = self.engine.session(answer_at_end=self.answer_at_end)
        for text in texts:
            session.submit(parse_command(text), self.outcomes.append)

    def stop(self) -> None:
        """The end of all motion, as packets ask for it."""
        stop = replace(parse_command("xx"), stops=True)
        self.engine.session().submit(stop, self.outcomes.append)

    def perform(self, name: ActionName, *arguments: float) -> None:
        self.engine.perform(Action(name, arguments))

    def believe(self, x: float, y: float = 0.0, turn: float = 0.0) -> None:
        pose = self.simulator.pose
        believed = Pose(pose.x + x, pose.y + y, pose.heading + turn)
        self.engine.tell(Belief(self.simulator.time, believed, pose, 0.5))


@pytest.fixture(scope="session")
def configuration() -> Configuration:
    return load_default()


@pytest.fixture
def start_run(tmp_path: Path, configuration: Configuration) -> Iterator[Callable[..., Run]]:
    """Starts a run with seed 7 that is logged to a new file."""
    logs = ExitStack()

    def start(
        name: str = "run.jsonl",
        *,
        timed: bool = False,
        answer_at_end: bool = True,
        link: LinkDelay | None = None,
        files: dict[str, str] | None = None,
        **changes: Any,
    ) -> Run:
        motion = replace(configuration.settings.motion, motion="timed" if timed else "instant")
        set_up = replace(
            configuration,
            settings=replace(configuration.settings, motion=motion),
            files={**configuration.files, **(files or {})},
        )
        simulator = Simulator(replace(configuration.simulation, **changes), 7)
        engine = Engine(simulator, timed=timed, link=link)
        loop = ManualLoop()
        if timed:
            engine.start(cast("Any", loop))
        clock = lambda: 1.7e9 + simulator.time  # noqa: E731
        engine.watch(logs.enter_context(RunLog(tmp_path / name, set_up, simulator, clock=clock)))
        return Run(tmp_path / name, simulator, engine, loop, answer_at_end)

    with logs:
        yield start


@pytest.fixture
def packets_run(start_run: Callable[..., Run]) -> Run:
    """A run in real time whose movements are answered as they begin."""
    return start_run(timed=True, answer_at_end=False)


@pytest.fixture
def eventful_log(start_run: Callable[..., Run]) -> Path:
    """A run with a contact, refused commands, hostile text, beliefs and a person's actions."""
    run = start_run()
    run.send("u1", "u2", "i1", "c1", "o3", "g1", "t1")
    for step in range(12):
        run.send("u1", "u3", "d1-2", "r1-5", "o3", "g1")
        run.believe(step * 1.0, 0.0, 2.0 * step)
    run.send("[bold]</b>", "<script>alert(1)</script>", "=cmd()", "d1-x")
    run.perform(ActionName.TELEPORT, 30.0, 42.0, 90.0)
    run.send("u1", "w1-3", "d1-40", "d1-40", "d1-40", "d1-40")
    run.engine.tell(Notice(NoticeKind.FAULT, "the <cable> [red]is[/red] out"))
    return run.path
