"""Discs, polygons and lines as numbers: distances, outlines, samples. Lengths are in inches."""

import math

import numpy as np
import shapely

from simmer_tui.sim.arrays import BoolArray, FloatArray, NDArray
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import RobotSpec

# Places further out are not drawn, and drawn ones must not overflow an integer.
FAR = 1e6
"""Largest coordinate, inches or units of a window."""
# A line of more samples is longer than any screen has dots.
MOST_SAMPLES = 4096
"""Samples of one line."""


def is_near(*numbers: float) -> bool:
    """True if something can be drawn at these coordinates and angles."""
    return all(abs(number) < FAR for number in numbers)


def near_places(places: FloatArray) -> FloatArray:
    """Places (n, 2), with those too far out moved to the edge of the drawable area."""
    # Of a NaN and a number, `fmin` takes the number.
    near: FloatArray = np.fmax(np.fmin(places, FAR), -FAR)
    return near


def covers(shape: RobotSpec, points: FloatArray) -> BoolArray:
    """True for points (..., 2) inside a shape's outline, (...)."""
    x, y = points[..., 0], points[..., 1]
    if shape.radius is not None:
        return np.asarray(np.hypot(x, y) < shape.radius)
    return np.asarray(shapely.contains_xy(shapely.Polygon(shape.vertices), x, y))


def front(shape: RobotSpec) -> float:
    """Extent of a shape along +X from the origin."""
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


def outline_points(shape: RobotSpec, pose: Pose, step: float) -> FloatArray:
    """Places (n, 2) about `step` inches apart along a shape's outline, global frame."""
    if shape.radius is not None:
        count = max(8, math.ceil(2 * math.pi * shape.radius / step))
        angles = np.arange(count) * (2 * math.pi / count)
        local = shape.radius * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    else:
        corners = np.array(shape.vertices)
        local = sample_segments(corners, np.roll(corners, -1, axis=0), step)
    return to_global(local, pose)


def to_global(local: FloatArray, pose: Pose) -> FloatArray:
    """Places (..., 2) in a pose's frame, in the global frame."""
    cosine, sine = math.cos(math.radians(pose.heading)), math.sin(math.radians(pose.heading))
    places: FloatArray = local @ np.array([[cosine, sine], [-sine, cosine]]) + np.array([pose.x, pose.y])
    return places


def to_local(places: FloatArray, pose: Pose) -> FloatArray:
    """Global places (..., 2) in a pose's frame, x ahead and y left."""
    return turned_into(pose, places[..., 0], places[..., 1])


def turned_into(pose: Pose, x: FloatArray, y: FloatArray) -> FloatArray:
    """The same of global coordinates that NumPy can broadcast together, as those of a grid's columns and
    rows."""
    cosine, sine = math.cos(math.radians(pose.heading)), math.sin(math.radians(pose.heading))
    x, y = x - pose.x, y - pose.y
    return np.stack((cosine * x + sine * y, cosine * y - sine * x), axis=-1)


def ray_points(origin: tuple[float, float], bearing: float, along: FloatArray) -> FloatArray:
    """Places (n, 2) along a ray at some distances from its origin, (n,)."""
    direction = np.array((math.cos(math.radians(bearing)), math.sin(math.radians(bearing))))
    places: FloatArray = np.array(origin) + along[:, None] * direction
    return places


def sample_segments(starts: FloatArray, ends: FloatArray, step: float) -> FloatArray:
    """Places (m, 2) about `step` apart along segments from `starts` to `ends` (both (n, 2)).

    A segment gets its two ends at least and `MOST_SAMPLES` places at most.
    """
    lengths = np.hypot(*(ends - starts).T)
    counts = np.clip(np.ceil(lengths / step), 1, MOST_SAMPLES - 1).astype(np.intp) + 1
    owners: NDArray[np.intp] = np.repeat(np.arange(len(counts)), counts)
    position = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    fraction = (position / (counts - 1)[owners])[:, None]
    places: FloatArray = starts[owners] + fraction * (ends - starts)[owners]
    return places
