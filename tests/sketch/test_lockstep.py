"""Boards in the robot's world: slices change nothing, a byte stops the robot in time, lines join boards."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from simmer_tui.config.reply_formats import ReplyForm, ReplyFormat
from simmer_tui.errors import ConfigurationError
from simmer_tui.links.backend import Message
from simmer_tui.run.events import Action, ActionName, CommandResult, LegEnded, WireMessage
from simmer_tui.sim.command import parse_command
from simmer_tui.sim.records import Status
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.sketch_robot import NOT_DRIVEN
from tests.sketch.rovers import (
    ENCODERS,
    JOINED,
    MOTORS,
    ROVER,
    ROVER_BY_LINK,
    SENSOR,
    STOPPABLE,
    Boards,
    made_set,
)
from tests.sketch.running import run_boards

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler"),
]
SECOND = 1_000_000_000


def test_slices_of_any_length_give_the_same_run(tmp_path: Path) -> None:
    configuration = made_set(tmp_path / "set", JOINED, {"sensor.ino": SENSOR, "rover.ino": ROVER_BY_LINK})
    runs = []
    for slice_length in (100_000, 1_000_000, 5_000_000, 20_000_000):
        boards = Boards(configuration, slice_length=slice_length)
        boards.run_to(4.0)
        boards.close()
        runs.append((repr(boards.events), boards.robot.lockstep.sent, boards.simulator.pose))
    assert runs[1:] == runs[:1] * 3
    assert any(isinstance(event, LegEnded) for event in boards.events)


def test_a_stop_at_any_moment_ends_the_wheels_by_the_costs(tmp_path: Path) -> None:
    """From the byte's end: at most one look at the queue and a pass of the loop, a read, and the writes
    before that of the pin. Each basic block takes 0.5 us."""
    configuration = made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": STOPPABLE})
    boards = Boards(configuration, noise=False)
    for kind in boards.simulator.bias:
        boards.simulator.set_bias({kind: type(boards.simulator.bias[kind])()})
    chance, at, moments = random.Random(7), 0.2, []
    for number in range(1000):
        begin = at + 0.01 + chance.random() * 0.01
        stop = begin + 0.005 + chance.random() * 0.03
        for time, letter in ((begin, "FB"[number % 2]), (stop, "S")):
            boards.run_to(time - 0.002)
            boards.robot.receive(round(time * SECOND), ord(letter), 9600)
        moments.append(stop)
        at = stop
    boards.run_to(at + 0.1)
    boards.close()
    changes = [
        event for event in boards.events if isinstance(event, CommandResult) and event.command.code == "ww"
    ]
    # Both wheels start and stop one after the other.
    ends = [event for event in changes if event.command.text == "ww-0;0"]
    assert len(ends) == 1000
    halves = [
        event for event in changes if event.command.text.count("0;") or event.command.text.endswith(";0")
    ]
    for moment, ended in zip(moments, ends, strict=True):
        # Left and right: two writes each, 6 us, the third of which stops the second wheel, or the fourth.
        late = (ended.time - moment) * 1e6
        assert 1.5 + 18 <= late <= 2 * 1.5 + 24 + 0.5 * 30, late
    # The path of each wheel by hand: its speed times the time between its two writes.
    x = boards.simulator.spec.start_pose.x
    legs = [event.leg for event in boards.events if isinstance(event, LegEnded)]
    for ahead in [leg for leg in legs if leg.commanded.r == 0.0]:
        x += ahead.commanded.x * ahead.duration
    for turning in [leg for leg in legs if leg.commanded.r != 0.0]:
        x += turning.commanded.x * turning.duration
    assert halves
    assert boards.simulator.pose.x == pytest.approx(x, abs=1e-3)
    assert boards.simulator.contacts == 0


def test_a_restart_starts_the_boards_again(tmp_path: Path) -> None:
    configuration = made_set(tmp_path / "set", JOINED, {"sensor.ino": SENSOR, "rover.ino": ROVER_BY_LINK})
    boards = Boards(configuration)
    boards.run_to(0.8)
    first = boards.simulator.pose, list(boards.robot.lockstep.sent)
    done = boards.robot.engine.perform(Action(ActionName.RESET))
    assert not done.refused
    assert boards.simulator.time == 0.0
    boards.run_to(0.8)
    boards.close()
    assert (boards.simulator.pose, boards.robot.lockstep.sent) == first
    assert first[0] != configuration.simulation.start_pose


def test_the_busy_share_begins_again_with_a_reset_by_usb(tmp_path: Path) -> None:
    text = "void setup() { Serial.begin(9600); }\nvoid loop() { delay(10); }\n"
    boards = Boards(made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": text}))
    try:
        boards.run_to(3.0)
        boards.robot.views()
        boards.robot.reset_by_usb()
        boards.run_to(4.5)
        assert boards.robot.views()[0].busy < 0.1
    finally:
        boards.close()


TALKER = """
#include <SoftwareSerial.h>
SoftwareSerial link(7, 8);
void setup() { Serial.begin(9600); link.begin(9600);
  Serial.println("begins with a line, and then another one");
  link.print("ab"); Serial.println("next"); }
