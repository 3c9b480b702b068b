"""The parts of one board for the draft of a wiring.toml, read off the text of its sketch."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from msgspec import Struct

from simmer_tui.sketch.boards import ESP32, MEGA, UNO, BoardKind
from simmer_tui.sketch.bus_draft import draft_gyros, draft_rangers
from simmer_tui.sketch.known_headers import is_provided, provided_classes
from simmer_tui.sketch.motion_check import forward_levels
from simmer_tui.sketch.motor_draft import END, LAMP, STANDBY, DraftMotor, draft_motors, oriented
from simmer_tui.sketch.servo_draft import attached_servos, draft_servo_wheels
from simmer_tui.sketch.side_draft import (
    PartPlace,
    parts_of_name,
    place_of_pins,
    sides_by_turns,
    written_by_functions,
)
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.sketch_source import SketchCall, texts_of
from simmer_tui.sketch.sketch_steps import PULSES, WRITES, SketchStep, pulses, steps
from simmer_tui.sketch.sketch_values import Pins
from simmer_tui.sketch.stepper_draft import DraftStepper, draft_steppers
from simmer_tui.sketch.wheel_draft import DraftDrive

_TRIGGER, _ECHO = (re.compile(word, re.IGNORECASE) for word in ("trig", "echo"))
_NO_SENSOR = re.compile("potent|knob|batter|button|joystick|taster", re.IGNORECASE)
_NO_SENSOR_PARTS = frozenset(("pot", "poti", "bat", "batt", "vbat", "volt", "volts", "voltage", "vin", "btn"))
"""Words and parts in the names of inputs that are no sensors of the world: knobs, buttons, the battery."""
_ENCODER_PARTS, _CHANNELS = frozenset(("enc", "encoder", "hall", "odo")), 2
"""Parts in the names of an encoder's pins, and the most channels that it has."""
_ESP32_HEADERS = frozenset(
    ("bluetoothserial.h", "esp32servo.h", "wifi.h", "esp_now.h", "freertos/freertos.h")
)
_ESP32_CALL = re.compile(
    r"ledc[A-Z]\w+|xTaskCreatePinnedToCore|xPortGetCoreID|esp_\w+|portENTER_CRITICAL_ISR"
)
"""Headers and calls of an ESP32 alone."""


class DraftSonar(Struct, frozen=True):
    """A sonar that was read off a sketch."""

    trig: int
    echo: int


class DraftEncoder(Struct, frozen=True):
    """An encoder that was read off a sketch; `b` is None without a second channel."""

    a: int
    b: int | None
    place: PartPlace


class BoardDraft:
    """The parts of one board that its sketch shows."""

    def __init__(self, name: str, sketch: str, facts: SketchFacts) -> None:
        self.name, self.sketch, self.facts = name, sketch, facts
        written_steps = [END if step is None else step for step in steps(facts)]
        self.sonars = list(_sonars(facts, written_steps))
        echoes = {each.echo for each in self.sonars}
        pulsed = [facts.pins(call) for call in facts.named(*PULSES)]
        self.has_lost_pulses = any(not self.sonars if pins is None else pins - echoes for pins in pulsed)
        """True if it waits for pulses at pins that are no sonar's as far as was found."""
        self.servos = sorted({pin for call in attached_servos(facts) for pin in facts.pins(call) or ()})
        self.ports = facts.ports()
        taken = {pin for each in self.sonars for pin in (each.trig, each.echo)} | {*self.servos}
        taken |= {pin for port in self.ports for pins in (port.rx, port.tx) for pin in pins or ()}
        taken |= {pin for call in facts.objects("LiquidCrystal") for pin in _all_pins(facts, call)}
        self.steppers = draft_steppers(facts, taken)
        taken |= {pin for stepper in self.steppers for pin in stepper.pins.values()}
        self.gyros, self.rangers = draft_gyros(facts), draft_rangers(facts)
        taken |= {each.interrupt for each in self.gyros if each.interrupt is not None}
        taken |= {each.xshut for each in self.rangers if each.xshut is not None}
        ahead = forward_levels(facts)
        rest = [each for each in written_steps if each.pin not in taken]
        found = draft_motors(rest, _in_order(facts, "pinMode"))
        if self.steppers:
            # The enables of their coils have a duty, and no direction.
            found = [each for each in found if each.driver == "hbridge"]
        self.motors = [oriented(each, ahead) for each in found]
        if not self.motors and not self.steppers:
            self.motors = draft_servo_wheels(facts)
            self.servos = [pin for pin in self.servos if all(pin != each.pins["pin"] for each in self.motors)]
        turns = ["" for _ in self.steppers] + sides_by_turns(facts, self.motors)
        written_by = written_by_functions(facts)
        every: tuple[DraftMotor | DraftStepper, ...] = (*self.steppers, *self.motors)
        self.drives = [
            DraftDrive(each, place_of_pins(facts, each.pins.values(), written_by), turn, facts)
            for each, turn in zip(every, turns, strict=True)
        ]
        self.encoders = list(_encoders(facts, taken))
        known = {pin for each in self.encoders for pin in (each.a, each.b)}
        self.encoders += _polled_encoders(facts, {*taken, *known} - {None})
        taken |= {pin for motor in self.motors for pin in motor.pins.values()}
        taken |= {pin for each in self.encoders for pin in (each.a, each.b) if pin is not None}
        no_sensors = taken | _seeds(facts)
        self.analog = [pin for pin in _in_order(facts, "analogRead") if facts.kind.is_analog(pin)]
        self.analog = [pin for pin in self.analog if pin not in no_sensors]
        no_sensors = taken | {*self.analog} | {*_in_order(facts, "digitalWrite")}
        self.digital = [pin for pin in _in_order(facts, "digitalRead") if pin not in no_sensors]
        self.knobs = _named(facts, ("analogRead", "digitalRead", "pinMode"), _is_no_sensor)
        """Inputs that are no sensors of the world, with their names."""
        self.analog = [pin for pin in self.analog if pin not in self.knobs]
        self.digital = [pin for pin in self.digital if pin not in self.knobs]
        lamps = _named(facts, ("digitalWrite", "analogWrite", "pinMode"), LAMP.search)
        lamps |= self.knobs | (_named(facts, WRITES, STANDBY.search) if self.drives else {})
        written = _named(facts, WRITES, str)
        self.loose = {
            pin: name for pin, name in written.items() if pin not in {*taken, *lamps, facts.kind.led}
        }
        """Pins that it writes and no part has, with their names."""
        self.strangers = _strangers(facts)


