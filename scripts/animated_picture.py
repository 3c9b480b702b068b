#!/usr/bin/env python3
"""Draw the animated pictures of README.md from a real run: the app in which solve.py does the mission.

    python scripts/animated_picture.py [--seed N] [--pace X] [--size COLUMNSxROWS] FOLDER
    python scripts/animated_picture.py --still [--seed N] FOLDER

Writes `mission-dark.svg` and `mission-light.svg`. The app runs here without a terminal; its screen is
captured a few times a second. A piece of a row that is the same in several pictures is written once, with the
times at which it is visible. Viewers that do not animate show a moment of the run.

With `--still`: the pictures of docs/screen.md, each a moment of such a run, at three sizes, in light
colours and in plain ASCII, and of its replay; and the one of docs/sketch-parts.md, with a board and its
display. That one needs a C++ compiler.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import subprocess
import sys
import tempfile
import threading
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path

from rich.segment import Segment
from rich.style import Style

from simmer_tui.cli.sketch_option import compiled
from simmer_tui.config.loader import Override, load
from simmer_tui.config.sets import bundled_sets, find_set, init_set
from simmer_tui.live.server import Server
from simmer_tui.program import Program
from simmer_tui.run.mission import plan_run
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.tui.app import SimmerApp
from simmer_tui.tui.recorded import RecordedRun
from simmer_tui.tui.replay import ReplayApp
from simmer_tui.tui.terminal import ColorDepth, GlyphMode, TerminalChoice
from simmer_tui.tui.textual_internals import rows_of

WIDTH, HEIGHT, BASELINE, LETTER = 8.4, 17.0, 13.0, 14.0
"""Of a cell, pixels: its size, where letters stand, their size."""
A_SECOND = 5
"""Pictures a second."""
LINGER = 3.0
"""Seconds that the last one stays."""
POSTER = 0.45
"""Moment that a viewer without animation shows, as a share of the run."""
QUADRANTS = " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"


@dataclass(frozen=True)
class Still:
    """A picture of docs/screen.md: size in columns and rows, theme, characters of the maze, the program with
    its set, its pace, and the moment as a share of the run."""

    size: tuple[int, int]
    theme: str = "dark"
    glyphs: GlyphMode = GlyphMode.QUADRANT
    program: str = "solve.py"
    set: str = "mission"
    pace: float = 10.0
    moment: float = POSTER


STILLS = {
    "small": Still((80, 24)),
    "medium": Still((120, 36)),
    "large": Still((200, 60)),
    "light": Still((120, 36), "light"),
    "ascii": Still((80, 24), glyphs=GlyphMode.ASCII),
    "wander": Still((120, 36), program="wander.py --steps 60"),
    # After its first turn: the map shows several places where it can be.
    "heat": Still((120, 36), program="course/step4b_histogram.py", set="default", pace=1.0, moment=0.6),
    "solve": Still((120, 36)),
}
"""Pictures of docs/screen.md by name."""
BOARD_STILL = Still((120, 40), pace=1.0, moment=0.8)
BOARD_SET = {
    "wiring.toml": """
[boards.rover]
sketch = "rover.ino"
board = "uno"
[laptop]
board = "rover"
[[motors]]
board = "rover"
driver = "shield"
dir = 7
pwm = 5
wheel = "left"
top_speed = 12
[[motors]]
board = "rover"
driver = "shield"
dir = 8
pwm = 6
wheel = "right"
top_speed = 12
[[sensors]]
code = "u1"
board = "rover"
part = "hc-sr04"
trig = 10
echo = 9
""",
    "rover.ino": """
