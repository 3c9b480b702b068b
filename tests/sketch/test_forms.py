"""Sketches in the forms that teams write: each is checked, compiled, and run twice the same."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.sketch_check import facts_of, sketch_problems
from simmer_tui.sketch.wiring import wiring_of
from tests.sketch.running import FORMS, Sent, run_boards, set_of

NAMES = sorted(path.name for path in FORMS.iterdir() if (path / "wiring.toml").is_file())
SECONDS = 5.0


def frame(command: int, value: int) -> bytes:
    body = bytes((0xAA, command, value & 0xFF))
    return body + bytes((sum(body) & 0xFF,))


SENT: dict[str, Sent] = {
    "read_string": ((0.5, b"fwd 120\n"), (1.2, b"dist\n"), (1.5, b"turn -60\n"), (2, b"jump\n")),
    "binary_frames": (
        *((0.3, frame(ord("L"), 60)), (0.4, frame(ord("R"), -60))),
        *((1.0, frame(ord("T"), 0)), (1.2, b"\xaa\1\2\3")),
    ),
    "bluetooth_chars": ((0.5, b"5F"), (1.0, b"L"), (1.4, b"S")),
    "esp32_bluetooth": (
        *((0.5, b"F"), (1.2, b"U"), (1.5, b"7L"), (1.9, b"S"), (2.2, b"G"), (2.5, b"B"), (3.0, b"S")),
    ),
    "rtos_timers": ((0.5, b"g"), (2.0, b"t"), (4.0, b"q")),
    "servo_gripper": ((0.5, b"c"), (2.0, b"?"), (2.5, b"o")),
    "two_boards": ((0.5, b"F160\n"), (2.0, b"L120\n"), (2.3, b"S\n")),
    "accel_stepper": ((0.5, b"D300\n"), (2.5, b"T-100\n")),
    "kept_settings": ((0.5, b"g"), (0.8, b"s12 1.5\n"), (2.5, b"gt")),
}
"""Bytes of the laptop for the forms that wait for some."""
EXPECTED = {
    "accel_stepper": "ready\r\n300 300 600\r\n400 200 800\r\n",
    "binary_frames": "Ux\0\x88\xff(?s:.{4})\xff",
    "bluetooth_chars": "hello\r\n5,177\r\nF,177\r\nL,177\r\nS,177\r\n",
    "delay_only": "",
    "dmp_interrupt": "connected\r\n" + r"(ypr\t-?\d+\.\d\d\t0\.00\t0\.00\r\n){3}overflow\r\n"
    r"(ypr\t-?\d+\.\d\d\t0\.00\t0\.00\r\n)+",
    "echo_interrupt": r"(\d{4} us, \d{5} passes\r\n)+",
    "esp32_bluetooth": r"F700\r\n\d+\.\d cm, line \d+\n7903\r\nL903\r\nS903\r\nG903\r\nB903\r\nS903\r\n",
    "esp32_encoders": r"encoders on core 0\r\nloop on core 1, 32-bit int\nreached\r\n40\d 40\d\n",
    "encoder_ticks": "done (60|61) (60|61)\r\n",
    "flag_wait": "5\r\n10\r\n15\r\n20\r\n25\r\n30\r\n35\r\n40\r\n",
    "gyro_registers": "2\r\n68\r\n16384 25.00\r\nturned 90.\\d\\d\r\n",
    "kept_settings": "g get, s set, t tone\r\n1050.00\r\nsaved\r\n10800.00\r\n",
    "l298n_ramp": "",
    "lcd_pid_line": "",
    "millis_states": "ready\r\n" + r"(\d\.\d\d\t[012]\r\n)+",
    "motor_shield": "duty 90\r\nduty 130\r\nduty 170\r\n" + r"(duty \d+\r\n)+",
    "newping_array": r"(\d+,\d+,\d+\n)+(\d+(,\d*)*)?",
    "number_widths": "2\r\n4\r\n4\r\n-25536\r\n0.333333\r\n-51072\r\n\xab\xaa\xaa>@\x9c0\r\n1\r\n(.|\r|\n)*",
    "pulse_in": r"(A: \d+\.\d\d B: \d+\.\d line: (850|120)\r\n)+.*",
    "read_string": r"ok fwd 120\r\nd=\d+\r\nok turn -60\r\n\? jump\r\n",
    "rtos_queue": r"(\d+: \d+\r\n){13}",
    "rtos_semaphores": r"go 160\r\nticks 20\r\nticks 40\r\nticks 60\r\nstopped 60\r\n(alive \d\r\n){5}",
    "rtos_timers": r"(beat [12]\r\n){2}stop\r\n(beat [34]\r\n){2}stop\r\nbeat 5\r\nbeat 6\r\n",
    "servo_gripper": "gripper\r\nclosed\r\n95\r\nopen\r\n",
    "step_pulses": "forward\r\nleft\r\n",
    "stepper_coils": "12\r\ndone\r\n",
    "tof_eight": r"((\d+,){7}\d+ \d+\r\n)+((\d+,)*\d*)?",
    "tof_single": "VL53L0X test\r\n" + r"(\d+ mm in 3[78]\r\n|out of range\r\n)+",
    "two_boards": r"F:0\r\nL:\d+\r\nS:\d+\r\n",
    "two_pwm": "",
    "wait_and_halt": "1000\r\nhalted\r\n",
}
"""Patterns of all that each form sends."""
STANDS = (
    *("echo_interrupt", "kept_settings", "newping_array", "number_widths", "pulse_in", "servo_gripper"),
    "tof_eight",
)
"""Forms that do not drive."""


def test_every_form_has_a_wiring_that_fits_it(tmp_path: Path) -> None:
    assert set(NAMES) == set(EXPECTED)
    for name in NAMES:
        configuration = set_of(FORMS / name, tmp_path / name)
        wiring = wiring_of(configuration)
        assert wiring is not None
        assert [
            str(each)
            for each in sketch_problems(
                wiring, facts_of(wiring, configuration.directory, []), configuration.simulation.wheels
            )
        ] == [], name


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_form_runs_twice_the_same(name: str, tmp_path: Path) -> None:
    if find_compiler() is None:
        pytest.skip("there is no C++ compiler")
    configuration = set_of(FORMS / name, tmp_path / "set")
    sent: Sequence[tuple[float, bytes]] = SENT.get(name, ())
    first, second = (run_boards(configuration, SECONDS, sent) for _ in range(2))
    assert first.failed == ""
    assert re.fullmatch(EXPECTED[name], first.text), first.text
    start = configuration.simulation.start_pose
    has_driven = first.pose != (start.x, start.y, start.heading)
    assert has_driven == (name not in (*STANDS, "wait_and_halt"))
    assert first.sent == second.sent
    assert first.pose == second.pose
    assert repr(first.events) == repr(second.events)
