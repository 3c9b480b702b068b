"""Pins of a board that cannot do what a sketch wants of them: each is told once, at the first call."""

from __future__ import annotations

from collections.abc import Iterator

from simmer_tui.errors import Problem
from simmer_tui.sketch.boards import BoardKind
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_source import SketchCall
from simmer_tui.sketch.sketch_steps import PULSES, WRITES
from simmer_tui.sketch.sketch_values import Pins

_PULLS = ("INPUT_PULLUP", "INPUT_PULLDOWN")
_READS = ("digitalRead", *PULSES)
_DRIVEN = {
    **dict.fromkeys((*WRITES, "ledcAttachPin", "ledcAttach", "ledcAttachChannel", "tone"), (0,)),
    "shiftOut": (0, 1),
}
"""Calls that drive a pin, and the places of the pins among their arguments."""
_DRIVEN_BY = {
    "NewPing": (0,),
    "AccelStepper": (1, 2, 3, 4),
    "Stepper": (1, 2, 3, 4),
    "LiquidCrystal": tuple(range(11)),
}
"""Classes whose objects drive pins, and the places of the pins among the arguments of their constructors."""
_SERVOS = ("Servo.h", "ESP32Servo.h")


def pin_problems(facts: SketchFacts) -> Iterator[Problem]:
    """Outputs at pins that are inputs alone, pull-ups that are not there, and pins that no sketch can use."""
    told: set[tuple[int, str]] = set()
    for call, pin, use in _uses(facts):
        what = _fault(facts.kind, pin, use)
        if what and (pin, what) not in told:
            told.add((pin, what))
            yield Problem(
                call.token.spot, f"{call.type or call.name} has pin {facts.kind.pin_name(pin)}, {what}"
            )


def _uses(facts: SketchFacts) -> Iterator[tuple[SketchCall, int, str]]:
    """The calls with a pin, and its use: `drives`, `pulls` or `reads`."""
    servos = any(name in _SERVOS for name, _ in facts.includes)
    for call in facts.calls:
        places, use = _DRIVEN.get(call.name, ()), "drives"
        if call.type or call.name in facts.functions:
            places = _DRIVEN_BY.get(call.type, ())
        elif call.name == "pinMode":
            mode = facts.spelled(call, 1)
            places, use = (0,), "drives" if mode == "OUTPUT" else "pulls" if mode in _PULLS else "reads"
        elif call.name == "attach" and call.object and servos:
            places = (0,)
        elif call.name in _READS:
            places, use = (0,), "reads"
        for place in places:
            for pin in sorted(facts.pins(call, place) or Pins()):
                yield call, pin, use


def _fault(kind: BoardKind, pin: int, use: str) -> str:
    """The reason why a pin cannot be used so; empty if it can."""
    if pin in kind.flash:
        flash = f"{min(kind.flash)} to {max(kind.flash)}"
        return f"one of the flash memory's, {flash}: a real {kind.title} crashes; take another pin"
    if use == "drives" and pin in kind.inputs:
        inputs = f"{min(kind.inputs)} to {max(kind.inputs)}"
        return f"an input alone, as are {inputs} of the {kind.title}: nothing leaves it; take another pin"
    if use != "reads" and pin in kind.analog_only:
        return f"which the {kind.title} has for analogRead alone; take another pin"
    if use == "pulls" and pin in kind.inputs:
        return "which has no pull-up or pull-down: add a resistor, or take another pin"
    return ""
