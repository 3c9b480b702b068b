"""The replay screen: a logged run, its clock, and the keys that move about in it."""

from __future__ import annotations

import asyncio
import gc
import warnings
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path

import pytest
from textual.pilot import Pilot

from simmer_tui.config import load_default
from simmer_tui.live.snapshot import EventFeed
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import (
    Action,
    ActionName,
    Belief,
    Goal,
    MissionEvent,
    OutputLine,
    ProgramEnded,
    Result,
)
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.log_records import BrokenLine, MissionRecord
from simmer_tui.runlog.playback import LOOK_BACK, Playback
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Pose, Simulator, parse_command
from simmer_tui.tui.event_text import entry_line
from simmer_tui.tui.line_panel import LinePanel, text_of
from simmer_tui.tui.log_panel import LogPanel
from simmer_tui.tui.maze.view import MazeView
from simmer_tui.tui.recorded import RecordedRun, TimelineMarkKind
from simmer_tui.tui.replay import ReplayApp, Timeline, bar_line, marks_line, seconds_of
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


def events(app: ReplayApp) -> list[str]:
    return app.query_one(LogPanel).text.splitlines()


async def shows(pilot: Pilot[int], app: ReplayApp, name: str, text: str) -> None:
    """Let the app go on until a panel has a text."""
    await until(pilot, lambda: any(text in line for line in lines(app, name)))


