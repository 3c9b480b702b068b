"""The robot's own program played by rules, with a wire, a robot and a clock that the test moves."""

from __future__ import annotations

import heapq
import itertools
import struct
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

from simmer_tui.config.dialect_reader import load_dialect
from simmer_tui.config.loader import find_set, load
from simmer_tui.dialect.device import DialectDevice, MoveEnd
from simmer_tui.dialect.dialect_rules import Parts
from simmer_tui.dialect.messages import dictionary
from simmer_tui.dialect.timer import Timer
from simmer_tui.errors import Problem

BEGIN = 1000.3


class Host:
    """A robot whose movements end when the test says, and whose sensors read a number each."""

    def __init__(self) -> None:
        self.now = BEGIN
        self.log: list[str] = []
        self.told: list[str] = []
        self.informed: list[str] = []
        self.under_way: list[Callable[[MoveEnd], None]] = []
        self.readings = {"u1": 10.0, "u2": float("inf")}
        self.reads = 0
        self.read_time = 0.0
        self._due: list[tuple[float, int, Timer]] = []
        self._count = itertools.count()

    def call_later(self, seconds: float, call: Callable[[], None]) -> Timer:
        timer = Timer(call)
        heapq.heappush(self._due, (self.now + seconds, next(self._count), timer))
        return timer

    def pass_time(self, seconds: float) -> None:
        """Let time pass."""
        until = self.now + seconds
        while self._due and self._due[0][0] <= until + 1e-9:
            due, _, timer = heapq.heappop(self._due)
            self.now = max(self.now, due)
            timer()
        self.now = max(self.now, until)

    def read(self, codes: Sequence[str], done: Callable[[Mapping[str, float]], None]) -> None:
        self.reads += len(codes)
        values = {code: self.readings[code] for code in codes}
        if self.read_time:
            self.call_later(self.read_time * len(codes), lambda: done(values))
        else:
            done(values)

    def move(self, command: str, done: Callable[[MoveEnd], None]) -> None:
        self.log.append(command)
        self.under_way.append(done)

    def end(self, ended: MoveEnd | None = None) -> None:
        """End the movement under way."""
        self.under_way.pop(0)(ended or MoveEnd())

    def drive(self, velocity: tuple[float, float, float] | None, seconds: float | None) -> str:
        self.log.append(f"{velocity} {seconds}")
        return ""

    def halt(self, by: str = "") -> None:
        self.log.append(f"halt by {by}" if by else "halt")
        ended, self.under_way = self.under_way, []
        for done in ended:
            done(MoveEnd(stopped=True))

    def send(self, data: bytes, *, droppable: bool = False) -> None:
        self.log.append(f"< {data.decode('latin-1')}")

    def done(self, message: bytes, meaning: str) -> None:
        pass

    def tell(self, text: str) -> None:
        self.told.append(text)

    def inform(self, text: str) -> None:
        self.informed.append(text)

    def take(self) -> list[str]:
        """Events since they were taken last."""
        taken, self.log = self.log, []
        return taken


COMMANDS = """
[[command]]
match = "get"
reply = "{u1*cm:.1f},{u2:.1f},{u1:d}"
[[command]]
match = "slow {s}"
takes = "s"
reply = "slept"
[[command]]
match = "f {n}"
do = ["d1-{n}", "pause 0.5", "r1-5", "count = count + 1"]
reply = "+"
done = "ok {contact} {count}"
stopped = "cut {count}"
[[command]]
match = "t {s}"
do = "run d1 for {s} s"
done = "ran"
stopped = "ran less"
[[command]]
match = "back {s}"
do = "run -d1 for {s} s"
done = "back"
[[command]]
match = "w"
do = "run d1"
[[command]]
match = "x"
do = "stop"
reply = "stopped"
[[command]]
match = "near {n}"
do = "d1-{u1 - n}"
[[command]]
match = "late"
do = "d1-1"
busy = "drop"
[state]
count = 0
"""


