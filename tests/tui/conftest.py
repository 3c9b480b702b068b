"""A sample scene for everything that draws, and the app to fly through scenarios."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
import pytest
from textual.events import Key
from textual.pilot import Pilot
from textual.widgets import Input

from simmer_tui.client import Robot
from simmer_tui.config.loader import Override, load
from simmer_tui.config.sets import MISSION_SET, bundled_folder, bundled_sets, init_set
from simmer_tui.config.settings import KeySettings
from simmer_tui.live.server import Server
from simmer_tui.run.events import Event, MovementPlanned
from simmer_tui.run.mission import plan_run
from simmer_tui.sim.command import Command
from simmer_tui.sim.records import CommandResult, FloorPatch, Pose, RangeScan
from simmer_tui.sim.specs import MazeSpec, RobotSpec
from simmer_tui.tui.app import SimmerApp
from simmer_tui.tui.key_table import MazePane
from simmer_tui.tui.line_panel import LinePanel
from simmer_tui.tui.log_panel import LogPanel
from simmer_tui.tui.maze.scene import BeliefMark, Scene, SensorView
from simmer_tui.tui.terminal import ColorDepth, GlyphMode, TerminalChoice

KEYS = KeySettings()
"""Keys by default: a test presses them by their action."""


@pytest.fixture(scope="session")
def plain_scene() -> Scene:
    """Two by three cells with one wall on a floor of alternating tiles, and a round robot."""
    maze = MazeSpec(((1, 1, 0), (1, 1, 1)))
    floor = (np.indices((8, 12)).sum(axis=0) % 2).astype(np.uint8)
    return Scene(maze=maze, floor=floor, robot=RobotSpec.circle(6), pose=Pose(9.0, 9.0, 0.0))


@pytest.fixture(scope="session")
def full_scene(plain_scene: Scene) -> Scene:
    """The same with everything a scene can hold."""
    grid = np.array([(i, j) for i in range(-6, 7) for j in range(-6, 7) if i * i + j * j <= 36])
    points = np.array((20.0, 6.0)) + grid / 6 * 2.0
    return Scene(
        maze=plain_scene.maze,
        floor=plain_scene.floor,
        robot=plain_scene.robot,
        pose=plain_scene.pose,
        block_centre=(30.0, 6.0),
        block_heading=20.0,
        trail=(np.array([(4.0, 4.0), (6.0, 6.0), (9.0, 9.0)]),),
        views=(
            SensorView(RangeScan((12.0, 9.0), (-5.0, 0.0, 5.0), (24.0, 23.0, float("inf")))),
            SensorView(FloorPatch((20.0, 6.0), 2.0, points, points[:, 0] > 20)),
        ),
        contact=(9.0, 12.0),
        belief=BeliefMark(Pose(16.0, 16.0, 90.0), 4.0, np.array([(15.0, 15.0), (17.0, 18.0)])),
    )


class Cockpit:
    """The app around a server of its own, under a pilot."""

    def __init__(self, app: SimmerApp, pilot: Pilot[int], told: list[Event]) -> None:
        self.app = app
        self._told = told
        self.pilot = pilot
        self.server = app.server
        self._clients: list[Robot] = []

    def __getitem__(self, name: str) -> str:
        """The text of a panel: `robot`, `sensors`, `run`, `hint`, `log`."""
        if name == "log":
            return self.app.screen_stack[0].query_one(LogPanel).text
        return "\n".join(self.app.screen_stack[0].query_one(f"#{name}", LinePanel).lines)

    @property
    def line(self) -> str:
        """Text typed in the console."""
        return self.app.screen_stack[0].query_one("#line", Input).value

    @property
    def maze(self) -> MazePane:
        return self.app.screen_stack[0].query_one(MazePane)

    def commands(self, source: str) -> list[str]:
        """The commands of one source so far, in order, by what the robot has told."""
        return [command.shown for command in self.given if command.source == source]

    @property
    def given(self) -> list[Command]:
        """The commands so far, whoever gave them."""
        told = [each for each in self._told if isinstance(each, (CommandResult, MovementPlanned))]
        return list({each.number: each.command for each in told}.values())

    @property
    def is_drawn(self) -> bool:
        """True once the panels that there is room for have been drawn."""
        panels = [self.app.query_one(f"#{name}", LinePanel) for name in ("header", "robot")]
        return all(panel.lines or not panel.display for panel in panels)

    async def until(self, condition: Callable[[], object]) -> None:
        """Let the app go on until a condition holds."""
        # By time, not by turns: on a busy machine a thread that computes an answer gets none of many.
        most = time.monotonic() + 60.0
        while not condition():
            if time.monotonic() > most:
                raise AssertionError(f"it never came: {self['robot']}\n{self['hint']}\n{self['log']}")
            await self.pilot.pause()

    async def type(self, line: str) -> None:
        """Give a line in the console, whatever has the focus."""
        console = self.app.screen_stack[0].query_one("#line", Input)
        console.focus()
        console.value = line
        await self.pilot.press("enter")

    async def press(self, *keys: str) -> None:
        """Press keys while the maze has the focus."""
        self.maze.focus()
        await self.pilot.pause()
        await self.pilot.press(*keys)

    def burst(self, keys: Iterable[str]) -> None:
        """Keys as a terminal delivers them at once: all are in the app's queue before any is looked at."""
        for key in keys:
            is_sign = len(key) == 1
            self.app.post_message(Key({":": "colon", "/": "slash"}.get(key, key), key if is_sign else None))

    def client(self) -> Robot:
        """A program's connection; closed at the end."""
        ports = self.server.ports
        robot = Robot("127.0.0.1", ports["commands"], ports["replies"], belief_port=ports["beliefs"])
        self._clients.append(robot)
        return robot

    def close(self) -> None:
        for robot in self._clients:
            robot.close()


