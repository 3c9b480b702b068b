"""Motions of a robot by the pins of its motors: of each motor alone, and of each function of a sketch that
sets all of them. A function `forward` that turns the robot has a motor with the wrong polarity.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from msgspec import Struct

from simmer_tui.errors import Problem
from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.specs import WheelsSpec
from simmer_tui.sim.wheels import WheelKinematics
from simmer_tui.sketch.parts import rim_speed
from simmer_tui.sketch.sketch_scan import SketchFacts, SketchStep
from simmer_tui.sketch.wiring import MotorDriver, WiredMotor, Wiring

TURN_TIME = 0.2
"""Seconds for which each motor is turned."""
_FORWARD: Mapping[MotorDriver, Mapping[str, float]] = {
    MotorDriver.HBRIDGE: {"en": 1.0, "in1": 1.0, "in2": 0.0},
    MotorDriver.SHIELD: {"dir": 1.0, "pwm": 1.0, "brake": 0.0},
    MotorDriver.PWM2: {"in1": 1.0, "in2": 0.0},
}
"""Levels of a driver's pins for full speed forward."""
_UNSET = {"en": 1.0, "pwm": 1.0, "brake": 0.0}
"""Levels of pins that a function leaves as they are: a duty, and no brake."""
_AHEAD, _BACK, _LEFT, _RIGHT = "drives ahead", "drives back", "turns left", "turns right"
_NAMED = (
    (re.compile(r"forward|fwd|ahead|straight", re.IGNORECASE), _AHEAD),
    (re.compile(r"backward|reverse|goback|moveback|driveback", re.IGNORECASE), _BACK),
    (re.compile(r"left", re.IGNORECASE), _LEFT),
    (re.compile(r"right(?!y)", re.IGNORECASE), _RIGHT),
)
"""Motions that names of functions promise."""
# Of full speed: less is an unequal pair of motors, not a turn.
_SMALL = 0.25


class SketchMotion(Struct, frozen=True):
    """The motion that a function of a sketch sets, at the place of its first write."""

    function: str
    spot: str
    motion: str
    backward: tuple[str, ...]
    """The motors that turn backward, by label."""


def motor_lines(wiring: Wiring, wheels: WheelsSpec | None) -> Iterator[str]:
    """Each motor turned forward alone, at full duty: `motors[1]: forward turns the robot left`."""
    if wheels is None:
        return
    kinematics = WheelKinematics.of(wheels)
    for motor in wiring.motors:
        speed = rim_speed(motor, _levels(motor, _FORWARD[motor.driver]).__getitem__)
        speeds = [0.0] * len(kinematics.wheels)
        speeds[motor.wheel_index] = speed
        twist = kinematics.twist(speeds)
        moved = f"{abs(twist.r) * TURN_TIME:.1f} deg in {TURN_TIME:g} s"
        if abs(twist.r) < 1e-9:
            moved = f"{twist.speed * TURN_TIME:.2f} in in {TURN_TIME:g} s"
        pins = ", ".join(f"{name} {'HIGH' if _FORWARD[motor.driver][name] else 'LOW'}" for name in motor.pins)
        yield f"{motor.label} {motor.wheel}: forward {_of_one(twist)} ({pins}; {moved})"


def _of_one(twist: Twist) -> str:
    if abs(twist.r) < 1e-9:
        return "moves the robot"
    return f"turns the robot {'left' if twist.r > 0 else 'right'}"


def levels_of_functions(facts: SketchFacts) -> Iterator[tuple[str, str, Mapping[int, float]]]:
    """Functions that set pins to levels that are known: name, place of the first write, and levels by pin."""
    steps: dict[str, list[SketchStep]] = {}
    for step in facts.deep_steps():
        if step is not None and step.root not in ("setup", "loop", ""):
            steps.setdefault(step.root, []).append(step)
    for function, found in steps.items():
        levels = _set_levels(found)
        if levels is not None:
            yield function, found[0].spot, levels


def forward_levels(facts: SketchFacts) -> Mapping[int, float]:
    """The levels that the sketch's own function for driving ahead sets, by its name; none without one."""
    for function, _, levels in levels_of_functions(facts):
        if _promised(function) == {_AHEAD}:
            return levels
    return {}


def _promised(function: str) -> set[str]:
    """The motions that a function's name promises."""
    return {motion for pattern, motion in _NAMED if pattern.search(function)}