def device(tmp_path: Path, head: str = "", commands: str = COMMANDS) -> tuple[DialectDevice, Host]:
    """A device of the default set with these rules, its port open."""
    (tmp_path / "dialect.toml").write_text(head + commands, "utf-8")
    spec = load(find_set("default")).simulation
    problems: list[Problem] = []
    parts = Parts(spec.sensors, spec.drives, spec.gripper, spec.velocities)
    rules = load_dialect(tmp_path, parts, problems)
    assert problems == []
    assert rules is not None
    host = Host()
    made = DialectDevice(rules, host)
    made.opened()
    return made, host


def test_check_shows_the_numbers_that_a_run_sends(tmp_path: Path) -> None:
    """A yes or no has no decimals, in any place; another reading has some."""
    fields = ("{i1}", "{not i1}", "{i1 + 1}", "{max(i1, 0)}", "{pick(i1, 'a', 'b')}", "{u1}", "{u1 + 2}")
    named = "{named('i1,u1')} {led} {time > 5}"
    commands = (
        f"[state]\nled = 0\n[[command]]\nmatch = 'get'\nreply = \"{' '.join(fields)} {named}\"\n"
        "[[command]]\nmatch = 'see'\ndo = 'led = i1'\nreply = '{i1}'\n"
    )
    robot, host = device(tmp_path, commands=commands)
    host.readings = {"i1": 1.0, "u1": 12.3}
    shown = [reply for _, _, reply in dictionary(robot._rules)]
    robot.received(b"get\nsee\nget\n")
    sent = [line.removeprefix("< ") for line in host.take()]
    assert sent[:2] == shown == ["1 0 2 1 b 12.3 14.3 i1:1.00,u1:12.30 0 1", "1"]
    assert sent[2] == sent[0].replace("0 1", "1 1")


def test_check_shows_a_message_s_numbers_as_a_run_has_them(tmp_path: Path) -> None:
    frame = '[frame]\nkind = "binary"\nhead = "<BB"\nnames = ["type", "size"]\nbody = "size"\n'
    reply = (
        '[reply]\nend = ";"\n[[command]]\ntype = 1\nunpack = "<hf?2s: a b c d"\nreply = "{a} {b} {c} {d:s}"\n'
    )
    robot, host = device(tmp_path, frame, reply)
    ((_, _, shown),) = dictionary(robot._rules)
    robot.received(bytes([1, 9]) + struct.pack("<hf?2s", 7, 7.0, True, b"7"))
    assert host.take() == [f"< {shown};".replace("\\x00", "\0")] == ["< 7 7.0 1 7\0;"]


def test_a_sensor_is_read_once_a_reply_however_often_it_is_written(tmp_path: Path) -> None:
    robot, host = device(tmp_path, '[reply]\nend = "\\r\\n"\nmissing = "-1"\n')
    robot.received(b"get\n")
    assert host.take() == ["< 25.4,-1,10\r\n"]
    assert host.reads == 2


def test_a_reply_comes_after_takes_and_the_read_times_with_the_values_of_their_moment(tmp_path: Path) -> None:
    robot, host = device(
        tmp_path, commands='[[command]]\nmatch = "get"\ntakes = 0.25\nreply = "{u1:g} {time:.2f}"\n'
    )
    host.read_time = 0.04
    robot.received(b"get\n")
    host.pass_time(0.24)
    host.readings["u1"] = 7.0
    host.pass_time(0.02)
    host.readings["u1"] = 99.0
    assert host.take() == []
    host.pass_time(0.03)
    assert host.take() == ["< 7 1000.59"]


def test_steps_come_one_after_the_other_and_done_last(tmp_path: Path) -> None:
    robot, host = device(tmp_path)
    robot.received(b"f 12\n")
    assert host.take() == ["< +", "d1-12"]
    host.end(MoveEnd(touched=True))
    host.pass_time(0.4)
    assert host.take() == []
    host.pass_time(0.2)
    assert host.take() == ["r1-5"]
    host.end()
    assert host.take() == ["< ok 1 1"]


def test_a_movement_waits_for_the_one_before_and_questions_do_not(tmp_path: Path) -> None:
    robot, host = device(tmp_path)
    robot.received(b"f 1\nnear 4\nget\n")
    assert host.take() == ["< +", "d1-1", "< 25.4,inf,10"]
    host.end()
    host.pass_time(0.5)
    host.end()
    assert host.take() == ["r1-5", "< ok 0 1", "d1-6.0"]


