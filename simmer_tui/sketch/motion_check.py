"""Motions of a robot by the pins of its motors: of each motor alone, and of each function of a sketch that
sets all of them. A function `forward` that turns the robot has a motor with the wrong polarity.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence

from msgspec import Struct

from simmer_tui.errors import Problem
from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.specs import WheelsSpec
from simmer_tui.sim.wheels import WheelKinematics
from simmer_tui.sketch.parts import PULSE_PERIOD, SERVO_STOP, rim_speed
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_steps import SketchStep, deep_steps
from simmer_tui.sketch.sketch_values import Pins
from simmer_tui.sketch.wiring import MotorDriver, WiredMotor, WiredStepper, Wiring

TURN_TIME = 0.2
"""Seconds for which each motor is turned."""
_TRIED_STEPS = 100
"""Steps by which each stepper is turned."""
_STEPPING = ("move", "setSpeed", "step")
"""Calls of a stepper's object whose sign is the direction."""
_INVERTED_COILS = 5
"""Arguments of setPinsInverted for four wires; with fewer the first one is that of the direction."""
_NO_MOTIONS = ("setup", "loop", "main", "")
"""Functions whose names promise no motion."""
_FORWARD: Mapping[MotorDriver, Mapping[str, float]] = {
    MotorDriver.HBRIDGE: {"en": 1.0, "in1": 1.0, "in2": 0.0},
    MotorDriver.SHIELD: {"dir": 1.0, "pwm": 1.0, "brake": 0.0},
    MotorDriver.PWM2: {"in1": 1.0, "in2": 0.0},
}
"""Levels of a driver's pins for full speed forward."""
_PULSES = ("write", "writeMicroseconds")
"""Calls of a servo's object."""
_SERVO_MIDDLE, _HALF_TURN = 90, 180
"""Degrees that a servo is written for its stop, and the most; a larger number is a pulse."""
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
    lines: dict[str, str] = {}
    for motor in wiring.motors:
        if motor.driver is MotorDriver.SERVO360:
            width = SERVO_STOP + motor.full_pulse
            levels, pins = {motor.pins["pin"]: width / PULSE_PERIOD}, f"pin {width:g} us"
        else:
            forward = _FORWARD[motor.driver]
            levels = _levels(motor, forward)
            pins = ", ".join(f"{name} {'HIGH' if forward[name] else 'LOW'}" for name in motor.pins)
        twist = _alone(kinematics, motor.wheel_index, rim_speed(motor, levels.__getitem__) * TURN_TIME)
        lines[motor.label] = f"{motor.wheel}: {_forward(twist)} ({pins}; {_size(twist)} in {TURN_TIME:g} s)"
    for stepper in wiring.steppers:
        inches = _TRIED_STEPS / stepper.steps_per_inch
        twist = _alone(kinematics, stepper.wheel_index, -inches if stepper.reversed else inches)
        pins = "dir HIGH" if "dir" in stepper.pins else "its coils in their order"
        lines[stepper.label] = (
            f"{stepper.wheel}: {_forward(twist)} ({pins}; {_size(twist)} in {_TRIED_STEPS} steps)"
        )
    yield from (f"{label} {lines[label]}" for label in sorted(lines))


def _alone(kinematics: WheelKinematics, wheel: int, inches: float) -> Twist:
    """The motion of the robot by one wheel."""
    return kinematics.twist([inches if index == wheel else 0.0 for index in range(len(kinematics.wheels))])


def _size(twist: Twist) -> str:
    return f"{twist.speed:.2f} in" if abs(twist.r) < 1e-9 else f"{abs(twist.r):.1f} deg"


def _forward(twist: Twist) -> str:
    if abs(twist.r) < 1e-9:
        return "forward moves the robot"
    return f"forward turns the robot {'left' if twist.r > 0 else 'right'}"


def levels_of_functions(
    facts: SketchFacts, pulsed: Collection[int] = ()
) -> Iterator[tuple[str, str, Mapping[int, float]]]:
    """Functions that set pins to levels that are known: name, place of the first write, and levels by pin.
    Those of `pulsed` pins, which are steps, do not count."""
    steps: dict[str, list[SketchStep]] = {}
    for step in deep_steps(facts):
        if step is not None and step.root not in _NO_MOTIONS and step.pin not in pulsed:
            steps.setdefault(step.root, []).append(step)
    for function, found in steps.items():
        levels = _set_levels(found)
        if levels is not None:
            yield function, found[0].spot, levels


