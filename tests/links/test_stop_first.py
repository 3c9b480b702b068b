"""Order on the way to a real robot and back: stops go first, whatever waits; at most one movement is
unanswered; the client has its answer after the watchers."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Sequence

import pytest

from simmer_tui.config.loader import load
from simmer_tui.config.reply_formats import ReplyForm, ReplyFormat
from simmer_tui.config.sets import bundled_folder
from simmer_tui.config.settings import SerialSettings
from simmer_tui.links.backend import MOST_COMMANDS, BackendSwitch, CommandBudget, Message
from simmer_tui.links.serial_bridge import ANSWER_MARGIN, SerialBridge
from simmer_tui.links.serial_link import LinkListener
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.sessions import Session
from simmer_tui.run.events import Action, ActionName, Notice, NoticeKind, TwinReading
from simmer_tui.sim import CommandResult, Simulator, Status, parse_command
from tests.links.recording import until

TEXT = ReplyForm(ReplyFormat.TEXT)
MUTE = SerialSettings(port="robot", timeout=0.02)


class MuteRobot:
    """A way to a robot that takes everything and answers nothing, unless told to."""

    name = "robot"
    restarts_board = False

    def __init__(self) -> None:
        self.heard: list[bytes] = []
        self.listener: LinkListener | None = None

    def start(self, listener: LinkListener) -> None:
        self.listener = listener
        listener.opened()

    def write(self, data: bytes) -> None:
        self.heard.append(data)

    def write_instead(self, data: bytes) -> list[bytes]:
        self.write(data)
        return []

    def close(self) -> None:
        self.listener = None


class Rig:
    """The bridge to a mute robot, and programs that send to it."""

    def __init__(self, settings: SerialSettings) -> None:
        self.robot = MuteRobot()
        self.loop = asyncio.get_running_loop()
        self.engine = Engine(Simulator(load(bundled_folder()).simulation, seed=1))
        self.engine.start(self.loop)
        self.told: list[object] = []
        self.engine.watch(self.told.append)
        self.bridge = SerialBridge(self.engine, self.robot, settings)
        self.switch = BackendSwitch(self.engine, self.bridge)
        self.budgets: dict[Session, CommandBudget] = {}

    def program(self) -> Session:
        session = self.engine.session()
        self.budgets[session] = CommandBudget("a program", self.engine.tell)
        return session

    def send(self, session: Session, text: str) -> list[CommandResult]:
        """Send a command; gives the list that its result will be in."""
        results: list[CommandResult] = []

        def answered(outcomes: Sequence[CommandResult], data: bytes | None) -> None:
            results.extend(outcomes)

        message = Message(f"{text}\n".encode(), (parse_command(text),), TEXT)
        self.switch.submit(message, session, answered, self.budgets[session])
        return results


def played(steps: Callable[[Rig], Awaitable[None]], settings: SerialSettings = MUTE) -> None:
    async def run() -> None:
        rig = Rig(settings)
        try:
            await steps(rig)
        finally:
            rig.switch.close()

    asyncio.run(run())


def test_a_stop_overtakes_any_number_of_drives_and_none_of_them_is_sent_after_it() -> None:
    async def steps(rig: Rig) -> None:
        program = rig.program()
        answers = [rig.send(program, "d1-1") for _ in range(2200)]
        stopped = rig.send(program, "xx")
        assert rig.robot.heard == [b"d1-1\n", b"xx\n"]
        await until(lambda: bool(stopped))
        statuses = [answer.status for (answer,) in answers]
        assert statuses.count(Status.UNANSWERED) == MOST_COMMANDS
        assert statuses[MOST_COMMANDS:] == [Status.BUSY] * 1200
        assert rig.robot.heard == [b"d1-1\n", b"xx\n"]

    played(steps)


def test_a_flood_of_stops_sends_no_second_one_while_one_is_unanswered() -> None:
    async def steps(rig: Rig) -> None:
        program = rig.program()
        for _ in range(MOST_COMMANDS + 20):
            rig.send(program, "xx")
        assert len(rig.robot.heard) <= MOST_COMMANDS

    played(steps, SerialSettings(port="robot", timeout=30))


def test_the_next_movement_waits_for_the_planned_time_of_one_without_an_answer_while_polls_pass() -> None:
    async def steps(rig: Rig) -> None:
        driving, polling = rig.program(), rig.program()
        begun = rig.loop.time()
        rig.send(driving, "r1-6")  # 0.05 s at 120 degrees a second
        second, behind = rig.send(driving, "r1-3"), rig.send(driving, "u2")
        polled = rig.send(polling, "u1")
        await until(lambda: bool(polled))
        assert rig.robot.heard == [b"r1-6\n", b"u1\n"]
        assert rig.loop.time() < begun + ANSWER_MARGIN
        await until(lambda: bool(second and behind))
        assert rig.loop.time() >= begun + 0.05 + ANSWER_MARGIN
        assert rig.robot.heard == [b"r1-6\n", b"u1\n", b"r1-3\n", b"u2\n"]

    played(steps)


def test_an_answered_movement_keeps_nothing_back() -> None:
    async def steps(rig: Rig) -> None:
        program = rig.program()
        first = rig.send(program, "d1-60")
        rig.send(program, "d1-1")
        assert rig.robot.listener is not None
        rig.robot.listener.received(b"inf\n")
        await until(lambda: bool(first))
        assert rig.robot.heard == [b"d1-60\n", b"d1-1\n"]

    played(steps, SerialSettings(port="robot", timeout=30))


def test_a_stop_frees_the_way_for_the_next_movement() -> None:
    async def steps(rig: Rig) -> None:
        program = rig.program()
        rig.send(program, "d1-600")
        stopped = rig.send(program, "xx")
        after = rig.send(program, "d1-1")
        await until(lambda: bool(stopped and after))
        assert rig.robot.heard == [b"d1-600\n", b"xx\n", b"d1-1\n"]

    played(steps)


# -- continuous motion: what a robot may not know stays with the simulator -----------------------------


def test_a_wait_is_answered_here_and_what_comes_after_it_waits() -> None:
    async def steps(rig: Rig) -> None:
        program = rig.program()
        waited, read = rig.send(program, "wt-0.05"), rig.send(program, "u1")
        other = rig.send(rig.program(), "u2")
        assert rig.robot.heard == [b"u2\n"]
        await until(lambda: bool(waited))
        assert (waited[0].status, waited[0].reply) == (Status.DONE, math.inf)
        await until(lambda: bool(read) and bool(other))
        assert rig.robot.heard == [b"u2\n", b"u1\n"]

    played(steps)


def test_a_stop_cuts_a_wait() -> None:
    async def steps(rig: Rig) -> None:
        program = rig.program()
        waited = rig.send(program, "wt-3600")
        rig.send(program, "xx")
        await until(lambda: bool(waited))
        assert rig.robot.heard == [b"xx\n"]

    played(steps)


def test_a_velocity_is_sent_only_to_a_robot_that_knows_it() -> None:
    async def refused(rig: Rig) -> None:
        (result,) = rig.send(rig.program(), "vv-4;0;0")
        assert result.status is Status.REFUSED
        assert "velocity = true" in result.reason
        assert rig.robot.heard == []

    async def sent(rig: Rig) -> None:
        rig.send(rig.program(), "vv-4;0;0")
        assert rig.robot.heard == [b"vv-4;0;0\n"]

    played(refused)
    played(sent, SerialSettings(port="robot", timeout=0.02, velocity=True))


@pytest.mark.parametrize(
    ("answer", "timeout", "kind", "how"),
    [
        (b"", 0.02, NoticeKind.FAULT, "the robot did not answer within 0.02 s: vv-4;0;0"),
        (b"NaN\n", 5, NoticeKind.FAULT, "the robot answered nan to vv-4;0;0"),
        (b"False\n", 5, NoticeKind.FAULT, "the robot answered nan to vv-4;0;0"),
        (b"inf\n", 5, NoticeKind.ROBOT, "the robot answered inf to vv-4;0;0"),
    ],
)
def test_the_first_velocity_says_that_a_robot_may_not_know_it(
    answer: bytes, timeout: float, kind: NoticeKind, how: str
) -> None:
    """Its program drives and nothing moves; each answer alone may be a success."""

    async def steps(rig: Rig) -> None:
        program, listener = rig.program(), rig.robot.listener
        assert listener is not None
        wrong = rig.send(program, "vv-x")
        listener.received(b"NaN\n")
        await until(lambda: bool(wrong))
        for _ in range(2):
            result = rig.send(program, "vv-4;0;0")
            if answer:
                listener.received(answer)
            await until(lambda result=result: bool(result))
        found = [each for each in rig.told if isinstance(each, Notice) and "velocities" in each.text]
        assert found == [
            Notice(
                kind,
                f"{how}; if it does not move, it knows no velocities: drive by lengths, as d1-3, or set "
                "velocity = false in [serial]",
            )
        ]

    played(steps, SerialSettings(port="robot", timeout=timeout, velocity=True))


def test_a_pause_of_the_simulation_holds_up_no_answer_of_the_real_robot() -> None:
    async def steps(rig: Rig) -> None:
        rig.engine.perform(Action(ActionName.PAUSE, source="keys"))
        answers = [rig.send(rig.program(), text) for text in ("u1", "u2")]
        await until(lambda: all(answers))

    played(steps)


def test_a_client_is_answered_when_the_watchers_have_been_told() -> None:
    """The log is one of them: a program must not have a reply that the log lacks."""

    async def steps(rig: Rig) -> None:
        program, reply = rig.program(), rig.robot.listener
        first = rig.send(program, "u1")
        assert reply is not None
        reply.received(b"1\n")  # may be the end of an earlier one: it needs a silence
        await until(lambda: bool(first))
        before = len(rig.told)
        told: list[object] = []
        message = Message(b"u1\n", (parse_command("u1"),), TEXT)
        rig.switch.submit(message, program, lambda outcomes, data: told.extend(rig.told[before:]))
        reply.received(b"7\n")
        result, twin = told
        assert isinstance(result, CommandResult)
        assert isinstance(twin, TwinReading)
        assert (result.command.text, result.reply, twin.robot) == ("u1", 7, 7)

    played(steps, SerialSettings(port="robot", timeout=30))
