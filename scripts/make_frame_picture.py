"""Draw the frames of maze and robot, with the sensors and drives of the default set: docs/frame.svg.

    python scripts/make_frame_picture.py

tests/test_docs.py looks that the picture is the present one.
"""

from __future__ import annotations

import math
import sys
from collections import defaultdict
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parent.parent))  # a clone's root; an installed one is first
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_sets
from simmer_tui.document import svg
from simmer_tui.report.figure import TILES, WALLS
from simmer_tui.sim import DriveKind, Pose
from simmer_tui.sim.specs import CELL_SIZE, WALL, SensorSpec, SimulationSpec

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "frame.svg"
WIDTH, HEIGHT = 820.0, 380.0
"""Of the picture, points: as wide as a page of the site, so that texts keep their size."""
SIZE = 12.0
"""Of its texts, points."""
POSE = Pose(54.0, 30.0, 30.0)
"""Place of the robot in the maze: free, with a heading along neither axis."""
RAY, COUNTER, DRIVE = "#554100", "#3066e4", "#ab4366"
BEGIN, MIDDLE, SCALE = (46.0, 310.0), (628.0, 212.0), 29.0
"""Origin of the maze, middle of the robot, and points to an inch of the robot."""
DIRECTIONS = {
    DriveKind.RIGHT: (0.0, "ahead"),
    DriveKind.UP: (90.0, "left"),
    DriveKind.LEFT: (180.0, "back"),
    DriveKind.DOWN: (270.0, "right"),
}
"""Of drives in the robot's frame, degrees from its front, and the word."""


def arrow(begin: tuple[float, float], end: tuple[float, float], colour: str, **style: object) -> str:
    """A line with a head at its end."""
    look = {"stroke": colour, "stroke_width": 1.6, "marker_end": f"url(#{colour[1:]})", **style}
    return svg.element("line", x1=begin[0], y1=begin[1], x2=end[0], y2=end[1], **look)


def words(x: float, y: float, text: str, colour: str = svg.INK, **style: object) -> str:
    """A text that stays readable on lines."""
    rim = {"paint_order": "stroke", "stroke": "#ffffff", "stroke_width": 3.0}
    return svg.text(x, y, text, SIZE, fill=colour, **{"text_anchor": "middle", **rim, **style})


def maze_frame(spec: SimulationSpec) -> str:
    """The maze with its axes, and a robot at `POSE` with its heading."""
    left, bottom = BEGIN
    scale = 330.0 / spec.maze.width
    side = CELL_SIZE * scale
    top = bottom - spec.maze.height * scale
    parts = [words(left + 165, 22, "maze: global frame, inches", font_weight="bold")]
    for row, cells in enumerate(spec.maze.cells):
        for column, cell in enumerate(cells):
            fill = WALLS if cell == WALL else TILES if (row + column) % 2 else "#ffffff"
            square = {"x": left + column * side, "y": top + row * side, "width": side, "height": side}
            parts.append(svg.element("rect", **square, fill=fill))
    parts += [
        arrow((left, bottom), (left + 352, bottom), svg.INK),
        arrow((left, bottom), (left, top - 26), svg.INK),
        words(left + 352, bottom + 18, "+X"),
        words(left - 18, top - 22, "+Y"),
        words(left - 12, bottom + 18, "0, 0"),
        words(left + 330, bottom + 36, f"{spec.maze.width:g}, 0"),
        words(left - 22, top + 4, f"0, {spec.maze.height:g}"),
    ]
    x, y = left + POSE.x * scale, bottom - POSE.y * scale
    angle = math.radians(POSE.heading)
    radius, reach = (spec.robot.radius or CELL_SIZE / 4) * scale, 62.0
    ahead = (x + reach * math.cos(angle), y - reach * math.sin(angle))
    turned = (x + 36 * math.cos(angle), y - 36 * math.sin(angle))
    parts += [
        svg.element("line", x1=x, y1=y, x2=x + reach, y2=y, stroke=svg.FAINT, stroke_dasharray="3 3"),
        svg.element(
            "path", d=f"M{x + 36:.1f} {y:.1f}A36 36 0 0 0 {turned[0]:.1f} {turned[1]:.1f}", fill="none",
            stroke=DRIVE, stroke_width=1.6, marker_end=f"url(#{DRIVE[1:]})",
        ),
        svg.element("circle", cx=x, cy=y, r=radius, fill=svg.BODY, stroke=svg.ROBOT_LINE, stroke_width=1.6),
        arrow((x, y), ahead, svg.ROBOT_LINE),
        words(x + 70, y - 12, f"heading {POSE.heading:g}", DRIVE, text_anchor="start"),
        words(x, y + radius + 16, f"at {POSE.x:g}, {POSE.y:g}"),
        words(left + 165, bottom + 36, "degrees, counter-clockwise from +X"),
    ]  # fmt: skip
    return "".join(parts)