def forward_levels(facts: SketchFacts, pulsed: Collection[int] = ()) -> Mapping[int, float]:
    """The levels that the sketch's own function for driving ahead sets, by its name; none without one."""
    for function, _, levels in levels_of_functions(facts, pulsed):
        if promises_ahead(function):
            return levels
    return {}


def promises_ahead(function: str) -> bool:
    """True if a function's name promises that the robot drives ahead, and nothing else."""
    return _promised(function) == {_AHEAD}


def promised_turn(function: str) -> str:
    """The side to which a function's name promises to turn, `left` or `right`; empty if it promises more, or
    something else."""
    promised = _promised(function)
    return {_LEFT: "left", _RIGHT: "right"}.get(min(promised), "") if len(promised) == 1 else ""


def _promised(function: str) -> set[str]:
    """The motions that a function's name promises."""
    return {motion for pattern, motion in _NAMED if pattern.search(function)}


def sketch_motions(
    wiring: Wiring, wheels: WheelsSpec, facts: SketchFacts, board: str
) -> Iterator[SketchMotion]:
    """The motions of the functions of a board's sketch that set every motor of the robot."""
    motors: tuple[WiredMotor | WiredStepper, ...] = (*wiring.motors, *wiring.steppers)
    if not motors or any(motor.board != board for motor in motors):
        return
    kinematics = WheelKinematics.of(wheels)
    pulsed = {each.pins["step"] for each in wiring.steppers if "step" in each.pins}
    by_levels = {name: (spot, levels) for name, spot, levels in levels_of_functions(facts, pulsed)}
    by_calls = _calls_of_steppers(facts, wiring.steppers)
    for name, (spot, pulses) in servo_signs(facts).items():
        by_calls.setdefault(name, (spot, {}))[1].update(_of_motors(facts, wiring.motors, pulses))
    for function in by_levels | by_calls:
        spot, levels = by_levels.get(function, ("", {}))
        call_spot, signs = by_calls.get(function, ("", {}))
        speeds = [0.0] * len(kinematics.wheels)
        backward = []
        for motor in motors:
            if isinstance(motor, WiredMotor) and motor.driver is MotorDriver.SERVO360:
                if motor.label not in signs:
                    break
                speed = -signs[motor.label] if motor.reversed else signs[motor.label]
            elif isinstance(motor, WiredMotor):
                if not _is_set(motor, levels):
                    break
                given = {name: levels.get(pin, _UNSET.get(name, 0.0)) for name, pin in motor.pins.items()}
                speed = rim_speed(motor, _levels(motor, given).__getitem__)
            else:
                level = levels.get(motor.pins.get("dir", -1))
                sign = signs.get(motor.label, 0.0 if level is None else 2.0 * level - 1.0)
                if not sign:
                    break
                speed = -sign if motor.reversed else sign
            speeds[motor.wheel_index] = speed
            backward += [motor.label] if speed < 0 else []
        else:
            motion = _motion(kinematics, speeds)
            if motion:
                yield SketchMotion(function, spot or call_spot, motion, tuple(backward))


def is_inverted(facts: SketchFacts, name: str) -> bool:
    """True if an object of AccelStepper has its direction inverted."""
    return any(
        facts.values(call.arguments[0], call.function, 0, bound) == Pins({1})
        for call, bound in facts.methods(name, "setPinsInverted")
        if 0 < len(call.arguments) < _INVERTED_COILS
    )


def servo_signs(facts: SketchFacts) -> dict[str, tuple[str, dict[str, float]]]:
    """Functions that write servos: by name the place of the first write, and the side of the stop on which
    its pulse is by the servo's name, 0 for a stop. Those with values that are several or unknown are
    missing."""
    found: dict[str, tuple[str, dict[str, float]]] = {}
    unknown: set[str] = set()
    for call in facts.named(*_PULSES):
        if not call.object or call.function in _NO_MOTIONS:
            continue
        values = facts.pins(call) or Pins()
        value = next(iter(values)) if len(values) == 1 else -1
        stop = _SERVO_MIDDLE if call.name == "write" and value <= _HALF_TURN else SERVO_STOP
        sign = float((value > stop) - (value < stop))
        _, signs = found.setdefault(call.function, (call.token.spot, {}))
        if value < 0 or signs.setdefault(call.object, sign) != sign:
            unknown.add(call.function)
    return {name: each for name, each in found.items() if name not in unknown}


