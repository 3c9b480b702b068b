"""Contract of every link to a robot, and of the bridge over it, whatever the link is made of."""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from typing import Any

import pytest
from msgspec.structs import replace

from simmer_tui.config.reply_formats import ReplyForm, ReplyFormat
from simmer_tui.config.settings import SerialSettings
from simmer_tui.links.backend import BackendSwitch, Message
from simmer_tui.links.serial_bridge import SerialBridge
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.sessions import Answered
from simmer_tui.run.events import Action, ActionName, Event, Notice, NoticeKind, TwinReading
from simmer_tui.sim import CommandResult, SimulationSpec, Simulator, Status, parse_command
from simmer_tui.sim.sensors.lidar import Lidar, LidarSpec
from tests.links.recording import RecordingListener, until

BIG = ReplyForm(ReplyFormat.FLOAT64, "big")
FRAMED = ReplyForm(ReplyFormat.FRAMED)
QUICK = SerialSettings(port="robot", timeout=0.05)
GAP = 0.01
WAIT = 1.0
SLOW = SerialSettings(port="robot", timeout=30)


def test_every_byte_goes_through_unchanged_both_ways(other_end: Any) -> None:
    every = bytes(range(256)) * 8

    async def run() -> None:
        other_end.plug_in()
        link, ear = other_end.link(), RecordingListener()
        link.start(ear)
        await until(lambda: ear.told == ["opened"])
        link.write(every)
        await until(lambda: bytes(other_end.heard) == every)
        other_end.write(every)
        await until(lambda: bytes(ear.bytes) == every)
        link.close()
        other_end.unplug()

    asyncio.run(run())


def test_a_link_that_is_lost_says_so_drops_what_is_written_and_comes_back(other_end: Any) -> None:
    async def run() -> None:
        other_end.plug_in()
        link, ear = other_end.link(), RecordingListener()
        link.start(ear)
        await until(lambda: ear.told == ["opened"])
        other_end.unplug()
        await until(lambda: len(ear.told) > 1)
        assert "gone" in ear.told[1]
        link.write(b"lost")
        other_end.plug_in()
        await until(lambda: ear.told[-1] == "opened")
        link.write(b"back")
        await until(lambda: bytes(other_end.heard) == b"back")
        link.close()
        told = list(ear.told)
        other_end.unplug()
        await asyncio.sleep(0)
        assert ear.told == told

    asyncio.run(run())


class Rig:
    """A bridge with a client on one side and a robot, made of a function, on the other."""

    def __init__(self, bridge: SerialBridge, engine: Engine, events: list[Event], end: Any) -> None:
        self.bridge, self.engine, self.events, self.end = bridge, engine, events, end
        session = engine.session()
        # The bridge itself, which answers at once what it drops: a session would keep the order.
        self.submit: Callable[[Message, Answered], None] = lambda message, answered: bridge.submit(
            message, session, answered
        )
        self.heard: list[bytes] = []
        self._buffer = b""

    def robot(self, answer: Callable[[bytes], bytes], end: bytes = b"\n") -> None:
        """Make the robot give these answers to lines (or packets)."""

        def hear(data: bytes) -> None:
            *whole, self._buffer = (self._buffer + data).split(end)
            for line in whole:
                self.heard.append(line + end)
                reply = answer(line)
                if reply:
                    self.end.write(reply)

        self.end.hear = hear

    def send(self, text: str, form: ReplyForm = BIG) -> asyncio.Future[tuple[CommandResult, bytes | None]]:
        """Send what a client would; the first outcome and the bytes to pass on."""
        future = asyncio.get_running_loop().create_future()

        def answered(outcomes: Sequence[CommandResult], data: bytes | None) -> None:
            assert len(outcomes) == len(commands)
            future.set_result((outcomes[0], data))

        commands = tuple(parse_command(each) for each in text.strip("[]\n").split(","))
        self.submit(Message(text.encode(), commands, form), answered)
        return future

    def outcomes(self) -> list[CommandResult]:
        return [event for event in self.events if isinstance(event, CommandResult)]