def around(angle: float, distance: float) -> tuple[float, float]:
    """A place around the robot, whose front is up: degrees from its front, points."""
    turned = math.radians(angle + 90)
    return MIDDLE[0] + distance * math.cos(turned), MIDDLE[1] - distance * math.sin(turned)


def on_robot(x: float, y: float) -> tuple[float, float]:
    """A place of the robot's frame (inches) in the picture."""
    return MIDDLE[0] - y * SCALE, MIDDLE[1] - x * SCALE


def sensors(spec: SimulationSpec) -> str:
    """Sensors at their places: rays of those that measure a range, dots and codes of the others."""
    parts: list[str] = []
    looking: dict[tuple[float, float, float], list[SensorSpec]] = defaultdict(list)
    others: dict[tuple[float, float], list[SensorSpec]] = defaultdict(list)
    for sensor in spec.sensors:
        if sensor.kind.is_range:
            looking[sensor.x, sensor.y, sensor.rotation].append(sensor)
        else:
            others[sensor.x, sensor.y].append(sensor)
    for (x, y, rotation), group in looking.items():
        begin, end = on_robot(x, y), around(rotation, 116.0)
        # Beside an axis that has the same direction.
        text = around(rotation - 15 if rotation % 90 == 0 else rotation, 132.0)
        parts += [
            arrow(begin, end, RAY),
            words(*text, " ".join(each.code for each in group), RAY, dominant_baseline="central"),
        ]
    for (x, y), group in others.items():
        at = on_robot(x, y)
        # Of a wheel the code stands further in, so that it does not lie on the rim.
        is_wheel = any(each.kind.counts for each in group) and bool(x or y)
        colour = COUNTER if is_wheel else svg.INK
        inwards = around(math.degrees(math.atan2(y, x)), math.hypot(x, y) * SCALE - 15)
        text = inwards if is_wheel else (at[0] + 4 + 4.5 * len(group) * 2, at[1] + 12)
        parts += [
            svg.element("circle", cx=at[0], cy=at[1], r=3.0, fill=colour),
            words(*text, " ".join(each.code for each in group), colour, dominant_baseline="central"),
        ]
    return "".join(parts)


def robot_frame(spec: SimulationSpec) -> str:
    """The robot from above, its front up: axes, sensors, and the drives that move it."""
    radius = (spec.robot.radius or CELL_SIZE / 4) * SCALE
    x, y = MIDDLE
    parts = [
        words(x, 22, "robot: its own frame, from above", font_weight="bold"),
        svg.element("circle", cx=x, cy=y, r=radius, fill=svg.BODY, fill_opacity=0.6, stroke=svg.ROBOT_LINE),
        arrow((x, y), around(0, 156.0), svg.INK, stroke_dasharray="2 4"),
        arrow((x, y), around(90, 156.0), svg.INK, stroke_dasharray="2 4"),
        words(x, y - 162, "+X front"),
        words(x - 160, y + 4, "+Y left", text_anchor="end"),
        sensors(spec),
    ]
    for drive in spec.drives:
        if drive.kind is DriveKind.ROT:
            begin, end = around(215, 104.0), around(248, 104.0)
            turn = f"M{begin[0]:.1f} {begin[1]:.1f}A104 104 0 0 0 {end[0]:.1f} {end[1]:.1f}"
            head = {"stroke_width": 1.6, "marker_end": f"url(#{DRIVE[1:]})"}
            parts.append(svg.element("path", d=turn, fill="none", stroke=DRIVE, **head))
            parts.append(
                words(*around(234, 112.0), f"{drive.code}-45 turns left", DRIVE, text_anchor="start")
            )
            continue
        angle, word = DIRECTIONS[drive.kind]
        # Beside the ray of a sensor that looks the same way.
        begin, end, text = around(angle + 15, 94.0), around(angle + 12, 126.0), around(angle + 22, 142.0)
        parts.append(arrow(begin, end, DRIVE))
        parts.append(words(*text, f"{drive.code}-3 {word}", DRIVE, dominant_baseline="central"))
    return "".join(parts)


def picture() -> str:
    """The whole SVG."""
    spec = load(bundled_sets()["default"]).simulation
    heads = "".join(
        svg.element(
            "marker", svg.element("path", d="M0 0 L8 4 L0 8 z", fill=colour), id=colour[1:], refX=7, refY=4,
            markerWidth=8, markerHeight=8, orient="auto",
        )
        for colour in dict.fromkeys((svg.INK, svg.ROBOT_LINE, RAY, DRIVE))
    )  # fmt: skip
    parts = (svg.element("defs", heads), svg.element("rect", width="100%", height="100%", fill="#ffffff"))
    about = "The maze's frame with x to the right and y up, and the robot's with x ahead and y to the left"
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {WIDTH:g} {HEIGHT:g}' {svg.FONT} role='img' "
        f"aria-label='{svg.html_text(about)}'>{''.join(parts)}{maze_frame(spec)}{robot_frame(spec)}</svg>\n"
    )


def main() -> None:
    """Write it."""
    PICTURE.write_text(picture(), "utf-8", newline="\n")
    print(f"Wrote {PICTURE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
