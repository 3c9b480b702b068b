"""The wiring of a set compared with the text of its sketches, without a compiler: each mistake in a line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from simmer_tui.errors import Problem, reason_of
from simmer_tui.sim.rules import listed
from simmer_tui.sim.specs import WheelsSpec
from simmer_tui.sketch.bus_check import bus_problems
from simmer_tui.sketch.interrupt_check import interrupt_problems
from simmer_tui.sketch.line_check import line_problems
from simmer_tui.sketch.motion_check import wrong_motions
from simmer_tui.sketch.pin_check import pin_problems
from simmer_tui.sketch.sketch_scan import PIN_CHANGES, SketchFacts
from simmer_tui.sketch.sketch_steps import PULSES, WRITES
from simmer_tui.sketch.sketch_values import Pins
from simmer_tui.sketch.task_check import task_problems
from simmer_tui.sketch.wiring import (
    MotorDriver,
    PinUse,
    SketchBoard,
    WiredMotor,
    WiredSonar,
    WiredStepper,
    Wiring,
)

_READERS = ("digitalRead", "analogRead", *PULSES)
_OF_PIN_CHANGES = ("SoftwareSerial.h", "PinChangeInterrupt.h", "EnableInterrupt.h", "PinChangeInt.h")
"""Libraries whose code has the functions of the pin-change interrupts."""
_MODES = (
    *("pinMode", "digitalPinToInterrupt", "attachInterrupt", "attachInterruptArg", "detachInterrupt"),
    *("digitalPinToPCINT", "digitalPinToPinChangeInterrupt", *PIN_CHANGES),
)
"""Calls that neither write nor read a pin; interrupts are found by their own list."""
_NO_PIN = re.compile(
    r"(ledc(?!Attach)|delay|timer[A-Z]|pdMS|[xuv](Task|Queue|Semaphore|Timer|EventGroup))\w*"
)
"""Calls whose numbers are no pins: channels, times, priorities."""
_LINES = ("rx", "tx", "from", "to", "sda", "scl")
"""Names of the uses of pins by serial lines and the bus, which have messages of their own."""
_DUTY_PINS: Mapping[MotorDriver, tuple[str, ...]] = {
    MotorDriver.HBRIDGE: ("en",),
    MotorDriver.SHIELD: ("pwm",),
    MotorDriver.PWM2: ("in1", "in2"),
    MotorDriver.SERVO360: (),
}
"""The pins of a driver that get its duty."""


def facts_of(wiring: Wiring, directory: Path, problems: list[Problem]) -> dict[str, SketchFacts]:
    """The facts of a wiring's sketches by board; one that cannot be read is missing, and a problem.
    Their paths begin at `directory`, the set's folder."""
    facts: dict[str, SketchFacts] = {}
    for name, board in wiring.boards.items():
        try:
            facts[name] = SketchFacts.read(directory / board.sketch, board.kind)
        except (OSError, ValueError) as error:
            problems.append(Problem(board.place_of("sketch"), f"cannot be read: {reason_of(error)}"))
    return facts


def sketch_problems(
    wiring: Wiring, facts: Mapping[str, SketchFacts], wheels: WheelsSpec | None
) -> list[Problem]:
    """The problems of a wiring with its sketches, by their facts, and with the robot's wheels."""
    problems: list[Problem] = list(_too_fast(wiring, wheels))
    for name, found in facts.items():
        board = wiring.boards[name]
        uses = [use for use in wiring.pin_uses() if use.board == name]
        problems += _unused_pins(board, found, uses)
        problems += _no_outputs(found, uses)
        problems += _claimed_pins(found, uses)
        problems += _interrupts(found)
        problems += _shared_changes(found)
        problems += _deaf_ports(found)
        problems += bus_problems(wiring, name, found)
        problems += task_problems(found)
        problems += pin_problems(found)
        problems += interrupt_problems(found)
        for sensor in wiring.sensors:
            if isinstance(sensor, WiredSonar) and sensor.board == name:
                problems += _swapped_sonar(found, sensor)
        for motor in wiring.motors:
            if motor.board == name:
                problems += _motor_duty(found, motor)
        for stepper in wiring.steppers:
            if stepper.board == name:
                problems += _stepper(found, stepper)
    problems += line_problems(wiring, facts)
    problems += wrong_motions(wiring, wheels, facts)
    return problems


