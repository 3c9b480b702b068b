"""The first contact of a moving footprint with an obstacle on its path, exactly.

The path is a chain of segments; each turns the robot about its centre, then moves it straight. On such a leg
the footprint can only begin to overlap an obstacle at a moment when a vertex of one crosses an edge of the
other. All these moments have closed forms. Between two of them nothing changes, so one test in between
distinguishes free from overlapping. A motion that only touches stays free.
"""

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from msgspec import Struct

from simmer_tui.sim.angles import turned
from simmer_tui.sim.arrays import BoolArray, FloatArray, NDArray
from simmer_tui.sim.footprint import Edges, Footprint
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.path import PATH_START, Path, PathPosition, distances
from simmer_tui.sim.pose import Pose

TOUCHING = 1e-9
"""A footprint this close to an obstacle, inches, may be touching it."""
# A path of up to 1e6 segments is searched in parts of so many: arrays of the whole would take gigabytes, and
# most paths meet their obstacle early.
_CHUNK = 128
_TURN = 2.0 * math.pi
# Far above the rounding of a cosine. Points just beyond a sweep are then excluded by their angle.
_SLACK = 1e-9
_Near = tuple[Edges, FloatArray]
"""Faces and corners within reach, as `Obstacles.near` has them."""
_Directions = tuple[FloatArray, FloatArray]
"""Cosines and sines of k headings, (k, 1) each."""
_Events = tuple[NDArray[np.intp], FloatArray]
"""Numbers of segments, and fractions of their legs after which something may begin to overlap, (n,) each."""


class FirstContact(Struct, frozen=True):
    """The place of a path where the robot meets an obstacle, and a pose a little further on, at which they
    would overlap."""

    stop: PathPosition
    beyond: Pose


def first_contact(
    footprint: Footprint, obstacles: Obstacles, path: Path, size: float, after: PathPosition = PATH_START
) -> FirstContact | None:
    """The first place of `path`, not before `after`, beyond which the robot would overlap an
    obstacle, or None.

    The robot must stand free at `after`. `size` is a length no free straight leg can exceed (the
    maze's diagonal), inches.
    """
    lengths = np.array(path.lengths())
    # A leg longer than the maze certainly ends at a wall, so that no leg after it is reached.
    gone = np.flatnonzero(lengths[after.segment :] > size)
    last = after.segment + int(gone[0]) + 1 if len(gone) else path.segments
    for begin in range(after.segment, last, _CHUNK):
        # A leg longer than the maze ends at a wall; cutting it keeps the arithmetic precise.
        shares = np.minimum(1.0, size / np.maximum(lengths[begin : min(begin + _CHUNK, last)], TOUCHING))
        met = _contact_within(footprint, obstacles, path, begin, shares, after)
        if met is not None:
            return met
    return None


def _contact_within(
    body: Footprint, obstacles: Obstacles, path: Path, begin: int, shares: FloatArray, after: PathPosition
) -> FirstContact | None:
    """The first contact in the segments from `begin` on; `shares` (k,) are the fractions of their straight
    legs to search."""
    end = begin + len(shares)
    points = path.points[begin : end + 1]
    centres, moves = points[:-1], np.diff(points, axis=0) * shares[:, None]
    # Only faces within reach of the legs' ends can be met: in a large maze most drop out here.
    margin = body.reach + TOUCHING
    ends = np.concatenate((centres, centres + moves))
    near = obstacles.near(ends.min(axis=0) - margin, ends.max(axis=0) + margin)
    if not len(near[0].offset) and not len(near[1]):
        return None
    cos, sin = (each[begin : end + 1, None] for each in path.directions)
    straight_events = _straight_events(body, near, centres, moves, (cos[1:], sin[1:]))
    found = [(2 * segments + 1, fractions) for segments, fractions in straight_events]
    # After a full circle a turn repeats itself.
    share = min(1.0, 360.0 / abs(path.turn)) if path.turn else 1.0
    if path.turn and len(body.vertices):
        swept = math.radians(path.turn * share)
        turning_events = _turning_events(body, near, centres, swept, (cos[:-1], sin[:-1]))
        found += [(2 * segments, fractions) for segments, fractions in turning_events]
    legs, fractions = (np.concatenate(each) for each in zip(*found, strict=True))
    for leg in np.unique(legs):
        segment, straight = divmod(int(leg), 2)
        at = begin + segment
        longest = float(shares[segment]) if straight else share
        events = np.unique(np.concatenate(([0.0], fractions[legs == leg], [1.0]))) * longest
        if at == after.segment:
            events = (
                _still_to_come(events, after.translated) if straight else _turned_on(events, after.turned)
            )
        met = _first_overlap(body, obstacles, path, at, events, straight=bool(straight))
        if met is not None:
            return met
    return None


