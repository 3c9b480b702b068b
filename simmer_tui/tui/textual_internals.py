"""All uses of Textual's private parts, and the only ones.

Each function says what it replaces. `KNOWN_VERSION` is the minor version of Textual that they were written
for. With any other, replacements are left out and questions have a fallback.

Updates: Textual sends every dirty span from its widget's left edge on, each piece with its whole style and a
reset after it. Here a `DeltaWriter` sends the cells that differ from those on the screen. Over a slow SSH
connection that saves two thirds of the bytes. The spans can go once Textual crops both ends itself
(Textualize/textual#5625), the styles cannot.
"""

import os
import re
import select
import signal
import sys
import threading
import time
from codecs import getincrementaldecoder
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import IO, Any, NamedTuple, cast

import textual
from rich.color import ColorSystem
from rich.console import Console
from textual._compositor import Compositor, CompositorUpdate, LayoutUpdate
from textual._xterm_parser import BRACKETED_PASTE_END, BRACKETED_PASTE_START, XTermParser
from textual.app import App
from textual.content import Content
from textual.driver import Driver
from textual.drivers._writer_thread import WriterThread
from textual.events import Resize
from textual.geometry import Region, Size
from textual.message import Message
from textual.screen import Screen
from textual.scroll_view import ScrollView
from textual.strip import Strip
from textual.widget import Widget

from simmer_tui import platform_has
from simmer_tui.errors import printable
from simmer_tui.tui.delta_writer import DeltaWriter

# pyproject.toml pins it; a newer one needs a review of each function here.
KNOWN_VERSION = "8.2."


def is_known_version(version: str = textual.__version__) -> bool:
    return version.startswith(KNOWN_VERSION)


# -- updates ---------------------------------------------------------------------------------------


@contextmanager
def delta_updates() -> Iterator[bool]:
    """Write updates of the screen as deltas inside the `with` block. Yields True if they are."""
    if not is_known_version(textual.__version__):
        yield False
        return
    originals = Compositor.render_partial_update, LayoutUpdate.render_segments
    writer = DeltaWriter()

    def render_spans(self: Compositor) -> _SpansUpdate | None:
        regions = self._dirty_regions.copy()
        self._dirty_regions.clear()
        return _SpansUpdate(writer, self.size, list(_shown_spans(self, regions))) if regions else None

    def render_whole(self: LayoutUpdate, console: Console) -> str:
        region = self.region
        # Textual calls it only when it does not know the terminal's content.
        writer.begin(region.right, region.bottom, _colors_of(console), is_full=True)
        for y, strips in enumerate(self.strips, region.y):
            x = region.x
            for strip in strips:
                writer.write(y, x, strip)
                x += strip.cell_length
        return writer.end()

    Compositor.render_partial_update = render_spans  # type: ignore[assignment,method-assign]
    LayoutUpdate.render_segments = render_whole  # type: ignore[method-assign]
    try:
        yield True
    finally:
        Compositor.render_partial_update, LayoutUpdate.render_segments = originals  # type: ignore[method-assign]


class _Span(NamedTuple):
    """A strip of a widget that begins in a cell of the screen, and the columns of it to write."""

    row: int
    column: int
    strip: Strip
    first: int
    last: int


class _SpansUpdate(CompositorUpdate):
    """Update of some parts of a screen."""

    def __init__(self, writer: DeltaWriter, size: Size, spans: Sequence[_Span]) -> None:
        self._writer, self._size, self._spans = writer, size, spans

    def render_segments(self, console: Console) -> str:
        self._writer.begin(*self._size, _colors_of(console))
        for span in self._spans:
            self._writer.write(*span)
        return self._writer.end()


