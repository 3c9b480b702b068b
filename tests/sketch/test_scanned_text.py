"""sscanf: the answers of avr-libc in simavr, and the wider ones of an ESP32."""

from __future__ import annotations

from pathlib import Path

import pytest

from simmer_tui.sketch.compiler import find_compiler
from tests.sketch.rovers import ROVER, made_set
from tests.sketch.running import run_boards

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler"),
]
START = """
char w[20], x[20];
int a, b, n;
long l;
unsigned int u;
signed char small[2];
void setup() { Serial.begin(115200); run(); }
void loop() {}
"""
# A call of sscanf, what is printed after its result, and all that an Uno prints: avr-libc 2.0 in simavr.
CASES = (
    ('("100 -50", "%d %d", &a, &b)', "a, b", "2 100 -50"),
    ('("12", "%d%n", &a, &n)', "a, n", "1 12 2"),
    ('("speed=12", "%[a-z]=%d", w, &a)', "w, a", "2 speed 12"),
    ('("left,30", "%[^,],%d", w, &a)', "w, a", "2 left 30"),
    ('("a]b", "%[]a]%s", w, x)', "w, x", "2 a] b"),
    ('("a-b", "%[a-]%s", w, x)', "w, x", "2 a- b"),
    ('("abcd", "%2[a-z]%s", w, x)', "w, x", "2 ab cd"),
    ('("abc", "%[0-9]", w)', "0", "0 0"),
    ('("12345", "%2d%3d", &a, &b)', "a, b", "2 12 345"),
    ('("7 8", "%*d %d", &a)', "a", "1 8"),
    ('("9", "%*d%n", &n)', "n", "0 1"),
    ('("70000", "%ld", &l)', "l", "1 70000"),
    ('("5", "%hhd", small)', "(int)small[0], (int)small[1]", "1 5 0"),
    ('("0x1F 017", "%x %o", &a, &b)', "a, b", "2 31 15"),
    ('("0x1F 017", "%i %i", &a, &b)', "a, b", "2 31 15"),
    ('("08", "%i", &a)', "a", "1 0"),
    ('("1ffg", "%2x%2x", &a, &b)', "a, b", "2 31 15"),
    ('("abcdef gh", "%3s%s", w, x)', "w, x", "2 abc def"),
    ('("5%6", "%d%%%d", &a, &b)', "a, b", "2 5 6"),
    ('("1,2", "%d,%d,%d", &a, &b, &n)', "a, b", "2 1 2"),
    ('("A 5", "A%d", &a)', "a", "1 5"),
    ('("A5", "B%d", &a)', "0", "0 0"),
    ('("", "%d", &a)', "0", "-1 0"),
    ('(" ", "%s", w)', "0", "-1 0"),
    ('("x", "%d", &a)', "0", "0 0"),
)
PRINT = """
template <class Value>
void show(Value value) {{ Serial.print(' '); Serial.print(value); }}
float f = 9;
double d = 9;
int64_t wide = 1;
char t[30];
char *printed() {{ sprintf(t, "%lld %d", wide << 40, 5); return t; }}
void run() {{
  a = b = n = -1; l = -1;
{}
}}
"""


def printed(folder: Path, cases: tuple[tuple[str, str, str], ...], board: str) -> list[str]:
    lines = [
        f"  Serial.print(sscanf{call}); {' '.join(f'show({each});' for each in shown.split(', '))}"
        " Serial.println();"
        for call, shown, _ in cases
    ]
    wiring = ROVER.replace("uno", board)
    configuration = made_set(folder, wiring, {"rover.ino": START + PRINT.format("\n".join(lines))})
    return run_boards(configuration, 0.5).text.replace("\r", "").splitlines()


def test_text_is_scanned_as_by_avr_libc(tmp_path: Path) -> None:
    cases = (
        *CASES,
        ('("70000", "%d", &a)', "a", "1 4464"),
        ('("-5", "%u", &u)', "u", "1 65531"),
        ('("1.5 7", "%f %d", &l, &a)', "0", "0 0"),
    )
    assert printed(tmp_path / "set", cases, "uno") == [each for *_, each in cases]


def test_an_esp32_scans_32_bits_and_floats(tmp_path: Path) -> None:
    cases = (
        *CASES,
        ('("100000 -50", "%d %d", &a, &b)', "a, b", "2 100000 -50"),
        ('("-5", "%u", &u)', "u", "1 4294967291"),
        ('("70000", "%hd", small)', "(int)*(int16_t *)small", "1 4464"),
        ('("1.5,-2e1;x", "%f,%lf;%s", &f, &d, w)', "f, d, w", "3 1.50 -20.00 x"),
        ('("-.5e 7", "%f%n", &f, &n)', "f, n", "1 -0.50 3"),
        ('("1.25", "%3f%d", &f, &a)', "f, a", "2 1.20 5"),
        ('("9000000000", "%lld", &wide)', "(long)(wide / 1000000)", "1 9000"),
        ('("7", "%zu", &wide)', "printed()", "1 7696581394432 5"),
    )
    assert printed(tmp_path / "set", cases, "esp32") == [each for *_, each in cases]
