"""Where on its path a moving footprint first runs into an obstacle, exactly.

The path is a chain of segments; each turns the robot about its centre, then moves it straight.
On such a leg the footprint can only begin to overlap an obstacle at a moment when a vertex of one
crosses an edge of the other. All these moments have closed forms. Between two of them nothing
changes, so one look in between tells free from overlapping; a motion that only touches stays free.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.angles import FloatArray, cos_sin_array
from simmer_tui.sim.footprint import Edges, Footprint
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.records import Pose

TOUCHING = 1e-9
"""An footprint this close to an obstacle, inches, may be touching it."""
_CHUNK = 128
_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class Stop:
    """Where a path ends: in which segment (from 0), after which fraction of its turn and its
    translation."""

    segment: int
    turned: float
    translated: float


START = Stop(0, 0.0, 0.0)


@dataclass(frozen=True)
class Path:
    """A chain of segments. From heading `start` (degrees) each segment turns by `turn` degrees
    and then goes from one of the (n + 1, 2) `points` to the next."""

    start: float
    turn: float
    points: FloatArray

    @property
    def segments(self) -> int:
        return len(self.points) - 1

    def headings_after(self, turns: NDArray[np.intp]) -> FloatArray:
        """Headings after whole numbers of turns."""
        return self.start + self.turn * turns.astype(np.float64)

    def pose(self, segment: int, turned: float, translated: float) -> Pose:
        """The pose inside a segment, after these fractions of its turn and its translation."""
        x, y = self.points[segment] + translated * (self.points[segment + 1] - self.points[segment])
        return Pose(float(x), float(y), self.start + self.turn * (segment + turned))


def first_contact(
    footprint: Footprint, obstacles: Obstacles, path: Path, size: float, after: Stop = START
) -> Stop | None:
    """The first place of `path`, not before `after`, beyond which the robot would overlap an
    obstacle, or None.

    The robot must stand free at `after`. `size` is a length no free straight leg can exceed (the
    maze's diagonal), inches.
    """
    lengths = np.hypot(*np.diff(path.points, axis=0).T)
    gone = np.flatnonzero(lengths[after.segment :] > size)
    last = after.segment + int(gone[0]) + 1 if len(gone) else path.segments
    for begin in range(after.segment, last, _CHUNK):
        end = min(begin + _CHUNK, last)
        stop = _contact_within(footprint, obstacles, path, (begin, end), lengths, size, after)
        if stop is not None:
            return stop
    return None


def _contact_within(
    footprint: Footprint,
    obstacles: Obstacles,
    path: Path,
    chunk: tuple[int, int],
    lengths: FloatArray,
    size: float,
    after: Stop,
) -> Stop | None:
    begin, end = chunk
    points = path.points[begin : end + 1]
    # A leg longer than the maze ends at a wall; cutting it keeps the arithmetic precise.
    within = np.minimum(1.0, size / np.maximum(lengths[begin:end], TOUCHING))
    moves = np.diff(points, axis=0) * within[:, None]
    margin = footprint.reach + TOUCHING
    corners = np.concatenate((points[:-1], points[:-1] + moves))
    faces, face_ends = obstacles.near(corners.min(axis=0) - margin, corners.max(axis=0) + margin)
    if not len(faces.offset) and not len(face_ends):
        return None
    turns = np.arange(begin, end)
    order, fractions = _straight_events(footprint, faces, face_ends, path, points[:-1], moves, turns)
    orders, fractions_of_leg = [order], [fractions]
    if path.turn and len(footprint.vertices):
        order, fractions = _turning_events(footprint, faces, face_ends, path, points[:-1], turns)
        orders.append(order)
        fractions_of_leg.append(fractions)
    all_orders, all_fractions = np.concatenate(orders), np.concatenate(fractions_of_leg)
    for leg in np.unique(all_orders):
        segment, straight = divmod(int(leg), 2)
        at = begin + segment
        longest = float(within[segment]) if straight else _turn_fraction(path.turn)
        events = np.unique(np.concatenate(([0.0], all_fractions[all_orders == leg], [1.0]))) * longest
        if at == after.segment:
            done = after.translated if straight else after.turned
            events = np.concatenate(([done], events[events > done]))

        def pose(fraction: float, at: int = at, straight: int = straight) -> Pose:
            return path.pose(at, 1.0, fraction) if straight else path.pose(at, fraction, 0.0)

        for free, following in pairwise(events):
            between = pose((free + following) / 2)
            if obstacles.overlap(footprint, between) or obstacles.overlap(footprint, pose(following)):
                return Stop(at, 1.0, float(free)) if straight else Stop(at, float(free), 0.0)
    return None


def _turn_fraction(turn: float) -> float:
    """The fraction of a segment's turn that needs looking at: a full circle is all there is."""
    return min(1.0, 360.0 / abs(turn))


def _straight_events(
    footprint: Footprint,
    faces: Edges,
    corners: FloatArray,
    path: Path,
    centres: FloatArray,
    moves: FloatArray,
    turns: NDArray[np.intp],
) -> tuple[NDArray[np.intp], FloatArray]:
    """Events on the straight legs: (leg order, fraction of the leg), both (n,)."""
    events: list[tuple[NDArray[np.intp], FloatArray]] = []
    if footprint.radius:
        for side in (footprint.radius, -footprint.radius):
            beside = replace(faces, offset=faces.offset + side)
            events.append(_crossings(centres[:, None, :], moves, beside))
        events.append(_rounded_corners(centres, moves, corners, footprint.radius))
    if len(footprint.vertices):
        cos, sin = cos_sin_array(path.headings_after(turns + 1))
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
    path: Path,
    centres: FloatArray,
    turns: NDArray[np.intp],
) -> tuple[NDArray[np.intp], FloatArray]:
    """Events on the turning legs: (leg order, fraction of the turn looked at), both (n,)."""
    cos, sin = cos_sin_array(path.headings_after(turns))
    swept = math.radians(path.turn * _turn_fraction(path.turn))
    vertices = _turned(footprint.vertices, cos, sin)
    walls_apart = faces.offset - centres @ faces.normal.T
    tangents_apart = centres @ faces.tangent.T
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
    gap = points @ edges.normal.T - edges.offset
    speed = (moves @ edges.normal.T)[:, None, :]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        fraction = np.where(np.abs(gap) <= TOUCHING, 0.0, -gap / speed)
        along = points @ edges.tangent.T + fraction * (moves @ edges.tangent.T)[:, None, :]
    met = (fraction >= 0.0) & (fraction <= 1.0)
    met &= (along >= edges.low - TOUCHING) & (along <= edges.high + TOUCHING)
    group = np.nonzero(met)[0]
    return group, fraction[met]


