"""Maze as a terminal shows it: cells after pyte has taken the bytes that the app sends."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import select
import shutil
import signal
import socket
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyte
import pyte.graphics
import pytest
from rich.color import Color, ColorSystem
from rich.color_triplet import ColorTriplet

from simmer_tui.client import Robot
from simmer_tui.tui.maze.glyphs import Cells, blank_cells
from simmer_tui.tui.maze.painter import Painter
from simmer_tui.tui.maze.palette import GROUNDS, Attribute, Role
from simmer_tui.tui.terminal import ColorDepth, GlyphMode
from tests.tui.maze.decoding import arrow_heading, hand_heading, robot_cells, turned
from tests.tui.maze.test_headings import HEADINGS, VIEWS
from tests.tui.test_tmux import UNKNOWN_TO_PYTE, Pane, environment, until

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="ptys are those of POSIX")

SECONDS = 120.0
KINDS = {
    "truecolor": (GlyphMode.QUADRANT, ColorDepth.TRUECOLOR),
    "256": (GlyphMode.QUADRANT, ColorDepth.COLORS_256),
    "16": (GlyphMode.QUADRANT, ColorDepth.COLORS_16),
    "mono": (GlyphMode.QUADRANT, ColorDepth.NONE),
    "ascii": (GlyphMode.ASCII, ColorDepth.NONE),
}
_STYLE = re.compile(rb"\x1b\[([0-9;]*)m")
UPDATE_ENDS = b"\x1b[?2026l"
_SIXTEEN = [pyte.graphics.FG_ANSI[30 + number] for number in range(8)]
_SIXTEEN += [pyte.graphics.FG_AIXTERM[90 + number] for number in range(8)]


class Terminal:
    """The app on a pty, and an emulated screen that shows what it sends."""

    def __init__(self, size: tuple[int, int], options: list[str], variables: dict[str, str]) -> None:
        columns, rows = size
        self._master, slave = os.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        command = [sys.executable, "-m", "simmer_tui", *options]
        self._process = subprocess.Popen(
            command, stdin=slave, stdout=slave, stderr=slave, start_new_session=True, env=variables
        )
        os.close(slave)
        self.screen = pyte.Screen(columns, rows)
        self._stream = pyte.ByteStream(self.screen)
        self._held = b""

    def type(self, line: str) -> None:
        os.write(self._master, f"{line}\r".encode())

    def until(self, condition: Callable[[], object]) -> None:
        """Take what the app sends until a condition holds."""
        end = time.monotonic() + SECONDS
        while not condition():
            assert time.monotonic() < end, "it never came; there was\n" + "\n".join(self.screen.display)
            self._take()

    def shows(self, text: str) -> bool:
        return any(text in row for row in self.screen.display)

    def _take(self) -> None:
        waiting = bool(select.select([self._master], [], [], 0.05)[0])
        self._held += os.read(self._master, 65536) if waiting else b""
        # A sequence may have come in part only; what has been silent since is whole.
        begun = self._held.rfind(b"\x1b") if waiting else -1
        whole = self._held if begun < 0 else self._held[:begun]
        self._held = self._held[len(whole) :]
        self._show(whole)

    def take_update(self) -> None:
        """Take what the app sends up to the end of its next update."""
        end = time.monotonic() + SECONDS
        while UPDATE_ENDS not in self._held:
            assert time.monotonic() < end, "it draws nothing more"
            if select.select([self._master], [], [], 0.05)[0]:
                self._held += os.read(self._master, 65536)
        update, self._held = self._held.split(UPDATE_ENDS, 1)
        self._show(update)

    def _show(self, written: bytes) -> None:
        if b"\x1b[?2026$p" in written:
            os.write(self._master, b"\x1b[?2026;2$y")  # its updates are synchronized
        self._stream.feed(_STYLE.sub(_dim_as_italics, UNKNOWN_TO_PYTE.sub(b"", written)))

    def close(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGTERM)
        end = time.monotonic() + SECONDS
        while self._process.poll() is None and time.monotonic() < end:
            with contextlib.suppress(OSError):
                self._take()
        self._process.kill()
        self._process.wait()
        os.close(self._master)


def _dim_as_italics(style: re.Match[bytes]) -> bytes:
    """A style with italics, which the app has none of, for dim, which pyte does not know."""
    codes = style[1].split(b";")
    if b"38" in codes or b"48" in codes:
        return style[0]  # their 2 is no attribute, and with colours nothing is dim
    changed = [{b"2": b"3", b"22": b"22;23"}.get(code, code) for code in codes]
    return b"\x1b[" + b";".join(changed) + b"m"


def shown_color(packed: int, depth: ColorDepth) -> str:
    """Name that pyte gives to a colour sent at a depth."""
    color = Color.from_triplet(ColorTriplet(packed >> 16, packed >> 8 & 255, packed & 255))
    if depth is ColorDepth.TRUECOLOR:
        return f"{packed:06x}"
    if depth is ColorDepth.COLORS_256:
        number = color.downgrade(ColorSystem.EIGHT_BIT).number
        assert number is not None
        return str(pyte.graphics.FG_BG_256[number])
    number = color.downgrade(ColorSystem.STANDARD).number
    assert number is not None
    return str(_SIXTEEN[number])


def maze_within(view: tuple[int, int]) -> tuple[slice, slice]:
    """Rows and columns of a screen where the maze stands, of a view of so many columns and rows."""
    columns, rows = view
    return slice(2, rows), slice(1, columns - 1)


def cells_of(screen: pyte.Screen, size: tuple[int, int], painter: Painter) -> Cells:
    """The maze within its frame. A colour of no role is a number that the palette does not have."""
    packed = {"default": -1}
    if not painter.palette.is_mono:
        for role in Role:
            packed.setdefault(shown_color(painter.palette[role], painter.depth), painter.palette[role])
    down, across = maze_within(size)
    cells = blank_cells(down.stop - down.start, across.stop - across.start)
    for row in range(cells.characters.shape[0]):
        for column in range(cells.characters.shape[1]):
            cell = screen.buffer[down.start + row][across.start + column]
            cells.characters[row, column] = ord(cell.data[0])
            cells.foreground[row, column] = packed.get(cell.fg, -2)
            cells.background[row, column] = packed.get(cell.bg, -2)
            attributes = Attribute.BOLD * cell.bold + Attribute.REVERSE * cell.reverse
            cells.attributes[row, column] = attributes + Attribute.DIM * cell.italics
    return cells


def free_ports(count: int) -> list[int]:
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(count)]
        return [each.getsockname()[1] for each in sockets]


class Course:
    """A robot with trail, rays, contact and belief over one another, on whatever screen."""

    def __init__(
        self,
        robot: Robot,
        give: Callable[[str], None],
        rows: Callable[[], list[str]],
        wait: Callable[[Callable[[], object]], None],
        view: tuple[int, int],
    ) -> None:
        """`give` types a line, `rows` are what stands on the screen, `wait` lets it go on."""
        self._robot, self._give, self._rows, self._wait = robot, give, rows, wait
        self._maze = maze_within(view)

    def _until(self, pattern: str, *, in_the_maze: bool = False) -> re.Match[str]:
        found: list[re.Match[str] | None] = []
        down, across = self._maze if in_the_maze else (slice(None), slice(None))

        def there() -> bool:
            found[:] = [re.search(pattern, "\n".join(row[across] for row in self._rows()[down]))]
            return found[0] is not None

        self._wait(there)
        assert found[0] is not None
        return found[0]

    def crowd(self, heading: float) -> float:
        """Returns once all of it is on the screen; gives the heading it has come to."""
        shown = 180.0 - (180.0 - heading) % 360.0
        self._give(":reset")
        self._give(":noise off")
        self._give(":bias off")
        self._give(f":teleport 66 30 {heading:g}")
        self._until(rf"66\.0, 30\.0 in +{shown:.0f} deg")
        # Of the four ways it can go, the one that leads most nearly up, to the outer wall.
        ways = {("d1", 1): 0, ("w1", 1): 90, ("d1", -1): 180, ("w1", -1): 270}
        code, sign = min(ways, key=lambda way: turned(heading + ways[way], 90))
        self._robot.send(f"{code}-{-3 * sign}")
        self._robot.send(f"{code}-{30 * sign}")
        for sensor in ("u1", "u2", "u3", "u4", "u5", "t1"):
            self._robot.send(sensor)
        self._until(r"contacts +1\b|\b1 contact\b")
        pose = self._until(r"(\d+\.\d), (\d+\.\d) in +(-?\d+) deg")
        x, y = float(pose[1]), float(pose[2])
        self._robot.believe(x - 2.4, y + 1.3, heading + 130, 4.0, [(x, y)])
        self._until(r"off \d")
        self._until("X", in_the_maze=True)  # it may be drawn after the numbers; log and legend have one, too
        return float(pose[3])


def check(cells: Cells, painter: Painter, heading: float) -> None:
    """The heading and the layers, as the cells have them."""
    arrow = arrow_heading(cells, painter)
    assert arrow is not None, heading
    assert turned(arrow, heading) <= 45, (heading, arrow)
    assert (cells.characters == ord("X")).any(), heading
    if painter.palette.is_mono:
        return
    robot = robot_cells(cells, painter)
    assert robot.sum() >= 4
    allowed = {painter.palette[role] for role in (*GROUNDS, Role.ROBOT, Role.HEADING)}
    seen = set(cells.background[robot].tolist())
    seen |= set(cells.foreground[robot & (cells.characters != ord(" "))].tolist())
    assert seen <= allowed, (heading, seen - allowed)
    # The trail is there too, but a ray backwards may lie over all of it.
    for roles in ((Role.RAY_STRONG, Role.RAY_WEAK), (Role.BELIEF,)):
        assert np.isin(cells.foreground, [painter.palette[role] for role in roles]).any(), (heading, roles)
    assert ((cells.background == painter.palette[Role.CONTACT]) & (cells.characters == ord("X"))).any()


def come_true(wait: Callable[[Callable[[], object]], None], claim: Callable[[], None]) -> None:
    """A picture may have come in part only: wait until a claim about it holds."""

    def holds() -> bool:
        try:
            claim()
        except AssertionError:
            return False
        return True

    with contextlib.suppress(AssertionError):
        wait(holds)
    claim()  # says what is wrong


def run_on_a_pty(tmp_path: Path, size: str, kind: str, headings: list[float]) -> None:
    glyphs, depth = KINDS[kind]
    painter = Painter(glyphs, depth)
    columns, rows = map(int, size.split("x"))
    commands, replies, beliefs = free_ports(3)
    options = ["--seed", "5", "--pace", "off", "--port", f"{commands}", "--reply-port", f"{replies}"]
    options += ["--belief-port", f"{beliefs}", "--color", depth.value, "--glyphs", glyphs.value]
    terminal = Terminal((columns, rows), options, environment(tmp_path))
    try:
        terminal.until(lambda: terminal.shows("WAITING"))
        with Robot("127.0.0.1", commands, replies, belief_port=beliefs) as robot:
            course = Course(
                robot, terminal.type, lambda: list(terminal.screen.display), terminal.until, VIEWS[size]
            )
            for heading in headings:
                come_to = course.crowd(heading)

                def claim(come_to: float = come_to) -> None:
                    check(cells_of(terminal.screen, VIEWS[size], painter), painter, come_to)

                come_true(terminal.until, claim)
    finally:
        terminal.close()


@pytest.mark.slow
def test_a_terminal_shows_heading_and_layers(tmp_path: Path) -> None:
    """With a number of colours that the option asks for: the terminal says it has more."""
    run_on_a_pty(tmp_path, "80x24", "256", [67.5])


@pytest.mark.slow
def test_every_update_shows_one_moment(tmp_path: Path) -> None:
    """Whatever a program does meanwhile, the robot looks where the pose line says."""
    commands, replies, beliefs = free_ports(3)
    options = ["--pace", "off", "--port", f"{commands}", "--reply-port", f"{replies}"]
    terminal = Terminal((120, 36), [*options, "--belief-port", f"{beliefs}"], environment(tmp_path))
    painter, over = Painter(GlyphMode.QUADRANT, ColorDepth.TRUECOLOR), threading.Event()

    def spin() -> None:
        with Robot("127.0.0.1", commands, replies) as robot:
            while not over.is_set():
                robot.send("r1-37")
                robot.read("u1", "u3")

    program = threading.Thread(target=spin)
    try:
        terminal.until(lambda: terminal.shows("no program") or terminal.shows("WAITING"))
        program.start()
        seen = set()
        while len(seen) < 10:
            terminal.take_update()
            told = re.search(r"pose +-?\d+\.\d, -?\d+\.\d in +(-?\d+)", "\n".join(terminal.screen.display))
            shown = hand_heading(cells_of(terminal.screen, VIEWS["120x36"], painter), painter)
            assert told is not None
            assert shown is not None
            # A hand points to the nearest of 16 headings, and the pose is rounded to a degree.
            assert turned(shown, float(told[1])) <= 11.25 + 0.5, told[0]
            seen.add(told[1])
    finally:
        over.set()
        program.join()
        terminal.close()


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", VIEWS)
def test_a_terminal_shows_all_headings(tmp_path: Path, size: str, kind: str) -> None:
    run_on_a_pty(tmp_path, size, kind, HEADINGS)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("tmux") is None, reason="there is no tmux here")
def test_tmux_shows_all_headings(tmp_path: Path) -> None:
    painter = Painter(GlyphMode.QUADRANT, ColorDepth.COLORS_256)
    commands, replies, beliefs = free_ports(3)
    ports = ["--port", f"{commands}", "--reply-port", f"{replies}", "--belief-port", f"{beliefs}"]
    pane = Pane(tmp_path)
    try:
        pane.start("--pace", "off", "--color", "256", "--glyphs", "quadrant", *ports, size=(120, 36))
        pane.until("WAITING")
        with Robot("127.0.0.1", commands, replies, belief_port=beliefs) as robot:
            course = Course(
                robot,
                lambda line: pane.type(line, "Enter"),
                lambda: pane.screen.splitlines(),
                until,
                VIEWS["120x36"],
            )
            for heading in HEADINGS:
                come_to = course.crowd(heading)

                def claim(come_to: float = come_to) -> None:
                    screen = pyte.Screen(120, 36)
                    picture = pane.tmux("capture-pane", "-e", "-p")
                    pyte.Stream(screen).feed(picture.replace("\n", "\r\n").rstrip())
                    check(cells_of(screen, VIEWS["120x36"], painter), painter, come_to)

                come_true(until, claim)
    finally:
        pane.close()
