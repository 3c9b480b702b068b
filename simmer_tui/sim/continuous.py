"""Continuous motion: wheels that turn until the next command, exactly and without a tick.

Between two events the robot's true velocity is constant, and its path is one arc: a leg. Events are a change
of the velocity, a step of a ramp, the end of a stretch of errors, a contact, and a choice at a wall. Legs are
planned one after the other, only as far as time is asked for. A query in between is computed from the leg
under way and changes nothing.

At a wall, with wheels that still turn, the robot is pressed. Errors on other axes are dropped to the end of
the stretch, and the first move that is not blocked happens (`wall_moves.py`). If all are blocked, it stands.
"""

import math
from collections.abc import Callable, Mapping
from typing import Protocol

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.sim.arc_contact import ArcContact, first_arc_contact
from simmer_tui.sim.arcs import LARGEST_TURN, STILL, Arc, Twist
from simmer_tui.sim.contact import TOUCHING
from simmer_tui.sim.distance_errors import Component, DistanceErrors, TrueVelocity, components
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.motion import AT_ONCE, CollisionChecker
from simmer_tui.sim.obstacles import Obstacles
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.specs import Axes, ContactRule, DriveKind, SimulationSpec
from simmer_tui.sim.velocity_plan import VelocityPlan, VelocityTarget, velocity_target
from simmer_tui.sim.wall_moves import wall_moves

# A robot that chatters along a wall touches it many times a second; people see one contact.
SAME_CONTACT = 0.1
"""Seconds after the last pressed moment within which a further contact belongs to the same one."""


class MotionListener(Protocol):
    """Listener to the events of a continuous motion, in order."""

    def leg_begun(self, leg: Leg) -> None:
        """A leg begins. It lasts to its end unless an event cuts it short."""

    def leg_ended(self, leg: Leg) -> None:
        """A leg is over; `leg` is as it really went."""

    def velocity_expired(self, time: float) -> None:
        """A velocity has timed out. Called before `leg_ended` of its last leg."""


class _WallState(Struct):
    """State of a robot's contact with a wall; times are simulated seconds."""

    dropped: bool = False
    """True while errors on other axes are dropped."""
    dropped_until: float = math.inf
    """Time at which these errors return if no stretch ends before."""
    hold_until: float = -math.inf
    """Time until which the chosen move stays."""
    stopped: bool = False
    """True if a contact has ended the motion until the velocity or the surroundings change."""
    pressed_last: float = -math.inf
    """Time at which the robot was pressed last."""
    contact_at: float = -math.inf
    """Time of the last contact that listeners got."""

    def renew(self) -> None:
        """Reset all choices after a change."""
        self.dropped, self.dropped_until = False, math.inf
        self.hold_until, self.stopped = -math.inf, False


class _FreePlace(Struct, frozen=True):
    """A place with its distance from the nearest obstacle, inches. Motion within that distance needs no
    search."""

    obstacles: Obstacles
    x: float
    y: float
    clearance: float

    def has_room(self, arc: Arc, around: CollisionChecker) -> bool:
        """True if a robot on an arc cannot reach an obstacle."""
        if self.obstacles is not around.obstacles:
            return False
        x, y = arc.start.x - self.x, arc.start.y - self.y
        return math.sqrt(x * x + y * y) + arc.length + around.footprint.reach + TOUCHING < self.clearance