def test_what_does_not_fit_into_the_buffer_is_lost_and_told_once(tmp_path: Path) -> None:
    robot, host = device(tmp_path, "[robot]\nbuffer = 12\n")
    robot.received(b"f 1\n" + b"near 4\n" * 5)
    assert len(host.told) == 1
    assert "7 bytes wait already, and the robot's buffer has 12" in host.told[0]
    host.end()
    host.pass_time(0.5)
    host.end()
    host.end()
    assert [each for each in host.take() if each.startswith("d1")] == ["d1-1", "d1-6.0"]


def test_a_movement_replaces_the_one_before_with_all_its_steps(tmp_path: Path) -> None:
    robot, host = device(tmp_path, '[robot]\nbusy = "replace"\n')
    robot.received(b"f 12\n")
    robot.received(b"f 3\n")
    assert host.take() == ["< +", "d1-12", "< cut 0", "halt", "< +", "d1-3"]
    host.end()
    host.pass_time(1.0)
    host.end()
    assert host.take() == ["r1-5", "< ok 0 1"]


def test_a_run_of_the_same_drive_goes_on_without_a_halt(tmp_path: Path) -> None:
    robot, host = device(tmp_path, '[robot]\nbusy = "replace"\n')
    robot.received(b"t 0.3\n")
    host.pass_time(0.2)
    robot.received(b"t 0.3\n")
    assert host.take() == ["(6.0, 0.0, 0.0) 0.3", "(6.0, 0.0, 0.0) 0.3"]
    host.pass_time(0.2)
    assert host.take() == []
    host.pass_time(0.2)
    assert host.take() == ["< ran"]
    robot.received(b"t 1\n")
    robot.received(b"back 1\n")
    assert host.take() == ["(6.0, 0.0, 0.0) 1.0", "< ran less", "halt", "(-6.0, -0.0, -0.0) 1.0"]


def test_a_dropped_message_is_told(tmp_path: Path) -> None:
    robot, host = device(tmp_path)
    robot.received(b"f 1\nlate\n")
    assert host.take() == ["< +", "d1-1"]
    assert host.told == ["'late' is lost: the robot is busy"]


def test_a_stop_goes_first_and_forgets_what_waits(tmp_path: Path) -> None:
    robot, host = device(tmp_path)
    robot.received(b"f 1\nf 2\nx\n")
    assert host.take() == ["< +", "d1-1", "< stopped", "< cut 0", "halt"]
    robot.received(b"f 3\n")
    assert host.take() == ["< +", "d1-3"]


def test_an_untimed_run_goes_on_until_a_stop_or_the_end_of_its_program(tmp_path: Path) -> None:
    robot, host = device(tmp_path)
    robot.received(b"w\n")
    host.pass_time(60)
    assert host.take() == ["(6.0, 0.0, 0.0) None"]
    robot.received(b"x\n")
    assert host.take() == ["< stopped", "halt"]
    robot.received(b"w\n")
    robot.closed()
    assert host.take() == ["(6.0, 0.0, 0.0) None", "halt"]


@pytest.mark.parametrize(("head", "log"), [("runs_on = true", []), ("halts_after = 2", ["halt by watchdog"])])
def test_a_run_may_go_on_without_its_program_or_end_with_silence(
    tmp_path: Path, head: str, log: list[str]
) -> None:
    robot, host = device(tmp_path, f"[robot]\n{head}\n")
    robot.received(b"w\n")
    host.take()
    host.pass_time(1.9)
    assert host.take() == []
    host.pass_time(0.2)
    if not log:
        robot.closed()
    assert host.take() == log


def test_silence_ends_a_velocity_of_a_command_as_well(tmp_path: Path) -> None:
    commands = '[[command]]\nmatch = "v {x}"\ndo = "vv-{x};0;0"\n' + COMMANDS
    robot, host = device(tmp_path, "[robot]\nhalts_after = 2\n", commands)
    robot.received(b"v 6\n")
    host.end(MoveEnd(lasts=True))
    host.pass_time(1.9)
    robot.received(b"get\n")
    assert not robot.moves, "readings on the way count, as of every continuous motion"
    host.pass_time(1.9)
    host.take()
    host.pass_time(0.2)
    assert host.take() == ["halt by watchdog"]
    assert host.informed == ["nothing has come for 2 s: the robot stops (halts_after)"]
    robot.received(b"v 6\nv 0\n")
    host.end(MoveEnd(lasts=True))
    host.end(MoveEnd(lasts=False))
    host.pass_time(2.1)
    assert host.take() == ["vv-6;0;0", "vv-0;0;0"], "it stands"


