"""Discs, polygons and lines as numbers: distances, outlines, samples. Lengths are in inches."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import RobotSpec

Places = NDArray[np.float64]


_FAR = 1e6
"""Inches; nothing further out is drawn, and what is drawn must not overflow an integer."""


def is_near(*numbers: float) -> bool:
    """Whether coordinates or angles are such that something can be drawn there."""
    return all(abs(number) < _FAR for number in numbers)


def near_places(places: Places) -> Places:
    """Places (n, 2) with those that are nowhere moved to the edge of what can be drawn."""
    near: Places = np.clip(np.nan_to_num(places, nan=_FAR), -_FAR, _FAR)
    return near


def distance_to_outline(points: Places, shape: RobotSpec) -> NDArray[np.float64]:
    """Signed distance of points (..., 2) to a shape's outline, negative inside."""
    if shape.radius is not None:
        disc: NDArray[np.float64] = np.hypot(points[..., 0], points[..., 1]) - shape.radius
        return disc
    x, y = points[..., 0], points[..., 1]
    squared = np.full(x.shape, np.inf)
    inside = np.zeros(x.shape, dtype=np.bool_)
    previous = shape.vertices[-1]
    for vertex in shape.vertices:
        (ax, ay), (bx, by) = previous, vertex
        ex, ey = bx - ax, by - ay
        along = np.clip(((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey or 1.0), 0.0, 1.0)
        np.minimum(squared, (x - ax - along * ex) ** 2 + (y - ay - along * ey) ** 2, out=squared)
        if ay != by:
            # Even-odd rule: a ray towards +X crosses this edge.
            inside ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) * ex / (by - ay))
        previous = vertex
    distance: NDArray[np.float64] = np.where(inside, -1.0, 1.0) * np.sqrt(squared)
    return distance


def reach(shape: RobotSpec) -> float:
    """The greatest distance from the origin to a shape's outline."""
    return shape.radius if shape.radius is not None else max(math.hypot(x, y) for x, y in shape.vertices)


def front(shape: RobotSpec) -> float:
    """How far the shape extends along +X from the origin."""
    if shape.radius is not None:
        return shape.radius
    crossings = [0.0]
    previous = shape.vertices[-1]
    for vertex in shape.vertices:
        (ax, ay), (bx, by) = previous, vertex
        if (ay > 0) != (by > 0):
            crossings.append(ax - ay * (bx - ax) / (by - ay))
        elif ay == by == 0:
            crossings.extend((ax, bx))
        previous = vertex
    return max(crossings)


def outline_points(shape: RobotSpec, pose: Pose, step: float) -> Places:
    """Places (n, 2) about `step` inches apart along a shape's outline, global frame."""
    if shape.radius is not None:
        count = max(8, math.ceil(2 * math.pi * shape.radius / step))
        angles = np.arange(count) * (2 * math.pi / count)
        local = shape.radius * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    else:
        corners = np.array(shape.vertices)
        local, _ = sample_segments(corners, np.roll(corners, -1, axis=0), step)
    return to_global(local, pose)


def to_global(local: Places, pose: Pose) -> Places:
    """Places (..., 2) in a pose's frame, in the global frame."""
    cosine, sine = math.cos(math.radians(pose.heading)), math.sin(math.radians(pose.heading))
    places: Places = local @ np.array([[cosine, sine], [-sine, cosine]]) + np.array([pose.x, pose.y])
    return places


def sample_segments(
    starts: Places, ends: Places, step: float, most: int = 4096
) -> tuple[Places, NDArray[np.intp]]:
    """Places about `step` apart along segments from `starts` to `ends` (both (n, 2)).

    Returns the places (m, 2) and the number (m,) of the segment each belongs to. A segment gets
    its two ends at least and `most` places at most.
    """
    lengths = np.hypot(*(ends - starts).T)
    counts = np.clip(np.ceil(lengths / step), 1, most - 1).astype(np.intp) + 1
    owners = np.repeat(np.arange(len(counts)), counts)
    position = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    fraction = (position / (counts - 1)[owners])[:, None]
    return starts[owners] + fraction * (ends - starts)[owners], owners
