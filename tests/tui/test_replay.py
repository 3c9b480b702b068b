"""The replay screen: a logged run, its clock, and the keys that move about in it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path

import pytest
from simmer_tui.tui.replay_readouts import clock, replay_line, scrubber
from textual.pilot import Pilot

from simmer_tui.config import load_default
from simmer_tui.engine import Engine
from simmer_tui.events import Action, ActionName, Belief
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.playback import Playback
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Pose, Simulator, parse_command
from simmer_tui.tui.line_panel import LinePanel, text_of
from simmer_tui.tui.maze.view import MazeView
from simmer_tui.tui.recorded import RecordedRun
from simmer_tui.tui.replay import ReplayApp, seconds_of
from simmer_tui.tui.terminal import ColorDepth, GlyphMode, TerminalChoice

CHOICE = TerminalChoice(ColorDepth.TRUECOLOR, GlyphMode.QUADRANT)
COMMANDS = ("u1", "d1-3", "u1", "zz", "w1-20", "u2", "r1-90", "t1", "[red]x[/red]")


class Run:
    """A run that goes on being logged as long as commands are given."""

    def __init__(self, path: Path) -> None:
        configuration = load_default()
        self.path = path
        self.engine = Engine(Simulator(configuration.simulation, 5))
        self.log = RunLog(path, configuration, self.engine.simulator)
        self.engine.watch(self.log)
        self._session = self.engine.session()

    def give(self, *commands: str) -> None:
        for command in commands:
            self._session.submit(parse_command(command), lambda outcome: None)


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    made = Run(tmp_path / "run.jsonl")
    made.give(*COMMANDS)
    made.engine.perform(Action(ActionName.TELEPORT, (6.0, 6.0, 0.0)))
    pose = made.engine.simulator.pose
    made.engine.tell(Belief(made.engine.simulator.time, Pose(12, 40, 80), pose, 2.0, ((12, 40), (13, 41))))
    yield made
    made.log.close()


Act = Callable[[ReplayApp, Pilot[int]], Awaitable[None]]


def play(run: Run, act: Act, *, size: tuple[int, int] = (120, 36), follow: bool = False) -> None:
    """Run the app on a log, do `act`, and end it."""

    async def main() -> None:
        with RunLogIndex(run.path) as log:
            app = ReplayApp(RecordedRun(log), CHOICE, follow=follow)
            async with app.run_test(size=size) as pilot:
                await pilot.pause()
                await act(app, pilot)

    asyncio.run(main())


async def until(pilot: Pilot[int], condition: Callable[[], bool]) -> None:
    for _ in range(500):
        if condition():
            return
        await pilot.pause(0.01)
    raise AssertionError("the screen never came to show it")


def lines(app: ReplayApp, name: str) -> list[str]:
    return app.query_one(f"#{name}", LinePanel).lines


def test_it_begins_before_the_first_command(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        assert (app.entry, app.elapsed) == (-1, 0.0)
        assert lines(app, "robot")[0] == "pose     (9.50, 42.00) in, 0.0 deg"
        assert app.query_one(MazeView).fault == ""

    play(run, act)


def test_stepping_shows_each_command_with_reading_truth_and_pose(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("n")
        assert any(line.startswith("> ") and "u1" in line for line in lines(app, "entries"))
        row = lines(app, "sensors")[0]
        assert row.startswith(">u1 ultra1")
        assert "35.50" in row, "the true value"
        scene = app.query_one(MazeView).scene
        assert scene is not None
        assert len(scene.views) == 1
        await pilot.press("n")
        assert "last     d1-3" in "".join(lines(app, "robot"))
        assert app.elapsed == pytest.approx(0.5)
        await pilot.press("N")
        assert app.entry == 0

    play(run, act)


def test_contacts_and_bad_commands_are_found(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("c")
        assert "w1-20" in lines(app, "robot")[2]
        assert any(line.endswith(", 1 contact") for line in lines(app, "robot"))
        await pilot.press("c")
        assert "r1-90" in lines(app, "robot")[2], "turning at a wall touches it"
        await pilot.press("c")
        assert app.entry == 6, "there is no further contact"
        await pilot.press("C", "X")
        assert "zz" in lines(app, "robot")[2]
        await pilot.press("x")
        assert app.entry == 8
        assert any("[red]x[/red]" in line for line in lines(app, "entries")), "markup is shown, not followed"

    play(run, act)


def test_belief_and_its_error_are_shown_at_the_end(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("end")
        assert any(line.startswith("believed (12.00, 40.00) in, 80.0 deg") for line in lines(app, "robot"))
        scene = app.query_one(MazeView).scene
        assert scene is not None
        assert scene.belief is not None
        assert scene.pose == Pose(6.0, 6.0, 0.0)
        await pilot.press("home")
        assert app.entry == -1

    play(run, act)


def test_playing_moves_the_robot_and_stops_at_the_end(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        for _ in range(10):
            await pilot.press("right_square_bracket")
        assert "16x" in lines(app, "scrubber")[0]
        await pilot.press("space")
        await until(pilot, lambda: app.elapsed > 0)
        await until(pilot, lambda: app.elapsed == app.log_index.duration)
        await pilot.press("space")
        await until(pilot, lambda: 0 < app.elapsed < app.log_index.duration)
        await pilot.press("space")
        stood = app.elapsed
        await pilot.pause()
        assert app.elapsed == stood

    play(run, act)


def test_a_time_typed_is_gone_to_and_nonsense_is_refused(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("g", *"0:01", "enter")
        assert app.elapsed == 1.0
        await pilot.press("right", "shift+left")
        assert app.elapsed == 0.0
        await pilot.press("g", *"soon", "enter")
        assert app.elapsed == 0.0
        await pilot.press("n")
        assert app.entry >= 0, "the keys work again after the question"

    play(run, act)


def test_toggles_zoom_and_help(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("n", "t", "y")
        view = app.query_one(MazeView)
        assert view.scene is not None
        assert not view.scene.show_trail
        assert not view.scene.show_rays
        await pilot.press("plus")
        assert view.zoom == 10
        await pilot.press("f", "question_mark")
        assert len(app.screen_stack) == 2
        await pilot.press("escape")
        assert len(app.screen_stack) == 1

    play(run, act)


def test_a_log_still_written_is_followed(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        assert app.entry == app.log_index.count - 1
        run.give("d1-2")
        await until(pilot, lambda: any("d1-2" in line for line in lines(app, "entries")))
        await pilot.press("home")
        run.give("u3")
        count = app.log_index.count
        await until(pilot, lambda: app.log_index.count > count)
        assert app.entry == -1, "who has gone back stays there"

    play(run, act, follow=True)


def test_a_torn_last_line_is_noted(run: Run) -> None:
    run.path.write_bytes(run.path.read_bytes()[:-20])

    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        assert len(lines(app, "scrubber")) == 2

    play(run, act)


def test_small_screens_show_the_maze_and_the_clock(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        assert app.query_one(MazeView).size.height >= 18
        assert not app.query_one("#side").display
        await pilot.resize_terminal(140, 40)
        await until(pilot, lambda: app.query_one("#side").display)

    play(run, act, size=(80, 24))


@pytest.mark.parametrize(("text", "seconds"), [("95", 95), ("1:35", 95), (" 0.5 ", 0.5), ("0:00.25", 0.25)])
def test_times_are_read(text: str, seconds: float) -> None:
    assert seconds_of(text) == seconds


@pytest.mark.parametrize("text", ["", "x", "1:2:3", "-5", "nan", "inf", "1e400"])
def test_what_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is not a time"):
        seconds_of(text)


def test_clock_shows_minutes() -> None:
    assert clock(95.254) == "1:35.25"
    assert clock(0) == "0:00.00"


def test_scrubber_fits_its_width(run: Run) -> None:
    with RunLogIndex(run.path) as log:
        for width in range(1, 120):
            for plain in (True, False):
                line = scrubber(log, 3, 1.0, speed=4, playing=True, width=width, plain=plain)
                assert len(text_of(line)) <= max(width, 40)
        [told] = Playback(log).events(3, 4)
        assert "zz" in text_of(replay_line(told))