#include <LiquidCrystal_I2C.h>
LiquidCrystal_I2C lcd(0x27, 16, 2);
bool driving = false;
float ahead() {
  digitalWrite(10, HIGH); delayMicroseconds(10); digitalWrite(10, LOW);
  return pulseIn(9, HIGH, 30000) / 148.0;
}
void drive(int duty) {
  digitalWrite(7, HIGH); digitalWrite(8, HIGH);
  analogWrite(5, duty); analogWrite(6, duty);
  digitalWrite(LED_BUILTIN, duty > 0);
}
void setup() {
  for (int pin : {5, 6, 7, 8, 10, LED_BUILTIN}) pinMode(pin, OUTPUT);
  Serial.begin(9600);
  lcd.begin();
  lcd.backlight();
  lcd.print("rover ready");
}
void loop() {
  if (Serial.available() && Serial.read() == 'F') driving = true;
  float inches = ahead();
  if (driving && inches < 4) { driving = false; Serial.println("stopped"); }
  drive(driving ? 90 : 0);
  lcd.setCursor(0, 0); lcd.print(driving ? "driving    " : "rover ready");
  lcd.setCursor(0, 1); lcd.print("ahead "); lcd.print(inches, 1); lcd.print(" in  ");
  Serial.print("ahead "); Serial.println(inches, 1);
  delay(200);
}
""",
    "drive_it.py": """
