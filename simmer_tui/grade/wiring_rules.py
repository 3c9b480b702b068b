"""A team's wiring against the course's robot: pins are the team's, and what hangs on them is the course's.

The reference is the wiring.toml of the course's set. Without one, motors are no faster than its [wheels].
"""

from __future__ import annotations

from collections.abc import Iterator

from simmer_tui.config import drive_csv, settings_file
from simmer_tui.config.loader import Configuration
from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.errors import Problem
from simmer_tui.grade.course import Rules
from simmer_tui.sim.specs import VelocityKind
from simmer_tui.sketch.wiring import WiredAnalog, WiredEncoder, WiredMotor, Wiring, WiringParts, read_wiring

_ROUNDING = 1e-9
"""Difference up to which two numbers are the same, by rounding."""


def parts_of(configuration: Configuration) -> WiringParts:
    """The parts of a set that a wiring may name."""
    spec = configuration.simulation
    return WiringParts(spec.sensors, spec.wheels)


def missing_for_boards(course: Configuration, rules: Rules) -> Iterator[str]:
    """Reasons why boards cannot drive the robot of a course's set, with the remedy."""
    if course.simulation.wheels is None and not rules.wheels:
        yield f"the set needs [wheels] in {settings_file.FILE}, or the course wheels = true"
    if not _turns_wheels(course):
        yield f"the set needs an enabled row wheels in {drive_csv.FILE}, by which boards turn the wheels"


def _turns_wheels(configuration: Configuration) -> bool:
    return any(
        each.kind is VelocityKind.WHEELS and each.enabled for each in configuration.simulation.velocities
    )


def wiring_problems(wiring: Wiring, team: Configuration, course: Configuration) -> Iterator[Problem]:
    """All that makes the robot of a team's wiring another than the course's."""
    if (wiring.motors or wiring.steppers) and not _turns_wheels(team):
        what = "boards turn the wheels by its row wheels, which must be there, and enabled"
        yield Problem(drive_csv.FILE, what)
    model = _reference(course)
    fastest = course.settings.wheels.top_speed
    for motor in wiring.motors:
        yield from _motor(motor, () if model is None else model.motors, fastest)
    if model is None:
        has_ramp = any(each.start_lag or each.acceleration for each in course.simulation.drives)
        for stepper in wiring.steppers if has_ramp else ():
            what = f"a stepper has neither lag nor ramp, which the course's {drive_csv.FILE} has"
            yield Problem(stepper.place, what)
        return
    yield from _kinds_of_motors(wiring, model)
    encoders = [each for each in model.sensors if isinstance(each, WiredEncoder)]
    curves = [each.points for each in model.sensors if isinstance(each, WiredAnalog)]
    for sensor in wiring.sensors:
        if isinstance(sensor, WiredEncoder):
            finest = max((each.edges_per_inch for each in encoders), default=0.0)
            if not encoders:
                yield Problem(sensor.place, "the course's robot has no encoders")
            elif sensor.edges_per_inch > finest + _ROUNDING:
                what = f"its {sensor.edges_per_inch:g} edges an inch are above the course's {finest:g}"
                yield Problem(sensor.place_of("edges_per_inch"), what)
        elif isinstance(sensor, WiredAnalog) and curves and sensor.points not in curves:
            yield Problem(sensor.place_of("points"), "its curve is not one of the course's")


def _kinds_of_motors(wiring: Wiring, model: Wiring) -> Iterator[Problem]:
    """Steppers where the course's robot has none, motors where it has one, and steps of another length."""
    lengths = {each.wheel: each.steps_per_inch for each in model.steppers}
    others = {each.wheel for each in model.motors}
    for stepper in wiring.steppers:
        if stepper.wheel in others or not lengths:
            yield Problem(stepper.place, "the course's robot has no stepper there")
            continue
        # A wheel that the course has wired with nothing has steps as the others.
        known = [lengths[stepper.wheel]] if stepper.wheel in lengths else list(lengths.values())
        if all(abs(stepper.steps_per_inch - each) > _ROUNDING for each in known):
            what = f"its {stepper.steps_per_inch:g} steps an inch are not the course's {known[0]:g}"
            yield Problem(stepper.place_of("steps_per_inch"), what)
    for motor in wiring.motors:
        if motor.wheel in lengths:
            yield Problem(motor.place, "the course's robot has a stepper there")


def _motor(motor: WiredMotor, models: tuple[WiredMotor, ...], fastest: float) -> Iterator[Problem]:
    """Problems of a motor beside those of the same wheel; beside all, if the course has none there."""
    alike = [each for each in models if each.wheel == motor.wheel] or models
    most = min(fastest, max((each.top_speed for each in alike), default=fastest))
    least = min((each.dead_band for each in alike), default=0.0)
    if motor.top_speed > most + _ROUNDING:
        what = f"its {motor.top_speed:g} in/s are above the course's {most:g}"
        yield Problem(motor.place_of("top_speed"), what)
    if motor.dead_band < least - _ROUNDING:
        what = f"its dead band of {motor.dead_band:g} is below the course's {least:g}"
        yield Problem(motor.place_of("dead_band"), what)


def _reference(course: Configuration) -> Wiring | None:
    """The wiring of the course's robot; None without one that can be read."""
    text = course.files.get(WIRING_FILE)
    problems: list[Problem] = []
    return None if text is None else read_wiring(text, parts_of(course), problems)