def test_people_who_stop_the_robot_end_the_message(tmp_path: Path) -> None:
    robot, host = device(tmp_path)
    robot.received(b"f 1\nf 2\n")
    host.end(MoveEnd(stopped=True))
    assert host.take() == ["< +", "d1-1", "< cut 0"]
    robot.received(b"get\n")
    assert host.take() == ["< 25.4,inf,10"]


RUNS = """
[[command]]
match = "t {s}"
do = "run d1 for {s} s"
done = "ok {contact}"
stopped = "cut {contact}"
[[command]]
match = "then {s}"
do = ["run d1 for {s} s", "r1-5"]
done = "ok {contact}"
[[command]]
match = "w"
do = "run d1"
"""


def test_a_run_that_met_something_says_so(tmp_path: Path) -> None:
    robot, host = device(tmp_path, commands=RUNS)
    robot.received(b"t 2\nthen 1\nt 3\n")
    host.pass_time(1)
    robot.run_touched()
    host.pass_time(1)
    assert host.take() == ["(6.0, 0.0, 0.0) 2.0", "< ok 1", "(6.0, 0.0, 0.0) 1.0"]
    host.pass_time(1)
    robot.run_touched()  # of somebody else: a movement tells its own contacts
    host.end()
    assert host.take() == ["r1-5", "< ok 0", "(6.0, 0.0, 0.0) 3.0"]


def test_people_who_stop_a_run_end_the_message(tmp_path: Path) -> None:
    robot, host = device(tmp_path, commands=RUNS)
    robot.received(b"t 2\nt 3\n")
    host.pass_time(1)
    robot.velocity_ended(by_others=True)
    assert host.take() == ["(6.0, 0.0, 0.0) 2.0", "< cut 0"], "what waits is dropped"
    robot.received(b"w\n")
    assert robot.moves
    robot.velocity_ended(by_others=True)
    assert not robot.moves
    robot.received(b"then 1\n")
    host.pass_time(1)
    robot.velocity_ended(by_others=True)
    host.end()
    assert host.take()[-1] == "< ok 0", "its run was over"


def test_a_refused_step_ends_the_message_without_done(tmp_path: Path) -> None:
    robot, host = device(tmp_path)
    robot.received(b"f 1\n")
    host.end(MoveEnd(refused="the value is beyond 1e6"))
    assert host.take() == ["< +", "d1-1"]
    assert host.told == ["'f {n}' at dialect.toml:9:command.3: the value is beyond 1e6"]


def test_unknown_messages_and_noise_are_told_with_the_nearest_pattern(tmp_path: Path) -> None:
    robot, host = device(tmp_path, commands=COMMANDS + '[unknown]\nreply = "? {text}"\n')
    robot.received(b"GET\nf  x\n")
    assert host.take() == ["< ? GET", "< ? f  x"]
    assert host.told[0] == "'GET' is no message of the dialect; 'get' differs in case"
    robot.received(b"SLOW 3\n")
    assert host.told[-1] == "'SLOW 3' is no message of the dialect; 'slow {s}' differs in case"
    robot.received(b"\xff\xfeget\n")
    assert host.told[-1].startswith("'\udcff\udcfeget' is no message of the dialect"), "the bytes that came"
    robot.received(b"half")
    robot.closed()
    assert host.told[-1] == "4 bytes dropped, a message without its end: 'half'"


def test_a_mistake_that_is_repeated_is_told_once_and_counted_at_the_end(tmp_path: Path) -> None:
    robot, host = device(tmp_path)
    for _ in range(50):
        robot.received(b"GET\n")
    assert len(host.told) == 1
    robot.closed()
    assert host.told[1:] == [f"50 times in all: {host.told[0]}"]
    assert host.told[0].startswith("'GET' is no message")
    host.told.clear()
    for number in range(100):
        robot.received(b"word%d\n" % number)
    robot.closed()
    assert len(host.told) == 21
    assert host.told[-1] == "20 different faults were reported, 80 more were not"