import time
import serial
port = serial.Serial("COM6", 9600, timeout=1)
time.sleep(2)
port.write(b"F")
time.sleep(4)
""",
}
"""A set of one board with a display, by its files beside those of the bundled mission."""
LAST_LOOKS = 20
"""Further pictures after the program has ended, to show the end of the mission."""
Piece = tuple[int, int, str, str, str, bool]
"""A part of a row: row, column, text, colours of letters and ground, bold."""


async def pictures(
    app: SimmerApp, server: Server, size: tuple[int, int], program: str
) -> list[frozenset[Piece]]:
    """Pictures of the screen, a few times a second, until the program has ended."""
    over = threading.Event()
    seen: list[frozenset[Piece]] = []
    async with app.run_test(size=size):
        running = Program(
            f"{sys.executable} {Path(__file__).parent / program}",
            server.environment,
            lambda code: over.set(),
            lambda line: None,
        )
        try:
            while not over.is_set():
                shown = frozenset(pieces(rows_of(app.screen)))
                # A program that loads NumPy connects late.
                if not any("WAITING" in piece[2] for piece in shown):
                    seen.append(shown)
                await asyncio.sleep(1 / A_SECOND)
            # A busy machine shows the end of the mission a while after the program has ended.
            for _ in range(LAST_LOOKS):
                await asyncio.sleep(2 / A_SECOND)
                last = frozenset(pieces(rows_of(app.screen)))
                if any("MISSION" in piece[2] for piece in last):
                    break
            seen.append(last)
        finally:
            running.end()
    return seen


def pieces(rows: Sequence[Sequence[Segment]]) -> Iterator[Piece]:
    """The parts of one picture that are drawn, including blocks of floor, which are side by side."""
    for row, strip in enumerate(rows):
        column = 0
        for segment in strip:
            style = segment.style or Style()
            letters, ground = _colour(style, front=True), _colour(style, front=False)
            if style.reverse:
                letters, ground = ground, letters
            yield row, column, segment.text, letters, ground, bool(style.bold)
            column += segment.cell_length


def _colour(style: Style, *, front: bool) -> str:
    colour = style.color if front else style.bgcolor
    return "" if colour is None or colour.is_default else colour.get_truecolor().hex


def animation(seen: Sequence[frozenset[Piece]], size: tuple[int, int], ground: str) -> str:
    """An SVG that shows one picture after the other, in an endless loop."""
    spans: Mapping[tuple[int, int], list[Piece]] = _spans(seen)
    length = len(seen) / A_SECOND + LINGER
    moves = (
        f'<animate id="t" attributeName="x" from="0" to="0" begin="0;t.end" dur="{length:g}s"/>'
        if len(seen) > 1
        else ""
    )
    poster = int(POSTER * len(seen))
    columns, rows = size
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {columns * WIDTH:g} {rows * HEIGHT:g}" '
        f'font-family="DejaVu Sans Mono,Menlo,Consolas,monospace" font-size="{LETTER:g}">',
        f'<rect width="100%" height="100%" fill="{ground}">{moves}</rect>',
    ]
    for (begin, end), found in sorted(spans.items()):
        body = "".join(_drawn(piece, ground) for piece in sorted(found))
        if not body:
            continue
        if begin == 0 and end == len(seen):
            parts.append(f"<g>{body}</g>")
            continue
        here = begin <= poster < end
        shown = "" if here else ' visibility="hidden"'
        last = f"{length:g}" if end == len(seen) else f"{end / A_SECOND:g}"
        times = [(f"{begin / A_SECOND:g}", last, "visible")]
        if here:
            times = [("0", f"{begin / A_SECOND:g}", "hidden")] if begin else []
            times += [(last, f"{length:g}", "hidden")] if end < len(seen) else []
        sets = "".join(
            f'<set attributeName="visibility" to="{value}" begin="t.begin+{since}s" '
            f'dur="{float(until) - float(since):g}s"/>'
            for since, until, value in times
        )
        parts.append(f"<g{shown}>{sets}{body}</g>")
    return "\n".join([*parts, "</svg>\n"])


def _spans(seen: Sequence[frozenset[Piece]]) -> Mapping[tuple[int, int], list[Piece]]:
    """The pieces by the pictures, from first up to last, in which they are visible."""
    spans = defaultdict(list)
    since: dict[Piece, int] = {}
    for number, look in enumerate((*seen, frozenset())):
        for piece in [each for each in since if each not in look]:
            spans[since.pop(piece), number].append(piece)
        for piece in look:
            since.setdefault(piece, number)
    return spans


def _drawn(piece: Piece, paper: str) -> str:
    """A piece as SVG. Blocks and dots are drawn, since fonts leave gaps between them."""
    row, column, text, letters, ground, bold = piece
    x, y = column * WIDTH, row * HEIGHT
    parts = []
    if ground and ground != paper:
        parts.append(_box(x, y, len(text) * WIDTH, HEIGHT, ground))
    dots, words = [], []
    for at, character in enumerate(text):
        left = x + at * WIDTH
        if character in QUADRANTS:
            bits = QUADRANTS.index(character)
            dots += [
                f"M{left + (bit % 2) * WIDTH / 2:g} {y + bit // 2 * HEIGHT / 2:g}"
                f"h{WIDTH / 2:g}v{HEIGHT / 2:g}h-{WIDTH / 2:g}z"
                for bit in range(4)
                if bits >> bit & 1
            ]
            words.append(" ")
        elif 0x2800 <= ord(character) < 0x2900:
            dots += [
                f"M{left + (0.16 + 0.5 * (bit in (3, 4, 5, 7))) * WIDTH:.1f} "
                f"{y + (0.07 + 0.25 * (3 if bit > 5 else bit % 3)) * HEIGHT:.1f}h2.6v2.6h-2.6z"
                for bit in range(8)
                if ord(character) - 0x2800 >> bit & 1
            ]
            words.append(" ")
        else:
            words.append(character)
    if dots:
        parts.append(f'<path fill="{letters}" d="{"".join(dots)}"/>')
    said = "".join(words)
    if said.strip():
        start = len(said) - len(said.lstrip())
        said = said.strip()
        weight = ' font-weight="bold"' if bold else ""
        parts.append(
            f'<text x="{x + start * WIDTH:.1f}" y="{y + BASELINE:g}" fill="{letters}"{weight} '
            f'textLength="{len(said) * WIDTH:.1f}" xml:space="preserve">{escape(said)}</text>'
        )
    return "".join(parts)


def _box(x: float, y: float, width: float, height: float, fill: str) -> str:
    # Slightly too large: otherwise lines show between cells of a scaled picture.
    return f'<rect x="{x:.1f}" y="{y:g}" width="{width + 0.3:.1f}" height="{height + 0.3:g}" fill="{fill}"/>'


def draw(look: Still, seed: int, pace: float, *, still: bool = False) -> str:
    """One run, as an animated SVG, or a moment of it."""
    given = {"seed": seed, "server.port": 0, "screen.theme": look.theme, "screen.fps": 20}
    overrides = {name: Override(f"--{name}", value) for name, value in given.items()}
    configuration, plan = load(find_set(look.set), overrides), None
    if configuration.mission is not None:
        configuration, plan = plan_run(configuration)
    return screens(Server(configuration, plan=plan), look, pace, still=still)


def draw_board(seed: int) -> str:
    """A moment of a run with a board and its display."""
    # The picture has the set's path: a relative one has nothing of this machine.
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        folder = Path("rover")
        init_set(folder, bundled_sets()["default"])
        with (folder / "settings.toml").open("a", encoding="utf-8") as file:
            file.write('\n[wheels]\nlayout = "diff"\n')
        for file_name, text in BOARD_SET.items():
            (folder / file_name).write_text(text, encoding="utf-8")
        given = {"seed": seed, "server.port": 0, "screen.theme": BOARD_STILL.theme}
        overrides = {name: Override(f"--{name}", value) for name, value in given.items()}
        configuration, sketches = compiled(load(folder, overrides))
        look = replace(BOARD_STILL, program=f"{folder.resolve()}/drive_it.py")
        return screens(Server(configuration, sketches=sketches), look, look.pace, still=True)


def screens(server: Server, look: Still, pace: float, *, still: bool) -> str:
    """The SVG of a server's run."""
    server.record(pace)
    server.start()
    try:
        with tempfile.TemporaryDirectory() as folder:
            choice = TerminalChoice(ColorDepth.TRUECOLOR, look.glyphs)
            app = SimmerApp(server, choice, Path(folder) / "history.txt")
            seen = asyncio.run(pictures(app, server, look.size, look.program))
            ground = app.current_theme.background or "#000000"
    finally:
        server.stop()
    moment = min(int(look.moment * len(seen)), len(seen) - 1)
    return animation(seen[moment:][:1] if still else seen, look.size, ground)