def _rounded_corners(
    centres: FloatArray, moves: FloatArray, corners: FloatArray, radius: float
) -> tuple[NDArray[np.intp], FloatArray]:
    """When a disc at `centres` (k, 2), moving by `moves` (k, 2), meets corners (c, 2)."""
    apart = centres[:, None, :] - corners[None, :, :]
    square = (moves**2).sum(axis=1)[:, None]
    half_linear = (apart * moves[:, None, :]).sum(axis=2)
    distance = np.hypot(apart[..., 0], apart[..., 1])
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

    From rho * cos(phi + theta - alpha) = apart. Returns group and fraction of the sweep, both (n,).
    """
    radius = np.hypot(points[..., 0], points[..., 1])[:, :, None]
    phase = np.arctan2(points[..., 1], points[..., 0])[:, :, None]
    normal_angle = np.arctan2(edges.normal[:, 1], edges.normal[:, 0])
    line = apart[:, None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = line / radius
    reachable = (np.abs(line) <= radius + TOUCHING) & (radius > 0.0)
    opening = np.arccos(np.clip(np.where(reachable, cosine, 1.0), -1.0, 1.0))
    tangent_angle = np.arctan2(edges.tangent[:, 1], edges.tangent[:, 0])
    sense = math.copysign(1.0, swept)
    low = (edges.low - TOUCHING)[None, None, :] - shift[:, None, :]
    high = (edges.high + TOUCHING)[None, None, :] - shift[:, None, :]
    groups, fractions = [], []
    for sign in (-1.0, 1.0):
        world = normal_angle + sign * opening
        with np.errstate(over="ignore"):  # a turn of next to nothing meets nothing
            fraction = np.mod(sense * (world - phase), _TURN) / abs(swept)
        along = radius * np.cos(world - tangent_angle)
        met = reachable & (fraction <= 1.0) & (along >= low) & (along <= high)
        groups.append(np.nonzero(met)[0])
        fractions.append(fraction[met])
    along = points @ edges.tangent.T
    touching = np.abs(points @ edges.normal.T - line) <= TOUCHING
    touching &= (along >= low) & (along <= high)
    groups.append(np.nonzero(touching)[0])
    fractions.append(np.zeros(len(groups[-1])))
    return np.concatenate(groups), np.concatenate(fractions)