@asynccontextmanager
async def rigged(end: Any, spec: SimulationSpec, settings: SerialSettings) -> AsyncIterator[Rig]:
    end.plug_in()
    engine = Engine(Simulator(spec))
    engine.start(asyncio.get_running_loop())
    events: list[Event] = []
    engine.watch(events.append)
    bridge = SerialBridge(engine, end.link(), settings, gap=GAP)
    await until(lambda: bridge.connected)
    rig = Rig(bridge, engine, events, end)
    try:
        async with asyncio.timeout(30):
            yield rig
    finally:
        bridge.close()
        end.unplug()


def check(
    end: Any, spec: SimulationSpec, settings: SerialSettings, steps: Callable[[Rig], Awaitable[None]]
) -> None:
    """Run steps on a rig."""

    async def run() -> None:
        async with rigged(end, spec, settings) as rig:
            await steps(rig)

    asyncio.run(run())


def double(number: float) -> bytes:
    return struct.pack(">d", number)


def test_robot_gets_the_clients_bytes_and_client_gets_the_robots(
    other_end: Any, course_spec: SimulationSpec
) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: double(12.25))
        outcome, data = await rig.send("u1\r\n")
        assert rig.heard == [b"u1\r\n"]
        assert data == double(12.25)
        assert outcome.reply == 12.25
        assert outcome.status is Status.READING

    check(other_end, course_spec, SLOW, steps)


def test_packets_are_answered_in_their_own_words(other_end: Any, course_spec: SimulationSpec) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda packet: b"booting\r\n[u1:7.002,d1:True]\r\n", end=b"]")
        outcome, data = await rig.send("[u1,d1:3]", FRAMED)
        assert rig.heard == [b"[u1,d1:3]"]
        assert data == b"[u1:7.002,d1:True]"
        assert [each.reply for each in rig.outcomes()] == [7.002, math.inf]
        assert outcome.reading is not None

    check(other_end, course_spec, SLOW, steps)


def test_simulated_robot_does_the_same_and_its_readings_stand_beside(
    other_end: Any, course_spec: SimulationSpec
) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: double(math.inf if line.startswith(b"d1") else 30.0))
        start = rig.engine.simulator.pose
        await rig.send("d1-3\n")
        await rig.send("u1\n")
        assert rig.engine.simulator.pose.x == pytest.approx(start.x + 3)
        (twin,) = [event for event in rig.events if isinstance(event, TwinReading)]
        assert (twin.code, twin.robot) == ("u1", 30.0)
        assert twin.simulated == pytest.approx(rig.engine.simulator.true_value("u1"))
        moved, read = rig.outcomes()
        assert moved.status is Status.DONE
        assert moved.trajectory is not None
        assert read.reading is not None
        assert read.reading.value == read.reply == 30.0

    check(other_end, course_spec, SLOW, steps)


def test_silent_robot_is_answered_for_and_the_next_command_goes_through(
    other_end: Any, course_spec: SimulationSpec
) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: b"" if line == b"u1" else double(5))
        outcome, data = await rig.send("u1\n")
        assert data is None
        assert math.isnan(outcome.reply)
        assert outcome.status is Status.UNANSWERED
        assert "did not answer within 0.05 s" in outcome.reason
        rig.bridge.settings = SLOW
        assert (await rig.send("u2\n"))[1] == double(5)

    check(other_end, course_spec, QUICK, steps)


def test_half_replies_and_boot_noise_are_discarded_up_to_the_next_good_one(
    other_end: Any, course_spec: SimulationSpec
) -> None:
    answers = {
        b"u1": b"Hello, here is robot 7\r\n" + double(1.5),
        b"u2": double(2.5)[:5],
        b"u3": double(3.5),
        b"u4": double(4.5) + b"debug: 4.5\r\n",
        b"u5": double(5.5),
    }

    async def steps(rig: Rig) -> None:
        rig.robot(answers.__getitem__)
        assert (await rig.send("u1\n"))[1] == double(1.5)
        rig.bridge.settings = QUICK
        assert (await rig.send("u2\n"))[0].status is Status.UNANSWERED
        rig.bridge.settings = SLOW
        for number in (3, 4, 5):
            assert (await rig.send(f"u{number}\n"))[1] == double(number + 0.5)

    check(other_end, course_spec, SLOW, steps)


