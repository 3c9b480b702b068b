"""The possible moves of a robot whose wheels turn while it touches an obstacle.

Wheels slip alike in all directions, so that friction on the floor acts against the slip. Without friction on
the wall, the balance of forces along it gives the commanded velocity's component along the wall. Friction
reduces it by `friction` times the component into the wall. So a robot that hits the wall nearly squarely
stands.
"""

import math
from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from simmer_tui.sim.angles import cos_sin, turned
from simmer_tui.sim.arcs import Arc, Twist
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.contact import TOUCHING
from simmer_tui.sim.footprint import Edges, Footprint
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.path import distances
from simmer_tui.sim.pose import Pose

# Twice, since the place of a contact is itself exact only to TOUCHING.
_NEAR = 2.0 * TOUCHING


class WallMove(Struct, frozen=True):
    """A move at a wall: global velocity (in/s), turning rate of its path, and additional turning on the spot
    (deg/s). `brief` moves last one control period only, then the choice is made again."""

    velocity: tuple[float, float]
    rate: float
    spin: float = 0.0
    brief: bool = True

    def arc(self, pose: Pose, seconds: float) -> Arc:
        """The arc of this move from a pose."""
        return Arc(pose, self.velocity, self.rate, seconds, self.spin)


def wall_moves(
    body: Footprint, obstacles: Obstacles, pose: Pose, own: Twist, friction: float
) -> Iterator[WallMove]:
    """The moves to try, in this order: `own`, the commanded motion without errors on other axes; turning on
    the spot; sliding along the obstacle, the fastest first. A disc turns as commanded while it slides."""
    arc = Arc.of(pose, own, 0.0)
    yield WallMove(arc.velocity, own.r, brief=False)
    is_disc = not len(body.vertices)
    if own.r and not is_disc:
        yield WallMove((0.0, 0.0), own.r)
    spin = own.r if is_disc else 0.0
    for velocity in _slides(_tangents(body, obstacles, pose), arc.velocity, friction):
        yield WallMove(velocity, 0.0, spin)
    if spin:
        yield WallMove((0.0, 0.0), 0.0, spin)


def _slides(
    tangents: FloatArray, velocity: tuple[float, float], friction: float
) -> list[tuple[float, float]]:
    """Velocities along (n, 2) tangents, the fastest first: the component along each, reduced by friction from
    the component across."""
    vx, vy = velocity
    slides = []
    for x, y in tangents.tolist():
        along, across = vx * x + vy * y, vy * x - vx * y
        speed = abs(along) - friction * abs(across)
        if speed > 0.0:
            signed = math.copysign(speed, along)
            slides.append((speed, (signed * x, signed * y)))
    # A stable sort: of equally fast ones the first face of the maze comes first, on every machine.
    slides.sort(key=lambda slide: -slide[0])
    return [slide for _, slide in slides]


def _tangents(body: Footprint, obstacles: Obstacles, pose: Pose) -> FloatArray:
    """Directions along obstacles that the robot touches, (n, 2). They are faces of obstacles, its own edges
    at corners, and the normal of the line from a disc's centre to a corner."""
    place = np.array((pose.x, pose.y))
    margin = body.reach + _NEAR
    faces, corners = obstacles.near(place - margin, place + margin)
    found = [np.empty((0, 2))]
    if body.radius:
        across, along = faces.places(place)
        touches = np.abs(np.abs(across - faces.offset) - body.radius) <= _NEAR
        found.append(faces.tangent[touches & (along >= faces.low) & (along <= faces.high)])
        apart = place - corners
        near = apart[np.abs(distances(apart[:, 0], apart[:, 1]) - body.radius) <= _NEAR]
        found.append(np.column_stack((-near[:, 1], near[:, 0])) / body.radius)
    if len(body.vertices):
        cos, sin = cos_sin(pose.heading)
        found.append(_touched(faces, turned(body.vertices, cos, sin) + place))
        own = _touched(body.edges, turned(corners - place, cos, -sin))
        found.append(turned(own, cos, sin))
    return np.concatenate(found)


def _touched(edges: Edges, points: FloatArray) -> FloatArray:
    """Directions, (n, 2), of the edges that any of the points touches."""
    across, along = edges.places(points)
    touches = np.abs(across - edges.offset) <= _NEAR
    touches &= (along >= edges.low - _NEAR) & (along <= edges.high + _NEAR)
    return edges.tangent[touches.any(axis=0)]
