"""Boards against a cycle-true core: from a byte received to a pin set, and to a byte answered."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from simmer_tui.sketch.compiler import find_compiler
from tests.sketch.avr.cores import ARDUINO, SKETCHES, Done, Sonar, Stimuli, build_core, run_ours, run_simavr

MILLISECOND = 1_000_000
BYTE_TIME = 1_041_667
"""Nanoseconds of a byte at 9600 baud."""


def _missing() -> str:
    """The sentence about what is missing on this machine; empty if all is there."""
    if find_compiler() is None or shutil.which("gcc") is None:
        return "there is no C++ compiler"
    if shutil.which("avr-gcc") is None or not ARDUINO.is_dir():
        return "there is no avr-gcc with Arduino's core: apt install gcc-avr avr-libc arduino-core-avr"
    if not Path("/usr/include/simavr/sim_avr.h").is_file():
        return "there is no simavr: apt install libsimavr-dev"
    return ""


pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(_missing()), reason=_missing())]


def at(*moments: tuple[float, str]) -> list[tuple[int, int]]:
    """Bytes with the time of each one's end, nanoseconds; letters of a text come one after the other."""
    return [
        (round(time * MILLISECOND) + place * BYTE_TIME, ord(letter))
        for time, text in moments
        for place, letter in enumerate(text, 1)
    ]


EDGES = [(2_300_000 * number, 2, number & 1) for number in range(1, 250)]
EDGES += [(3_100_000 * number + 7_000, 3, number & 1) for number in range(1, 180)]
SONAR = Sonar(12, 11, 2_500_000)
CASES = {
    "command": Stimuli(
        at(*((20, "H"), (60.3, "L"), (90, "?"), (130, "won\n"), (190, "d"), (260, "H?"), (320.7, "L"))),
        watched=(8,),
    ),
    "sonar": Stimuli(
        at((20, "p"), (90.4, "i"), (150, "p"), (260.2, "ii"), (400, "p")), watched=(8,), sonar=SONAR
    ),
    "encoder": Stimuli(
        at((20, "F"), (320, "S"), (360.2, "B"), (420, "S"), (470.9, "F"), (520, "S")),
        sorted(EDGES),
        watched=(7, 8),
        modulated=(5,),
    ),
    "bluetooth": Stimuli(
        at((20, "H"), (60.2, "L"), (90, "?"), (130, "HL?"), (170, "H")),
        [each for each in sorted(EDGES) if each[1] == 2],
        watched=(8,),
        soft_rx=10,
        soft_tx=11,
    ),
}


SECONDS = 0.65
TOLERANCE, LONGEST_DIFFERENCE = 0.02, 0.5 * MILLISECOND
"""Share of the time since the command began to arrive, and nanoseconds, by which both may differ."""
# SoftwareSerial has a byte three quarters of a bit before its stop bit ends; here it arrives whole.
STOP_BIT = 0.1 * MILLISECOND


def since_commands(done: list[Done], stimuli: Stimuli) -> list[tuple[float, str]]:
    """All that was done, each with the time since the last byte of a command had begun to arrive."""
    begun = [time - BYTE_TIME for time, _ in stimuli.received]
    return [
        (each.time - max(begin for begin in begun if begin + 0.9 * BYTE_TIME <= each.time), each.what)
        for each in done
    ]


def without_digits(what: str) -> str:
    """A byte's name; all digits have one."""
    kind, _, value = what.partition(" ")
    return "digit" if kind == "byte" and chr(int(value)).isdigit() else what


def numbers(done: list[tuple[float, str]]) -> list[float]:
    """The numbers with a point among all that was sent."""
    text = "".join(chr(int(what[5:])) for _, what in done if what.startswith("byte"))
    return [float(each) for each in re.findall(r"\d+\.\d+", text)]


@pytest.mark.parametrize("name", CASES)
def test_a_board_acts_when_the_core_does(name: str, tmp_path: Path) -> None:
    stimuli = CASES[name]
    sketch = SKETCHES / f"{name}.ino"
    ours = since_commands(run_ours(sketch, stimuli, SECONDS), stimuli)
    real = since_commands(run_simavr(build_core(tmp_path), sketch, stimuli, SECONDS, tmp_path), stimuli)
    assert len(ours) >= len(stimuli.received)
    # A pulse that is timed differs by the microseconds of the core's own interrupts.
    assert [without_digits(what) for _, what in ours] == [without_digits(what) for _, what in real]
    assert numbers(ours) == pytest.approx(numbers(real), rel=0.01)
    for (mine, what), (theirs, _) in zip(ours, real, strict=True):
        allowed = TOLERANCE * theirs + (STOP_BIT if stimuli.soft_rx is not None else 0.0)
        assert abs(mine - theirs) <= min(allowed, LONGEST_DIFFERENCE), (what, mine, theirs)