def _shown_spans(compositor: Compositor, regions: Iterable[Region]) -> Iterator[_Span]:
    """Strips of the widgets that are visible in some regions of the screen.

    Textual makes all lines of every widget within the rectangle around these regions: with a change in two
    corners, those of the whole screen.
    """
    wanted: dict[int, list[tuple[int, int]]] = {}
    for y, start, stop in compositor._regions_to_spans(regions):
        wanted.setdefault(y, []).append((start, stop))
    # They come from the front to the back, so that a widget covers those after it.
    for widget, (region, clip) in compositor.visible_widgets.items():
        shown = region.intersection(clip)
        left, right = shown.column_span
        spans = [
            (y, max(start, left), min(stop, right))
            for y in shown.line_range
            for start, stop in wanted.get(y, ())
            if start < right and left < stop
        ]
        if not spans:
            continue
        top, bottom = spans[0][0], spans[-1][0] + 1
        begin, end = min(first for _, first, _ in spans), max(last for _, _, last in spans)
        strips = widget.render_lines(Region(begin - region.x, top - region.y, end - begin, bottom - top))
        for y, first, last in spans:
            yield _Span(y, begin, strips[y - top], first, last)
            rest = [(start, min(stop, left)) for start, stop in wanted[y] if start < left]
            wanted[y] = rest + [(max(start, right), stop) for start, stop in wanted[y] if right < stop]


def _colors_of(console: Console) -> ColorSystem:
    return console._color_system or ColorSystem.TRUECOLOR


def mark_changed(widget: Widget, regions: Collection[Region]) -> bool:
    """Send regions of a widget, whose size and style stay, with the next update. Returns False if that is
    left to Textual's `refresh`.

    Textual would wake the widget's task to tell the screen, for each widget in each frame.
    """
    if not is_known_version() or not widget.is_mounted or not widget.is_attached:
        return False
    widget._set_dirty(*regions)
    widget.screen._dirty_widgets.add(widget)
    widget.screen.check_idle()
    return True


def draw_at_once(screen: Screen[Any]) -> None:
    """Send all changes of a screen in one update, now.

    Textual would have each widget send the screen a message, and may send an update between two of them. One
    part of the screen would then show another moment than the next.
    """
    # By the default argument: Textual reads its version from a file at every call.
    if not is_known_version() or not screen.is_attached:
        return
    # With scrollbars, which are no children.
    for widget in screen._compositor.visible_widgets:
        if widget._repaint_required:
            widget._repaint_required = False
            screen._dirty_widgets.add(widget)
    screen._on_timer_update()


# -- what is asked ---------------------------------------------------------------------------------


def writes_waiting(app: App[Any]) -> int:
    """Number of pending writes to the terminal. The queue is the driver's own; a driver without one never
    blocks."""
    writer = getattr(app._driver, "_writer_thread", None)
    queue = getattr(writer, "_queue", None)
    return 0 if queue is None else int(queue.qsize())


def bytes_written(app: App[Any]) -> int:
    """Bytes written to the terminal so far; 0 for a driver that does not count them."""
    return int(getattr(app._driver, "written", 0))


def messages_waiting(app: App[Any]) -> int:
    """Number of messages, keys among them, that the app has not taken yet."""
    return app._message_queue.qsize()


def age_of(event: Message) -> float:
    """Real seconds since an event was made; for a key, since it was read from the terminal."""
    # By the clock of Textual's events, which is not the same on every system.
    return Message().time - event.time


def rows_of(screen: Screen[Any]) -> list[Strip]:
    """Present content of a screen, row by row."""
    return screen._compositor.render_strips()


# -- what is done ----------------------------------------------------------------------------------


def write_sequence(app: App[Any], sequence: str) -> None:
    """Send a control sequence of our own to the terminal, between Textual's own."""
    if app._driver is not None:
        app._driver.write(sequence)


def set_virtual_size(view: ScrollView, size: Size) -> None:
    """Set the size that a view scrolls over, without the layout of the whole screen that the usual setter
    causes."""
    view.set_reactive(ScrollView.virtual_size, size)
    view._scroll_update(size)


class FaultReporting:
    """Mixin for an app with a method for exceptions that Textual cannot continue from.

    They end the app with one line. Textual would first draw a traceback with all local variables, which can
    fail in its turn, and `panic` would keep the exit code 0.
    """

    def fault_met(self, error: Exception) -> None:
        """Called after Textual has stored it."""

    def _handle_exception(self, error: Exception) -> None:
        self.fault_met(error)
        super()._handle_exception(error)  # type: ignore[misc]

    def _fatal_error(self) -> None:
        self._close_messages_no_wait()  # type: ignore[attr-defined]

    def panic(self, *renderables: object) -> None:
        app = cast(App[Any], self)
        error = sys.exc_info()[1]
        # `_handle_exception` has called `fault_met`; other parts of Textual have not.
        if app._exception is None:
            app._exception = error if isinstance(error, Exception) else RuntimeError("Textual has given up")
            app._return_code = 1
            self.fault_met(app._exception)
        app._close_messages_no_wait()