def sketch_motions(
    wiring: Wiring, wheels: WheelsSpec, facts: SketchFacts, board: str
) -> Iterator[SketchMotion]:
    """The motions of the functions of a board's sketch that set every motor of the robot."""
    motors = wiring.motors
    if not motors or any(motor.board != board for motor in motors):
        return
    kinematics = WheelKinematics.of(wheels)
    for function, spot, levels in levels_of_functions(facts):
        if not all(_is_set(motor, levels) for motor in motors):
            continue
        speeds = [0.0] * len(kinematics.wheels)
        backward = []
        for motor in motors:
            given = {name: levels.get(pin, _UNSET.get(name, 0.0)) for name, pin in motor.pins.items()}
            speeds[motor.wheel_index] = speed = rim_speed(motor, _levels(motor, given).__getitem__)
            backward += [motor.label] if speed < 0 else []
        motion = _motion(kinematics, speeds)
        if motion:
            yield SketchMotion(function, spot, motion, tuple(backward))


class WrongMotion(Struct, frozen=True):
    """A function whose name promises another motion than it sets: the sentence says both. `spots` are the
    places of its writes."""

    spot: str
    text: str
    spots: frozenset[str]


def wrong_motions(
    wiring: Wiring, wheels: WheelsSpec | None, facts: Mapping[str, SketchFacts]
) -> Iterator[Problem]:
    """Problems of functions whose name promises another motion than they set."""
    remedy = "swap a motor's pins in wiring.toml if its wires are swapped, else in the sketch"
    for each in wrong_functions(wiring, wheels, facts):
        yield Problem(each.spot, f"{each.text}; {remedy}")


def wrong_functions(
    wiring: Wiring, wheels: WheelsSpec | None, facts: Mapping[str, SketchFacts]
) -> Iterator[WrongMotion]:
    """Functions whose name promises another motion than they set."""
    if wheels is None:
        return
    for board, found in facts.items():
        for each in sketch_motions(wiring, wheels, found, board):
            promised = _promised(each.function)
            if len(promised) == 1 and each.motion not in promised:
                turned = " and ".join(each.backward)
                which = (
                    f"{turned} {'turn' if len(each.backward) > 1 else 'turns'} backward"
                    if turned
                    else ("all motors turn forward")
                )
                motion = each.motion.replace(" ", " the robot ", 1)
                what = f"{each.function}() {motion}: {which}"
                steps = (step for step in found.deep_steps() if step is not None)
                spots = frozenset(step.spot for step in steps if step.root == each.function)
                yield WrongMotion(each.spot, what, spots)


def _motion(kinematics: WheelKinematics, speeds: list[float]) -> str:
    """The motion in words; empty for a stop, and for a mixture of driving and turning."""
    top = max((abs(speed) for speed in speeds), default=0.0)
    if not top:
        return ""
    twist = kinematics.twist(speeds)
    # Speed of the wheels by the turn alone, beside that of the centre.
    turn = max(abs(each) for each in kinematics.speeds(Twist(r=twist.r)))
    if turn < _SMALL * top and abs(twist.y) < _SMALL * top:
        return _AHEAD if twist.x > 0 else _BACK
    if twist.speed < _SMALL * top:
        return _LEFT if twist.r > 0 else _RIGHT
    return ""


def _levels(motor: WiredMotor, by_name: Mapping[str, float]) -> dict[int, float]:
    return {pin: by_name[name] for name, pin in motor.pins.items()}


def _is_set(motor: WiredMotor, levels: Mapping[int, float]) -> bool:
    """True if a function sets the pins that give a motor its direction."""
    return all(pin in levels for name, pin in motor.pins.items() if name not in _UNSET)


def _set_levels(steps: list[SketchStep]) -> dict[int, float] | None:
    """The levels that a function sets; None if an `if` decides: a pin has two levels, or an unknown one."""
    levels: dict[int, float] = {}
    for step in steps:
        if step.call == "analogWrite":
            value = step.value
            level = 0.0 if value is not None and max(value, default=0) == 0 else 1.0
        elif step.call == "digitalWrite":
            if step.value is None or len(step.value) != 1:
                return None
            level = float(bool(next(iter(step.value))))
        else:
            continue
        if levels.setdefault(step.pin, level) != level:
            return None
    return levels
