"""The first contact of a moving footprint with an obstacle on its path, exactly.

The path is a chain of segments; each turns the robot about its centre, then moves it straight.
On such a leg the footprint can only begin to overlap an obstacle at a moment when a vertex of one
crosses an edge of the other. All these moments have closed forms. Between two of them nothing
changes, so one look in between tells free from overlapping; a motion that only touches stays free.
"""

import math
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from simmer_tui.sim.angles import FloatArray
from simmer_tui.sim.footprint import Edges, Footprint
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.path import START, Path, PathPosition, distances
from simmer_tui.sim.pose import Pose

TOUCHING = 1e-9
"""A footprint this close to an obstacle, inches, may be touching it."""
# A path of 1e6 segments is looked at in parts: arrays of a whole one would take gigabytes, and most paths
# meet their obstacle early.
_CHUNK = 128
_TURN = 2.0 * math.pi
# Rounding of a cosine, by far: what is just beyond a sweep is sorted out by its angle.
_SLACK = 1e-9


class Met(Struct, frozen=True):
    """The place of a path where the robot meets an obstacle, and a pose a little further on, in
    which it would overlap it."""

    stop: PathPosition
    beyond: Pose


def first_contact(
    footprint: Footprint, obstacles: Obstacles, path: Path, size: float, after: PathPosition = START
) -> Met | None:
    """The first place of `path`, not before `after`, beyond which the robot would overlap an
    obstacle, or None.

    The robot must stand free at `after`. `size` is a length no free straight leg can exceed (the
    maze's diagonal), inches.
    """
    lengths = np.array(path.lengths())
    # The first leg that is longer than the maze ends at a wall for certain, so that none after it is reached.
    gone = np.flatnonzero(lengths[after.segment :] > size)
    last = after.segment + int(gone[0]) + 1 if len(gone) else path.segments
    for begin in range(after.segment, last, _CHUNK):
        end = min(begin + _CHUNK, last)
        met = _contact_within(footprint, obstacles, path, (begin, end), lengths, size, after)
        if met is not None:
            return met
    return None


def _contact_within(
    footprint: Footprint,
    obstacles: Obstacles,
    path: Path,
    chunk: tuple[int, int],
    lengths: FloatArray,
    size: float,
    after: PathPosition,
) -> Met | None:
    begin, end = chunk
    points = path.points[begin : end + 1]
    # A leg longer than the maze ends at a wall; cutting it keeps the arithmetic precise.
    within = np.minimum(1.0, size / np.maximum(lengths[begin:end], TOUCHING))
    moves = np.diff(points, axis=0) * within[:, None]
    # Only what is within reach of the legs' ends can be met: of a large maze most faces drop out here.
    margin = footprint.reach + TOUCHING
    corners = np.concatenate((points[:-1], points[:-1] + moves))
    faces, face_ends = obstacles.near(corners.min(axis=0) - margin, corners.max(axis=0) + margin)
    if not len(faces.offset) and not len(face_ends):
        return None
    cos, sin = (each[begin : end + 1] for each in path.directions)
    order, fractions = _straight_events(footprint, faces, face_ends, points[:-1], moves, cos[1:], sin[1:])
    orders, fractions_of_leg = [order], [fractions]
    if path.turn and len(footprint.vertices):
        swept = math.radians(path.turn * _turn_fraction(path.turn))
        order, fractions = _turning_events(
            footprint, faces, face_ends, points[:-1], swept, cos[:-1], sin[:-1]
        )
        orders.append(order)
        fractions_of_leg.append(fractions)
    all_orders, all_fractions = np.concatenate(orders), np.concatenate(fractions_of_leg)
    for leg in np.unique(all_orders):
        segment, straight = divmod(int(leg), 2)
        at = begin + segment
        longest = float(within[segment]) if straight else _turn_fraction(path.turn)
        events = np.unique(np.concatenate(([0.0], all_fractions[all_orders == leg], [1.0]))) * longest
        if at == after.segment:
            events = (
                _still_to_come(events, after.translated) if straight else _turned_on(events, after.turned)
            )

        def pose(fraction: float, at: int = at, straight: int = straight) -> Pose:
            return path.pose(at, 1.0, fraction) if straight else path.pose(at, fraction, 0.0)

        # Between two events nothing changes, so the middle stands for all of it.
        for free, following in pairwise(events.tolist()):
            for beyond in (pose((free + following) / 2), pose(following)):
                if obstacles.overlap(footprint, beyond):
                    return Met(
                        PathPosition(at, 1.0, free) if straight else PathPosition(at, free, 0.0), beyond
                    )
    return None


