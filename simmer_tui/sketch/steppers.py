"""Steppers at a board's pins: steps are angle of the rim, and the rim stands where the steps say.

A wheel cannot jump by a step. Its rim follows the steps at a speed that changes only when their rate does,
two of them behind at most, or those of 6 ms. After the last one it moves on until it stands on that. All of
it follows from the times of the steps alone, in closed form from one change of speed to the next: the times
of looks change nothing.

Times are nanoseconds, positions steps.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from copy import copy

from simmer_tui.sketch.board_process import NEVER, BoardRecord, Told
from simmer_tui.sketch.parts import SECOND
from simmer_tui.sketch.wiring import StepperDriver, WiredStepper

# The rotor of a NEMA 17 with a wheel swings at 50 to 100 Hz: slower steps are movements of their own.
ALONE = 20_000_000
"""Time between two steps from which the rim stands between them, and in which it makes one."""
# A sketch that polls steps unevenly, by up to a pass of its loop. These follow the rate, not each pass.
_LEAST_LAG, _LAG = 1.5, 0.003
"""Lag of the rim in a steady drive: steps, or seconds if that is more."""
_LEAST_GAP = 0.1
"""Lag that is left right before a step, so that the rim does not stop between two."""
_MOST_LAG = 4.0
"""Lag beyond twice the usual one at which steps are lost, steps: the rotor has lost its field."""
_OVER = 1.5
"""Correction of the rate by its deviation since the last one: 1 follows no acceleration, 2 no unevenness."""
# The current of a coil needs longer (L/R of some ms); the four writes of a step take 16 us.
COIL_TIME = 50_000
"""Time for which coils must be as they are before they turn the rotor."""
_ANGLES = {
    (1, 0): 0, (1, 1): 1, (0, 1): 2, (-1, 1): 3, (-1, 0): 4, (-1, -1): 5, (0, -1): 6, (1, -1): 7
}  # fmt: skip
"""The angle of the field by the currents of both coils, in half steps of one period."""
_PERIOD = 8
# AccelStepper's second step comes 0.96 s after the first with its usual acceleration. Coils that are on for
# longer hold the rotor.
_FIRST = SECOND
"""Time after the first field within which the next one tells that the rotor came from a step before it."""
IDLE, LOST = "idle", "lost"
"""Reasons for which a step moves nothing: the driver is not enabled, or the wheel cannot follow."""


class StepperState:
    """A stepper's rim, by what its board tells of its pins."""

    def __init__(self, wired: WiredStepper) -> None:
        self.wired = wired
        self.on_missed: Callable[[StepperState, str], None] = _ignore
        """Called with a step that moves nothing."""
        self.known_until = 0
        """The clock of its board: before that no record is missing."""
        self._ahead: StepperState | None = None
        """A copy that goes ahead, to a change of speed."""
        self._change = -NEVER
        """Time of that change."""
        self.restart()

    def restart(self) -> None:
        """At rest, at time 0."""
        self._records: deque[BoardRecord] = deque()
        self._levels = dict.fromkeys(self.wired.pins.values(), 0)
        self._angle: int | None = None
        self._first_at = -NEVER
        """Time of the first field of the coils, until the next one."""
        self._coils_at = NEVER
        """Time at which the coils will have turned the rotor."""
        self.place = 0
        """Address of the sketch's block that made the last step."""
        self._target = 0.0
        self._last = (-NEVER, 0.0)
        """Time and direction of the last step."""
        self._origin, self._since, self._rate = 0.0, 0, 0.0
        """The rim's position at a time, and its rate from then on, steps/s."""
        self._steps_rate, self._rate_since, self._rate_target = 0.0, 0, 0.0
        """The rate of the steps, and the time and target at which it was found."""
        self._follow_at = NEVER
        """Time at which the rim has its usual lag, and takes the rate of the steps."""
        self._foresee_again()

    # -- pins ------------------------------------------------------------------------------------------

    @property
    def step_pin(self) -> int | None:
        """The pin whose rises are steps; None with four wires."""
        return self.wired.pins.get("step")

    def add(self, record: BoardRecord) -> None:
        """Add a record of its board about one of its pins. They are in order."""
        self._records.append(record)
        if self._ahead is not None:
            self._ahead._records.append(record)

    @property
    def due(self) -> int:
        """Time at which something happens next; NEVER if nothing is known."""
        due = min(self._coils_at, self._follow_at, self._arrival)
        return min(due, self._records[0].time) if self._records else due

    def happen(self) -> None:
        """Let happen what is due next."""
        time = self.due
        if self._records and self._records[0].time == time:
            self._take(self._records.popleft())
        elif self._coils_at == time:
            self._coils_at = NEVER
            self._turn(time)
        elif self._arrival == time:
            self._stop(time)
        else:
            self._follow_at = NEVER
            self._set_rate(time, self._steps_rate)

    def next_change(self, time: int) -> int:
        """The time of the first change of its speed after a time that it has reached. From `known_until` on
        it may come earlier, or not at all.

        Most steps of a steady drive change nothing. So a copy of it goes ahead to the next that does.
        """
        if self._ahead is None:
            self._ahead = copy(self)
            self._ahead.on_missed = _ignore
            self._ahead._records, self._ahead._levels = deque(self._records), dict(self._levels)
        ahead = self._ahead
        while self._change <= time:
            due = ahead.due
            # What happens from then on may still be changed by a record.
            if due >= self.known_until:
                return due
            before = ahead._rate
            ahead.happen()
            if ahead._rate != before:
                self._change = due
        return self._change

    def _foresee_again(self) -> None:
        """Forget the copy that goes ahead: it is no future of this one any more."""
        self._ahead, self._change = None, -NEVER

    def cut(self, time: int) -> None:
        """Cut its power until the next step: it stands where it is."""
        self._foresee_again()
        self._target = 0.0
        self._stop(time)
        self._origin, self._last = 0.0, (-NEVER, 0.0)

    def _take(self, record: BoardRecord) -> None:
        time, kind, pin, _, value = record
        if kind == Told.STEP:
            self.place = value & 0xFFFFFFFF
            if self._is_enabled:
                self._step(time, 1.0 if self._levels[self.wired.pins["dir"]] else -1.0)
            else:
                self.on_missed(self, IDLE)
            return
        self._levels[pin] = value if kind == Told.LEVEL else 0
        if self.wired.driver is not StepperDriver.STEP_DIR:
            self._coils_at = time + COIL_TIME

    @property
    def _is_enabled(self) -> bool:
        pin = self.wired.pins.get("enable")
        return pin is None or bool(self._levels[pin]) == self.wired.enable_high

    def _turn(self, time: int) -> None:
        """The field of the coils turns the rotor, the shorter way round. Half a turn it does not follow."""
        ends = [self._levels[self.wired.pins[name]] for name in ("in1", "in2", "in3", "in4")]
        if self.wired.driver is StepperDriver.ULN2003:
            ends[1], ends[2] = ends[2], ends[1]
        angle = _ANGLES.get((ends[0] - ends[1], ends[2] - ends[3]))
        if angle is None:
            return
        if self._angle is None:
            self._angle, self._first_at = angle, time
            return
        half = _PERIOD // 2
        turned = (angle - self._angle + half) % _PERIOD - half
        if turned in (0, -half):
            return
        # Where the rotor is at the beginning is not known: a step before the first field that turned it.
        steps = 2 if time - self._first_at < _FIRST else 1
        self._angle, self._first_at = angle, -NEVER
        self._step(time, steps * turned / 2.0)

    # -- the rim ---------------------------------------------------------------------------------------

    @property
    def speed(self) -> float:
        """The rim speed now, in/s."""
        speed = self._rate / self.wired.steps_per_inch
        return -speed if self.wired.reversed else speed

    def position(self, time: int) -> float:
        """The rim's position at a time before the next change."""
        return self._origin + self._rate * ((time - self._since) / SECOND)

    @property
    def _arrival(self) -> int:
        """Time at which the rim reaches the steps."""
        if not self._rate:
            return NEVER
        return self._since + max(math.ceil((self._target - self._origin) / self._rate * SECOND), 0)

    def _set_rate(self, time: int, rate: float) -> None:
        most = self.wired.top_speed * self.wired.steps_per_inch
        self._origin, self._since = self.position(time), time
        self._rate = min(max(rate, -most), most)

    def _stop(self, time: int) -> None:
        self._set_rate(time, 0.0)
        self._steps_rate, self._follow_at = 0.0, NEVER

    def _step(self, time: int, by: float) -> None:
        """A step, or a part or several of one, in the direction of its sign."""
        before, last = self._last
        lag = self._target + by - self.position(time)
        if abs(lag) > 2.0 * max(_LEAST_LAG, _LAG * abs(self._steps_rate)) + _MOST_LAG:
            self.on_missed(self, LOST)
            return
        self._target += by
        self._last = time, by
        interval = max(time - before, 1)
        if interval >= ALONE or last * by <= 0.0:
            self._stop(time)
            self._rate_since, self._rate_target = time, self._target
            self._set_rate(time, lag / min(interval, ALONE) * SECOND)
            return
        passed, steps = (time - self._rate_since) / SECOND, self._target - self._rate_target
        rate = by / interval * SECOND
        if self._steps_rate:
            deviation = steps - self._steps_rate * passed
            if abs(deviation) <= _usual_lag(self._steps_rate) - 1.0 - _LEAST_GAP:
                return
            corrected = self._steps_rate + _OVER * deviation / passed
            if abs(steps) <= 2.0 * abs(by):
                rate = steps / passed
            elif corrected * by > 0.0:
                rate = corrected
        self._steps_rate, self._rate_since, self._rate_target = rate, time, self._target
        usual = _usual_lag(rate)
        # Half a step more than the usual lag is time enough to reach it without turning back.
        seconds = (usual + 0.5) / abs(rate)
        corrected = rate + (lag - math.copysign(usual, rate)) / seconds
        self._set_rate(time, corrected if corrected * by > 0.0 else rate / 4.0)
        self._follow_at = time + math.ceil(seconds * SECOND)


def _ignore(state: StepperState, reason: str) -> None:
    """A step that moves nothing is told once."""


def _usual_lag(rate: float) -> float:
    """The lag of a rim whose steps have this rate."""
    return max(_LEAST_LAG, _LAG * abs(rate))