def _sonars(facts: SketchFacts, steps: Sequence[SketchStep]) -> Iterator[DraftSonar]:
    found: dict[int, DraftSonar] = {}
    for call in facts.objects("NewPing"):
        trig, echo = facts.pins(call, 0), facts.pins(call, 1)
        if trig and echo and len(trig) == len(echo) == 1:
            each = DraftSonar(next(iter(trig)), next(iter(echo)))
            found.setdefault(each.echo, each)
    written = -1
    for step in steps:
        if step.call == "digitalWrite":
            written = step.pin
        elif step.call in PULSES and written >= 0 and written != step.pin:
            found.setdefault(step.pin, DraftSonar(written, step.pin))
    for written, pulsed in pulses(facts):
        found.setdefault(pulsed, DraftSonar(written, pulsed))
    yield from found.values()
    # An echo by interrupt or by digitalRead has no call that tells its trigger: the names do.
    trigs = [step.pin for step in steps if step.call == "digitalWrite" and _TRIGGER.search(step.name)]
    names = {
        pin: facts.spelled(call) for call in facts.named("digitalRead") for pin in facts.pins(call) or ()
    }
    for interrupt in facts.interrupts():
        for pin in interrupt.pins or ():
            names[pin] = f"{names.get(pin, '')} {interrupt.function}"
    echoes = [pin for pin, name in names.items() if _ECHO.search(name) and pin not in found]
    known = {sonar.trig for sonar in found.values()}
    trigs = [pin for pin in dict.fromkeys(trigs) if pin not in known]
    if trigs:
        for at, pin in enumerate(echoes):
            yield DraftSonar(trigs[min(at, len(trigs) - 1)], pin)


def _encoders(facts: SketchFacts, taken: set[int]) -> Iterator[DraftEncoder]:
    seen: set[int] = set()
    for each in facts.interrupts():
        pins = each.pins or Pins()
        if len(pins) != 1 or pins & (taken | seen) or _ECHO.search(each.function):
            continue
        (a,) = pins
        others = sorted(each.reads - {a} - taken)
        b = others[0] if len(others) == 1 else None
        seen |= {a} | ({b} if b is not None else set())
        yield DraftEncoder(a, b, place_of_pins(facts, {a} if b is None else {a, b}))


