"""The robot's world as boards reach it: wheels that turn by duties, and sensors, at exact simulated times.

Times are nanoseconds of the boards' clocks. The world only goes forward.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from msgspec import Struct

from simmer_tui.robot.engine import Engine
from simmer_tui.robot.sessions import Session
from simmer_tui.sim.command import BOARD_SOURCE, parse_command
from simmer_tui.sim.records import CommandResult, Status
from simmer_tui.sim.specs import VelocityKind
from simmer_tui.sim.wheels import WheelKinematics
from simmer_tui.sketch.board_process import NEVER
from simmer_tui.sketch.low_pass import LowPassRate
from simmer_tui.sketch.parts import SECOND, EncoderState
from simmer_tui.sketch.steppers import StepperState

# A line sensor is read thousands of times a second: all of that would be most of the log. Real errors last
# too, those of light, of surfaces, of a motor's noise.
READING_PERIOD = SECOND // 50
"""Time for which a sensor's error lasts, and in which one reading of it is told."""


class RobotWorld:
    """The simulated robot with its wheels and sensors. Only for the robot's thread."""

    def __init__(
        self,
        engine: Engine,
        session: Session,
        encoders: Sequence[EncoderState],
        steppers: Sequence[StepperState] = (),
        stepped_at: Callable[[StepperState], str] = lambda stepper: "",
        gyros: Sequence[str] = (),
    ) -> None:
        """`gyros` are the codes of sensors whose rate is read.

        `stepped_at` is called for the place in the sketch that made a stepper's last step."""
        self._steppers, self._stepped_at = tuple(steppers), stepped_at
        self._engine = engine
        self._simulator = engine.simulator
        self._session = session
        self._encoders = tuple(encoders)
        spec = self._simulator.spec
        self._kinematics = WheelKinematics.of(spec.wheels) if spec.wheels is not None else None
        self._wheels_code = next(
            (each.code for each in spec.velocities if each.kind is VelocityKind.WHEELS and each.enabled), ""
        )
        self._by_duty: Mapping[int, float] = {}
        """Rim speeds of the wheels that turn by duties, by the wheel's index."""
        self._speeds: tuple[float, ...] = ()
        self._source = BOARD_SOURCE
        self._waiting: tuple[float, ...] | None = None
        """Rim speeds that wait for the end of the gripper's movement."""
        self._jaws_closed = self._jaws_wanted = False
        """The jaws as they were last moved, and as they are to be. A run begins with open ones."""
        self._leg: object = None
        self._last: dict[str, _LastReading] = {}
        self._rate_errors: dict[str, tuple[int, float]] = {}
        """The last error of each gyro's rate, with the time of its draw."""
        self._rates = {code: LowPassRate() for code in gyros}
        """The rate of each gyro behind its filter."""
        self.steady_until = 0
        """The time until which the rate that was read last stays the same; 0 if it changes meanwhile."""
        self.time = 0
        """The time that the world has reached."""
        self._due = math.inf
        """Time of the next change of the motion, seconds."""

    def restart(self) -> None:
        """Everything as at time 0."""
        self.time, self._leg, self._due = 0, None, math.inf
        self._by_duty, self._speeds, self._waiting = {}, (), None
        self._jaws_closed = self._jaws_wanted = False
        self._last.clear()
        for each in self._steppers:
            each.restart()
        self._rate_errors.clear()
        self._rates = {code: LowPassRate() for code in self._rates}

    @property
    def next_change(self) -> int:
        """The time of the next change of the wheels' speed, or of the robot's, that is known."""
        due = math.ceil(self._due * SECOND) if self._due < math.inf else NEVER
        return min(due, self._next_step)

    @property
    def next_wheel_change(self) -> int:
        """The time of the next change of the wheels' speed that is known."""
        due = math.ceil(self._due * SECOND) if self._due < math.inf else NEVER
        return min(due, *[each.next_change(self.time) for each in self._steppers]) if self._steppers else due

    @property
    def _next_step(self) -> int:
        """The time of the next change of a stepper that is known."""
        return min([each.due for each in self._steppers]) if self._steppers else NEVER

    def look_again(self) -> None:
        """Plan again after a person has changed something."""
        self._plan()
        self._note_leg(self.time)

    def _plan(self) -> None:
        trajectory, due = self._simulator.trajectory, self._simulator.next_event
        self._due = due if trajectory is None else min(due, trajectory.end_time)
        for code, rate in self._rates.items():
            rate.set_rate(self.time, self._simulator.count_rate(code))

    def _act(self, text: str, source: str = BOARD_SOURCE) -> CommandResult:
        """Do a command now, and tell it."""
        self._simulator.advance(self.time / SECOND)
        result = self._engine.act(parse_command(text, source), self._session)
        self._plan()
        return result

    def advance(self, time: int) -> None:
        """Let the world go on to a time."""
        while (step := self._next_step) <= time:
            self._advance_motion(step)
            for each in self._steppers:
                if each.due == step:
                    each.happen()
                    self._set(partial(self._stepped_at, each))
        self._advance_motion(time)

    def _advance_motion(self, time: int) -> None:
        """Let the motion in force go on to a time."""
        if time <= self.time:
            return
        target = time / SECOND
        # The simulator itself is advanced only where something is read or done: that costs more than this.
        while self._due <= target:
            due = self._due
            self.time = max(math.ceil(due * SECOND), self.time)
            trajectory = self._simulator.trajectory
            if trajectory is not None and trajectory.end_time <= due:
                self._engine.end_movement()
                self._move_jaws()
                self._set_waiting()
            else:
                self._simulator.advance(due)
            self._plan()
            self._note_leg(self.time)
        self.time = max(time, self.time)

    def settle(self) -> None:
        """Bring the simulator to the time that the world has reached."""
        self._simulator.advance(self.time / SECOND)

    # -- wheels ----------------------------------------------------------------------------------------

    def set_speeds(self, speeds: Mapping[int, float], where: Callable[[], str] = str) -> bool:
        """The wheels' rim speeds from now on, by the wheel's index; wheels without a motor stand.

        Those of steppers are their own. `where` is called for the place in the sketch. Returns True if the
        speeds are others than before.
        """
        self._by_duty = speeds
        return self._set(where)

    def _set(self, where: Callable[[], str]) -> bool:
        """Set the rim speeds that duties and steps ask for now, at `where` in the sketch. Returns True if
        they are others than before."""
        if self._kinematics is None or not self._wheels_code:
            return False
        asked_by = {**self._by_duty, **{each.wired.wheel_index: each.speed for each in self._steppers}}
        asked = tuple(asked_by.get(index, 0.0) for index in range(len(self._kinematics.wheels)))
        if asked == (self._speeds or (0.0,) * len(asked)):
            return False
        self._speeds = asked
        place = where()
        self._source = f"{BOARD_SOURCE}, {place}" if place else BOARD_SOURCE
        if self._simulator.trajectory is not None:
            self._waiting = asked
        else:
            self._drive(asked)
        return True

    def cut_power(self) -> None:
        """Nothing moves until a duty changes, or a step comes."""
        for each in self._steppers:
            each.cut(self.time)

    def drive_again(self) -> None:
        """Set the rim speeds again, after the robot was put elsewhere."""
        if any(self._speeds):
            self._drive(self._speeds)

    def _set_waiting(self) -> None:
        if self._simulator.trajectory is not None:
            return
        speeds, self._waiting = self._waiting, None
        if speeds is not None:
            self._drive(speeds)

    def _drive(self, speeds: Sequence[float]) -> None:
        self._act(f"{self._wheels_code}-{';'.join(f'{each:.12g}' for each in speeds)}", self._source)
        self._note_leg(self.time)

    def _note_leg(self, time: int) -> None:
        """Tell the encoders of the speed in force, if it has changed."""
        leg = self._simulator.leg
        if leg is self._leg or not self._encoders:
            return
        self._leg = leg
        kinematics = self._kinematics
        assert kinematics is not None, "encoders are at wheels"
        speeds = (0.0,) * len(kinematics.wheels) if leg is None else kinematics.speeds(leg.commanded)
        for each in self._encoders:
            each.set_speed(time, speeds[each.wired.wheel_index])

    # -- the gripper -----------------------------------------------------------------------------------

    def grip(self, *, close: bool) -> None:
        """Close or open the jaws, now or once a movement of theirs is over: the last position counts. The
        robot stands while they move, as with the gripper's command."""
        self._jaws_wanted = close
        if self._simulator.trajectory is None:
            self._move_jaws()

    def _move_jaws(self) -> None:
        """Move the jaws, if they are not as they are to be."""
        gripper = self._simulator.spec.gripper
        if gripper is None or not gripper.enabled or self._jaws_closed == self._jaws_wanted:
            return
        self._jaws_closed = self._jaws_wanted
        moved = self._speeds if any(self._speeds) else None
        self._act(f"{gripper.code}-{int(self._jaws_closed)}")
        self._waiting = moved
        self._note_leg(self.time)

    # -- sensors ---------------------------------------------------------------------------------------

    def read(self, code: str) -> float:
        """A reading of a sensor now.

        Its error is drawn anew, and the reading told, once in `READING_PERIOD`. Readings in between have the
        error of the last one.
        """
        last = self._last.get(code)
        if last is not None and self.time - last.time < READING_PERIOD:
            return self._held(code, last)
        result = self._act(code)
        if result.status is not Status.READING or result.reading is None:
            return math.nan
        reading, is_opposite = result.reading, None
        if reading.sensor.is_yes_or_no:
            is_opposite = result.reply != self._simulator.plain_reading(code)
        self._last[code] = _LastReading(self.time, result.reply, reading.true, is_opposite)
        return result.reply

    def level(self, code: str) -> float:
        """A reading of a yes-or-no sensor now, as `read` gives it. `steady_until` is set."""
        value = self.read(code)
        last = self._last.get(code)
        self.steady_until = 0
        if last is not None and not math.isnan(value):
            until = min(self.next_change, last.time + READING_PERIOD)
            seconds = min(self._simulator.steady_seconds(code), READING_PERIOD / SECOND)
            self.steady_until = min(until, self.time + math.floor(seconds * SECOND))
        return value

    def rate(self, code: str, filter_number: int = 0) -> float:
        """The turning rate that a gyro measures now behind one of its filters, deg/s. The angle that its
        sensor reads is told as with `read`, and the rate's error lasts as long."""
        self.steady_until = 0
        if math.isnan(self.read(code)):
            return math.nan
        self._simulator.advance(self.time / SECOND)
        drawn, error = self._rate_errors.get(code, (-READING_PERIOD, 0.0))
        if self.time - drawn >= READING_PERIOD:
            error = self._simulator.rate_error(code, READING_PERIOD / SECOND)
            drawn = self.time
            self._rate_errors[code] = drawn, error
        told = self._last[code].time
        rate = self._rates[code]
        rate.set_rate(self.time, self._simulator.count_rate(code))
        rate.set_filter(self.time, filter_number)
        steady = min(self.next_change, told + READING_PERIOD, drawn + READING_PERIOD)
        self.steady_until = steady if rate.is_steady(self.time) else 0
        return rate.at(self.time) + error

    def _held(self, code: str, last: _LastReading) -> float:
        """A reading of the present true value with the error of the last one."""
        self._simulator.advance(self.time / SECOND)
        if math.isnan(last.value):
            return last.value
        if last.is_opposite is not None:
            plain = self._simulator.plain_reading(code)
            return 1.0 - plain if last.is_opposite else plain
        true = self._simulator.true_value(code)
        error = last.value - last.true
        return true + error if math.isfinite(error) else last.value


class _LastReading(Struct, frozen=True):
    """The last reading of a sensor that was told, its time, and the true value then; of a yes or no, true if
    its error has made it the opposite."""

    time: int
    value: float
    true: float
    is_opposite: bool | None