def _still_to_come(events: FloatArray, done: float) -> FloatArray:
    """The events after a fraction of a leg, and that fraction."""
    return np.concatenate(([done], events[events > done]))


def _turned_on(events: FloatArray, done: float) -> FloatArray:
    """The same for a turn, in which each event comes again after every full circle (the last one
    looked at): those of the circle that begins at the fraction done."""
    circle = float(events[-1])
    if circle == 1.0:
        return _still_to_come(events, done)
    again = events + np.ceil(np.maximum(done - events, 0.0) / circle) * circle
    end = min(done + circle, 1.0)
    return np.concatenate(([done], np.unique(again[(again > done) & (again < end)]), [end]))


def _turn_fraction(turn: float) -> float:
    """The fraction of a segment's turn that needs looking at: a full circle is all there is."""
    return min(1.0, 360.0 / abs(turn))


def _straight_events(
    footprint: Footprint,
    faces: Edges,
    corners: FloatArray,
    centres: FloatArray,
    moves: FloatArray,
    cos: FloatArray,
    sin: FloatArray,
) -> tuple[NDArray[np.intp], FloatArray]:
    """Events on the straight legs: (leg order, fraction of the leg), both (n,)."""
    events: list[tuple[NDArray[np.intp], FloatArray]] = []
    if footprint.radius:
        sides = np.concatenate((faces.offset + footprint.radius, faces.offset - footprint.radius))
        beside = replace(Edges.join(faces, faces), offset=sides)
        events.append(_crossings(centres[:, None, :], moves, beside))
        events.append(_rounded_corners(centres, moves, corners, footprint.radius))
    if len(footprint.vertices):
        vertices = _turned(footprint.vertices, cos, sin) + centres[:, None, :]
        events.append(_crossings(vertices, moves, faces))
        # Seen from the robot the corners move, the other way round.
        apart = _turned_each(corners[None, :, :] - centres[:, None, :], cos, -sin)
        away = _turned_each(-moves[:, None, :], cos, -sin)[:, 0, :]
        events.append(_crossings(apart, away, footprint.edges))
    return _joined(events, straight=1)


def _turning_events(
    footprint: Footprint,
    faces: Edges,
    corners: FloatArray,
    centres: FloatArray,
    swept: float,
    cos: FloatArray,
    sin: FloatArray,
) -> tuple[NDArray[np.intp], FloatArray]:
    """Events on the turning legs: (leg order, fraction of the turn looked at), both (n,)."""
    vertices = _turned(footprint.vertices, cos, sin)
    across, tangents_apart = faces.places(centres)
    walls_apart = faces.offset - across
    events = [_sweeps(vertices, swept, faces, walls_apart, tangents_apart)]
    apart = _turned_each(corners[None, :, :] - centres[:, None, :], cos, -sin)
    edges = footprint.edges
    events.append(_sweeps(apart, -swept, edges, edges.offset[None, :], np.zeros((1, len(edges.offset)))))
    return _joined(events, straight=0)


def _joined(
    events: list[tuple[NDArray[np.intp], FloatArray]], straight: int
) -> tuple[NDArray[np.intp], FloatArray]:
    legs = np.concatenate([leg for leg, _ in events])
    return legs * 2 + straight, np.concatenate([fraction for _, fraction in events])


def _turned(points: FloatArray, cos: FloatArray, sin: FloatArray) -> FloatArray:
    """(v, 2) points turned by each of k angles: (k, v, 2)."""
    return _turned_each(np.broadcast_to(points, (len(cos), *points.shape)), cos, sin)