def _polled_encoders(facts: SketchFacts, taken: set[int | None]) -> Iterator[DraftEncoder]:
    """Encoders that are read without an interrupt, by their names; those of a wheel are its two channels."""
    named = _named(facts, ("digitalRead",), lambda name: parts_of_name(name) & _ENCODER_PARTS)
    by_place: dict[PartPlace, list[int]] = {}
    for pin in named:
        if pin not in taken:
            by_place.setdefault(place_of_pins(facts, {pin}), []).append(pin)
    for place, pins in by_place.items():
        is_one = place != PartPlace() and len(pins) == _CHANNELS
        for one, *other in [pins] if is_one else ([pin] for pin in pins):
            yield DraftEncoder(one, other[0] if other else None, place)


def facts_for_draft(sketch: Path) -> SketchFacts:
    """The facts of a sketch on the board that it needs. Raises OSError, or ValueError for a source that is
    too long."""
    texts = texts_of(sketch)
    facts = SketchFacts(texts, UNO)
    kind = _kind(facts)
    return facts if kind is UNO else SketchFacts(texts, kind)


def _strangers(facts: SketchFacts) -> dict[str, list[SketchCall]]:
    """Objects with numbers that may be pins, by classes that neither the sketch nor the simulator has."""
    if all(is_provided(name, facts.files) for name, _ in facts.includes):
        return {}
    known = {*facts.functions, *facts.classes, *provided_classes()}
    found: dict[str, list[SketchCall]] = {}
    for call in facts.calls:
        if call.type and call.type not in known:
            pins = [pin for at in range(len(call.arguments)) for pin in facts.ordered_pins(call, at)]
            if pins and all(pin < facts.kind.pins for pin in pins):
                found.setdefault(call.type, []).append(call)
    return found


def _named(facts: SketchFacts, calls: Sequence[str], is_meant: Callable[[str], object]) -> dict[int, str]:
    """The pins of calls whose names are meant, each with its name; empty for one of several."""
    found: dict[int, str] = {}
    for call in facts.named(*calls):
        pins, name = facts.pins(call) or Pins(), facts.spelled(call)
        if is_meant(name):
            shown = name if len(pins) == 1 else ""
            found |= {pin: shown for pin in sorted(pins) if pin not in found}
    return found


def _is_no_sensor(name: str) -> bool:
    return bool(_NO_SENSOR.search(name) or parts_of_name(name) & _NO_SENSOR_PARTS)


def _all_pins(facts: SketchFacts, call: SketchCall) -> set[int]:
    return {pin for at in range(len(call.arguments)) for pin in facts.pins(call, at) or ()}


def _in_order(facts: SketchFacts, name: str) -> list[int]:
    """The pins of a call's uses, in the order of the text: elements of an array in their own order."""
    found = (
        pin
        for call in facts.named(name)
        for pin in (*facts.ordered_pins(call, 0), *sorted(facts.pins(call) or ()))
    )
    return list(dict.fromkeys(found))


def _seeds(facts: SketchFacts) -> set[int]:
    """The open pins whose noise is a seed: `randomSeed(analogRead(A3))`."""
    after = {call.order + 1 for call in facts.named("randomSeed")}
    return {
        pin for call in facts.named("analogRead") if call.order in after for pin in facts.pins(call) or ()
    }


def _kind(facts: SketchFacts) -> BoardKind:
    """The board that a sketch needs: an ESP32 for its libraries and calls; a Mega for its further ports, a
    pin or interrupt that an Uno lacks, or for two pins that have a PWM on a Mega alone."""
    of_esp32 = any(name.lower() in _ESP32_HEADERS for name, _ in facts.includes)
    if of_esp32 or any(_ESP32_CALL.fullmatch(call.name) for call in facts.calls):
        return ESP32
    is_mega = any(call.object in ("Serial1", "Serial2", "Serial3") for call in facts.calls)
    for call in facts.named(*WRITES, *PULSES, "digitalRead", "pinMode", "attach"):
        is_mega |= any(UNO.pins <= pin < MEGA.pins for pin in facts.pins(call) or ())
    more = MEGA.interrupts.keys() - UNO.interrupts.keys()
    is_mega |= any(more & (each.pins or Pins()) for each in facts.interrupts())
    for kind in ("AccelStepper", "Stepper", "LiquidCrystal", "NewPing"):
        for call in facts.objects(kind):
            # The first argument of a stepper is its kind, or its steps a turn; a sonar has two pins.
            first = 1 if kind.endswith("Stepper") else 0
            last = 2 if kind == "NewPing" else len(call.arguments)
            pins = (facts.pins(call, at) or () for at in range(first, last))
            is_mega |= any(UNO.pins <= pin < MEGA.pins for each in pins for pin in each)
    duties = {pin for call in facts.named("analogWrite") for pin in facts.pins(call) or ()}
    return MEGA if is_mega or len(duties & (MEGA.pwm - UNO.pwm)) > 1 else UNO