def run_app(app: App[int], *, mouse: bool) -> int | None:
    """Run an app that reports its faults. Returns the value it ended with; None after a fault.

    Faults of the event loop and of the start are its own, too. The terminal is restored in any case.
    """
    try:
        return app.run(mouse=mouse)
    except Exception as error:  # noqa: BLE001 (any: the robot is served after it)
        app._handle_exception(error)
        driver = app._driver
        if driver is not None:
            with suppress(Exception):
                driver.stop_application_mode()
                driver.close()
    return None


def as_plain(text: str) -> str:
    """Text for a parameter of Textual that would take it for markup, control characters escaped. Textual's
    `escape` leaves `[/` unchanged (Textualize/textual#6155); this can be simpler with that."""
    return cast(str, Content(printable(text)))


class StillWhenClamped:
    """Mixin for a view that must know when Textual itself, not its user, changes its scroll position."""

    placing = False
    """True while Textual, not the user, scrolls."""

    def _scroll_update(self, virtual_size: Size) -> None:
        placing, self.placing = self.placing, True
        super()._scroll_update(virtual_size)  # type: ignore[misc]
        self.placing = placing


# -- the terminal ------------------------------------------------------------------------------------

# A key takes the app about 1 ms (measured), so these are worked off in a tenth of a second.
_AHEAD = 100
"""Messages of the terminal that may wait for the app. With more the terminal is not read for a moment."""
# The longest sequence that Textual's parser waits for.
_LONGEST_SEQUENCE = 32
_SOON = 0.01
"""Seconds until a full queue or a full terminal is tried again."""
# As Textual's own. It also ends a lone Escape.
_TICK = 0.1
"""Seconds of silence after which the parser is asked again."""
# Judged: a link pauses for less. Without an end every key, ctrl+Q too, would belong to the paste.
_PASTE_ENDS = 3.0
"""Seconds of silence after which a paste without an end has ended."""
_READ = 1024
"""Bytes of input that are read at once; the rest waits in the kernel."""
# ECMA-48: strings of OSC, DCS and APC up to their end, and reports with a private sign or of a status.
# Textual itself asks for modes (`$y`). Alt+] and Alt+P begin as the strings do, but no digit or sign follows.
_REPLY = re.compile(
    r"\x1b(?:\]\d[^\x07\x1b]*(?:\x07|\x1b\\)|(?:P[\d$>!+|?]|_G)[^\x1b]*\x1b\\"
    r"|\[[?>=][\d;:]*(?:\$[a-xz]|[A-Za-z~])|\[\d[\d;]*[cn])"
)
_REPLY_BEGUN = re.compile(
    r"\x1b(?:\]\d[^\x07\x1b]*|(?:P[\d$>!+|?]|_G)[^\x1b]*|\[[?>=]?[\d;:]*)\x1b?$", re.ASCII
)
_LONGEST_REPLY = 1024
"""Characters of a reply, more than a terminal's name or colours have; a longer one is no reply."""
_AT_ONCE = 8192
"""Characters that are collected for one write, as the streams of Python do."""
# Judged: more cells than the largest monitor shows with the smallest font. Each costs memory.
_LARGEST = Size(1000, 500)


def steady_driver(usual: type[Driver]) -> type[Driver]:
    """The driver to use in place of Textual's usual one for this system: the same if it needs no mend."""
    if sys.platform != "win32" and platform_has.POSIX and is_known_version(textual.__version__):
        return SteadyDriver if usual is LinuxDriver else usual
    return usual


