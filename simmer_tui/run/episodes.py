"""Episodes of what a program believes: localized, lost, frozen, and moved by a person.

One belief says little: a particle filter that is about to converge is off for a reading or two, and is
right again. So a change counts once it has lasted for as much movement as shows a robot its surroundings
anew. It is told from its first belief on.
"""

import math
from enum import StrEnum

from msgspec import Struct

from simmer_tui.events import ActionName
from simmer_tui.run.facts import COVERED, UNSURE, UNSURE_TURN, wrapped
from simmer_tui.run.history_rows import ActionRow, BeliefRow, ContactRow
from simmer_tui.sim.specs import CELL_SIZE

LASTING, LASTING_TURN = CELL_SIZE, 360.0
"""So much movement, inches or degrees, shows other walls, or all that are around."""
# Judged: less may be one told pose too many before a program adds up what it did.
FROZEN, FROZEN_WAY, FROZEN_TURN = 3, 4.0, 45.0
"""The same pose told so often, while the robot went so far away, inches or degrees, is frozen."""
# Poses pass through JSON with all digits; this is for programs that round them.
SAME = 0.005
"""Poses that differ by less, inches and degrees, are the same."""


class EpisodeKind(StrEnum):
    """Kinds of episodes."""

    LOCALIZED = "localized"
    LOST = "lost"
    FROZEN = "frozen"
    MOVED = "moved"
    BLOCK_MOVED = "block moved"
    RESTARTED = "restarted"


class Episode(Struct, frozen=True):
    """A stretch of a run that begins at `elapsed` (seconds), in a line of the log.

    `distance` (inches) and `turn` (degrees) are the error of the belief then; of `MOVED` how far the robot
    was moved, of `FROZEN` how far it went meanwhile. `again` is True if it was localized before. `moved` or
    `touched` is what came just before and may explain it.
    """

    kind: EpisodeKind
    elapsed: float
    line: int
    distance: float = 0.0
    turn: float = 0.0
    again: bool = False
    moved: ActionRow | None = None
    touched: ContactRow | None = None


class _Told(Struct, frozen=True):
    """A belief, and what the robot had gone (inches) and turned (degrees, either way) by then, in all."""

    row: BeliefRow
    turned: float

    @property
    def is_sure(self) -> bool:
        row = self.row
        return not row.unsure and row.allowed_turn <= COVERED * UNSURE_TURN

    @property
    def is_off(self) -> bool:
        """True if it is wrong by more than it allows for, or allows for anything and is far off."""
        row = self.row
        return row.lost or (not self.is_sure and (row.distance > UNSURE or abs(row.turn) > UNSURE_TURN))

    def lasts_until(self, other: "_Told") -> bool:
        return other.row.gone - self.row.gone >= LASTING or other.turned - self.turned >= LASTING_TURN

    def is_as(self, other: "_Told") -> bool:
        """True if it tells the same pose."""
        mine, theirs = self.row, other.row
        return (
            abs(mine.x - theirs.x) < SAME
            and abs(mine.y - theirs.y) < SAME
            and abs(mine.heading - theirs.heading) < SAME
        )


class BeliefEpisodes:
    """Follows a run; give it what happens in order, and read `items`."""

    def __init__(self) -> None:
        self._items: list[Episode] = []
        self._is_localized = False
        self._was_localized = False
        """True once the program has known where the robot is: before, nothing can be lost."""
        self._change: _Told | None = None
        """The first of the newest beliefs that all say the opposite of the present state."""
        self._same: _Told | None = None
        """The first of the newest beliefs that all tell one pose."""
        self._times = 0
        self._is_frozen = False
        self._moved: ActionRow | None = None
        self._touched: ContactRow | None = None
        """The last time that a person moved the robot, and the last contact, since a belief was right."""

    def believe(self, row: BeliefRow, turned: float) -> None:
        """A belief was told, after so many degrees of turning, either way, in all."""
        if not row.finite:
            return
        told = _Told(row, turned)
        self._check_frozen(told)
        off, vague = told.is_off, not told.is_sure
        if off and self._is_localized and self._moved is not None:
            # No need to wait: that it was moved is known.
            self._lose(told)
        elif off != self._is_localized or (vague and not off):
            # As before, or too vague to say anything.
            self._change = None
        elif self._change is None:
            self._change = told
        elif self._change.lasts_until(told):
            self._switch(self._change)
        if not off and not vague:
            self._moved = self._touched = None

    def act(self, row: ActionRow) -> None:
        """A person did something."""
        done = row.done
        if done.refused:
            return
        if row.places:
            # Whoever was right until a person came is localized, however short.
            if self._change is not None and not self._is_localized:
                self._switch(self._change)
            self._same, self._change, self._is_frozen = None, None, False
        if done.restarts:
            self._items.clear()
            self._is_localized = self._was_localized = False
            self._moved = self._touched = None
            self._items.append(Episode(EpisodeKind.RESTARTED, row.elapsed, row.line))
        elif done.action.name is ActionName.TELEPORT:
            distance = math.hypot(done.pose.x - row.before.x, done.pose.y - row.before.y)
            turn = wrapped(done.pose.heading - row.before.heading)
            self._items.append(Episode(EpisodeKind.MOVED, row.elapsed, row.line, distance, turn))
            self._moved = row
        elif done.action.name is ActionName.BLOCK:
            self._items.append(Episode(EpisodeKind.BLOCK_MOVED, row.elapsed, row.line))

    def touch(self, row: ContactRow) -> None:
        """The robot touched something."""
        self._touched = row

    def so_far(self, *, ended_badly: bool = False) -> list[Episode]:
        """The episodes up to now. What has just begun counts where it can no longer pass: being right at the
        end, and being wrong where the run `ended_badly` over it."""
        change = self._change
        if change is None:
            return list(self._items)
        if not self._is_localized:
            return [*self._items, self._localized(change.row)]
        return [*self._items, self._lost(change.row)] if ended_badly else list(self._items)

    # -- within ----------------------------------------------------------------------------------

    def _switch(self, since: _Told) -> None:
        if self._is_localized:
            self._lose(since)
            return
        self._items.append(self._localized(since.row))
        self._is_localized = self._was_localized = True
        self._change = None

    def _lose(self, since: _Told) -> None:
        # A frozen belief goes wrong too, and has been told as what it is.
        if not self._is_frozen:
            self._items.append(self._lost(since.row))
        self._is_localized, self._change = False, None

    def _check_frozen(self, told: _Told) -> None:
        first = self._same
        if first is None or not told.is_as(first):
            self._same, self._times, self._is_frozen = told, 1, False
            return
        self._times += 1
        if self._is_frozen or self._times < FROZEN:
            return
        then, now = first.row, told.row
        gone = math.hypot(now.true_x - then.true_x, now.true_y - then.true_y)
        turned = wrapped(now.true_heading - then.true_heading)
        if gone >= FROZEN_WAY or abs(turned) >= FROZEN_TURN:
            self._is_frozen = True
            self._items.append(Episode(EpisodeKind.FROZEN, then.elapsed, then.line, gone, turned))

    def _localized(self, row: BeliefRow) -> Episode:
        return Episode(
            EpisodeKind.LOCALIZED, row.elapsed, row.line, row.distance, row.turn, self._was_localized
        )

    def _lost(self, row: BeliefRow) -> Episode:
        touched = self._touched
        if touched is not None and touched.elapsed > row.elapsed:
            touched = None
        return Episode(
            EpisodeKind.LOST,
            *(row.elapsed, row.line, row.distance, row.turn),
            moved=self._moved,
            touched=touched,
        )
