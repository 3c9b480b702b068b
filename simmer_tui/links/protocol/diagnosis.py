"""Mistakes of a program, recognised from the bytes it sends: pure text, no sockets."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from msgspec import Struct

from simmer_tui.sim.command import LARGEST_VALUE, WORD, cut, parse_value, utf8_text

# Request line of RFC 9112, section 3: a browser, curl, or a health check.
_HTTP = re.compile(r"[A-Z]{3,8} \S* ?HTTP/\d")
_JSON = re.compile(r'\s*\{\s*"')
_POSE = re.compile(r'"(?:x|y|heading|pose|particles|grid)"')
"""Keys of a belief."""
# Far below any intended movement. Bytes in the wrong order give such numbers.
_TINY = 1e-30


def is_http(text: str) -> bool:
    """True if a text is a request of HTTP: a health check may ask so whether the port is served."""
    return _HTTP.match(text) is not None


class Diagnosis(Struct, frozen=True):
    """A mistake that was recognised. `name` identifies it: each is reported once."""

    name: str
    text: str


def wrong_protocol(text: str, port: int, others: Mapping[str, int]) -> Diagnosis | None:
    """The mistake of a program that speaks another protocol than the line port's.

    Args:
        text: the command as it came.
        port: the port it came to.
        others: the ports of "packets" and "beliefs", those that are served.
    """
    if is_http(text):
        return http(port)
    if text.startswith("["):
        where = others.get("packets")
        there = f"send it to port {where}" if where else "start with --listeners packets"
        return Diagnosis(
            "packets on a line port",
            f"port {port} takes lines; '{cut(utf8_text(text), WORD)}' is a packet: {there}",
        )
    if not _JSON.match(text):
        return None
    if "beliefs" in others and _POSE.search(text):
        return Diagnosis(
            "beliefs on a line port", f"port {port} takes commands; beliefs go to port {others['beliefs']}"
        )
    shown = cut(utf8_text(text), WORD)
    return Diagnosis("JSON on a line port", f"'{shown}' is no command: send plain text such as u1")


def wrong_packet(data: bytes, port: int, line_port: int | None) -> Diagnosis | None:
    """The mistake in the first bytes of a connection on a packet port. `line_port` takes lines, if served."""
    text = data.decode("utf-8", "surrogateescape")
    if is_http(text):
        return http(port)
    if data.endswith(b"\n") and b"[" not in data:
        first = cut(text.splitlines()[0], WORD)
        there = f"send lines to port {line_port}" if line_port else "start with --listeners binary"
        return Diagnosis(
            "lines on a packet port", f"port {port} takes packets such as [u0]; '{first}' is a line: {there}"
        )
    return None


def http(port: int) -> Diagnosis:
    """The mistake of a browser."""
    return Diagnosis(
        "HTTP", f"HTTP request on port {port}, which is no web server: it takes commands such as u1"
    )


def code_from_zero(code: str, known: frozenset[str], disabled: frozenset[str]) -> Diagnosis | None:
    """The mistake of a program whose codes begin at 0 while the set's begin at 1."""
    if len(code) != 2 or code[1] != "0" or code in known | disabled or f"{code[0]}1" not in known:
        return None
    return Diagnosis(
        "codes from 0", f"the program asks for {cut(code)}, but codes of this set begin at 1: {code[0]}1"
    )


def joined(text: str, known: frozenset[str]) -> Diagnosis | None:
    """The mistake of a program that sends commands together without line ends: `u1u2` reads only u1."""
    for at in range(2, len(text) - 1):
        # A digit before an e may belong to a number: d1-1e5.
        if text[at : at + 2] in known and text[at].isalpha() and text[at] not in "eE":
            return Diagnosis(
                "commands joined",
                f"'{cut(utf8_text(text), WORD)}' came without a line end between its commands and was "
                "taken for one: end each with a newline (\\n)",
            )
    return None


def without_end(rest: bytes, peer: str) -> Diagnosis:
    """The mistake of a program that ends only some of its lines."""
    shown = cut(rest.decode("utf-8", "surrogateescape"), WORD)
    return Diagnosis(
        "line without an end",
        f"client {peer} sent '{shown}' without a line end and waits: its earlier lines ended with a newline "
        "(\\n), so every one must",
    )


def is_nonsense(argument: str | None) -> bool:
    """True if the value of a drive looks like a reply read with the wrong width or byte order."""
    if argument is None:
        return False
    if argument.strip().lower().lstrip("+-") in ("nan", "inf", "infinity"):
        return True
    value = parse_value(argument)
    return not isinstance(value, str) and (
        abs(value) > LARGEST_VALUE or 0 < abs(value) < _TINY or not math.isfinite(value)
    )
