"""Draw the way of one command through the rooms: docs/developing/command.svg.

    python scripts/make_architecture_picture.py

Each box is a file of the package with what it makes of the command; tests/test_checks.py looks that the files
are there and that the picture is the present one.
"""

from __future__ import annotations

from pathlib import Path

from simmer_tui.document.svg import FAINT, FONT, INK, element, text

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "developing" / "command.svg"
Box = tuple[str, str]
"""A file of the package, and its part in the way."""
DOWN: tuple[Box, ...] = (
    ("links/binary_link.py", "bytes of a connection"),
    ("links/protocol/binary.py", "a Command of bytes"),
    ("links/backend.py", "a Message to the robot in use"),
    ("robot/sessions.py", "its turn in the sender's one queue"),
    ("robot/engine.py", "one command at a time, and the clock"),
    ("sim/simulator.py", "a Trajectory, a reading: the CommandResult"),
)
"""From the program to the robot; the reply goes the same way back."""
BESIDE: tuple[Box, ...] = (
    ("run/events.py", "what has happened, as frozen records"),
    ("run/reducer.py", "the State now, and the RunHistory"),
    ("runlog/writer.py", "a line of the log"),
    ("live/snapshot.py", "one frozen moment for screen and page"),
    ("run/mission.py", "the referee's verdict"),
    ("report/content.py", "what happened, and why"),
)
"""Readers of events, live or from a log: all that people see."""
WIDTH, HEIGHT, GAP, MARGIN = 300.0, 44.0, 26.0, 20.0
"""Of a box, points: the longest part fits at 12 points."""
BOTTOM = 50.0 + len(DOWN) * (HEIGHT + GAP)


def box(x: float, y: float, words: Box, fill: str) -> str:
    """A file's name above its part."""
    name, part = words
    return (
        element("rect", x=x, y=y, width=WIDTH, height=HEIGHT, rx=6.0, fill=fill, stroke=INK)
        + text(x + 10, y + 18, name, 13.0, font_weight="bold", fill=INK)
        + text(x + 10, y + 35, part, 12.0, fill=INK)
    )


def arrow(x: float, y: float, to_x: float, to_y: float) -> str:
    """A line with a head at its end."""
    return element(
        "line", x1=x, y1=y, x2=to_x, y2=to_y, stroke=INK, stroke_width=1.5, marker_end="url(#head)"
    )


def picture() -> str:
    """The whole SVG: the way of the command on the left, what is made of its events on the right."""
    right = MARGIN + WIDTH + 80
    head = element(
        "marker", element("path", d="M0 0 L8 4 L0 8 z", fill=INK), id="head", markerWidth=8, markerHeight=8,
        refX=7, refY=4, orient="auto",
    )  # fmt: skip
    parts = [element("defs", head), element("rect", width="100%", height="100%", fill="#ffffff")]
    parts.append(text(MARGIN, 30, "program: d1-3 to port 9000, and its reply", 13.0, fill=FAINT))
    parts.append(text(right, 30, "events: screen, page, log, report", 13.0, fill=FAINT))
    for x, boxes, fill in ((MARGIN, DOWN, "#e4eefb"), (right, BESIDE, "#e7f5e6")):
        for number, words in enumerate(boxes):
            y = 50 + number * (HEIGHT + GAP)
            parts.append(box(x, y, words, fill))
            if boxes is DOWN and number + 1 < len(boxes):
                parts.append(arrow(x + 60, y + HEIGHT, x + 60, y + HEIGHT + GAP))
                parts.append(arrow(x + WIDTH - 60, y + HEIGHT + GAP, x + WIDTH - 60, y + HEIGHT))
    engine = 50 + 4 * (HEIGHT + GAP) + HEIGHT / 2
    events = 50 + HEIGHT / 2
    parts.append(arrow(MARGIN + WIDTH, engine, right, events))
    parts.append(arrow(right + 60, 50 + HEIGHT, right + 60, 50 + HEIGHT + GAP))
    reducer = 50 + (HEIGHT + GAP) + HEIGHT
    for number in range(2, len(BESIDE)):  # the reducer's state and history serve all below it
        y = 50 + number * (HEIGHT + GAP)
        parts.append(arrow(right + WIDTH + 14, y + HEIGHT / 2, right + WIDTH, y + HEIGHT / 2))
    line = (
        f"M{right + WIDTH} {reducer - HEIGHT / 2} h14 V{50 + (len(BESIDE) - 1) * (HEIGHT + GAP) + HEIGHT / 2}"
    )
    parts.append(element("path", d=line, fill="none", stroke=INK, stroke_width=1.5))
    size = f"0 0 {right + WIDTH + MARGIN + 14:.0f} {BOTTOM + 10:.0f}"
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='{size}' {FONT} role='img' "
        f"aria-label='The way of one command through the rooms'>{''.join(parts)}</svg>\n"
    )


def main() -> None:
    PICTURE.write_text(picture(), "utf-8")
    print(f"written: {PICTURE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