def test_flooding_robot_is_bounded_and_told_of(
    other_end: Any, course_spec: SimulationSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("simmer_tui.links.serial_bridge._REPORT_DELAY", 0.01)

    async def steps(rig: Rig) -> None:
        for _ in range(200):
            with_room = b"noise \x1b[31m" * 100
            try:
                rig.end.write(with_room)
            except BlockingIOError:
                await asyncio.sleep(0)

        def discards() -> list[Notice]:
            return [event for event in rig.events if isinstance(event, Notice) and "discarded" in event.text]

        await until(lambda: bool(discards()))
        notices = discards()
        assert all(len(notice.text) < 200 for notice in notices)
        assert "'noise \x1b[31mnoise" in notices[0].text
        rig.robot(lambda line: double(1))
        outcome, _ = await rig.send("u1\n")
        assert outcome.status in (Status.READING, Status.UNANSWERED)

    check(other_end, course_spec, SLOW, steps)


def test_stop_overtakes_what_waits_which_is_then_not_sent(
    other_end: Any, course_spec: SimulationSpec
) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: b"")
        driving = rig.send("d1-20\n")
        await until(lambda: rig.heard == [b"d1-20\n"])
        waiting = [rig.send("u1\n"), rig.send("d1-5\n")]
        stop = rig.send("xx\n")
        dropped = [await each for each in waiting]
        assert all("stopped" in outcome.reason for outcome, _ in dropped)
        await until(lambda: len(rig.heard) == 2)
        assert rig.heard == [b"d1-20\n", b"xx\n"]
        rig.end.write(double(math.inf) + double(0))
        assert (await driving)[1] == double(math.inf)
        outcome, data = await stop
        assert (outcome.status, data) == (Status.STOPPED, double(0))

    check(other_end, course_spec, SLOW, steps)


def test_a_persons_stop_goes_to_the_robot_at_once_and_its_answer_to_nobody(
    other_end: Any, course_spec: SimulationSpec
) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: double(9) if line.startswith(b"u") else b"")
        assert (await rig.send("u1\n"))[1] == double(9)
        driving = rig.send("d1-20\n")
        await until(lambda: rig.heard[-1] == b"d1-20\n")
        rig.engine.perform(Action(ActionName.STOP))
        await until(lambda: rig.heard[-1] == b"halt!\n")
        rig.end.write(double(math.inf) + double(0))
        assert (await driving)[1] == double(math.inf)
        assert (await rig.send("u2\n"))[1] == double(9)

    check(other_end, course_spec, replace(SLOW, stop="halt!"), steps)


def test_commands_wait_for_a_closed_port_but_not_for_ever(
    other_end: Any, course_spec: SimulationSpec
) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: double(3))
        rig.end.unplug()
        await until(lambda: not rig.bridge.connected)
        outcome, _ = await rig.send("u1\n")
        assert outcome.status is Status.UNANSWERED
        rig.bridge.settings = SLOW
        patient = rig.send("u2\n")
        rig.engine.perform(Action(ActionName.STOP))
        assert (await patient)[0].status is Status.UNANSWERED
        rig.end.plug_in()
        await until(lambda: rig.heard == [b"xx\n"])
        assert (await rig.send("u3\n"))[1] == double(3)
        assert any(isinstance(event, Notice) and event.kind is NoticeKind.FAULT for event in rig.events)

    check(other_end, course_spec, QUICK, steps)


@pytest.mark.parametrize(
    ("settings", "reply", "number"),
    [
        (replace(SLOW, robot_reply="text"), b"ready\r\nu1 = 3\r\n12.5\r\n", 12.5),
        (replace(SLOW, robot_reply="float32"), struct.pack("<f", 12.5), 12.5),
        (replace(SLOW, robot_reply="float64", robot_byte_order="big"), struct.pack(">d", 12.5), 12.5),
        (replace(SLOW, robot_reply="text", reply_end="quiet"), b"12.5", 12.5),
        (replace(SLOW, robot_reply="text", reply_end="bracket"), b"[u1:12.5]", 12.5),
    ],
    ids=["text", "float32", "float64", "quiet", "bracket"],
)
def test_replies_in_another_form_are_left_to_the_link_to_write(
    pty_end: Any, course_spec: SimulationSpec, settings: SerialSettings, reply: bytes, number: float
) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: reply)
        outcome, data = await rig.send("u1\n")
        assert (outcome.reply, data) == (number, None)

    check(pty_end, course_spec, settings, steps)