def _turned_each(points: FloatArray, cos: FloatArray, sin: FloatArray) -> FloatArray:
    """(k, v, 2) points, each of the k groups turned by its own angle."""
    x, y = points[..., 0], points[..., 1]
    cos, sin = cos[:, None], sin[:, None]
    return np.stack((cos * x - sin * y, sin * x + cos * y), axis=-1)


def _crossings(points: FloatArray, moves: FloatArray, edges: Edges) -> tuple[NDArray[np.intp], FloatArray]:
    """When points (k, v, 2), each group moving by its row of `moves` (k, 2), meet edges.

    Returns the group and the fraction of the move, both (n,). A point that touches an edge at the
    start is met at 0, whatever its direction.
    """
    (across, along), (speed, speed_along) = edges.places(points), edges.places(moves[:, None, :])
    gap = across - edges.offset
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        fraction = np.where(np.abs(gap) <= TOUCHING, 0.0, -gap / speed)
        along = along + fraction * speed_along
    met = (fraction >= 0.0) & (fraction <= 1.0)
    met &= (along >= edges.low - TOUCHING) & (along <= edges.high + TOUCHING)
    group = np.nonzero(met)[0]
    return group, fraction[met]


def _rounded_corners(
    centres: FloatArray, moves: FloatArray, corners: FloatArray, radius: float
) -> tuple[NDArray[np.intp], FloatArray]:
    """When a disc at `centres` (k, 2), moving by `moves` (k, 2), meets corners (c, 2)."""
    # |apart + t move|^2 = radius^2, a quadratic equation in t, solved with half its linear coefficient.
    apart = centres[:, None, :] - corners[None, :, :]
    square = (moves[:, 0] * moves[:, 0] + moves[:, 1] * moves[:, 1])[:, None]
    half_linear = apart[..., 0] * moves[:, None, 0] + apart[..., 1] * moves[:, None, 1]
    distance = distances(apart[..., 0], apart[..., 1])
    # As a product: the difference of two squares would lose the digits that tell touching from not.
    constant = (distance - radius) * (distance + radius)
    root = np.sqrt(np.maximum(half_linear**2 - square * constant, 0.0))
    real = half_linear**2 >= square * constant
    groups, fractions = [], []
    for sign in (-1.0, 1.0):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            fraction = (-half_linear + sign * root) / square
        met = real & (fraction >= 0.0) & (fraction <= 1.0)
        groups.append(np.nonzero(met)[0])
        fractions.append(fraction[met])
    touching = np.abs(distance - radius) <= TOUCHING
    groups.append(np.nonzero(touching)[0])
    fractions.append(np.zeros(len(groups[-1])))
    return np.concatenate(groups), np.concatenate(fractions)


def _sweeps(
    points: FloatArray, swept: float, edges: Edges, apart: FloatArray, shift: FloatArray
) -> tuple[NDArray[np.intp], FloatArray]:
    """When points (k, v, 2), given from the centre of rotation, turn by `swept` radians about it
    and meet edges whose lines are `apart` (k or 1, e) from the centre along their normals; a
    point's place along edge e is `tangent . p + shift`.

    A point at distance rho meets the line where its place along the normal is `apart`, so that along
    the tangent it is h or -h with h = sqrt(rho^2 - apart^2). How far it has to turn for that is one
    arctangent, taken by the standard library: numpy's own differs between processors. Returns group
    and fraction of the sweep, both (n,).
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
    groups, fractions = [], []
    for side in (-half, half):
        cross, dot = along * line - ahead * side, along * side + ahead * line
        met = reachable & (side >= low) & (side <= high) & (dot >= least)
        if angle < math.pi:
            met &= sense * cross >= 0.0
        found = np.nonzero(met)
        turned = [math.atan2(sense * y, x) % _TURN for y, x in zip(cross[found], dot[found], strict=True)]
        # A turn of next to nothing meets nothing.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            fraction = np.array(turned) / angle
        groups.append(found[0][fraction <= 1.0])
        fractions.append(fraction[fraction <= 1.0])
    touching = (np.abs(ahead - line) <= TOUCHING) & (along >= low) & (along <= high)
    groups.append(np.nonzero(touching)[0])
    fractions.append(np.zeros(len(groups[-1])))
    return np.concatenate(groups), np.concatenate(fractions)
