"""Frames that are left out: all while the terminal is behind, most while input waits, some while too much
changes, and parts of them that change slowly."""

import math
import time
from contextlib import ExitStack

import numpy as np
from textual.app import App

from simmer_tui.live.snapshot import Snapshot
from simmer_tui.tui.textual_internals import messages_waiting, writes_waiting

# One is under way whenever something has just been drawn.
_WAITING = 2
"""Pending writes to the terminal at which it counts as behind."""
# A slow link, and a terminal in a browser, take so much without delay; at 200 x 60 there is more to change.
_CELLS, _BYTES = (4_320.0, 12_000.0), (23_500.0, 44_000.0)
"""Bytes a second for pictures, for screens of so many cells; in between in proportion."""
_BURST = 0.25
"""Seconds of these bytes that may be saved up."""
# The largest frames of a robot that jumps have 9 KB; a new page has 30 KB, and nobody is to wait for that.
_DEFICIT = 0.4
"""Seconds of these bytes that may be overdrawn."""
# A key takes 1 ms, a person presses 30 a second: so many wait only after a paste, or on a busy machine.
_MUCH_INPUT = 10
"""Messages to the app that wait for it, from which on they come before the picture."""
# A picture costs as much as 15 keys. Twice a second it still shows where the robot is.
_SELDOM = 0.5
"""Seconds between two pictures while much input waits."""
# A program that drives ten times a second gives no news for 0.1 s; at every tick between, all parts of the
# screen would be drawn as for a robot that has come to stand.
QUIET = 0.15
"""Least seconds from one picture to the next without an event between them."""
# Parts with history may lag, since nothing beside them shows the same. Each changed line is bytes over a slow
# link, and nobody reads faster.
_LAGS = {"events": 0.5, "values": 1.0, "radar": 0.2}
"""Least seconds between two pictures of a part with history."""


class Backpressure:
    """Open while the terminal keeps up; while it is closed, nothing is drawn.

    A terminal may not read for a while (ctrl+S, a dead connection). Textual writes from a thread with a queue
    of 30 writes; a 31st blocks the whole app until the terminal reads again. So nothing is sent while writes
    are pending. Textual keeps the pending changes, except those of the layout, after which the whole screen
    is sent.
    """

    def __init__(self, app: App[int]) -> None:
        self._app = app
        self._batch = ExitStack()
        self._lost = False
        self.closed = False

    def keep_up(self) -> bool:
        """Open or close it by the number of pending writes. Returns True if it is open."""
        behind = writes_waiting(self._app) >= (1 if self.closed else _WAITING)
        if behind and not self.closed:
            self._batch.enter_context(self._app.batch_update())
        elif self.closed and not behind:
            self._batch.close()
            if self._lost:
                self._app.screen.refresh(layout=True)
            self._app.screen.check_idle()
            self._lost = False
        self.closed = behind
        return not behind

    def note_display(self) -> None:
        """Note that something was displayed, or would have been."""
        self._lost |= self.closed


class InputFirst:
    """Leaves out most pictures while much input waits for the app."""

    def __init__(self, app: App[int]) -> None:
        self._app = app
        self._shown = -math.inf

    def passes_over(self) -> bool:
        """True if the next picture is left out."""
        now = time.monotonic()
        if messages_waiting(self._app) >= _MUCH_INPUT and now - self._shown < _SELDOM:
            return True
        self._shown = now
        return False


class ByteBudget:
    """A token bucket of bytes. It leaves out pictures while they are used up: where much changes, as with a
    robot that jumps, there are fewer of them. Each is whole in any case."""

    def __init__(self) -> None:
        self._tokens, self._at, self._written = 0.0, -math.inf, 0

    def delay(self, written: int, cells: int, now: float) -> float:
        """Seconds until there are bytes for the next picture. `written` counts all bytes so far, `cells`
        those of the screen, `now` is in seconds."""
        rate = float(np.interp(cells, _CELLS, _BYTES))
        gained = rate * min(now - self._at, _BURST + _DEFICIT) - (written - self._written)
        self._tokens = min(max(self._tokens + gained, -rate * _DEFICIT), rate * _BURST)
        self._at, self._written = now, written
        return max(-self._tokens, 0.0) / rate


class Lags:
    """Parts of the screen that may show an older moment than the rest: which of them is due."""

    def __init__(self) -> None:
        self._shown = dict.fromkeys(_LAGS, -math.inf)
        self._calm = False
        self._marks: tuple[object, ...] = ()
        self.waiting: set[str] = set()
        """Parts that do not show the newest snapshot yet."""

    def make_due(self) -> None:
        """Make all parts due now."""
        self._shown = dict.fromkeys(_LAGS, -math.inf)

    def take(self, snapshot: Snapshot, before: Snapshot | None) -> None:
        """Note a new snapshot.

        When the robot comes to stand, at a pause, a contact and a verdict, the whole screen shows that
        moment.
        """
        state = snapshot.state
        now = snapshot.number, state.pose
        # A picture may be taken between the commands that a program sends one after the other.
        calm = not state.moving and (before is None or now == (before.number, before.state.pose))
        # In a quiet run the waiting parts are due one after the other; then the screen does not change.
        if before is None or snapshot.is_full or not calm:
            self.waiting = set(_LAGS)
        marks = state.paused, state.contacts, snapshot.verdict is None
        if marks != self._marks or (calm and not self._calm):
            self.make_due()
        self._calm, self._marks = calm, marks

    def is_due(self, part: str) -> bool:
        """True if a part is to show the newest snapshot now; it counts as shown then."""
        now = time.monotonic()
        if now - self._shown[part] < _LAGS[part]:
            return False
        self._shown[part] = now
        self.waiting.discard(part)
        return True
