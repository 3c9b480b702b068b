"""Waits of matplotlib, pygame, asyncio and other toolkits, by the program's clock.

It is imported into other people's programs, by whatever Python they use: standard library alone, Python 3.8
on, and nothing of the package. It imports no toolkit: it changes those that the program has imported.
"""

from __future__ import annotations

import sys
import time

TYPE_CHECKING = False  # the module typing would cost every start some milliseconds
if TYPE_CHECKING:
    from typing import Any

# As pygame's own.
_FRAMES = 10
"""Frames over which a frame rate is averaged."""


def patch(module: Any) -> None:
    """Change a module that the program has imported."""
    name = module.__name__
    for dotted, advice in _hook().REFUSED.get(name, {}).items():
        *path, last = dotted.split(".")
        owner = module
        for part in path:
            owner = getattr(owner, part, None)
        if getattr(owner, last, None) is not None:
            setattr(owner, last, _refusing("{} of {}".format(dotted, name.partition(".")[0]), advice))
    if name in _PATCHES:
        _PATCHES[name](module)


def _hook() -> Any:
    """The module of the clock, which has imported this one."""
    return sys.modules["simmer_clock"]


def _refusing(what: str, advice: str) -> Any:
    """A function that ends the program: it would wait by a clock of its own."""

    def refused(*arguments: object, **named: object) -> None:
        _hook().refuse(f"{what} waits by a clock of its own", advice)

    return refused


# -- matplotlib --------------------------------------------------------------------------------------


def _patch_pyplot(pyplot: Any) -> None:
    """Pauses and windows of matplotlib: what was drawn is shown, and nobody is waited for."""
    real_show = pyplot.show

    def is_on_screen() -> bool:
        """True if figures have windows."""
        # Those without have the event loop of their base class.
        return any(
            hasattr(type(each.canvas), "required_interactive_framework")
            and type(each.canvas).required_interactive_framework
            for each in pyplot._pylab_helpers.Gcf.get_all_fig_managers()
        )

    def show(*arguments: Any, **named: Any) -> Any:
        """Show all figures, and continue: no person is there to close the windows."""
        if not is_on_screen():
            return real_show(*arguments, **named)
        if named.pop("block", arguments[0] if arguments else None) is not False:
            _hook().said_once("show() shows the figures and does not wait for a person to close them")
        result = real_show(block=False)
        for manager in pyplot._pylab_helpers.Gcf.get_all_fig_managers():
            manager.canvas.draw_idle()
            manager.canvas.flush_events()
        return result

    def pause(interval: float) -> None:
        """Draw, show, and sleep by the program's clock."""
        manager = pyplot._pylab_helpers.Gcf.get_active()
        if manager is not None:
            if manager.canvas.figure.stale:
                manager.canvas.draw_idle()
            real_show(block=False)
            manager.canvas.flush_events()
        time.sleep(max(interval, 0.0))

    pyplot.show, pyplot.pause = show, pause
    for name in ("ginput", "waitforbuttonpress"):
        setattr(pyplot, name, _for_a_person(f"{name} of matplotlib", is_on_screen, getattr(pyplot, name)))


def _for_a_person(what: str, is_on_screen: Any, real: Any) -> Any:
    """A function that waits for a person where there is a window, and is refused there."""

    def call(*arguments: Any, **named: Any) -> Any:
        if is_on_screen():
            _hook().refuse(f"{what} waits for a person", "plt.pause(0.1) goes on by itself")
        return real(*arguments, **named)

    return call


# -- pygame ------------------------------------------------------------------------------------------


class FrameClock:
    """`pygame.time.Clock` by the program's clock: frames of whole milliseconds."""

    def __init__(self) -> None:
        self._last = _milliseconds()
        self._passed = self._raw = 0
        self._frames: list[int] = []

    def tick(self, framerate: float = 0) -> int:
        """Wait until the frame is over. Returns milliseconds since the previous call."""
        self._raw = _milliseconds() - self._last
        if framerate:
            _delay(int(1000.0 / framerate) - self._raw)
        now = _milliseconds()
        self._passed, self._last = now - self._last, now
        self._frames = [*self._frames[-_FRAMES + 1 :], self._passed]
        return self._passed

    tick_busy_loop = tick

    def get_time(self) -> int:
        """Milliseconds between the two latest ticks."""
        return self._passed

    def get_rawtime(self) -> int:
        """The same, without the wait for the end of the frame."""
        return self._raw

    def get_fps(self) -> float:
        """Frames a second; 0 before ten of them."""
        total = sum(self._frames)
        return 1000.0 * _FRAMES / total if len(self._frames) == _FRAMES and total else 0.0


def _milliseconds() -> int:
    return int(time.monotonic_ns() // 1_000_000)


def _delay(milliseconds: float) -> int:
    """Sleep some milliseconds. Returns how many."""
    if not isinstance(milliseconds, (int, float)):
        raise TypeError("delay requires one integer argument")
    whole = max(int(milliseconds), 0)
    if whole:
        time.sleep(whole / 1000.0)
    return whole


def _patch_pygame_time(module: Any) -> None:
    began = _milliseconds()
    module.Clock = FrameClock
    module.wait = module.delay = _delay
    module.get_ticks = lambda: _milliseconds() - began


def _patch_pygame_event(module: Any) -> None:
    def wait(timeout: int = 0) -> Any:
        """The next event; sleep for `timeout` milliseconds if there is none."""
        event = module.poll()
        if not event.type and timeout <= 0:
            _hook().refuse(
                "pygame.event.wait() waits for a person",
                "pygame.event.get() and pygame.time.Clock().tick(50) go on by themselves",
            )
        if not event.type:
            _delay(timeout)
            event = module.poll()
        return event

    module.wait = wait


# -- asyncio -----------------------------------------------------------------------------------------


def _patch_asyncio(module: Any) -> None:
    """Loops of asyncio wait by the program's clock. A look for work without a wait is no poll for a reply."""
    kind = module.BaseSelectorEventLoop
    real_init = kind.__init__

    def init(loop: Any, selector: Any = None) -> None:
        real_init(loop, _hook().PROGRAM_CLOCK[0].loop_selector() if selector is None else selector)
        # Only the program itself writes to it.
        loop._selector.inner = {loop._ssock.fileno()}

    kind.__init__ = init


def _patch_asyncio_windows(module: Any) -> None:
    """The loop of completion ports waits by itself: programs get the other one."""
    for name in ("WindowsProactorEventLoopPolicy", "_WindowsProactorEventLoopPolicy"):
        if hasattr(module, name):
            getattr(module, name)._loop_factory = module.SelectorEventLoop
    if hasattr(module, "EventLoop"):
        module.EventLoop = module.SelectorEventLoop


_PATCHES = {
    "matplotlib.pyplot": _patch_pyplot,
    "pygame.time": _patch_pygame_time,
    "pygame.event": _patch_pygame_event,
    "asyncio.selector_events": _patch_asyncio,
    "asyncio.windows_events": _patch_asyncio_windows,
}
"""Changes of modules after their import, by their names."""
