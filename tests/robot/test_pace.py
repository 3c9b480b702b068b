"""Looking slowly changes nothing: what is shown, when answers come, and that they are the same ones."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from simmer_tui.config import load_default
from simmer_tui.config.loader import Override, load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.live.server import Server
from simmer_tui.live.snapshot import Recorder, Snapshot
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.playback_throttle import LONGEST_SHOWN, MOST_LATE, PlaybackThrottle
from simmer_tui.robot.sessions import Session
from simmer_tui.run.events import Action, ActionName, Event, MovementEnded, Notice, NoticeKind
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.runlog.rerun import Rerun
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import CommandResult, Simulator, parse_command
from simmer_tui.sim.command import Command
from tests.stepped_clock import Clock

PACES = (0.0, 0.25, 4.0, 400.0)


@dataclass
class Watched:
    """A run that is logged, and shown at a pace."""

    clock: Clock
    pace: float
    log: Path
    timed: bool = False
    step_time: float = 0.0
    told: list[Event] = field(default_factory=list)
    shown: list[Event] = field(default_factory=list)
    answers: list[tuple[float, str, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        configuration = load_default()
        self.simulator = Simulator(configuration.simulation, 7)
        self.simulator.advance(12.5)
        self.engine = Engine(self.simulator, timed=self.timed, step_time=self.step_time)
        self.began = self.clock.time()
        self.engine.watch(RunLog(self.log, configuration, self.simulator, clock=lambda: 0.0))
        self.engine.watch(self.told.append)
        self.throttle: PlaybackThrottle = self.engine.paced(self.clock, self.pace)
        self.throttle.watchers.add(self.shown.append)
        reducer = Reducer(checkpoint_of(self.simulator))
        self.recorder = Recorder(self.engine, reducer)
        self.throttle.watchers.add(self.recorder.apply)
        self.engine.start(self.clock)

    def session(self) -> Session:
        return self.engine.session()

    def send(self, session: Session, *texts: str) -> None:
        for text in texts:
            command = Command("xx", "xx", stops=True) if text == "xx" else parse_command(text)
            session.submit(command, self._note)

    def _note(self, outcome: CommandResult) -> None:
        when = round(self.clock.time() - self.began, 6)
        self.answers.append((when, outcome.command.text, outcome.reply))

    def act(self, name: ActionName, *arguments: float) -> None:
        self.engine.perform(Action(name, arguments))

    @property
    def snapshot(self) -> Snapshot:
        return self.recorder.snapshot()

    @property
    def answered(self) -> list[tuple[float, str]]:
        return [(when, text) for when, text, _ in self.answers]


@pytest.fixture
def watched(clock: Clock, tmp_path: Path) -> Watched:
    return Watched(clock, 4.0, tmp_path / "run.jsonl")


def test_an_answer_comes_when_its_way_has_passed(watched: Watched) -> None:
    watched.send(watched.session(), "d1-8", "u1")  # 8 in at 10 in/s
    took = watched.simulator.time - 12.5
    assert took > 0.4
    assert watched.answers == []
    watched.clock.pass_by(took / 4 - 0.01)
    assert watched.answers == []
    watched.clock.pass_by(0.02)
    assert watched.answered == [
        (pytest.approx(took / 4, abs=1e-6), "d1-8"),
        (pytest.approx(took / 4, abs=1e-6), "u1"),
    ]


def test_readings_of_others_do_not_wait(watched: Watched) -> None:
    watched.send(watched.session(), "d1-8")
    watched.send(watched.session(), "u1")
    assert [text for _, text in watched.answered] == ["u1"]


def test_no_movement_is_shown_for_longer_than_two_seconds(watched: Watched) -> None:
    watched.throttle.pace = 0.125
    watched.send(watched.session(), "d1-10")
    watched.clock.pass_by(LONGEST_SHOWN + 0.001)
    assert watched.answered == [(LONGEST_SHOWN, "d1-10")]


def test_what_was_sent_ahead_is_shown_in_order_and_ever_faster(watched: Watched) -> None:
    watched.throttle.pace = 0.125
    watched.send(watched.session(), *["r1-90"] * 20)
    watched.clock.pass_by(20.0)
    times = [when for when, _ in watched.answered]
    lengths = [after - before for before, after in zip([0.0, *times], times, strict=False)]
    assert len(times) == 20
    assert lengths[0] == pytest.approx(2.0)
    assert lengths == sorted(lengths, reverse=True)
    assert times[-1] < 8.0


def test_the_picture_follows_the_way(watched: Watched) -> None:
    before = watched.simulator.pose
    watched.send(watched.session(), "d1-8")
    took, end = watched.simulator.time - 12.5, watched.simulator.pose
    assert (watched.snapshot.state.pose.x, watched.snapshot.state.pose.y) == (before.x, before.y)
    watched.clock.pass_by(took / 8)
    half = watched.snapshot
    assert half.state.moving
    assert half.state.time == pytest.approx(12.5 + took / 2)
    assert half.state.pose.x == pytest.approx((before.x + end.x) / 2, abs=0.1)
    assert half.state.path[-1, :2].tolist() == [half.state.pose.x, half.state.pose.y]
    assert watched.throttle.busy
    watched.clock.pass_by(took / 8 + 0.001)
    assert watched.snapshot.state.pose == end
    assert not watched.snapshot.state.moving
    assert not watched.throttle.busy
    assert isinstance(watched.shown[-2], MovementEnded)


def test_a_contact_is_shown_when_the_robot_gets_there(watched: Watched) -> None:
    watched.send(watched.session(), "w1-30")
    watched.clock.pass_by(0.001)
    assert watched.snapshot.state.contact is None
    assert watched.snapshot.state.contacts == 0
    watched.clock.pass_by(3.0)
    assert watched.snapshot.state.contact is not None
    assert watched.snapshot.state.contacts == 1


def test_an_intervention_shows_the_present_at_once(watched: Watched) -> None:
    watched.send(watched.session(), "d1-8", "r1-30", "d1-2")
    watched.clock.pass_by(0.1)
    watched.act(ActionName.TELEPORT, 9.5, 42.0, 0.0)
    assert [text for _, text in watched.answered] == ["d1-8", "r1-30", "d1-2"]
    assert watched.snapshot.state.pose == watched.simulator.pose
    watched.send(watched.session(), "d1-8", "xx")
    assert [text for _, text in watched.answered][3:] == ["d1-8", "xx"]
    assert not watched.throttle.busy


def test_as_fast_as_possible_holds_at_once(watched: Watched) -> None:
    watched.send(watched.session(), "d1-8")
    watched.throttle.pace = 0.0
    watched.throttle.catch_up()
    watched.send(watched.session(), "d1--8")
    assert [text for _, text in watched.answered] == ["d1-8", "d1--8"]


def test_a_flood_is_not_kept_to_be_watched(watched: Watched) -> None:
    watched.send(watched.session(), "d1-8")
    flood = watched.session()
    while watched.throttle.busy:
        watched.engine.tell(Notice(NoticeKind.PROGRAM, "tick"))
        watched.send(flood, "c1")
        assert len(watched.shown) < 10 or not watched.throttle.busy
        assert len(watched.told) <= MOST_LATE + 10
    assert watched.shown == watched.told


def test_an_answer_nobody_waits_for_any_more_is_dropped(watched: Watched) -> None:
    session = watched.session()
    watched.send(session, "d1-8", "u1")
    session.close()
    watched.clock.pass_by(5.0)
    assert watched.answers == []


def test_timed_motion_has_no_pace(clock: Clock, tmp_path: Path) -> None:
    watched = Watched(clock, 4.0, tmp_path / "run.jsonl", timed=True)
    watched.send(watched.session(), "r1-12")
    clock.pass_by(12 / 120 + 20)
    assert watched.throttle.pace == 0.0
    assert watched.answered[0][0] > 0.09


def play(watched: Watched, step: float) -> None:
    """A program that waits for answers, one that sends ahead, and people who intervene."""
    program, console = watched.session(), watched.session()

    def wait() -> None:
        watched.clock.pass_by(step)

    def finish() -> None:
        watched.clock.pass_by(30.0)

    for text in ("u1", "d1-9", "u1", "r1-33", "o1", "w1-30"):
        watched.send(program, text)
        wait()
        watched.send(console, "u3", "zz")
        finish()
    watched.send(program, "d1-4", "i1", "s1-2", "u1", "d1-3")
    wait()
    watched.send(console, "g1", "d1-1")
    watched.send(program, "r1-5", "xx", "u2", "d1-2")
    wait()
    for name, arguments in (
        (ActionName.STOP, ()),
        (ActionName.TELEPORT, (9.5, 42.0, 30.0)),
        (ActionName.TELEPORT, (0.0, 0.0, 0.0)),
        (ActionName.PAUSE, ()),
        (ActionName.RESUME, ()),
        (ActionName.RESET, ()),
        (ActionName.SEED, (9.0,)),
    ):
        watched.send(program, "d1-6", "u1", "r1-20")
        wait()
        watched.act(name, *arguments)
        watched.send(console, "o2", "xx")
        finish()


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("step_time", [0.0, 0.5])
def test_the_pace_changes_no_event_no_answer_and_no_line_of_the_log(tmp_path: Path, step_time: float) -> None:
    runs = []
    for pace in PACES:
        clock = Clock()
        watched = Watched(clock, pace, tmp_path / f"{pace:g}.jsonl", step_time=step_time)
        # A pause before replies makes what comes meanwhile depend on when it comes: all wait for it.
        play(watched, 30.0 if step_time else 0.01)
        clock.close()
        assert watched.shown == watched.told, "what is shown is what happened, in the same order"
        runs.append(watched)
    first, *others = runs
    logs = [run.log.read_text().splitlines()[1:] for run in runs]
    assert len(logs[0]) > 70
    for run, log in zip(others, logs[1:], strict=True):
        assert log == logs[0]
        by_reply = sorted((text, repr(reply)) for _, text, reply in run.answers)
        assert by_reply == sorted((text, repr(reply)) for _, text, reply in first.answers)


def test_a_run_that_was_watched_can_be_run_again(clock: Clock, tmp_path: Path) -> None:
    watched = Watched(clock, 4.0, tmp_path / "run.jsonl")
    play(watched, 0.05)
    with Rerun(watched.log) as rerun:
        for _ in rerun.steps():
            pass
        assert rerun.difference is None
        assert rerun.commands > 60


def test_a_program_gets_its_replies_from_a_server_that_shows_movements() -> None:
    import socket

    replies = []
    for pace in (None, 1024.0):
        overrides = {"server.port": Override("--port", 0), "seed": Override("--seed", 4)}
        server = Server(load(bundled_folder(), overrides))
        if pace is not None:
            server.record(pace)
        server.start()
        try:
            with socket.create_connection(("127.0.0.1", server.ports["commands"])) as client:
                client.sendall(b"d1-3\nu1\nr1-40\no1\nxx\nu2\n")
                data = b""
                while len(data) < 48:
                    data += client.recv(48)
            replies.append(data)
        finally:
            server.stop()
    assert replies[0] == replies[1]
