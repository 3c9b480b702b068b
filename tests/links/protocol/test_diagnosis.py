"""Mistakes of programs, recognised from their bytes: which are named, in which words, and which are none."""

from __future__ import annotations

import pytest

from simmer_tui.links.protocol.diagnosis import (
    Diagnosis,
    code_from_zero,
    is_nonsense,
    joined,
    without_end,
    wrong_packet,
    wrong_protocol,
)

WEB = Diagnosis("HTTP", "HTTP request on port 9, which is no web server: it takes commands such as u1")


def json_text(text: str) -> Diagnosis:
    return Diagnosis("JSON on a line port", f"'{text}' is no command: send plain text such as u1")


@pytest.mark.parametrize(
    ("text", "others", "found"),
    [
        ("GET / HTTP/1.1\r", {}, WEB),
        ("OPTIONS * HTTP/1.1", {}, WEB),
        ("GET  HTTP/1", {}, WEB),
        ("GE / HTTP/1.1", {}, None),
        ("CONNECTIO / HTTP/1.1", {}, None),
        ("get / HTTP/1.1", {}, None),
        ("GET / HTTP/x", {}, None),
        ("u1", {"packets": 5, "beliefs": 7}, None),
        ("", {"packets": 5, "beliefs": 7}, None),
        (
            "[u0]",
            {"packets": 5},
            Diagnosis("packets on a line port", "port 9 takes lines; '[u0]' is a packet: send it to port 5"),
        ),
        (
            "[" + "x" * 40,
            {"packets": 0},
            Diagnosis(
                "packets on a line port",
                f"port 9 takes lines; '[{'x' * 36}...' is a packet: start with --listeners packets",
            ),
        ),
        (
            ' {\t"x": 1',
            {"beliefs": 7},
            Diagnosis("beliefs on a line port", "port 9 takes commands; beliefs go to port 7"),
        ),
        ('{"x": 1', {"packets": 5}, json_text('{"x": 1')),
        ('{"cmd": "u1"}', {"beliefs": 7}, json_text('{"cmd": "u1"}')),
        ("{x", {"beliefs": 7}, None),
    ],
)
def test_the_protocol_of_another_port_is_named(
    text: str, others: dict[str, int], found: Diagnosis | None
) -> None:
    assert wrong_protocol(text, 9, others) == found


LINES = "lines on a packet port"


@pytest.mark.parametrize(
    ("data", "line_port", "found"),
    [
        (b"GET / HTTP/1.1\r\n", 4, WEB),
        (
            b"u1\n",
            4,
            Diagnosis(LINES, "port 9 takes packets such as [u0]; 'u1' is a line: send lines to port 4"),
        ),
        (
            b"\xff" + b"x" * 40 + b"\nu2\n",
            None,
            Diagnosis(
                LINES,
                f"port 9 takes packets such as [u0]; '\udcff{'x' * 36}...' is a line: start with "
                "--listeners binary",
            ),
        ),
        (b"u1", 4, None),
        (b"[u1]\n", 4, None),
        (b"u1[\n", 4, None),
    ],
)
def test_lines_on_a_packet_port_are_named(
    data: bytes, line_port: int | None, found: Diagnosis | None
) -> None:
    assert wrong_packet(data, 9, line_port) == found


@pytest.mark.parametrize(
    ("code", "named"),
    [
        *(("u0", True), ("d0", True), ("x0", False), ("u1", False), ("k0", False), ("z0", False)),
        *(("u00", False), ("u", False), ("", False), ("0u", False)),
    ],
)
def test_codes_that_begin_at_0_are_named(code: str, named: bool) -> None:
    found = code_from_zero(code, frozenset(("u1", "d1", "z1", "z0", "k1")), frozenset(("k0",)))
    text = f"the program asks for {code}, but codes of this set begin at 1: {code[:1]}1"
    assert found == (Diagnosis("codes from 0", text) if named else None)


KNOWN = frozenset(("u1", "u2", "d1", "e1", "E1", "11"))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("u1u2", True),
        ("u1 u2", True),
        ("d1-3u2", True),
        ("d1-3u1", True),
        ("xu2", False),
        ("u2", False),
        ("u1u", False),
        ("u1u3", False),
        ("d1-1e1", False),
        ("d1-1E1", False),
        ("d1-11", False),
        ("", False),
    ],
)
def test_commands_without_line_ends_between_them_are_named(text: str, named: bool) -> None:
    said = (
        f"'{text}' came without a line end between its commands and was taken for one: end each with a "
        "newline (\\n)"
    )
    assert joined(text, KNOWN) == (Diagnosis("commands joined", said) if named else None)


def test_what_came_is_shown_with_40_characters_at_most() -> None:
    found = joined("u1u2" * 10, KNOWN), joined("u1u2" * 11, KNOWN), without_end(b"x" * 40, "a:1")
    shown = [diagnosis.text.split("'")[1] for diagnosis in found if diagnosis is not None]
    assert shown == ["u1u2" * 10, "u1u2" * 9 + "u...", "x" * 40]
    assert without_end(b"\x00" + b"x" * 40, "a:1") == Diagnosis(
        "line without an end",
        f"client a:1 sent '\0{'x' * 36}...' without a line end and waits: its earlier lines ended with "
        "a newline (\\n), so every one must",
    )


@pytest.mark.parametrize(
    "argument", ["nan", " -INF ", "+infinity", "1e400", "-1.1e6", "1000001", "1e-31", "-1e-31"]
)
def test_values_that_are_replies_read_wrongly_are_nonsense(argument: str) -> None:
    assert is_nonsense(argument)


@pytest.mark.parametrize(
    "argument", [None, "", "3", "0", "-0", "1e6", "-1e6", "1e-30", "-1.1e-30", "x", "nana"]
)
def test_other_values_are_not(argument: str | None) -> None:
    assert not is_nonsense(argument)