if sys.platform != "win32" and platform_has.POSIX:
    from textual.drivers import linux_driver
    from textual.drivers.linux_driver import LinuxDriver

    class SteadyDriver(LinuxDriver):
        """Linux driver that no input ends, and that reports faults of the terminal to the app.

        - Bytes that are no UTF-8 are replaced (Textualize/textual#6456). Sequences that the parser raises
          errors for are left out.
        - The window's size is the kernel's, not that of COLUMNS and LINES (Textualize/textual#6153).
        - A terminal that does not take bytes at once is waited for (Textualize/rich#2492).
        - Replies to questions that an earlier program asked are left out (tmux/tmux#4846). Textual takes what
          it does not know for keys: the `r` and `b` of `rgb:` would restart the run and pause it.
        - A paste without an end ends after some seconds (irssi/irssi#942).
        - Input that comes faster than the app works it off is read later.
        - A second stop by ctrl+Z, or one at the app's end, only stops the process. Textual would end its
          threads again, and wait for them for ever.

        The class can go once Textual does all of this; no version up to 8.2 does.
        """

        def __init__(self, app: App[Any], **options: Any) -> None:
            super().__init__(app, **options)
            self._output = sys.__stderr__.fileno() if sys.__stderr__ is not None else self.fileno
            # Until the first event the app would ask rich, which asks COLUMNS and LINES.
            self._size = self._size or self._get_terminal_size()
            self._scale: tuple[Size | None, Size | None] = (None, None)
            """Size of the window in cells and pixels, if the terminal has sent both."""
            self._last_read = ""
            """The last characters read; a mark of a paste may be cut in two."""
            self._held = ""
            """The begin of a reply whose end may still come."""
            self.written = 0
            """Bytes written to the terminal."""
            self._is_pasting = False
            self._read_at = 0.0
            self._sent = 0
            self._has_terminal = False
            self._is_suspending = self._is_suspended = False

        def write(self, data: str) -> None:
            self.written += len(data.encode("utf-8", "replace"))
            super().write(data)

        def _get_terminal_size(self) -> tuple[int, int]:
            return self._window(*super()._get_terminal_size())

        def _window(self, columns: int, rows: int) -> tuple[int, int]:
            """Size of the window, by default these columns and rows."""
            size = platform_has.window_size(self._output) or platform_has.window_size(self.fileno)
            columns, rows = size or (columns, rows)
            return min(max(columns, 1), _LARGEST.width), min(max(rows, 1), _LARGEST.height)

        def start_application_mode(self) -> None:
            names = vars(linux_driver)
            usual = names["WriterThread"]
            names["WriterThread"] = partial(_SteadyWriter, failed=self._fail)
            try:
                super().start_application_mode()  # type: ignore[no-untyped-call]
            finally:
                names["WriterThread"] = usual
            self._has_terminal = True
            loop = self._loop
            # Textual's own does nothing for a terminal that sends its size, too: see `_is_true_size`.
            signal.signal(
                signal.SIGWINCH, lambda *_: loop.is_closed() or loop.call_soon_threadsafe(self._tell_size)
            )

        def stop_application_mode(self) -> None:
            self._has_terminal = False
            super().stop_application_mode()

        def _sigtstp_application(self, *_: object) -> None:
            if self._is_suspending:
                return  # it stops in a moment
            if self._has_terminal:
                self._is_suspending = True
                self.suspend_application_mode()
                self._is_suspending, self._is_suspended = False, True
                self._must_signal_resume = True
            os.kill(os.getpid(), signal.SIGSTOP)

        def _sigcont_application(self, *_: object) -> None:
            if self._is_suspended:
                self._is_suspended = False
                self.resume_application_mode()

        def _tell_size(self) -> None:
            size = Size(*self._get_terminal_size())
            self.send_message(Resize(size, size))

        def _fail(self, error: Exception) -> None:
            """End the app by a fault of a thread."""
            with suppress(RuntimeError):  # the app's loop has ended
                self._loop.call_soon_threadsafe(self._app._handle_exception, error)

        def _run_input_thread(self) -> None:
            try:
                self.run_input_thread()
            except Exception as error:  # noqa: BLE001 (any: it ends the thread)
                self._fail(error)

        def run_input_thread(self) -> None:
            decode = getincrementaldecoder("utf-8")("replace").decode
            self._begin_parsing()
            while not self.exit_event.is_set():
                if select.select([self.fileno], [], [], _TICK)[0]:
                    with suppress(BlockingIOError):  # another process has read it
                        data = os.read(self.fileno, _READ)
                        self._feed(decode(data))
                        if not data:
                            # Another process has made ctrl+D an end of input. A closed terminal is noticed
                            # elsewhere.
                            self.exit_event.wait(_TICK)
                elif self._held:
                    held, self._held = self._held, ""
                    self._take(held)
                elif self._is_pasting and time.monotonic() - self._read_at > _PASTE_ENDS:
                    self._take(BRACKETED_PASTE_END)
                self._process(lambda: self._parser.tick())

        def _begin_parsing(self) -> None:
            """Make a parser. One that has raised an error cannot continue."""
            self._parser = XTermParser(self._debug)
            self._set_scale()

        def _set_scale(self) -> None:
            self._parser.terminal_size, self._parser.terminal_pixel_size = self._scale
            self._parser.mouse_pixels = None not in self._scale

        def _feed(self, text: str) -> None:
            """Take text that was read, without replies to questions of other programs."""
            text = _REPLY.sub("", self._held + text)
            begun = _REPLY_BEGUN.search(text)
            self._held = begun[0] if begun is not None and len(begun[0]) <= _LONGEST_REPLY else ""
            self._take(text.removesuffix(self._held))

        def _take(self, text: str) -> None:
            self._read_at = time.monotonic()
            seen = self._last_read + text
            self._last_read = seen[1 - len(BRACKETED_PASTE_START) :]
            begun, ended = seen.rfind(BRACKETED_PASTE_START), seen.rfind(BRACKETED_PASTE_END)
            if begun != ended:
                self._is_pasting = begun > ended
            for piece in _pieces(text):
                self._process(lambda piece=piece: self._parser.feed(piece))  # type: ignore[misc]

        def _process(self, parse: Callable[[], Iterable[Message]]) -> None:
            try:
                messages = list(parse())
            except Exception:  # noqa: BLE001 (any: the parser is not ours)
                self._begin_parsing()
                return
            for message in messages:
                self.process_message(message)

        def process_message(self, message: Message) -> None:
            if isinstance(message, Resize):
                if not self._is_true_size(message):
                    self._set_scale()
                    return
                self._scale = message.size, message.pixel_size
            super().process_message(message)

        def _is_true_size(self, resize: Resize) -> bool:
            """False for a size that the window does not have: it is noise, or SIGWINCH follows."""
            (columns, rows), pixels = resize.size, resize.pixel_size
            has_pixels = pixels is not None and pixels.width >= columns > 0 and pixels.height >= rows > 0
            is_size = (columns, rows) == self._window(columns, rows)
            return self._in_band_window_resize and has_pixels and is_size

        def send_message(self, message: Message) -> None:
            # Textual's own makes a coroutine here. One that comes as the loop ends is never awaited: Python
            # warns of it below the picture of a screen that has ended well.
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._app.post_message, message)
                if threading.current_thread() is self._key_thread:
                    self._wait_for_app()

        def _wait_for_app(self) -> None:
            """Wait until the app has few messages before it."""
            self._sent += 1
            if self._sent % _AHEAD == 0:
                posted = threading.Event()
                self._loop.call_soon_threadsafe(posted.set)
                # The loop may wait for this thread: it does when the app ends.
                while not (posted.wait(_SOON) or self.exit_event.is_set()):
                    pass
            while self._app._message_queue.qsize() >= _AHEAD and not self.exit_event.wait(_SOON):
                pass


