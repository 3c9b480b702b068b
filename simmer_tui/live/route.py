"""Route of the robot since the start of a run, as lines that are simplified by their shape."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain, pairwise

import numpy as np
from msgspec import Struct

from simmer_tui.sim.arrays import FloatArray

# Half a dot is 0.3 in at 120 x 36 and 0.17 in at 200 x 60; this holds up to 30 columns a maze cell.
TOLERANCE = 0.1
"""Inches by which a simplified line may differ from the route."""
_PIECE = 24.0
"""Inches of a piece of the route: two maze cells, so that a mission's route has a dozen."""
# A turn of a differential drive on the spot moves its centre by less.
_STANDSTILL = 0.05
"""Inches within which the robot counts as standing."""
# A mission has about 20, an hour of driving some thousands.
_MOST_PIECES = 4000
"""Pieces kept; of more the oldest half is joined and simplified further."""
_COARSE = 1.0
"""Inches by which that half may differ: a dot of the usual screens."""


_Place = tuple[float, float]
"""x and y, inches."""
_NOWHERE: _Place = (math.nan, math.nan)
"""The place before the first movement: near no other."""


class Route(Struct, frozen=True, eq=False):
    """Pieces of the route, oldest first, each (n, 3): x and y in inches, simulated seconds. A piece is an
    array of its own that never changes, so it can be drawn once."""

    pieces: tuple[FloatArray, ...] = ()

    def since(self, time: float) -> list[FloatArray]:
        """The parts of the pieces from a simulated time on."""
        found: list[FloatArray] = []
        for piece in reversed(self.pieces):
            if piece[-1, 2] < time:
                break
            later = piece[piece[:, 2] > time]
            if len(later) < len(piece):
                at = [np.interp(time, piece[:, 2], piece[:, axis]) for axis in (0, 1)]
                later = np.concatenate(([(*at, time)], later))
            found.append(later)
        return found[::-1]


class RouteKeeper:
    """Collects the movements of a run as its route.

    The movements of the open piece are kept as they came until it is long enough: lines that are simplified
    again with each of many small movements drift away from an arc.
    """

    def __init__(self) -> None:
        self._closed: list[FloatArray] = []
        self._open: list[tuple[Sequence[_Place], float, float]] = []
        self._length = 0.0
        self._last = self._kept = _NOWHERE
        """The last place, and the last one that the open piece has."""
        self._route: Route | None = Route()

    def clear(self) -> None:
        """Begin anew: the run restarts."""
        self._closed = []
        self._reopen(_NOWHERE, math.nan)

    def add(self, centres: Sequence[_Place], begin: float, end: float) -> None:
        """Add a movement: the robot's centres, (n, 2) inches, from a simulated time to another."""
        # Plain numbers: a movement has some ten places, for which arrays take ten times as long.
        if not math.dist(self._last, centres[0]) < _STANDSTILL:
            self._close()  # the robot was put elsewhere
            self._reopen(centres[0], begin)
        self._last, kept = centres[-1], self._kept
        # From the last place kept: small movements add up.
        moves = math.dist(kept, self._last) >= _STANDSTILL
        if not (moves or any(math.dist(kept, each) >= _STANDSTILL for each in centres)):
            return
        self._open.append((centres, begin, end))
        self._kept = centres[-1]
        self._length += math.dist(kept, centres[0]) + sum(map(math.dist, centres, centres[1:]))
        self._route = None
        if self._length >= _PIECE:
            self._close()
            self._reopen(self._last, end)

    @property
    def route(self) -> Route:
        """The route so far."""
        if self._route is None:
            self._route = Route((*self._closed, self._shortened()))
        return self._route

    def _shortened(self) -> FloatArray:
        return simplified(_timed_line(self._open), TOLERANCE)

    def _close(self) -> None:
        if len(self._open) > 1:
            self._closed.append(self._shortened())
        if len(self._closed) > _MOST_PIECES:
            old = merged_pieces(self._closed[: _MOST_PIECES // 2])
            self._closed[: _MOST_PIECES // 2] = [simplified(each, _COARSE) for each in old]

    def _reopen(self, place: _Place, time: float) -> None:
        """Begin a piece."""
        self._open, self._length, self._last, self._kept = [([place], time, time)], 0.0, place, place
        self._route = Route(tuple(self._closed))


def _timed_line(movements: Sequence[tuple[Sequence[_Place], float, float]]) -> FloatArray:
    """The places of movements with the times at which even motions pass them, (n, 3)."""
    lengths = [len(places) for places, *_ in movements]
    points = np.fromiter(chain.from_iterable(chain(*(places for places, *_ in movements))), np.float64)
    points = points.reshape(-1, 2)
    begins, ends = np.array([times for _, *times in movements]).T
    last = np.cumsum(lengths) - 1
    first = last - lengths + 1
    along = np.cumsum(np.hypot(*np.diff(points, axis=0, prepend=points[:1]).T))
    went = along[last] - along[first]
    # Without a length the places are one.
    slowness = np.divide(ends - begins, went, out=np.zeros(len(went)), where=went > 0.0)
    times = np.repeat(begins - along[first] * slowness, lengths) + along * np.repeat(slowness, lengths)
    times[first], times[last] = begins, ends
    return np.column_stack((points, times))


def merged_pieces(pieces: Sequence[FloatArray]) -> list[FloatArray]:
    """The pieces, with those as one whose ends meet."""
    groups = [[pieces[0]]]
    for before, piece in pairwise(pieces):
        if np.allclose(before[-1, :2], piece[0, :2], atol=_STANDSTILL):
            groups[-1].append(piece)
        else:
            groups.append([piece])
    return [np.concatenate(each) for each in groups]


def simplified(line: FloatArray, tolerance: float) -> FloatArray:
    """Points of a line (n, 2 or more) that are needed to stay within a distance of all of them, by Ramer
    (1972) and Douglas and Peucker (1973); only the first two columns count."""
    kept = np.zeros(len(line), dtype=np.bool_)
    kept[[0, -1]] = True
    spans = [(0, len(line) - 1)]
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        start, chord = line[first, :2], line[last, :2] - line[first, :2]
        away = line[first + 1 : last, :2] - start
        squared = float(chord @ chord)
        # From the nearest place of the chord itself, not of the line through it: a route may turn back.
        share = (
            np.minimum(np.maximum(away @ chord / squared, 0.0), 1.0) if squared > 0.0 else 0.0 * away[:, 0]
        )
        away -= share[:, None] * chord
        distance = np.hypot(away[:, 0], away[:, 1])
        farthest = int(distance.argmax())
        if distance[farthest] > tolerance:
            middle = first + 1 + farthest
            kept[middle] = True
            spans += [(first, middle), (middle, last)]
    shorter: FloatArray = line[kept]
    return shorter
