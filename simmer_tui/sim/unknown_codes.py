"""Commands with a code that no sensor or drive has: the reason for their refusal, and what was meant."""

from collections.abc import Sequence

from simmer_tui.sim.command import (
    LARGEST_VALUE,
    NUMBER,
    WORD,
    Command,
    cut,
    keyboard_text,
    meant_number,
    utf8_text,
)
from simmer_tui.sim.specs import DriveKind, SimulationSpec

_MOVES = {
    **dict.fromkeys(("forward", "forwards", "fwd", "move", "drive", "go", "ahead"), (DriveKind.RIGHT, 1.0)),
    **dict.fromkeys(("back", "backward", "backwards", "reverse"), (DriveKind.LEFT, 1.0)),
    **dict.fromkeys(("turn", "rotate", "spin", "left"), (DriveKind.ROT, 1.0)),
    "right": (DriveKind.ROT, -1.0),
}
"""The movement that a word means. A turn to the left is positive."""


def unknown_code(command: Command, spec: SimulationSpec) -> str:
    """The reason for refusing a command whose code no enabled row has."""
    code, rows = command.code, (*spec.sensors, *spec.drive_rows, *spec.velocities)
    known = [row.code for row in rows if row.enabled]
    if any(row.code == code for row in rows):
        return f"the code {code} is disabled"
    text = utf8_text(command.text.strip())
    typed = keyboard_text(text)
    meant = movement_in_words(text.split(), spec)
    near = [other for other in known if other.lower() == code.lower() or other == code[::-1]]
    if typed != text and typed[:2] in known:
        near = [typed]
    elif meant:
        near = [meant]
    near = near or [other for other in known if other[0] == code[0]]
    # Its bytes are no characters: letters of documents and of other keyboards are longer.
    code = code if text.isascii() else text[:2]
    hint = f"; did you mean {' or '.join(cut(each, WORD) for each in near)}?" if near else ""
    return f"no sensor or drive has the code {cut(code, WORD)}{hint}"


def movement_in_words(words: Sequence[str], spec: SimulationSpec) -> str:
    """The command for a movement in words, such as `forward 3`; empty if there is none that the robot has."""
    kind, sign = _MOVES.get(words[0].lower().strip("():;!?."), (None, 0.0)) if words else (None, 0.0)
    code = next((drive.code for drive in spec.drives if drive.kind is kind and drive.enabled), "")
    number = meant_number(words[1]) if len(words) > 1 else ""
    if not NUMBER.fullmatch(number) or abs(float(number)) > LARGEST_VALUE:
        number = "90" if kind is DriveKind.ROT else "3"
    return f"{code}-{sign * float(number):g}" if code else ""