def draw_replay(seed: int, size: tuple[int, int]) -> str:
    """A moment of the replay of a run."""

    async def look(app: ReplayApp, run: RecordedRun) -> frozenset[Piece]:
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            run.move_to(POSTER * run.duration)
            # Digits are typed half a second apart.
            await asyncio.sleep(1.0)
            return frozenset(pieces(rows_of(app.screen)))

    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "mission.jsonl"
        program = f"{sys.executable} {Path(__file__).with_name('solve.py')}"
        command = [sys.executable, "-m", "simmer_tui", "--no-ui", "--mission", "--seed", f"{seed}"]
        command += ["--port", "0", "--log", f"{log}", "--run", program]
        subprocess.run(command, check=True, capture_output=True)
        with RunLogIndex(log) as index:
            run = RecordedRun(index)
            app = ReplayApp(run, TerminalChoice(ColorDepth.TRUECOLOR, GlyphMode.QUADRANT))
            seen = asyncio.run(look(app, run))
            return animation([seen], size, app.current_theme.background or "#000000")


def draw_stills(folder: Path, seed: int) -> None:
    """The pictures of docs/screen.md and docs/sketch-parts.md."""
    if find_compiler() is None:
        print("board.svg is left out: it needs a C++ compiler")
    else:
        write(folder / "board.svg", draw_board(seed))
    for name, look in STILLS.items():
        write(folder / f"{name}.svg", draw(look, seed, look.pace, still=True))
    write(folder / "replay.svg", draw_replay(seed, (120, 36)))


def write(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8")
    print(f"{file}: {file.stat().st_size / 1e6:.2f} MB")


def main() -> None:
    parser = argparse.ArgumentParser(description="Draw the animated pictures of README.md.")
    parser.add_argument("folder", type=Path, help="where they are written")
    parser.add_argument("--seed", type=int, default=3, help="of the run (default: 3)")
    parser.add_argument("--pace", type=float, default=5.0, help="times real speed (default: 5)")
    parser.add_argument("--size", default="104x32", help="columns and rows (default: 104x32)")
    parser.add_argument("--still", action="store_true", help="the pictures of docs/screen.md instead")
    options = parser.parse_args()
    if options.still:
        draw_stills(options.folder, options.seed)
        return
    columns, rows = map(int, options.size.split("x"))
    for theme in ("dark", "light"):
        text = draw(Still((columns, rows), theme), options.seed, options.pace)
        write(options.folder / f"mission-{theme}.svg", text)


if __name__ == "__main__":
    main()
