"""Discs, polygons and lines as numbers on a grid: distances, coverage, samples."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import RobotSpec
from simmer_tui.tui.maze.viewport import Viewport

_SUBSAMPLES = 4
"""Samples a pixel, each way."""


def distance_to_outline(points: NDArray[np.float64], shape: RobotSpec) -> NDArray[np.float64]:
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


def nose(shape: RobotSpec) -> RobotSpec:
    """The mark at a shape's +X side: a wedge from its middle to its front."""
    tip = front(shape)
    half_width = 0.5 * tip
    return RobotSpec(vertices=((tip, 0.0), (0.25 * tip, half_width), (0.25 * tip, -half_width)))


def square(size: float) -> RobotSpec:
    return RobotSpec.rectangle(size, size)


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A rectangle of pixels with sample places in it, in the frame of what is drawn there."""

    rows: slice
    columns: slice
    samples: NDArray[np.float64]

    def coverage(self, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
        """The fraction of each pixel for which a mask over `samples` holds, (rows, columns)."""
        height, width = (mask.shape[0] // _SUBSAMPLES, mask.shape[1] // _SUBSAMPLES)
        blocks = mask.reshape(height, _SUBSAMPLES, width, _SUBSAMPLES)
        fractions: NDArray[np.float64] = blocks.mean(axis=(1, 3))
        return fractions


def patch(viewport: Viewport, pose: Pose, radius: float) -> Patch | None:
    """The pixels within `radius` inches of a pose, or None where none is in the window."""
    if not all(map(math.isfinite, (pose.x, pose.y, pose.heading, radius))):
        return None
    (x, y) = viewport.to_pixels(np.array([pose.x, pose.y]))
    extent = radius * viewport.scale + 1
    left, right = max(0, math.floor(x - extent)), min(viewport.columns, math.ceil(x + extent))
    top, bottom = max(0, math.floor(y - extent)), min(2 * viewport.rows, math.ceil(y + extent))
    if left >= right or top >= bottom:
        return None
    offset = 0.5 / _SUBSAMPLES
    across = (np.arange((right - left) * _SUBSAMPLES) / _SUBSAMPLES + left + offset - x) / viewport.scale
    up = -(np.arange((bottom - top) * _SUBSAMPLES) / _SUBSAMPLES + top + offset - y) / viewport.scale
    cosine, sine = math.cos(math.radians(pose.heading)), math.sin(math.radians(pose.heading))
    samples = np.empty((up.size, across.size, 2))
    samples[..., 0] = cosine * across + sine * up[:, None]
    samples[..., 1] = -sine * across + cosine * up[:, None]
    return Patch(slice(top, bottom), slice(left, right), samples)


def outline_points(shape: RobotSpec, pose: Pose, step: float) -> NDArray[np.float64]:
    """Places (n, 2) about `step` inches apart along a shape's outline, global frame."""
    if shape.radius is not None:
        count = max(8, math.ceil(2 * math.pi * shape.radius / step))
        angles = np.arange(count) * (2 * math.pi / count)
        local = shape.radius * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    else:
        corners = np.array(shape.vertices)
        local, _ = sample_segments(corners, np.roll(corners, -1, axis=0), step)
    return to_global(local, pose)


def to_global(local: NDArray[np.float64], pose: Pose) -> NDArray[np.float64]:
    """Places (..., 2) in a pose's frame, in the global frame."""
    places: NDArray[np.float64] = local @ _rotation(pose) + np.array([pose.x, pose.y])
    return places


def to_local(places: NDArray[np.float64], pose: Pose) -> NDArray[np.float64]:
    """Places (..., 2) in the global frame, in a pose's frame."""
    local: NDArray[np.float64] = (places - np.array([pose.x, pose.y])) @ _rotation(pose).T
    return local


def _rotation(pose: Pose) -> NDArray[np.float64]:
    """What turns a row of local coordinates into global ones, multiplied from the right."""
    cosine, sine = math.cos(math.radians(pose.heading)), math.sin(math.radians(pose.heading))
    return np.array([[cosine, sine], [-sine, cosine]])


def sample_segments(
    starts: NDArray[np.float64], ends: NDArray[np.float64], step: float, most: int = 4096
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
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
