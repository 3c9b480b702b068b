"""Servos for the draft of a wiring.toml: those that turn a wheel all round, and those that do not."""

from __future__ import annotations

import re
from collections.abc import Iterator

from simmer_tui.sketch.motion_check import promises_ahead, servo_signs
from simmer_tui.sketch.motor_draft import DraftMotor
from simmer_tui.sketch.side_draft import names_of_pins
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_source import SketchCall

_WHEEL, _NO_WHEEL = (
    re.compile(word, re.IGNORECASE)
    for word in (
        r"left|right|wheel|motor|drive|^[lr]_?servo|(?:^|[\s_])esc",
        "claw|grip|arm|hand|finger|jaw|door|lid|pan|tilt|scan|look|head|sonar|ping|steer",
    )
)


def attached_servos(facts: SketchFacts) -> Iterator[SketchCall]:
    """Calls that attach a servo."""
    if any(name in ("Servo.h", "ESP32Servo.h") for name, _ in facts.includes):
        yield from (call for call in facts.named("attach") if call.object)


def draft_servo_wheels(facts: SketchFacts) -> list[DraftMotor]:
    """Servos as wheels: at least two that are named so. One turns the other way if the sketch's function that
    drives ahead writes less than the stop."""
    wheels: dict[int, str] = {}
    for call in attached_servos(facts):
        for pin in facts.ordered_pins(call, 0):
            name = " ".join((call.object, facts.spelled(call), *names_of_pins(facts, {pin})))
            if _WHEEL.search(name) and not _NO_WHEEL.search(name):
                wheels.setdefault(pin, call.object)
    if len(wheels) < 2:
        return []
    ahead: dict[str, float] = {}
    for function, (_, signs) in servo_signs(facts).items():
        if promises_ahead(function):
            ahead = signs
            break
    return [
        DraftMotor("servo360", {"pin": pin}, reversed=ahead.get(name, 0.0) < 0.0)
        for pin, name in wheels.items()
    ]