def _first_overlap(
    body: Footprint, obstacles: Obstacles, path: Path, at: int, events: FloatArray, *, straight: bool
) -> FirstContact | None:
    """The first of a leg's events after which the robot overlaps an obstacle. Between two of them nothing
    changes, so the middle represents the whole interval."""
    for free, following in pairwise(events.tolist()):
        for fraction in ((free + following) / 2, following):
            beyond = path.pose(at, 1.0, fraction) if straight else path.pose(at, fraction, 0.0)
            if obstacles.overlap(body, beyond):
                return FirstContact(
                    PathPosition(at, 1.0, free) if straight else PathPosition(at, free, 0.0), beyond
                )
    return None


def _still_to_come(events: FloatArray, done: float) -> FloatArray:
    """The events after a fraction of a leg, and that fraction."""
    return np.concatenate(([done], events[events > done]))


def _turned_on(events: FloatArray, done: float) -> FloatArray:
    """The same for a turn, in which each event repeats after every full circle: the events of the circle that
    begins at the fraction done."""
    circle = float(events[-1])
    if circle == 1.0:
        return _still_to_come(events, done)
    again = events + np.ceil(np.maximum(done - events, 0.0) / circle) * circle
    end = min(done + circle, 1.0)
    return np.concatenate(([done], np.unique(again[(again > done) & (again < end)]), [end]))


def _straight_events(
    footprint: Footprint, near: _Near, centres: FloatArray, moves: FloatArray, headings: _Directions
) -> Iterator[_Events]:
    """Events on the straight legs."""
    faces, corners = near
    if footprint.radius:
        yield _crossings(centres[:, None, :], moves, faces.beside(footprint.radius))
        yield from _rounded_corners(centres, moves, corners, footprint.radius)
    if len(footprint.vertices):
        cos, sin = headings
        yield _crossings(turned(footprint.vertices, cos, sin) + centres[:, None, :], moves, faces)
        # Seen from the robot the corners move, in the opposite direction.
        apart = turned(corners - centres[:, None, :], cos, -sin)
        away = turned(-moves[:, None, :], cos, -sin)[:, 0, :]
        yield _crossings(apart, away, footprint.edges)


def _turning_events(
    footprint: Footprint, near: _Near, centres: FloatArray, swept: float, headings: _Directions
) -> Iterator[_Events]:
    """Events on the turning legs: fractions of the turn that is searched, `swept` radians."""
    (faces, corners), (cos, sin), edges = near, headings, footprint.edges
    across, along = faces.places(centres)
    yield from _sweeps(turned(footprint.vertices, cos, sin), swept, faces, faces.offset - across, along)
    apart = turned(corners - centres[:, None, :], cos, -sin)
    yield from _sweeps(apart, -swept, edges, edges.offset[None, :], np.zeros((1, len(edges.offset))))