def test_bytes_are_lost_while_it_boots_and_then_it_greets(tmp_path: Path) -> None:
    robot, host = device(tmp_path, '[robot]\nboot = 1.5\ngreeting = "ready"\n')
    robot.received(b"get\n")
    assert host.told == ["'get\n' is lost: the robot boots for 1.5 s after the port was opened"]
    host.pass_time(2)
    robot.received(b"get\n")
    assert host.take() == ["< ready", "< 25.4,inf,10"]


def test_a_port_that_is_opened_again_while_the_robot_boots_boots_it_anew(tmp_path: Path) -> None:
    stream = '[[stream]]\nevery = 1\nsend = "{tick}"\n'
    robot, host = device(tmp_path, '[robot]\nboot = 1.5\ngreeting = "ready"\n', stream)
    host.pass_time(1.0)
    robot.closed()
    robot.opened()
    host.pass_time(1.4)
    assert host.take() == []
    host.pass_time(2.2)
    assert host.take() == ["< ready", "< 0", "< 1"]
    robot.closed()
    host.pass_time(2.0)
    assert host.take() == []


def test_a_stream_comes_by_itself_while_its_condition_holds(tmp_path: Path) -> None:
    stream = '[[stream]]\nevery = 0.1\nsend = "{tick},{u1:g}"\nif = "on"\n'
    on = '[state]\non = 1\n[[command]]\nmatch = "quiet"\ndo = "on = 0"\n'
    robot, host = device(tmp_path, commands=stream + on)
    host.pass_time(0.35)
    assert host.take() == ["< 0,10", "< 1,10", "< 2,10"]
    robot.received(b"quiet\n")
    host.pass_time(1)
    robot.closed()
    host.pass_time(1)
    assert host.take() == []


def test_codes_in_the_expression_itself_are_read(tmp_path: Path) -> None:
    robot, host = device(tmp_path, commands='[[command]]\nmatch = "g"\nreply = "{named(\'u1,u2\')}"\n')
    robot.received(b"g\n")
    assert host.take() == ["< u1:10.00,u2:inf"]


def test_messages_of_a_stream_that_are_late_are_sent_at_once_up_to_a_second(tmp_path: Path) -> None:
    robot, host = device(tmp_path, commands='[[stream]]\nevery = 0.1\nsend = "{tick}"\n')
    host.pass_time(0.15)
    host.now += 0.5  # the machine is busy with something else
    host.pass_time(0.0)
    assert host.take() == [f"< {tick}" for tick in range(6)]
    host.now += 60
    host.pass_time(0.1)
    assert host.informed == ["598 messages of a stream that were more than 1 s late are left out"]
    assert host.take() == ["< 6", "< 605", "< 606"]
    robot.closed()


def test_an_expression_that_fails_is_told_with_its_place(tmp_path: Path) -> None:
    robot, host = device(tmp_path, commands='[[command]]\nmatch = "p {n}"\ndo = "d1-{pick(n, 1, 2)}"\n')
    robot.received(b"p 7\n")
    assert host.take() == []
    assert host.told == ["dialect.toml:1:command.1: do: pick(7, ...) has 2 values, counted from 0"]


def test_codes_that_a_message_names_are_read(tmp_path: Path) -> None:
    commands = '[[command]]\nmatch = "read {codes:list}"\nreply = "[{named(codes)}]"\n'
    made, host = device(tmp_path, "", commands)
    made.received(b"read u1,u2, zz\n")
    assert host.take() == ["< [u1:10.00,u2:inf,zz:inf]"]
    assert host.reads == 2


def test_a_message_in_small_letters_differs_in_case_too(tmp_path: Path) -> None:
    robot, host = device(tmp_path, commands='[[command]]\nmatch = "MOVE {way:L=1|R=2} {n}"\n')
    robot.received(b"move r 3\n")
    assert host.told == ["'move r 3' is no message of the dialect; 'MOVE {way:L=1|R=2} {n}' differs in case"]