void loop() {}
"""
HEARER = """
#include <SoftwareSerial.h>
SoftwareSerial link(7, 8);
void setup() { link.begin(9600); }
void loop() { if (link.available()) analogWrite(5, link.read()); }
"""


def test_bytes_that_wait_to_leave_a_port_are_gone_with_its_reset(tmp_path: Path) -> None:
    """Else they would arrive among those of the new beginning."""
    wiring = JOINED.partition("[[motors]]")[0]
    boards = Boards(made_set(tmp_path / "set", wiring, {"sensor.ino": TALKER, "rover.ino": HEARER}))
    try:
        boards.run_to(0.0205)
        boards.robot.reset_by_usb()
        boards.run_to(0.2)
        sent = boards.robot.lockstep.sent
    finally:
        boards.close()
    lines = [event for event in boards.events if isinstance(event, WireMessage) and not event.port]
    whole = "begins with a line, and then another one\r\n"
    # 19 bytes have arrived after 20.5 ms, and the next one never does.
    assert [event.data for event in lines] == [whole[:19], whole, "next\r\n"]
    assert [event.time for event in lines] == sorted(event.time for event in lines)
    assert sent == sorted(sent)
    assert bytes(value for _, value in sent).decode() == f"{whole[:19]}{whole}next\r\n"


def test_others_may_read_and_not_drive(tmp_path: Path) -> None:
    boards = Boards(made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": STOPPABLE}))
    engine = boards.robot.engine
    results: list[CommandResult] = []
    for text in ("u1", "d1-3", "ww-3;3", "zz"):
        message = Message(text.encode(), (parse_command(text, "console"),), ReplyForm(ReplyFormat.TEXT))
        boards.robot.submit(message, engine.session(), lambda given, data: results.extend(given))
    boards.close()
    assert [each.status for each in results] == [
        *(Status.READING, Status.REFUSED, Status.REFUSED, Status.UNKNOWN)
    ]
    assert results[1].reason == results[2].reason == NOT_DRIVEN
    assert boards.simulator.pose == boards.simulator.spec.start_pose


LOSING = """
#include <SoftwareSerial.h>
SoftwareSerial link(11, 12);
volatile long edges;
void edge() { edges++; if (edges % 20 == 0) link.println(edges); }
void setup() {
  Serial.begin(9600); link.begin(9600);
  attachInterrupt(0, edge, CHANGE);
  analogWrite(5, 255); analogWrite(9, 255);
  delay(1000);
  analogWrite(5, 0); analogWrite(9, 0);
  Serial.println(edges);
}
void loop() {}
"""


def test_edges_are_lost_while_an_interrupt_writes(tmp_path: Path) -> None:
    wiring = (
        ROVER + MOTORS + ENCODERS.format(board="rover").replace("edges_per_inch = 40", "edges_per_inch = 200")
    )
    run = run_boards(made_set(tmp_path / "set", wiring, {"rover.ino": LOSING}), 2.0)
    counted = int(run.text)
    # 12 in/s with 200 edges an inch are 2,400 edges; a line of 4 to 6 bytes keeps interrupts off for 5 ms.
    assert 1000 < counted < 2000
    assert any("an edge at pin 2 was lost at rover.ino:5" in text for text in run.notices), run.notices
    # Edges after the last lost one are not counted.
    assert any(re.search(r": 10 of the first [0-9]+ edges at pin 2 were", text) for text in run.notices)


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("int zero = 0; Serial.println(10 / zero);", "died at rover.ino:3 after 0.5 s"),
        ("volatile int *place = 0; *place = 1;", "died at rover.ino:3 after 0.5 s"),
        ('asm volatile("1: jmp 1b");', "hangs at rover.ino:3 after 0.5"),
        ("}\nint *nothing = 0;\nint first = *nothing;\nvoid more() {", "died after 0 s"),
    ],
)
def test_a_board_that_dies_or_hangs_is_told_with_its_line(tmp_path: Path, body: str, said: str) -> None:
    text = f"void setup() {{ delay(500); }}\nvoid loop() {{\n  {body}\n}}\n"
    run = run_boards(made_set(tmp_path / "set", ROVER + MOTORS, {"rover.ino": text}), 1.0)
    assert said in run.failed
    assert run.failed in run.notices[-1]


def test_errors_have_the_lines_of_the_sketch(tmp_path: Path) -> None:
    text = "void setup() {\n  foo();\n}\nvoid loop() {\n  int x = ;\n  bar(1);\n  baz(2);\n}\n"
    with pytest.raises(ConfigurationError) as raised:
        run_boards(made_set(tmp_path / "set", ROVER, {"rover.ino": text}), 1.0)
    problems = raised.value.problems
    assert [each.where for each in problems] == ["rover.ino:2", "rover.ino:5", "rover.ino:6"]
    assert problems[0].what.endswith(": foo();")


def test_a_library_that_is_missing_is_refused_by_name(tmp_path: Path) -> None:
    text = "#include <Arduino.h>\n#include <Adafruit_Motor.h>\nvoid setup() {}\nvoid loop() {}\n"
    with pytest.raises(ConfigurationError) as raised:
        run_boards(made_set(tmp_path / "set", ROVER, {"rover.ino": text}), 1.0)
    (problem,) = raised.value.problems
    assert problem.where == "rover.ino:2"
    assert "no library with Adafruit_Motor.h; there are AccelStepper.h, Adafruit_MPU6050.h, " in problem.what


CALLS = r"""
#include <EEPROM.h>
const char table[] PROGMEM = "flash";
const char *const list[] PROGMEM = {table};
void setup() {
  Serial.begin(115200);
  char text[40];
  sprintf(text, "%d %ld %5.1f|%-4s|%04X %u", -5, 100000L, 1.5, "ab", 0xAB, 65535);
  Serial.println(text);
  strcpy_P(text, (char *)pgm_read_word(&(list[0])));
  Serial.println(text);
  Serial.println(3.14159, 3); Serial.println(-7, BIN); Serial.println(255, HEX); Serial.println('a');
  String s = String("x=") + 12 + ',' + 3.5;
  s.replace("x", "why"); Serial.println(s); Serial.println(s.indexOf(','));
  Serial.println(s.substring(4, 6).toInt());
  Serial.println(map(512, 0, 1023, 0, 255)); Serial.println(constrain(300, 0, 255));
  randomSeed(42); Serial.println(random(1000)); Serial.println(random(10, 20));
  EEPROM.put(0, 1234L); long back; EEPROM.get(0, back); Serial.println(back);
  int a, b; sscanf("12,-7", "%d,%d", &a, &b); Serial.println(a + b);
  Serial.println(F("flash text")); Serial.println(B1010 | bit(0)); Serial.println(highByte(0x1234));
  unsigned long t = micros(); delay(10); Serial.println((micros() - t) / 1000);
  byte small = 250; small += 10; Serial.println(small);
  int wraps = 32767; wraps++; Serial.println(wraps);
}
void loop() {}
"""
# random(1000) after randomSeed(42): 16807 * 42 = 705894; the next is 16807 * 705894 mod (2^31 - 1).
PRINTED = [
    *("-5 100000 ?|ab  |00AB 65535", "flash", "3.142", "11111111111111111111111111111001", "FF", "a"),
    *(
        "why=12,3.50",
        "6",
        "12",
        "127",
        "255",
        "894",
        str(10 + 16807 * 705894 % (2**31 - 1) % 10),
        "1234",
        "5",
    ),
    *("flash text", "11", "18", "10", "4", "-32768"),
]


def test_calls_print_what_the_board_prints(tmp_path: Path) -> None:
    run = run_boards(made_set(tmp_path / "set", ROVER, {"rover.ino": CALLS}), 1.0)
    assert run.text.split("\r\n")[:-1] == PRINTED