def _too_fast(wiring: Wiring, wheels: WheelsSpec | None) -> Iterator[Problem]:
    """Motors that are faster than the set's wheels may turn."""
    for motor in wiring.motors:
        if wheels is not None and motor.top_speed > wheels.top_speed:
            what = f"{motor.top_speed:g} in/s is more than top_speed of [wheels] in settings.toml"
            remedy = "the wheel turns no faster; give both the same"
            yield Problem(motor.place_of("top_speed"), f"{what}, {wheels.top_speed:g}: {remedy}")


# -- pins ------------------------------------------------------------------------------------------


def _touched(facts: SketchFacts, *, writes: bool) -> Pins | None:
    """The pins that a sketch may write (or read), by all its calls; None if one of them cannot be known.

    Any argument of another call or object counts: a class of the team's own may write it."""
    direct, others = (WRITES, _READERS) if writes else (_READERS, WRITES)
    found: set[int] = set()
    for call in facts.calls:
        if call.name in _MODES or call.name in others:
            continue
        if not call.object and not call.type and (call.name in facts.functions or _NO_PIN.match(call.name)):
            continue  # the sketch's own calls are in the list
        if call.name.startswith("ledcAttach"):
            # Its other numbers are a channel, a frequency and bits.
            pins = facts.pins(call)
            if pins is None:
                return None
            found |= pins
            continue
        if call.name in direct:
            pins = facts.pins(call)
            if pins is None:
                return None
            found |= pins
        else:
            for at in range(len(call.arguments)):
                found |= facts.pins(call, at) or Pins()
    if not writes:
        for each in facts.interrupts():
            found |= each.pins or Pins()
    return Pins(found)


def _unused_pins(board: SketchBoard, facts: SketchFacts, uses: Iterable[PinUse]) -> Iterator[Problem]:
    """Pins that the wiring has and the sketch does not use."""
    written, read = _touched(facts, writes=True), _touched(facts, writes=False)
    ports = facts.ports()
    modes = {pin for call in facts.named("pinMode") for pin in facts.pins(call) or ()}
    for use in uses:
        if use.name in _LINES:
            continue
        pins = written if use.writes else read
        if use.name == "xshut" and use.pin in modes:
            continue  # an output is LOW before it is written, and an input lets the part be on
        if pins is None or use.pin in pins:
            continue
        shown = board.kind.pin_name(use.pin)
        verb = "writes" if use.writes else "reads"
        what = f"the sketch never {verb} pin {shown} ({facts.file})"
        if any(use.pin in (port.rx or ()) or use.pin in (port.tx or ()) for port in ports):
            what += "; it is a pin of a serial port there"
        yield Problem(use.place, f"{what}; look at its pin numbers")


def _claimed_pins(facts: SketchFacts, uses: Iterable[PinUse]) -> Iterator[Problem]:
    """Pins of parts that the sketch has given to a serial port or a display too."""
    claims: dict[int, str] = {}
    for port in facts.ports():
        for name, pins in (("rx", port.rx), ("tx", port.tx)):
            if pins is not None and len(pins) == 1:
                claims.setdefault(next(iter(pins)), f"{name} of {port.name} too ({port.spot})")
    for call in facts.objects("LiquidCrystal"):
        for at in range(len(call.arguments)):
            pins = facts.pins(call, at)
            if pins is not None and len(pins) == 1:
                claims.setdefault(next(iter(pins)), f"the display's too ({call.token.spot})")
    for use in uses:
        if use.name not in _LINES and use.pin in claims:
            what = f"pin {facts.kind.pin_name(use.pin)} is {claims[use.pin]}"
            yield Problem(use.place, f"{what}; give each its own pin")