def _of_motors(
    facts: SketchFacts, motors: Sequence[WiredMotor], signs: Mapping[str, float]
) -> Iterator[tuple[str, float]]:
    """The signs of servos as those of motors, by label."""
    for motor in motors:
        for call in facts.named("attach"):
            if call.object in signs and facts.pins(call) == Pins({motor.pins.get("pin", -1)}):
                yield motor.label, signs[call.object]


def _calls_of_steppers(
    facts: SketchFacts, steppers: Sequence[WiredStepper]
) -> dict[str, tuple[str, dict[str, float]]]:
    """Functions that let objects of AccelStepper or Stepper step: by name the place of the first call, and
    the sign of the steps by the stepper's label, 0 for both."""
    objects: dict[str, tuple[str, float]] = {}
    for call in (*facts.objects("AccelStepper"), *facts.objects("Stepper")):
        pins = [facts.pins(call, at) for at in range(1, 5)]
        known = {next(iter(each)) for each in pins if each is not None and len(each) == 1}
        for stepper in steppers:
            moving = {pin for name, pin in stepper.pins.items() if name != "enable"}
            if call.type and moving <= known:
                objects[call.name] = stepper.label, -1.0 if is_inverted(facts, call.name) else 1.0
    # Their speeds are turns a minute, without a direction.
    turning = {call.name for call in facts.objects("Stepper")}
    found: dict[str, tuple[str, dict[str, float]]] = {}
    for call in facts.named(*_STEPPING):
        if call.object not in objects or call.function in _NO_MOTIONS or not call.arguments:
            continue
        label, sign = objects[call.object]
        if call.name == "setSpeed" and call.object in turning:
            continue
        _, signs = found.setdefault(call.function, (call.token.spot, {}))
        sign = -sign if facts.spelled(call).startswith("-") else sign
        signs[label] = sign if signs.get(label, sign) == sign else 0.0
    return found


class WrongMotion(Struct, frozen=True):
    """A function whose name promises another motion than it sets: the sentence says both. `spots` are the
    places of its writes."""

    spot: str
    text: str
    spots: frozenset[str]
    is_mirrored: bool = False
    """True if it turns the other way round, as all do, and the others are right: the wheels are exchanged."""


def wrong_motions(
    wiring: Wiring, wheels: WheelsSpec | None, facts: Mapping[str, SketchFacts]
) -> Iterator[Problem]:
    """Problems of functions whose name promises another motion than they set."""
    # Not the pins: most drivers have no two that could be swapped.
    remedy = "change reversed of a motor in wiring.toml if its wires are swapped, else correct the sketch"
    mirrored = (
        "exchange the two wheel values in wiring.toml if the motors are the other way round, else in the"
    )
    for each in wrong_functions(wiring, wheels, facts):
        yield Problem(each.spot, f"{each.text}; {f'{mirrored} sketch' if each.is_mirrored else remedy}")


def wrong_functions(
    wiring: Wiring, wheels: WheelsSpec | None, facts: Mapping[str, SketchFacts]
) -> Iterator[WrongMotion]:
    """Functions whose name promises another motion than they set."""
    if wheels is None:
        return
    has_two = len(wiring.motors) + len(wiring.steppers) == 2
    for board, found in facts.items():
        told = [
            (each, next(iter(promised)))
            for each in sketch_motions(wiring, wheels, found, board)
            if len(promised := _promised(each.function)) == 1
        ]
        # Every turn, and nothing else: one alone is a mistake of its function.
        are_turns_wrong = all(
            {promise, each.motion} == {_LEFT, _RIGHT}
            if promise in (_LEFT, _RIGHT)
            else each.motion == promise
            for each, promise in told
        )
        for each in (each for each, promise in told if each.motion != promise):
            turned = " and ".join(each.backward)
            which = (
                f"{turned} {'turn' if len(each.backward) > 1 else 'turns'} backward"
                if turned
                else ("all motors turn forward")
            )
            motion = each.motion.replace(" ", " the robot ", 1)
            what = f"{each.function}() {motion}: {which}"
            steps = (step for step in deep_steps(found) if step is not None)
            spots = {step.spot for step in steps if step.root == each.function}
            pulses = (call for call in found.named(*_PULSES) if call.object)
            spots |= {call.token.spot for call in pulses if call.function == each.function}
            yield WrongMotion(each.spot, what, frozenset(spots), has_two and are_turns_wrong)


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