@pytest.mark.slow
def test_it_begins_before_the_first_command(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        assert (app.run_shown.entry, app.run_shown.elapsed) == (-1, 0.0)
        await shows(pilot, app, "robot", "pose     9.5, 42.0 in  0 deg")
        assert app.query_one(MazeView).fault == ""
        await shows(pilot, app, "header", "stopped")
        await shows(pilot, app, "console-head", "X contact   ◆ goal   ‖ pause")

    play(run, act)


@pytest.mark.slow
def test_stepping_shows_each_command_with_reading_truth_and_pose(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("n")
        await until(pilot, lambda: any("u1" in line for line in events(app)))
        await until(pilot, lambda: any("35.5" in line.split() for line in lines(app, "sensors")))
        scene = app.query_one(MazeView).scene
        assert scene is not None
        assert len(scene.views) == 1
        await pilot.press("n")
        await until(pilot, lambda: events(app)[-1].split()[1:3] == ["d1-3", "forward"])
        assert app.run_shown.elapsed == pytest.approx(0.5)
        await pilot.press("N")
        assert app.run_shown.entry == 0
        await until(pilot, lambda: not any("forward" in line for line in events(app)))

    play(run, act)


@pytest.mark.slow
def test_contacts_and_refused_commands_are_found(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("c")
        await until(pilot, lambda: any("w1-20" in line and "contact left" in line for line in events(app)))
        await shows(pilot, app, "robot", "contacts 1")
        await pilot.press("c")
        await until(pilot, lambda: "r1-90" in events(app)[-1])
        assert "touched the wall left" in events(app)[-1], "turning at a wall touches it"
        await pilot.press("c")
        assert app.run_shown.entry == 9, "there is no further contact"
        await pilot.press("C", "X")
        await until(pilot, lambda: "zz" in events(app)[-1])
        await pilot.press("x")
        assert app.run_shown.entry == 11
        await until(pilot, lambda: "[red]x[/red]" in events(app)[-1])  # markup is shown, not followed

    play(run, act)


@pytest.mark.slow
def test_belief_and_its_error_are_shown_at_the_end(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("end")
        await shows(pilot, app, "robot", "belief   off 34.5 in 80 deg, lost")
        scene = app.query_one(MazeView).scene
        assert scene is not None
        assert scene.belief is not None
        assert scene.pose == Pose(6.0, 6.0, 0.0)
        await pilot.press("home")
        assert app.run_shown.entry == -1

    play(run, act)


@pytest.mark.slow
def test_playing_moves_the_robot_and_stops_at_the_end(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        for _ in range(10):
            await pilot.press("right_square_bracket")
        await shows(pilot, app, "console", "16x")
        await pilot.press("space")
        await until(pilot, lambda: app.run_shown.elapsed > 0)
        await until(pilot, lambda: app.run_shown.elapsed == app.run_shown.duration)
        await pilot.press(*["left_square_bracket"] * 5, "space")
        await until(pilot, lambda: 0 < app.run_shown.elapsed < app.run_shown.duration)
        await pilot.press("space")
        stood = app.run_shown.elapsed
        await pilot.pause()
        assert app.run_shown.elapsed == stood

    play(run, act)


@pytest.mark.slow
def test_a_time_typed_is_gone_to_and_nonsense_is_refused(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("g", *"0:01", "enter")
        assert app.run_shown.elapsed == 1.0
        await pilot.press("right", "shift+left")
        assert app.run_shown.elapsed == 0.0
        await pilot.press("g", *"soon", "enter")
        assert app.run_shown.elapsed == 0.0
        await pilot.press("n")
        assert app.run_shown.entry >= 0, "the keys work again after the question"

    play(run, act)


@pytest.mark.slow
def test_a_click_on_the_bar_goes_there(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        width = app.query_one(Timeline).size.width
        await pilot.click("#console", offset=(width - 20, 1))
        await until(pilot, lambda: app.run_shown.elapsed > app.run_shown.duration / 2)

    play(run, act)


@pytest.mark.slow
def test_toggles_zoom_and_help(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("n", "r", "y")
        view = app.query_one(MazeView)
        await until(pilot, lambda: view.scene is not None and "trail" not in view.scene.shown)
        assert view.scene is not None
        assert "plot_sense" not in view.scene.shown
        zoom = view.zoom
        await pilot.press("plus")
        assert view.zoom > zoom
        await pilot.press("f", "question_mark")
        assert len(app.screen_stack) == 2
        await pilot.press("escape")
        assert len(app.screen_stack) == 1

    play(run, act)


@pytest.mark.slow
def test_t_takes_over_where_the_replay_stands(run: Run) -> None:
    ended: list[ReplayApp] = []

    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("n", "n", "t")
        await until(pilot, lambda: app.taken_over is not None)
        ended.append(app)

    play(run, act)
    chosen = ended[0].taken_over
    assert chosen is not None
    assert (chosen.path, chosen.moment.line, chosen.moment.elapsed) == (run.path, 4, 0.5)


def test_after_a_jump_the_route_is_known_since_the_start(tmp_path: Path) -> None:
    made = Run(tmp_path / "long.jsonl")
    made.give("d1-3", "r1-90", *["u1"] * 2 * LOOK_BACK, "d1-2")
    made.log.close()
    with RunLogIndex(made.path) as log:
        shown = RecordedRun(log)
        for entry in (log.count - 1, log.count - 3, log.count - 1):
            shown.stand_at(entry)
            route = asyncio.run(shown.snapshot(0, True)).route
        assert route.pieces[0][0, :2].tolist() == [9.5, 42.0]
        pose = made.engine.simulator.pose
        assert route.pieces[-1][-1, :2] == pytest.approx((pose.x, pose.y))


def test_what_is_asked_twice_at_once_is_done_once_and_without_a_warning(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("n")
        with warnings.catch_warnings(record=True) as warned:
            app.action_take_over()
            app.action_take_over()
            await until(pilot, lambda: app.taken_over is not None)
            gc.collect()
        assert not [str(each.message) for each in warned]

    play(run, act)


@pytest.mark.slow
def test_a_log_that_comes_out_otherwise_is_not_taken_over(run: Run) -> None:
    lines = run.path.read_text().splitlines(keepends=True)
    run.path.write_text("".join((*lines[:1], *lines[2:])))  # the first command is missing

    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("n", "t")
        await until(pilot, lambda: "command number 1 is missing" in answer(app))
        assert app.taken_over is None
        assert app.is_running

    play(run, act)


def answer(app: ReplayApp) -> str:
    """Text of the answer, its wrapped lines joined."""
    return " ".join(line.strip() for line in lines(app, "answer"))


@pytest.mark.slow
def test_the_end_of_a_failed_run_has_the_cause_that_the_live_screen_had(run: Run) -> None:
    stderr = (OutputLine(1.0, "ValueError: no way on"),)
    end = ProgramEnded(
        run.engine.simulator.time, exit_code=1, error="ValueError: no way on", place="way.py:7", stderr=stderr
    )
    run.engine.tell(end)

    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("end")
        await shows(pilot, app, "header", "PROGRAM CRASHED   ValueError: no way on")
        assert "way.py:7" in answer(app)
        await pilot.press("home")
        await until(pilot, lambda: "CRASHED" not in "".join(lines(app, "header")))
        assert "ValueError" not in answer(app), "the end is not told before it comes"

    play(run, act)


@pytest.mark.slow
def test_a_log_still_written_is_followed(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        index = app.run_shown.index
        await until(pilot, lambda: app.run_shown.entry == index.count - 1)
        run.give("d1-2")
        await until(pilot, lambda: any("d1-2" in line for line in events(app)))
        await pilot.press("home")
        run.give("u3")
        count = index.count
        await until(pilot, lambda: index.count > count)
        assert app.run_shown.entry == -1, "who has gone back stays there"

    play(run, act, follow=True)


@pytest.mark.slow
def test_a_torn_last_line_is_noted(run: Run) -> None:
    run.path.write_bytes(run.path.read_bytes()[:-20])

    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await shows(pilot, app, "console", app.run_shown.index.note[:10])

    play(run, act)


@pytest.mark.slow
def test_small_screens_show_all_in_brief_and_have_pages(run: Run) -> None:
    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        assert app.query_one(MazeView).size.height >= 18
        await shows(pilot, app, "keys", "F2 sensors")
        await pilot.press("4")
        await until(pilot, lambda: app.query_one(LogPanel).size.height > 15)
        await shows(pilot, app, "console", "00:00.0 /")
        await pilot.resize_terminal(140, 40)
        await until(pilot, lambda: bool(app.query_one("#run").region.area))

    play(run, act, size=(80, 24))


def test_live_run_and_replay_say_the_same_of_the_same_events(run: Run) -> None:
    """The same words, whether the events come from the engine or from the log."""
    reducer = Reducer(checkpoint_of(Simulator(load_default().simulation, 5)))
    feed = EventFeed()
    with RunLogIndex(run.path) as log:
        for told in Playback(log).events(0, 100):
            assert not isinstance(told, BrokenLine)
            reducer.apply(told.event)
            feed.take(reducer, 0.0, told.event)
    live = [text_of(entry_line(entry)).rstrip() for entry in feed.since(0)]

    async def act(app: ReplayApp, pilot: Pilot[int]) -> None:
        await pilot.press("end")
        shown = [line for line in events(app) if not line.startswith("  ")]
        await until(pilot, lambda: len(events(app)) > 5)
        shown = [line for line in events(app) if not line.startswith("  ")]
        assert shown == live

    play(run, act)


def marked(run: RecordedRun, width: int) -> str:
    return text_of(marks_line(run, "", width, plain=True)).strip()


def test_marks_stand_above_the_bar_and_are_jumped_to(run: Run) -> None:
    run.engine.perform(Action(ActionName.PAUSE))
    with RunLogIndex(run.path) as log:
        recorded = RecordedRun(log)
        kinds = [mark.kind for mark in recorded.marks]
        assert kinds == [TimelineMarkKind.CONTACT, TimelineMarkKind.CONTACT, TimelineMarkKind.PAUSE]
        assert set(marked(recorded, 100)) <= {"X", "|", " "}
        assert marked(recorded, 100).startswith("X")
        note = "line 37, the last, is cut off and was skipped"
        assert text_of(marks_line(recorded, note, 100, plain=True)).startswith(" line 37, the last, is cu… ")
        first = recorded.marks[0]
        assert recorded.mark_from(TimelineMarkKind.CONTACT, 1) == first.entry
        recorded.stand_at(first.entry)
        assert recorded.elapsed == first.elapsed
        assert recorded.mark_from(TimelineMarkKind.CONTACT, -1) is None
        assert recorded.mark_from(TimelineMarkKind.GOAL, 1) is None


def test_only_the_goals_of_a_mission_are_marked_as_goals(run: Run) -> None:
    """Not its beginning, and not its failure."""
    for subject in (Result.UNDER_WAY, Goal.REACHED, Result.FAILED):
        run.engine.tell(MissionEvent(run.engine.simulator.time, subject, f"mission: {subject}", "late"))
    with RunLogIndex(run.path) as log:
        recorded = RecordedRun(log)
        (goal,) = (mark for mark in recorded.marks if mark.kind is TimelineMarkKind.GOAL)
        line = log.record(goal.entry)
        assert isinstance(line, MissionRecord)
        assert line.goal is Goal.REACHED


@pytest.mark.parametrize(("text", "seconds"), [("95", 95), ("1:35", 95), (" 0.5 ", 0.5), ("0:00.25", 0.25)])
def test_times_are_read(text: str, seconds: float) -> None:
    assert seconds_of(text) == seconds


@pytest.mark.parametrize("text", ["", "x", "1:2:3", "-5", "nan", "inf", "1e400"])
def test_what_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is not a time"):
        seconds_of(text)


def test_the_bar_fits_its_width(run: Run) -> None:
    with RunLogIndex(run.path) as log:
        recorded = RecordedRun(log)
        recorded.stand_at(3)
        for width in range(1, 120):
            for plain in (True, False):
                assert len(text_of(bar_line(recorded, width, plain=plain))) <= max(width, 40)
                assert len(text_of(marks_line(recorded, "a note", width, plain=plain))) <= max(width, 40)
