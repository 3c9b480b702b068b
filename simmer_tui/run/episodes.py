"""Episodes of a program's beliefs: localized, lost, frozen, and moved by a person.

One belief says little: a particle filter that is about to converge is off for a reading or two, and is
right again. So a change counts once it has lasted for as much movement as shows a robot other surroundings.
Its episode begins with the first belief of the change.
"""

from enum import StrEnum

from msgspec import Struct

from simmer_tui.run.events import ActionName
from simmer_tui.run.facts import COVERED, UNSURE, UNSURE_TURN, displacement
from simmer_tui.run.history_rows import ActionRow, BeliefRow, ContactRow
from simmer_tui.sim.specs import CELL_SIZE

LASTING, LASTING_TURN = CELL_SIZE, 360.0
"""Movement, inches or degrees, after which a change counts: it shows other walls, or all around."""
# Judged: less may be a pose that was sent once more before a program added up its last movements.
FROZEN, FROZEN_WAY, FROZEN_TURN = 3, 4.0, 45.0
"""A belief is frozen if its pose was sent this often while the robot moved this far, inches or degrees."""
# Poses pass through JSON with all digits; this allows for programs that round them.
SAME_POSE = 0.005
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

    `distance` (inches) and `turn` (degrees) are the error of the belief then. Of `MOVED` they are the
    displacement by a person, of `FROZEN` the robot's motion meanwhile. `again` is true if it was localized
    before. `moved` or `touched` is an event just before it that may explain it.
    """

    kind: EpisodeKind
    elapsed: float
    line: int
    distance: float = 0.0
    turn: float = 0.0
    again: bool = False
    moved: ActionRow | None = None
    touched: ContactRow | None = None


class _BeliefPoint(Struct, frozen=True):
    """A belief, and the total turning of the robot by then, degrees in either direction."""

    row: BeliefRow
    turned: float

    @property
    def is_sure(self) -> bool:
        row = self.row
        return not row.unsure and row.allowed_turn <= COVERED * UNSURE_TURN

    @property
    def is_off(self) -> bool:
        """True if the error is more than the belief allows for, or if the belief is unsure and far off."""
        row = self.row
        return row.lost or (not self.is_sure and (row.distance > UNSURE or abs(row.turn) > UNSURE_TURN))

    def lasts_until(self, other: "_BeliefPoint") -> bool:
        return other.row.gone - self.row.gone >= LASTING or other.turned - self.turned >= LASTING_TURN

    def is_as(self, other: "_BeliefPoint") -> bool:
        """True if both have the same pose."""
        mine, theirs = self.row, other.row
        return (
            abs(mine.x - theirs.x) < SAME_POSE
            and abs(mine.y - theirs.y) < SAME_POSE
            and abs(mine.heading - theirs.heading) < SAME_POSE
        )


class BeliefEpisodes:
    """Collects the episodes of a run from its beliefs, actions and contacts, given in order; see `so_far`."""

    def __init__(self) -> None:
        self._items: list[Episode] = []
        self._is_localized = False
        self._was_localized = False
        """True once the program has been localized: before that it cannot be lost."""
        self._change: _BeliefPoint | None = None
        """The first of the newest beliefs that all say the opposite of the present state."""
        self._same: _BeliefPoint | None = None
        """The first of the newest beliefs that all have one pose."""
        self._times = 0
        self._is_frozen = False
        self._moved: ActionRow | None = None
        self._touched: ContactRow | None = None
        """The last time that a person moved the robot, and the last contact, since a belief was right."""

    def believe(self, row: BeliefRow, turned: float) -> None:
        """Add a belief. `turned` is the total turning until then, degrees in either direction."""
        if not row.finite:
            return
        newest = _BeliefPoint(row, turned)
        self._check_frozen(newest)
        off, vague = newest.is_off, not newest.is_sure
        if off and self._is_localized and self._moved is not None:
            # No need to wait: an action has moved it.
            self._lose(newest)
        elif off != self._is_localized or (vague and not off):
            # As before, or too vague to say anything.
            self._change = None
        elif self._change is None:
            self._change = newest
        elif self._change.lasts_until(newest):
            self._switch(self._change)
        if not off and not vague:
            self._moved = self._touched = None

    def act(self, row: ActionRow) -> None:
        """Add an action of a person."""
        done = row.done
        if done.refused:
            return
        if done.places:
            # A program that was right until the action was localized, for however short a time.
            if self._change is not None and not self._is_localized:
                self._switch(self._change)
            self._same, self._change, self._is_frozen = None, None, False
        if done.restarts:
            self._items.clear()
            self._is_localized = self._was_localized = False
            self._moved = self._touched = None
            self._items.append(Episode(EpisodeKind.RESTARTED, row.elapsed, row.line))
        elif done.action.name is ActionName.TELEPORT:
            moved = displacement(row.before, done.pose)
            self._items.append(Episode(EpisodeKind.MOVED, row.elapsed, row.line, *moved))
            self._moved = row
        elif done.action.name is ActionName.BLOCK:
            self._items.append(Episode(EpisodeKind.BLOCK_MOVED, row.elapsed, row.line))

    def touch(self, row: ContactRow) -> None:
        """Add a contact."""
        self._touched = row

    def so_far(self, *, ended_badly: bool = False) -> list[Episode]:
        """The episodes up to now. A change that has just begun counts if the belief is right at the end, or
        if it is wrong and the run `ended_badly`."""
        change = self._change
        if change is None:
            return list(self._items)
        if not self._is_localized:
            return [*self._items, self._localized(change.row)]
        return [*self._items, self._lost(change.row)] if ended_badly else list(self._items)

    # -- internal --------------------------------------------------------------------------------

    def _switch(self, since: _BeliefPoint) -> None:
        if self._is_localized:
            self._lose(since)
            return
        self._items.append(self._localized(since.row))
        self._is_localized = self._was_localized = True
        self._change = None

    def _lose(self, since: _BeliefPoint) -> None:
        # A frozen belief becomes wrong too, and its episode is there already.
        if not self._is_frozen:
            self._items.append(self._lost(since.row))
        self._is_localized, self._change = False, None

    def _check_frozen(self, newest: _BeliefPoint) -> None:
        first = self._same
        if first is None or not newest.is_as(first):
            self._same, self._times, self._is_frozen = newest, 1, False
            return
        self._times += 1
        if self._is_frozen or self._times < FROZEN:
            return
        then = first.row
        gone, turned = displacement(then.true, newest.row.true)
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