def _pieces(text: str) -> Iterator[str]:
    """Pieces of input for a parser, so that an error in a sequence costs no text behind it."""
    for number, part in enumerate(text.split("\x1b")):
        piece = f"\x1b{part}" if number else part
        # A sequence may have begun before.
        yield from piece[:_LONGEST_SEQUENCE]
        if len(piece) > _LONGEST_SEQUENCE:
            yield piece[_LONGEST_SEQUENCE:]


class _SteadyWriter(WriterThread):
    """Writes to the terminal, and waits if it does not take bytes at once. After another error it writes no
    more, and reports the error once."""

    def __init__(self, file: IO[str], failed: Callable[[Exception], None]) -> None:
        super().__init__(file)
        self._failed = failed

    def run(self) -> None:
        waiting, is_lost = "", False
        while (text := self._queue.get()) is not None:
            waiting += text
            if self._queue.qsize() == 0 or len(waiting) > _AT_ONCE:
                is_lost, waiting = is_lost or not self._write(waiting), ""
        if not is_lost:
            self._write(waiting)

    def _write(self, text: str) -> bool:
        # Signs that its encoding lacks are as wide as before.
        data = memoryview(text.encode(getattr(self._file, "encoding", None) or "utf-8", "replace"))
        while data:
            try:
                data = data[os.write(self._file.fileno(), data) :]
            except BlockingIOError:  # another process has set it so
                time.sleep(_SOON)
            except OSError as error:
                self._failed(error)
                return False
        return True