@pytest.mark.parametrize(
    ("suffix", "sent", "heard"),
    [("none", "u1\n", b"u1\n"), ("lf", "u1", b"u1\n"), ("crlf", "u1", b"u1\r\n"), ("lf", "u1\n", b"u1\n")],
)
def test_suffix_is_added_where_there_is_none(
    pty_end: Any, course_spec: SimulationSpec, suffix: str, sent: str, heard: bytes
) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: double(1))
        await rig.send(sent)
        assert rig.heard == [heard]

    check(pty_end, course_spec, replace(SLOW, suffix=suffix), steps)


@pytest.mark.slow
def test_unplugged_and_plugged_in_again_a_hundred_times_under_load(
    pty_end: Any, course_spec: SimulationSpec
) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: double(8))
        answers: list[CommandResult] = []
        over = asyncio.Event()

        async def load() -> None:
            while not over.is_set():
                answers.append((await rig.send("u1\n"))[0])

        clients = [asyncio.create_task(load()) for _ in range(3)]
        for _ in range(100):
            good = sum(each.status is Status.READING for each in answers)
            await until(lambda good=good: sum(e.status is Status.READING for e in answers) > good)  # type: ignore[misc]
            rig.end.unplug()
            await until(lambda: not rig.bridge.connected)
            rig.end.plug_in()
            await until(lambda: rig.bridge.connected)
        over.set()
        await asyncio.gather(*clients)
        assert all(each.reply == 8 or math.isnan(each.reply) for each in answers)

    check(pty_end, course_spec, replace(SLOW, timeout=0.5), steps)


def test_switch_to_the_robot_and_back_while_a_client_stays(
    other_end: Any, course_spec: SimulationSpec
) -> None:
    async def steps(rig: Rig) -> None:
        switch, session = BackendSwitch(rig.engine), rig.engine.session()
        rig.submit = lambda message, answered: switch.submit(message, session, answered)
        rig.robot(lambda line: double(4))
        true = rig.engine.simulator.true_value("u1")
        outcome, data = await rig.send("u1\n")
        assert outcome.reply == pytest.approx(true)
        assert data is None
        switch.use(rig.bridge)
        assert (await rig.send("u1\n"))[1] == double(4)
        rig.robot(lambda line: b"")
        left = rig.send("u1\n")
        switch.use(None)
        assert (await left)[0].status is Status.UNANSWERED
        assert (await rig.send("u1\n"))[0].reply == pytest.approx(true)

    check(other_end, course_spec, SLOW, steps)


def test_a_stop_just_after_the_switch_waits_for_nothing_the_simulator_still_does(
    other_end: Any, course_spec: SimulationSpec
) -> None:
    async def steps(rig: Rig) -> None:
        rig.engine.timed, rig.engine.time_scale = True, 0.001  # a drive lasts for minutes
        switch, session = BackendSwitch(rig.engine), rig.engine.session()
        rig.submit = lambda message, answered: switch.submit(message, session, answered)
        rig.robot(lambda line: double(4))
        asked = [rig.send(text) for text in ("d1-1\n", "d1-2\n", "u1\n")]
        answered: list[int] = []
        switch.use(rig.bridge)
        asked += [rig.send(text) for text in ("xx\n", "u2\n")]
        for number, each in enumerate(asked):
            each.add_done_callback(lambda _, number=number: answered.append(number))
        await until(lambda: rig.heard[:1] == [b"xx\n"])
        outcomes = [(await each)[0] for each in asked]
        assert answered == [0, 1, 2, 3, 4]
        drives = [outcomes[0].status, outcomes[1].status]
        assert drives == [Status.DONE, Status.STOPPED], "the second never began"
        assert [outcome.reply for outcome in outcomes[3:]] == [4.0, 4.0]
        assert rig.heard == [b"xx\n", b"u2\n"]

    check(other_end, course_spec, SLOW, steps)