def _no_outputs(facts: SketchFacts, uses: Iterable[PinUse]) -> Iterator[Problem]:
    """Pins that are written and never made outputs: they stay weak, and drive nothing. analogWrite makes them
    outputs by itself."""
    outputs: set[int] = set()
    for call in facts.named("pinMode", "analogWrite"):
        pins = facts.pins(call)
        if pins is None:
            return
        if call.name == "analogWrite" or facts.spelled(call, 1) not in ("INPUT", "INPUT_PULLUP"):
            outputs |= pins
    for use in uses:
        if not use.writes or use.pin in outputs:
            continue
        for call in facts.named("digitalWrite"):
            if use.pin in (facts.pins(call) or ()):
                shown = facts.kind.pin_name(use.pin)
                what = f"pin {shown} is written ({call.token.spot}) and is no output"
                yield Problem(use.place, f"{what}: add pinMode({shown}, OUTPUT)")
                break


def _interrupts(facts: SketchFacts) -> Iterator[Problem]:
    """Interrupts that the board does not have."""
    kind = facts.kind
    there = f"the {kind.title} has them on pins {listed(map(str, sorted(kind.interrupts)))}"
    for each in facts.interrupts():
        if each.number is not None and not each.pins:
            what = (
                f"attachInterrupt has the interrupt {each.number}, which the {kind.title} lacks; "
                f"write digitalPinToInterrupt(pin): {there}"
            )
            yield Problem(each.spot, what)
        for pin in sorted(each.pins or ()):
            if each.is_pin_change and pin not in kind.software_rx:
                those = ", ".join(kind.pin_name(one) for one in sorted(kind.software_rx))
                what = f"pin {kind.pin_name(pin)} of the {kind.title} has no pin-change interrupt"
                yield Problem(each.spot, f"{what}; there are those of {those}")
            elif not each.is_pin_change and each.number is None and pin not in kind.interrupts:
                what = f"attachInterrupt on pin {kind.pin_name(pin)}, which has no interrupt; {there}"
                yield Problem(each.spot, what)


def _shared_changes(facts: SketchFacts) -> Iterator[Problem]:
    """Two libraries that both define the pin-change interrupts: the sketch of a real board is not linked."""
    found = {name: spot for name, spot in facts.includes if name in _OF_PIN_CHANGES}
    (first, *others) = found or ("",)
    for name in others:
        what = f"{name} and {first} ({found[first]}) both define the pin-change interrupts"
        yield Problem(found[name], f"{what}: Arduino links no sketch with both; use one of them")


def _deaf_ports(facts: SketchFacts) -> Iterator[Problem]:
    """SoftwareSerial ports at pins at which the board has no pin-change interrupt."""
    kind = facts.kind
    if kind.int_bits == 32:
        return
    for port in facts.ports():
        for pin in sorted((port.rx or Pins()) - kind.software_rx):
            if port.name not in kind.serial and pin < kind.pins:
                there = ", ".join(kind.pin_name(each) for each in sorted(kind.software_rx))
                what = f"{port.name} cannot receive at pin {kind.pin_name(pin)} of the {kind.title}"
                yield Problem(port.spot, f"{what}: SoftwareSerial can at {there}")


def _swapped_sonar(facts: SketchFacts, sonar: WiredSonar) -> Iterator[Problem]:
    """A trigger that the sketch listens to, and an echo that it writes."""
    if sonar.trig == sonar.echo:
        return
    trig, echo = (facts.kind.pin_name(pin) for pin in (sonar.trig, sonar.echo))
    for call in facts.objects("NewPing"):
        first, second = facts.pins(call, 0), facts.pins(call, 1)
        # An array's elements give several pins each, which do not tell which belong together.
        if first == Pins({sonar.echo}) and second == Pins({sonar.trig}):
            yield Problem(sonar.place, _swapped(trig, echo, f"NewPing at {call.token.spot}"))
            return
    for call in facts.named(*PULSES):
        if facts.pins(call) == Pins({sonar.trig}):
            yield Problem(sonar.place, _swapped(trig, echo, f"pulseIn at {call.token.spot}"))
            return
    modes = {
        mode: [call for call in facts.named("pinMode") if facts.pins(call) == Pins({pin})]
        for mode, pin in (("INPUT", sonar.trig), ("OUTPUT", sonar.echo))
    }
    if all(found and facts.spelled(found[0], 1) == mode for mode, found in modes.items()):
        spot = modes["INPUT"][0].token.spot
        yield Problem(sonar.place, _swapped(trig, echo, f"pinMode at {spot}"))