Scenario = Callable[[Cockpit], Awaitable[None]]


@pytest.fixture
def fly(tmp_path: Path) -> Callable[..., int | None]:
    """Runs the app through a scenario and returns what the app returned. Options are settings by dotted
    name (`motion__motion="timed"`), `files` replace those of the default set. A `mission` has a set of its
    own."""

    def run(
        scenario: Scenario,
        size: tuple[int, int] = (120, 36),
        glyphs: GlyphMode = GlyphMode.QUADRANT,
        history: Path | None = None,
        files: Mapping[str, str] | None = None,
        mission: bool = False,
        **options: object,
    ) -> int | None:
        given: dict[str, object] = {"seed": 5, "server__port": 0, "screen__fps": 20} | options
        overrides = {name.replace("__", "."): Override(f"--{name}", value) for name, value in given.items()}
        directory = bundled_folder()
        if files:
            directory = tmp_path / "set"
            init_set(directory, bundled_folder())
            for name, text in files.items():
                (directory / name).parent.mkdir(exist_ok=True)
                (directory / name).write_text(text, encoding="utf-8")
        configuration, plan = load(directory, overrides), None
        if mission:
            configuration, plan = plan_run(load(bundled_sets()[MISSION_SET], overrides))
        server = Server(configuration, plan=plan)
        server.keep_verdict(has_program=False)
        server.record()
        told: list[Event] = []
        server.engine.watch(told.append)
        server.start()
        depth = ColorDepth.NONE if glyphs is GlyphMode.ASCII else ColorDepth.TRUECOLOR
        app = SimmerApp(server, TerminalChoice(depth, glyphs), history or tmp_path / "history.txt")

        async def play() -> None:
            async with app.run_test(size=size, notifications=True) as pilot:
                cockpit = Cockpit(app, pilot, told)
                try:
                    await cockpit.until(lambda: app.frames > 0 and cockpit.is_drawn)
                    await scenario(cockpit)
                finally:
                    cockpit.close()

        try:
            asyncio.run(play())
        finally:
            server.stop()
        return app.return_value

    return run
