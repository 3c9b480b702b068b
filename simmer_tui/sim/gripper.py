"""The gripper: what its window can grasp, and the block between its jaws."""

from simmer_tui.sim.angles import cos_sin
from simmer_tui.sim.block import Block
from simmer_tui.sim.footprint import Footprint
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import Grip
from simmer_tui.sim.specs import GripperSpec


class Gripper:
    """Open jaws, closed ones, or closed ones with the block between them.

    `body` is everything that can touch a wall: the robot's `footprint`, and the block while it is held.
    """

    def __init__(self, footprint: Footprint, walls: Obstacles) -> None:
        self._footprint = footprint
        self._walls = walls
        self.closed = False
        self.held: Block | None = None
        """The block that is held, in the robot's frame."""
        self.body = footprint

    def block(self, lying: Block, pose: Pose) -> Block:
        """The block with the robot at a pose; `lying` is the block where it lies unless held."""
        return lying if self.held is None else in_global_frame(self.held, pose)

    def move(self, spec: GripperSpec, close: bool, lying: Block, pose: Pose, time: float) -> Grip:
        """Close or open the jaws. They grasp the block only as they close: closed ones must open first."""
        block = self.block(lying, pose)
        missed = missed_by(spec, self._footprint, pose, block) if close and block.size else None
        if not close:
            self.held, self.body = None, self._footprint
        # Closed jaws that get another command to close grasp nothing.
        elif not self.closed and missed == (0.0, 0.0):
            held = in_robot_frame(block, pose)
            body = self._footprint.with_block(held.corners())
            # It could overlap one by rounding only: no block lies in a wall.
            if not self._walls.overlap(body, pose):
                self.held, self.body = held, body
        self.closed = close
        lies = Pose(block.x, block.y, block.heading)
        return Grip(time, close, self.held is not None, lies, missed if self.held is None else None)


def can_take(spec: GripperSpec, footprint: Footprint, pose: Pose, block: Block) -> bool:
    """True if the block's centre is in the gripper's window, so that closing jaws grasp it."""
    return bool(block.size) and missed_by(spec, footprint, pose, block) == (0.0, 0.0)


def missed_by(spec: GripperSpec, footprint: Footprint, pose: Pose, block: Block) -> tuple[float, float]:
    """Distances of the block's centre from the window, inches, in the robot's frame: ahead (beyond the
    window; negative: too near), and to the left (negative: to the right). 0 within it, its edges included.

    The window lies across the robot's +X axis and reaches from the footprint's front, the greatest X
    of any of its points, `reach` inches ahead.
    """
    centre, front, half = in_robot_frame(block, pose), footprint.front, spec.width / 2
    return _outside(centre.x, front, front + spec.reach), _outside(centre.y, -half, half)


def _outside(place: float, low: float, high: float) -> float:
    return place - low if place < low else place - high if place > high else 0.0


def in_robot_frame(block: Block, pose: Pose) -> Block:
    """A block of the global frame as the robot at a pose sees it."""
    cos, sin = cos_sin(pose.heading)
    x, y = block.x - pose.x, block.y - pose.y
    return Block(cos * x + sin * y, cos * y - sin * x, block.size, block.heading - pose.heading)


def in_global_frame(block: Block, pose: Pose) -> Block:
    """The reverse of `in_robot_frame`."""
    return Block(*pose.place(block.x, block.y), block.size, block.heading + pose.heading)
