"""The dialect.toml of a new set: a small language of each kind, with comments, to be edited."""

from collections.abc import Mapping

from simmer_tui.config import dialect_toml, drive_csv, sensors_csv
from simmer_tui.config.csv_table import ID, POLL_CHARACTER, rows_by_header

_HEAD = """# The language of your robot: what its sketch understands, and answers. simmer-tui check DIR finds
# every mistake, and prints all messages with an example of their replies. docs/dialects.md has every key.
# Values are inches and degrees; counter-clockwise and left are positive. cm, mm and m are factors.
"""
_LINE = """
[frame]
kind = "line"            # a message ends with a newline
end = "\\n"

[reply]
end = "\\r\\n"
missing = "-1"           # a reading without a value

[robot]
busy = "wait"            # a movement during another: wait (a sketch with delay()), replace or drop

[[command]]
match = "get"
reply = "{SENSOR*cm:.1f}"

[[command]]
match = "f {n}"          # {n} is a number; {n=6} has a default
do = "FORWARD-{n}"
done = "ok {contact}"    # when the movement has ended

[[command]]
match = "t {n}"
do = "TURN-{n}"
done = "ok {contact}"

[[command]]
match = "x"
do = "stop"
reply = "stopped"

[unknown]
reply = "? {text}"
"""
_BRACKET = """
[frame]
kind = "bracket"         # a message stands between these
open = "["
close = "]"

[reply]
missing = "8190"         # a sensor that sees nothing

[robot]
busy = "replace"         # a movement ends the one before

[[command]]
match = "p"
reply = "[{SENSOR*mm:d}]"

[[command]]
match = "{way:f=FORWARD|b=-FORWARD|l=TURN|r=-TURN}{ms:int=300}"
do = "run {way} for {ms/1000} s"
reply = "[+]"

[[command]]
match = "h"
do = "stop"
reply = "[+]"
"""
_BYTE = """
[frame]
kind = "byte"            # each byte is a message

[reply]
end = "\\r\\n"
missing = "-1"

[robot]
halts_after = 0          # seconds of silence after which the robot stops; 0: never

[[command]]
match = "u"
reply = "{SENSOR*cm:.1f}"

[[command]]
match = "w"
do = "run FORWARD"       # until another letter, or x

[[command]]
match = "s"
do = "run -FORWARD"

[[command]]
match = "a"
do = "run TURN"

[[command]]
match = "d"
do = "run -TURN"

[[command]]
match = "x"
do = "stop"
"""
_BINARY = """
[frame]
kind = "binary"          # a header, content, and an end
head = "<BB"             # struct format: two bytes
names = ["type", "size"]
body = "size"            # which field is the length of the content
end = "$"
silence = 0.5            # seconds after which half a frame is dropped

[[command]]
type = 1                 # asks for the distance
reply = { type = 101, pack = "<f", values = ["SENSOR*cm"] }

[[command]]
type = 2                 # ahead, mm
unpack = "<h: distance"
do = "FORWARD-{distance/mm}"
done = { type = 102, pack = "<B", values = ["contact"] }

[[command]]
type = 3                 # counter-clockwise, degrees
unpack = "<h: angle"
do = "TURN-{angle}"
done = { type = 102, pack = "<B", values = ["contact"] }

[[command]]
type = 4
do = "stop"
"""
TEMPLATES: Mapping[str, str] = {"line": _LINE, "bracket": _BRACKET, "byte": _BYTE, "binary": _BINARY}
"""A small language for each kind. SENSOR, FORWARD and TURN are replaced by codes of the set."""


def with_dialect(files: Mapping[str, bytes], kind: str) -> dict[str, bytes]:
    """The files of a set with a dialect.toml of a kind, its codes those of the set."""
    drives, sensors = (_codes(files[name]) for name in (drive_csv.FILE, sensors_csv.FILE))
    ranges = [code for name, code in sensors.items() if name.startswith(("ultra", "tof"))]
    text = _HEAD + TEMPLATES[kind]
    for word, code in (
        ("SENSOR", next(iter([*ranges, *sensors.values()]), "u1")),
        ("FORWARD", drives.get("right", "d1")),
        ("TURN", drives.get("rot", "r1")),
    ):
        text = text.replace(word, code)
    return {**files, dialect_toml.FILE: text.encode()}


def _codes(data: bytes) -> dict[str, str]:
    """The codes of the rows of a table, by ID."""
    rows = rows_by_header(data.decode("utf-8-sig", "replace"))
    return {row.get(ID, ""): row.get(POLL_CHARACTER, "") for row in rows}