def _crossings(points: FloatArray, moves: FloatArray, edges: Edges) -> _Events:
    """Moments at which points (k, v, 2), each group moving by its row of `moves` (k, 2), meet edges. A point
    that touches an edge at the start is met at 0, whatever its direction."""
    (across, along), (speed, speed_along) = edges.places(points), edges.places(moves[:, None, :])
    gap = across - edges.offset
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        fraction = np.where(np.abs(gap) <= TOUCHING, 0.0, -gap / speed)
        along = along + fraction * speed_along
    met = (fraction >= 0.0) & (fraction <= 1.0)
    met &= (along >= edges.low - TOUCHING) & (along <= edges.high + TOUCHING)
    return np.nonzero(met)[0], fraction[met]


def _rounded_corners(
    centres: FloatArray, moves: FloatArray, corners: FloatArray, radius: float
) -> Iterator[_Events]:
    """Moments at which a disc at `centres` (k, 2), moving by `moves` (k, 2), meets corners (c, 2)."""
    # |apart + t move|^2 = radius^2, a quadratic equation in t, solved with half its linear coefficient.
    apart = centres[:, None, :] - corners[None, :, :]
    square = (moves[:, 0] * moves[:, 0] + moves[:, 1] * moves[:, 1])[:, None]
    half_linear = apart[..., 0] * moves[:, None, 0] + apart[..., 1] * moves[:, None, 1]
    distance = distances(apart[..., 0], apart[..., 1])
    # As a product: the difference of two squares would lose the digits that tell touching from not.
    constant = (distance - radius) * (distance + radius)
    root = np.sqrt(np.maximum(half_linear**2 - square * constant, 0.0))
    real = half_linear**2 >= square * constant
    for sign in (-1.0, 1.0):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            fraction = (-half_linear + sign * root) / square
        met = real & (fraction >= 0.0) & (fraction <= 1.0)
        yield np.nonzero(met)[0], fraction[met]
    yield _at_once(np.abs(distance - radius) <= TOUCHING)


def _sweeps(
    points: FloatArray, swept: float, edges: Edges, apart: FloatArray, shift: FloatArray
) -> Iterator[_Events]:
    """Moments at which points (k, v, 2), given from the centre of rotation, meet edges as they turn by
    `swept` radians about it. The lines of the edges are `apart` (k or 1, e) from the centre along their
    normals; a point's place along edge e is `tangent . p + shift`.

    A point at distance rho meets the line where its place along the normal is `apart`, so that along the
    tangent it is h or -h with h = sqrt(rho^2 - apart^2). The angle to turn is one arctangent, by the standard
    library: numpy's own differs between processors.
    """
    radius = distances(points[..., 0], points[..., 1])[:, :, None]
    ahead, along = edges.places(points)
    line = apart[:, None, :]
    low = (edges.low - TOUCHING) - shift[:, None, :]
    high = (edges.high + TOUCHING) - shift[:, None, :]
    reachable = (np.abs(line) <= radius + TOUCHING) & (radius > 0.0)
    # Likewise a product; rounding may make it slightly negative where a point just reaches the line.
    half = np.sqrt(np.maximum((radius - line) * (radius + line), 0.0))
    sense, angle = math.copysign(1.0, swept), abs(swept)
    least = (math.cos(angle) - _SLACK if angle < math.pi else -math.inf) * radius * radius
    for side in (-half, half):
        cross, dot = along * line - ahead * side, along * side + ahead * line
        met = reachable & (side >= low) & (side <= high) & (dot >= least)
        if angle < math.pi:
            met &= sense * cross >= 0.0
        found = np.nonzero(met)
        turned = [math.atan2(sense * y, x) % _TURN for y, x in zip(cross[found], dot[found], strict=True)]
        # A turn of almost 0 meets nothing.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            fraction = np.array(turned) / angle
        yield found[0][fraction <= 1.0], fraction[fraction <= 1.0]
    yield _at_once((np.abs(ahead - line) <= TOUCHING) & (along >= low) & (along <= high))


def _at_once(touching: BoolArray) -> _Events:
    """Events at the very beginning, of points that touch something there; groups are the first axis."""
    groups = np.nonzero(touching)[0]
    return groups, np.zeros(len(groups))