def test_stops_to_a_mute_robot_are_given_up_together(other_end: Any, course_spec: SimulationSpec) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: b"")
        loop = asyncio.get_running_loop()
        given_up: list[float] = []
        asked = [rig.send("d1-5\n")]
        await until(lambda: rig.heard == [b"d1-5\n"])
        asked += [rig.send("xx\n") for _ in range(5)]
        for each in asked:
            each.add_done_callback(lambda _: given_up.append(loop.time()))
        await until(lambda: len(rig.heard) == 6)
        assert rig.heard == [b"d1-5\n"] + [b"xx\n"] * 5, "none waits for another's reply"
        outcomes = [(await each)[0] for each in asked]
        assert {outcome.status for outcome in outcomes} == {Status.UNANSWERED}
        # Together they end at once; one after the other they would take five waits.
        assert given_up[-1] - given_up[0] < 4 * WAIT, "one wait for all, not one for each"

    check(other_end, course_spec, replace(QUICK, timeout=WAIT), steps)


@pytest.mark.quick_cases(2)
def test_a_stop_that_waits_for_a_closed_port_is_answered_for_but_never_given_up(
    other_end: Any, course_spec: SimulationSpec
) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: double(3))
        rig.end.unplug()
        await until(lambda: not rig.bridge.connected)
        outcome, _ = await rig.send("xx\n")
        assert outcome.status is Status.UNANSWERED
        rig.bridge.settings = SLOW
        rig.end.plug_in()
        await until(lambda: rig.heard == [b"xx\n"])
        assert (await rig.send("u3\n"))[1] == double(3)

    check(other_end, course_spec, QUICK, steps)


def test_a_reply_that_comes_after_its_time_is_not_taken_for_the_next_one(
    other_end: Any, course_spec: SimulationSpec
) -> None:
    answers = {b"u0": double(0), b"u1": b"", b"u2": double(1) + double(2), b"u3": double(3)}

    async def steps(rig: Rig) -> None:
        rig.robot(answers.__getitem__)
        assert (await rig.send("u0\n"))[1] == double(0), "from here on there is no doubt"
        rig.bridge.settings = QUICK
        assert (await rig.send("u1\n"))[0].status is Status.UNANSWERED
        rig.bridge.settings = SLOW
        assert (await rig.send("u2\n"))[1] == double(2), "the late reply to u1 came first"
        assert (await rig.send("u3\n"))[1] == double(3)

    check(other_end, course_spec, SLOW, steps)


# -- a lidar: replies of many numbers ---------------------------------------------------------------

LIDAR = LidarSpec(kind=Lidar, number=1, code="sc", rays=6)
RANGES = [12.5, 11.25, math.inf, 7.0, 30.0, 31.5]


def with_lidar(spec: SimulationSpec) -> SimulationSpec:
    return replace(spec, sensors=(*spec.sensors, LIDAR))


def doubles(*numbers: float, order: str = ">") -> bytes:
    return struct.pack(f"{order}{len(numbers)}d", *numbers)


@pytest.mark.parametrize("ranges", [RANGES, RANGES[:4]], ids=["as many rays as the twin", "other rays"])
def test_the_robots_scan_reaches_client_watchers_and_log_unchanged(
    other_end: Any, course_spec: SimulationSpec, ranges: list[float]
) -> None:
    async def steps(rig: Rig) -> None:
        answers = {b"sc": doubles(len(ranges), *ranges), b"u1": double(3.5), b"sc-90": double(11.25)}
        rig.robot(lambda line: answers[line])
        outcome, data = await rig.send("sc\n")
        assert data == answers[b"sc"]
        assert outcome.ranges is not None
        assert outcome.ranges.tolist() == ranges
        assert outcome.reply == 12.5, "one number stands for all: the first ray's"
        assert outcome.reading is not None
        scan = outcome.reading.scan
        assert scan is not None
        assert scan.bearings.tolist() == [-360.0 / len(ranges) * ray for ray in range(len(ranges))]
        outcome, data = await rig.send("u1\n")
        assert (outcome.reply, outcome.ranges, data) == (3.5, None, double(3.5))
        outcome, data = await rig.send("sc-90\n")
        assert (outcome.reply, outcome.ranges, data) == (11.25, None, double(11.25))
        twins = [each for each in rig.events if isinstance(each, TwinReading)]
        assert [(each.code, each.robot) for each in twins] == [("sc", 12.5), ("u1", 3.5), ("sc", 11.25)]

    check(other_end, with_lidar(course_spec), SLOW, steps)


