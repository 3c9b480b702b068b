"""The first contact of a footprint that moves along an arc, exactly.

With h as in `arcs.py`, a point that moves at w about any centre crosses the line n . p = c where

    (g w^2 / 4 + (n . v') w / 2) h^2 + (n . v) h + g = 0,   g = n . p0 - c,

v being the point's own velocity at the start. A disc of radius R meets a corner q, with d = p0 - q, where

    ((d^2 - R^2) w^2 / 4 + w d . v' + v^2) h^2 + 2 (d . v) h + (d^2 - R^2) = 0.

Both are quadratic in h. Between two such moments nothing changes, so that one test in between distinguishes
free from overlapping, as in `contact.py`.
"""

from itertools import pairwise

import numpy as np
from msgspec import Struct

from simmer_tui.sim.angles import cos_sin, turned
from simmer_tui.sim.arcs import Arc
from simmer_tui.sim.arrays import BoolArray, FloatArray
from simmer_tui.sim.contact import TOUCHING
from simmer_tui.sim.footprint import Edges, Footprint
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.path import distances
from simmer_tui.sim.pose import Pose


class ArcContact(Struct, frozen=True):
    """The contact of a robot on an arc with an obstacle: its number h, and a pose a little later, at which
    they would overlap."""

    h: float
    beyond: Pose


def first_arc_contact(footprint: Footprint, obstacles: Obstacles, arc: Arc) -> ArcContact | None:
    """The first moment of `arc` after which the robot would overlap an obstacle, or None. The robot must
    stand free at its start."""
    last = arc.half_tangent(arc.duration)
    events = _events(footprint, obstacles, arc, last)
    if events is None:
        return None
    for free, following in pairwise(events):
        for h in ((free + following) / 2.0, following):
            beyond = arc.pose_at(h)
            if obstacles.overlap(footprint, beyond):
                return ArcContact(free, beyond)
    return None


def _events(footprint: Footprint, obstacles: Obstacles, arc: Arc, last: float) -> list[float] | None:
    """Moments at which something may begin to overlap, with 0 and the end of the arc; None if nothing is
    within reach."""
    end = arc.place_at(last)
    start = np.array((arc.start.x, arc.start.y))
    w = arc.turn_rate
    # An arc's middle lies at most length x turn / 8 off its chord.
    margin = footprint.reach + TOUCHING + arc.length * abs(w * arc.duration) / 8.0
    faces, corners = obstacles.near(np.minimum(start, end) - margin, np.maximum(start, end) + margin)
    if not len(faces.offset) and not len(corners):
        return None
    velocity = np.array(arc.velocity)
    found: list[FloatArray] = []
    # Once for all: lines that are never crossed give numbers that are not finite.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if footprint.radius:
            beside = faces.beside(footprint.radius)
            found.append(_line_crossings(start[None, :], velocity[None, :], w, beside))
            found.append(_disc_at_corners(start - corners, velocity, w, footprint.radius))
        if len(footprint.vertices):
            cos, sin = cos_sin(arc.start.heading)
            arms = turned(footprint.vertices, cos, sin)
            found.append(_line_crossings(start + arms, velocity + w * _left(arms), w, faces))
            # Seen from the robot the corners move by the inverse twist.
            seen = turned(corners - start, cos, -sin)
            own = turned(velocity[None, :], cos, -sin)
            found.append(_line_crossings(seen, -(own + w * _left(seen)), -w, footprint.edges))
        every = np.concatenate(found)
        inside = every[(every > 0.0) & (every < last)]
    # Mostly fewer than ten, for which np.unique takes longer than all of the above.
    return [0.0, *sorted(set(inside.tolist())), last]


def _line_crossings(points: FloatArray, velocities: FloatArray, w: float, edges: Edges) -> FloatArray:
    """Numbers h at which points (v, 2) with velocities (v, 2), turning at `w` rad/s, are on edges: (n,)."""
    across, along = edges.places(points)
    speed, speed_along = edges.places(velocities)
    bend, bend_along = edges.places_of(-velocities[:, 1], velocities[:, 0])
    gap = across - edges.offset
    h = _roots(gap * (w * w / 4.0) + bend * (w / 2.0), speed, gap, np.abs(gap) <= TOUCHING)
    place = along + h * (speed_along + (w / 2.0) * h * bend_along) / (1.0 + (w * w / 4.0) * h * h)
    crossed: FloatArray = h[(place >= edges.low - TOUCHING) & (place <= edges.high + TOUCHING)]
    return crossed


def _disc_at_corners(apart: FloatArray, velocity: FloatArray, w: float, radius: float) -> FloatArray:
    """Numbers h at which a disc whose centre lies `apart` (c, 2) from corners touches them, not finite where
    it does not."""
    distance = distances(apart[:, 0], apart[:, 1])
    # As a product: the difference of two squares would lose the digits that distinguish touching from not
    # touching.
    gap = (distance - radius) * (distance + radius)
    x, y = velocity.tolist()
    ahead = apart[:, 0] * x + apart[:, 1] * y
    aside = apart[:, 1] * x - apart[:, 0] * y
    square = gap * (w * w / 4.0) + w * aside + (x * x + y * y)
    return _roots(square, 2.0 * ahead, gap, np.abs(distance - radius) <= TOUCHING).ravel()


def _roots(a: FloatArray, b: FloatArray, c: FloatArray, touching: BoolArray) -> FloatArray:
    """Both roots (2, ...) of a h^2 + b h + c = 0, not finite where there is none; 0 and -b / a where it
    touches at the start."""
    # The textbook form for roots without cancellation (Press et al., Numerical Recipes, 5.6).
    q = -0.5 * (b + np.copysign(np.sqrt(b * b - 4.0 * a * c), b))
    roots = np.empty((2, *q.shape))
    roots[0], roots[1] = np.where(touching, 0.0, c / q), np.where(touching, -b / a, q / a)
    return roots


def _left(vectors: FloatArray) -> FloatArray:
    """(n, 2) vectors turned left by 90 degrees."""
    turned_left = np.empty_like(vectors)
    turned_left[:, 0], turned_left[:, 1] = -vectors[:, 1], vectors[:, 0]
    return turned_left