def _swapped(trig: str, echo: str, by: str) -> str:
    return f"trig {trig} and echo {echo} are the other way round in the sketch ({by})"


def _motor_duty(facts: SketchFacts, motor: WiredMotor) -> Iterator[Problem]:
    """Duties on pins that have no PWM, or that lose it to the Servo library."""
    if motor.driver is MotorDriver.SERVO360:
        yield from _servo(facts, motor)
        return
    kind = facts.kind
    uses_servo = any(name == "Servo.h" for name, _ in facts.includes) and any(facts.named("attach"))
    inputs = () if "en" in motor.pins else ("in1", "in2")
    for name in dict.fromkeys((*_DUTY_PINS[motor.driver], *inputs)):
        pin = motor.pins.get(name)
        if pin is None:
            continue
        shown = kind.pin_name(pin)
        written = [call for call in facts.named("analogWrite") if pin in (facts.pins(call) or ())]
        if not written:
            continue
        spot = written[0].token.spot
        if pin not in kind.pwm:
            there = ", ".join(str(each) for each in sorted(kind.pwm))
            what = (
                f"pin {shown} of the {kind.title} has no PWM: analogWrite ({spot}) is on from 128, else off"
            )
            yield Problem(motor.place_of(name), f"{what}; PWM pins: {there}")
        elif uses_servo and pin in kind.servo_takes:
            what = f"pin {shown} of the {kind.title} has no PWM while Servo is used: they share a timer"
            yield Problem(motor.place_of(name), f"{what} (analogWrite at {spot}); take another PWM pin")
    no_speed = not any(
        pin in (facts.pins(call) or ()) for pin in motor.pins.values() for call in facts.named("analogWrite")
    )
    unknown = any(facts.pins(call) is None for call in facts.named("analogWrite"))
    # A bridge whose enable pin is wired high has no PWM: its motor is on or off.
    is_switched = motor.driver is MotorDriver.HBRIDGE and "en" not in motor.pins
    if no_speed and not unknown and not is_switched:
        what = "no analogWrite of the sketch is on a pin of this motor: it has full speed or none"
        yield Problem(motor.place, f"{what} ({facts.file})")


def _servo(facts: SketchFacts, motor: WiredMotor) -> Iterator[Problem]:
    """Writes of a servo's pin in a sketch that attaches none to it."""
    pin = motor.pins["pin"]
    attached = [facts.pins(call) for call in facts.named("attach")]
    if any(pins is None or pin in pins for pins in attached):
        return
    for call in facts.named(*WRITES):
        if pin in (facts.pins(call) or ()):
            what = f"the sketch attaches no servo to pin {facts.kind.pin_name(pin)}"
            remedy = "with analogWrite it is no servo360: look at its driver"
            yield Problem(motor.place_of("pin"), f"{what} ({call.name} at {call.token.spot}); {remedy}")
            return


def _stepper(facts: SketchFacts, stepper: WiredStepper) -> Iterator[Problem]:
    """Step and direction that are swapped, and steps by a call that makes none here."""
    step, way = stepper.pins.get("step"), stepper.pins.get("dir")
    if step is None or way is None:
        return
    shown = facts.kind.pin_name(step)
    for call in facts.objects("AccelStepper"):
        if facts.pins(call, 1) == Pins({way}) and facts.pins(call, 2) == Pins({step}):
            what = f"step {shown} and dir {facts.kind.pin_name(way)} are the other way round in the sketch"
            yield Problem(stepper.place, f"{what} (AccelStepper at {call.token.spot})")
            return
    for call in facts.named("tone", "analogWrite"):
        if facts.pins(call) == Pins({step}):
            what = f"{call.name} at {call.token.spot} makes no steps here on pin {shown}"
            yield Problem(stepper.place_of("step"), f"{what}: write it HIGH and LOW, or use AccelStepper")
            return