def test_a_robots_scan_comes_in_pieces_after_a_greeting(other_end: Any, course_spec: SimulationSpec) -> None:
    async def steps(rig: Rig) -> None:
        data = doubles(len(RANGES), *RANGES)

        def slowly(line: bytes) -> bytes:
            for begin in range(0, len(data), 5):
                other_end.write(data[begin : begin + 5])
            return b""

        other_end.write(b"ready, version 3\r\n")
        rig.robot(slowly)
        for _ in range(3):
            outcome, passed = await rig.send("sc\n")
            assert passed == data
            assert outcome.ranges is not None
            assert outcome.ranges.tolist() == RANGES

    check(other_end, with_lidar(course_spec), SLOW, steps)


@pytest.mark.quick_cases(4)
@pytest.mark.parametrize(
    ("form", "reply"),
    [
        ("text", b"12.5;11.25;inf;7.0;30.0;31.5\r\n"),
        ("float32", struct.pack("<7f", 6, *RANGES)),
        ("float64", doubles(6, *RANGES, order="<")),
    ],
)
def test_a_robots_scan_in_another_form_is_converted_for_the_client(
    other_end: Any, course_spec: SimulationSpec, form: str, reply: bytes
) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: reply)
        outcome, data = await rig.send("sc\n")
        assert data is None, "the link writes it in its own dialect"
        assert outcome.ranges is not None
        assert outcome.ranges.tolist() == RANGES

    check(other_end, with_lidar(course_spec), replace(SLOW, robot_reply=form), steps)


def test_a_scan_in_a_robots_packet_stands_among_others(other_end: Any, course_spec: SimulationSpec) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda packet: b"[u1:7.002,sc:12.5;11.25;inf;7.0;30.0;31.5,d1:True]\r\n", end=b"]")
        _, data = await rig.send("[u1,sc,d1:3]", FRAMED)
        assert data == b"[u1:7.002,sc:12.5;11.25;inf;7.0;30.0;31.5,d1:True]"
        first, scan, drive = rig.outcomes()
        assert (first.reply, drive.reply) == (7.002, math.inf)
        assert scan.ranges is not None
        assert scan.ranges.tolist() == RANGES

    check(other_end, with_lidar(course_spec), SLOW, steps)


def test_a_robot_may_refuse_a_scan_with_one_nan(other_end: Any, course_spec: SimulationSpec) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: double(math.nan))
        outcome, data = await rig.send("sc\n")
        assert data == double(math.nan)
        assert math.isnan(outcome.reply)
        assert outcome.ranges is None

    check(other_end, with_lidar(course_spec), SLOW, steps)


def test_a_robot_that_sends_one_number_for_a_scan_has_not_answered(
    other_end: Any, course_spec: SimulationSpec
) -> None:
    async def steps(rig: Rig) -> None:
        rig.robot(lambda line: double(12.25))
        outcome, data = await rig.send("sc\n")
        assert (outcome.status, outcome.ranges, data) == (Status.UNANSWERED, None, None)
        assert "a lidar's reply is its count and so many numbers" in outcome.reason
        rig.bridge.settings = replace(SLOW, baud=4_000_000)
        rig.robot(lambda line: double(3.5))
        outcome, data = await rig.send("u1\n")
        assert data == double(3.5)

    check(other_end, with_lidar(course_spec), replace(QUICK, baud=4_000_000), steps)
