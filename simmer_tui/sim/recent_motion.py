"""The last seconds of a robot and its block, for sensors that look back.

A turn of a lidar takes time: each ray is sent at its own moment, and needs the pose at that moment. Pieces of
motion are kept as long as such a sensor may need them. Between two pieces, and before the first one, the
robot stands.
"""

from collections import deque
from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from simmer_tui.sim.arcs import Arc, poses_along
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.block import Block
from simmer_tui.sim.gripper import in_global_frame
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.trajectory import Trajectory

Motion = Trajectory | Leg
"""A piece of motion: a movement, or a leg of a continuous motion."""


class BlockPlace(Struct, frozen=True):
    """The block from a simulated time on: where it lies, or, while it is held, in the robot's frame."""

    since: float
    block: Block
    held: bool = False

    def at(self, pose: Pose) -> Block:
        """The block with the robot at a pose."""
        return in_global_frame(self.block, pose) if self.held else self.block


class RecentMotion:
    """The poses of a robot and the places of the block in the last `span` seconds of simulated time; nothing
    is kept for a span of 0."""

    def __init__(self, span: float) -> None:
        self._span = span
        self._pieces: deque[Motion] = deque()
        self._blocks: deque[BlockPlace] = deque()

    def forget(self) -> None:
        """Forget all motion after the robot has been placed: it counts as if it had always stood there."""
        self._pieces.clear()

    def add_motion(self, piece: Motion) -> None:
        """Add a piece of motion that is over."""
        if not self._span:
            return
        self._pieces.append(piece)
        oldest = piece.end_time - self._span
        while self._pieces[0].end_time < oldest:
            self._pieces.popleft()

    def add_block_place(self, place: BlockPlace) -> None:
        """Add a place of the block, from now on: it was moved, grasped or released."""
        # Places before the run began are dropped.
        if not self._span or place.since <= 0.0:
            self._blocks.clear()
        self._blocks.append(place)
        # The first one counts for all the time before the second.
        while len(self._blocks) > 1 and self._blocks[1].since < place.since - self._span:
            self._blocks.popleft()

    def poses(self, times: FloatArray, now: Pose, under_way: Motion | None) -> FloatArray:
        """The poses, (n, 3), at n ascending simulated times up to the present. `now` is its present pose,
        `under_way` the piece of motion that has not ended, if any."""
        pieces = [*self._pieces, *([] if under_way is None else [under_way])]
        if not pieces:
            return np.tile((now.x, now.y, now.heading), (len(times), 1))
        # A piece counts from after the moment of its command on.
        begins = np.searchsorted(times, [piece.start_time for piece in pieces], side="right").tolist()
        arcs = [(Arc.standing(pieces[0].before), 0.0, begins[0])]
        movements = []
        for piece, begin, end in zip(pieces, begins, [*begins[1:], len(times)], strict=True):
            if begin == end:
                continue
            if isinstance(piece, Leg):
                within = begin + int(times[begin:end].searchsorted(piece.end_time))
                arcs.append((piece.arc, piece.start_time, within - begin))
                arcs.append((Arc.standing(piece.last_pose), 0.0, end - within))
            else:
                movements.append((piece, begin, end))
                arcs.append((Arc.standing(piece.before), 0.0, end - begin))
        poses = poses_along(arcs, times)
        for movement, begin, end in movements:
            poses[begin:end] = movement.poses_at(times[begin:end])
        return poses

    def blocks(self, times: FloatArray) -> Iterator[tuple[slice, BlockPlace]]:
        """The places of the block at n ascending simulated times: each with the slice of those times."""
        if len(self._blocks) == 1:
            yield slice(0, len(times)), self._blocks[0]
            return
        starts = np.searchsorted(times, [place.since for place in self._blocks], side="right")
        starts[0] = 0
        for place, begin, end in zip(self._blocks, starts, [*starts[1:], len(times)], strict=True):
            if begin < end:
                yield slice(begin, end), place