class ContinuousMotion:
    """A robot that drives at a velocity until the next command, and reports its legs to a listener."""

    def __init__(
        self,
        spec: SimulationSpec,
        bias: Callable[[], Mapping[DriveKind, Axes]],
        errors: DistanceErrors,
        checker: Callable[[Pose], CollisionChecker],
        listener: MotionListener,
    ) -> None:
        self._drives = {drive.kind: drive for drive in spec.drives if drive.enabled}
        self._bias = bias
        self._errors = errors
        self._checker = checker
        self._rule = spec.contact
        self._period = spec.control_period
        self._friction = spec.wall_friction
        self._listener = listener
        self._plan = VelocityPlan(spec.control_period)
        self.at_rest = True
        """True if no velocity has been commanded since all motion was halted."""
        self.leg: Leg | None = None
        """The leg under way, None while no velocity is in force."""
        self._parts: tuple[Component, ...] = ()
        self._stretch_ends: tuple[tuple[DriveKind, float], ...] = ()
        """Times at which stretches of errors end, if the leg under way is long enough."""
        self._noise = True
        self._expires = math.inf
        self._wall = _WallState()
        self._free: _FreePlace | None = None

    # -- commands ----------------------------------------------------------------------------------

    @property
    def commanded(self) -> Twist:
        """The velocity commanded last."""
        return self._plan.commanded

    def command(
        self, time: float, pose: Pose, target: VelocityTarget, expires: float, *, noise: bool
    ) -> bool:
        """Accept a velocity at a simulated time to which the motion has been advanced; `pose` is the robot's
        then. The same velocity only renews `expires`. Returns True if the velocity changes."""
        self._expires, self.at_rest = expires, False
        if not self._plan.command(time, target):
            return False
        if self.leg is None:
            self._noise = noise
        if self.leg is None or self._plan.due <= time:
            self._cut(time)
            self._change(time)
            self._plan_leg(time, pose)
        return True

    def release(self, time: float, pose: Pose) -> None:
        """Velocity 0 from a simulated time on, as a command of it would set it."""
        self.command(time, pose, self._still(), math.inf, noise=self._noise)

    def _still(self) -> VelocityTarget:
        return velocity_target(STILL, self.commanded, self._drives)

    def halt(self, time: float) -> None:
        """End all motion at a simulated time, without lag or ramp."""
        self._cut(time)
        self._end_leg(time)
        self._plan.halt()
        self._wall.renew()
        self._expires = math.inf
        self.at_rest = True

    def look_again(self, time: float, pose: Pose, *, noise: bool) -> None:
        """Plan the rest of the leg under way again, because the surroundings of the robot, or its errors,
        changed at this simulated time."""
        if self.leg is not None:
            self._cut(time)
            self._noise = noise
            self._wall.renew()
            self._plan_leg(time, pose)

    # -- time ----------------------------------------------------------------------------------------

    @property
    def due(self) -> float:
        """Simulated time of the next event, infinite if there is none."""
        if self.leg is None:
            return math.inf
        return min(self.leg.end_time, self._plan.due, self._expires)

    def step(self) -> None:
        """Advance to the next event, and plan the leg after it."""
        assert self.leg is not None, "nothing is commanded"
        time = self.due
        pose = self.leg.pose_at(time)
        self._cut(time)
        if self._expires <= time:
            self._expires = math.inf
            self._listener.velocity_expired(time)
            self._plan.command(time, self._still())
        self._change(time)
        self._plan_leg(time, pose)

    def _change(self, time: float) -> None:
        """Change the velocity in force if that is due: choices at a wall are made again."""
        if self._plan.due <= time:
            self._plan.change(time)
            self._wall.renew()

    def _cut(self, time: float) -> None:
        """The leg under way is over at a simulated time: its end, or an earlier one."""
        leg = self.leg
        if leg is None:
            return
        # A leg of no duration is not reported if another replaces it.
        if time <= leg.start_time:
            return
        ended = tuple(kind for kind, at in self._stretch_ends if at <= time)
        if self._noise:
            self._errors.advance(self._parts, time - leg.start_time, ended)
        if leg.pressed:
            self._wall.pressed_last = time
        if ended or time >= self._wall.dropped_until:
            self._wall.dropped, self._wall.dropped_until = False, math.inf
        self._end_leg(time)

    def _end_leg(self, time: float) -> None:
        """Report the end of the leg under way, if there is one."""
        if self.leg is not None:
            leg, self.leg = self.leg.cut(time), None
            self._listener.leg_ended(leg)

    # -- planning legs -------------------------------------------------------------------------------

    def _plan_leg(self, time: float, pose: Pose) -> None:
        """Plan the leg that begins at a simulated time."""
        if not self._plan.moves:
            self._end_leg(time)
            return
        self.leg = None
        twist = self._plan.twist
        self._parts = components(twist, self._drives)
        self._stretch_ends = self._stretches(time)
        true = TrueVelocity(twist, self._parts, self._errors, self._bias(), noise=self._noise)
        until = min(self._plan.due, min((at for _, at in self._stretch_ends), default=math.inf))
        around = self._checker(pose)
        here = _Here(time, pose, until, around, true)
        if not twist.moves:
            self._begin(here, _CutArc(Arc.standing(pose)), until)
            return
        if not (self._wall.dropped or self._wall.stopped):
            cut = self._clear(Arc.of(pose, true.whole, 0.0), until - time, around)
            if not cut.blocked:
                self._begin(here, cut, until)
                return
            self._touch(here, cut)
        cut, end = self._pressed(here)
        self._begin(here, cut, end, pressed=True)

    def _begin(self, here: "_Here", cut: "_CutArc", until: float, *, pressed: bool = False) -> None:
        """Make this the leg under way. A leg that nothing cuts short ends at `until` exactly."""
        arc, time = cut.arc, here.time
        # Only the turn of a robot that is not pressed has all its errors.
        free = self._plan.twist.moves and not pressed
        counts = here.true.counts(None if free else arc.rate + arc.spin)
        whole = arc.duration >= until - time
        arc = replace(arc, duration=until - time) if whole else arc
        end = until if whole else time + arc.duration
        # A robot that stands until something changes has no end time, and needs none.
        last = arc.end if end < math.inf else arc.start
        contact = None
        if cut.met is not None and not whole and not pressed:
            contact = self._contact(end, last, cut.met, here)
        self.leg = Leg(arc, time, end, last, self._plan.twist, counts, pressed=pressed, contact=contact)
        self._listener.leg_begun(self.leg)

    def _contact(self, time: float, pose: Pose, met: ArcContact, here: "_Here") -> Contact | None:
        """The contact at a simulated time, unless it belongs to the one before."""
        wall, around = self._wall, here.around
        if time - wall.pressed_last <= SAME_CONTACT or wall.contact_at == time:
            return None
        wall.contact_at = time
        touch = around.obstacles.touch(around.footprint, pose, met.beyond)
        own = self._clear(Arc.of(pose, here.true.own, 0.0), self._period, around)
        # A leg is one segment, which its contact ends.
        return Contact(
            pose,
            touch.point,
            segment=0,
            turned=1.0,
            translated=1.0,
            time=time,
            ended=self._rule is ContactRule.STOP or own.blocked,
            drift=not own.blocked,
            held_block=touch.held_block,
            cell=touch.cell,
        )

    def _stretches(self, time: float) -> tuple[tuple[DriveKind, float], ...]:
        """Simulated times at which the present stretches of errors end, what they need drawn."""
        if not self._noise:
            return ()
        return tuple((part.drive.kind, self._stretch_end(time, part)) for part in self._parts)

    def _stretch_end(self, time: float, part: Component) -> float:
        while True:
            self._errors.begin(part)
            end = time + self._errors.left(part)
            if end > time:
                return end
            # The rest of the stretch is below the rounding of simulated time: it is over.
            self._errors.advance((part,), 0.0, (part.drive.kind,))

    def _clear(self, arc: Arc, seconds: float, around: CollisionChecker) -> "_CutArc":
        """An arc for as many seconds at most, cut off at its first contact."""
        x, y = arc.velocity
        speed, rate = math.sqrt(x * x + y * y), abs(arc.rate)
        # Infinite only for a robot that stands still or a disc that turns.
        most = min(LARGEST_TURN / rate if rate else math.inf, around.size / speed if speed else math.inf)
        arc = replace(arc, duration=min(seconds, most))
        if arc.duration == math.inf or not (speed or len(around.footprint.vertices)):
            return _CutArc(arc)
        if self._free is not None and self._free.has_room(arc, around):
            return _CutArc(arc)
        met = first_arc_contact(around.footprint, around.obstacles, arc)
        if met is None:
            start, obstacles = arc.start, around.obstacles
            clearance = obstacles.clearance(start.x, start.y)
            self._free = _FreePlace(obstacles, start.x, start.y, clearance)
            return _CutArc(arc)
        after = arc.seconds_at(met.h)
        moved = after * (speed + math.radians(rate) * around.footprint.reach)
        return _CutArc(replace(arc, duration=after if moved > AT_ONCE else 0.0), met)

    def _touch(self, here: "_Here", cut: "_CutArc") -> None:
        """Apply the contact rule to a motion that is blocked at its first instant."""
        wall, met = self._wall, cut.met
        assert met is not None, "something blocks it"
        if self._rule is ContactRule.STOP:
            wall.stopped = True
        else:
            wall.dropped = True
            if not self._noise:
                # Without noise no stretch ends: errors stay dropped for the length of one stretch.
                errors, parts = self._errors, self._parts
                lengths = (errors.length(each.drive.kind) / each.commanded_speed for each in parts)
                wall.dropped_until = here.time + min(lengths, default=self._period)
        contact = self._contact(here.time, here.pose, met, here)
        if contact is not None:
            # It already touched the obstacle: a leg of length 0 reports the contact.
            counts = here.true.counts()
            leg = Leg(cut.arc, here.time, here.time, here.pose, self._plan.twist, counts, contact=contact)
            self._listener.leg_begun(leg)
            self._listener.leg_ended(leg)

    def _pressed(self, here: "_Here") -> tuple["_CutArc", float]:
        """The arc of a robot that is pressed, and the time to which it may last."""
        wall, time, pose, around = self._wall, here.time, here.pose, here.around
        if wall.stopped:
            return _CutArc(Arc.standing(pose)), here.until
        until = min(here.until, wall.dropped_until)
        # A contact has ended a move early: the robot stands still for the rest of that time, so that
        # choices are few.
        if time < wall.hold_until:
            return _CutArc(Arc.standing(pose)), min(until, wall.hold_until)
        hold_until = time + self._period
        for move in wall_moves(around.footprint, around.obstacles, pose, here.true.own, self._friction):
            end = min(until, hold_until) if move.brief else until
            cut = self._clear(move.arc(pose, 0.0), end - time, around)
            if not cut.blocked:
                wall.hold_until = -math.inf if cut.met is None else hold_until
                return cut, end
        return _CutArc(Arc.standing(pose)), until


class _Here(Struct, frozen=True):
    """The start of a leg: simulated time, pose, the time to which it lasts at most."""

    time: float
    pose: Pose
    until: float
    around: CollisionChecker
    true: TrueVelocity


class _CutArc(Struct, frozen=True):
    """An arc and the contact that cuts it off, if there is one."""

    arc: Arc
    met: ArcContact | None = None

    @property
    def blocked(self) -> bool:
        """True if the arc is blocked at its first instant."""
        return self.met is not None and not self.arc.duration
