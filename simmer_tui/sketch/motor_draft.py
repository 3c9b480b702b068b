"""Motors for the draft of a wiring.toml: the pins that a sketch sets together, and how they are named.

A team sets the direction of a motor right before, or after, its duty. Without duties, the digital pins
that are set together are inputs of H-bridges.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from msgspec import Struct

from simmer_tui.sketch.sketch_steps import SketchStep

END = SketchStep("", -1, "", None, "", "")
"""A step that ends those of a function."""
_BRAKE, LAMP, STANDBY, _DUTY, _MOTOR, _INPUT = (
    re.compile(word, re.IGNORECASE)
    for word in (
        "brake|brk",
        "led|lamp|buzz",
        "stby|stdby|standby|n?sleep|n?slp|enable|en_?[ab0-9]?$",
        "en_?[ab]?$|en_?[0-9]|pwm|speed|spd",
        r"^in_?[0-9]|mot|left|right|wheel|fwd|forward|m[0-9]",
        r"in_?[0-9]",
    )
)
_WAYS = re.compile(r"forwards?|backwards?|reverse|fwd|bwd|rev|back|cw|ccw|plus|minus|pos|neg", re.IGNORECASE)
"""Words of a name that tell the direction."""
_ROLE = re.compile("dir(ection)?|pwm|speed|spd|enable|pin|_", re.IGNORECASE)
"""Words of a name that tell what the pin is, and not of which motor."""
# Arduino's Motor Shield R3 has its pins fixed: direction, PWM and brake of channels A and B.
_SHIELD = ({"dir": 12, "pwm": 3, "brake": 9}, {"dir": 13, "pwm": 11, "brake": 8})


class DraftMotor(Struct, frozen=True):
    """A motor that was read off a sketch: its driver and pins."""

    driver: str
    pins: Mapping[str, int]
    reversed: bool = False
    sure: bool = True
    """False if its duty and its direction are set in different functions, or it has no duty."""


def draft_motors(steps: Sequence[SketchStep], declared: Sequence[int] = ()) -> list[DraftMotor]:
    """The motors that a sketch's steps show. `declared` are the pins in the order of its calls of pinMode."""
    found = list(_shield(steps))
    used = {pin for motor in found for pin in motor.pins.values()}
    rest = [step for step in steps if step.pin not in used]
    found += _with_duties(rest)
    used |= {pin for motor in found for pin in motor.pins.values()}
    return [*found, *_without_duties(rest, used, declared)]


def _shield(steps: Sequence[SketchStep]) -> Iterator[DraftMotor]:
    """Both channels of a Motor Shield R3, if the sketch writes all six pins."""
    duties = {step.pin for step in steps if step.call == "analogWrite" and not LAMP.search(step.name)}
    names = {step.pin: step.name for step in steps if step.call == "digitalWrite"}
    levels = [channel[key] for channel in _SHIELD for key in ("dir", "brake")]
    if duties != {channel["pwm"] for channel in _SHIELD} or not all(pin in names for pin in levels):
        return
    # An L298N on the same pins has inputs that are named so.
    if not all(_INPUT.match(names[pin]) for pin in levels):
        for channel in _SHIELD:
            yield DraftMotor("shield", channel)


def _with_duties(steps: Sequence[SketchStep]) -> Iterator[DraftMotor]:
    """The motors by their duties: the digital pins that are written right before the analogWrite of a motor,
    or right after it, are its directions."""
    duties = [step.pin for step in steps if step.call == "analogWrite"]
    names = {step.pin: step.name for step in steps}
    votes: dict[int, Counter[tuple[tuple[int, str], ...]]] = {}
    pairs: Counter[tuple[int, int]] = Counter()
    for levels, analog, after in _runs(steps, {*duties}):
        if not levels and not after and len(analog) % 2 == 0:
            pairs.update(zip(analog[::2], analog[1::2], strict=True))
        sides = levels or after
        if len(sides) == 2 and len(analog) > 1 and len(analog) % 2:
            # A bridge with its enable, and others of the same function with a PWM on each input.
            pairs.update(zip(analog[1::2], analog[2::2], strict=True))
            analog = analog[:1]
        share = len(sides) // len(analog)
        if share == 1:
            sides = _by_name(sides, [names[pin] for pin in analog])
        elif share == 2 and len(analog) > 1:
            sides = _together(sides, names)
        if share in (1, 2) and share * len(analog) == len(sides):
            for at, duty in enumerate(analog):
                votes.setdefault(duty, Counter())[tuple(sides[share * at : share * (at + 1)])] += 1
    used: set[int] = set()
    for duty in dict.fromkeys(duties):
        if duty not in votes:
            continue
        pins, _ = max(votes[duty].items(), key=lambda each: (len(each[0]), each[1]))
        numbers = [pin for pin, _ in pins]
        if used & {duty, *numbers}:
            continue
        used |= {duty, *numbers}
        brakes = [pin for pin, name in pins if _BRAKE.search(name)]
        if len(numbers) == 1 and _lettered([duty, *numbers], names):
            # `IA` and `IB` are two inputs, also where one of them has no PWM.
            yield DraftMotor("pwm2", {"in1": duty, "in2": numbers[0]})
        elif len(numbers) == 1:
            yield DraftMotor("shield", {"dir": numbers[0], "pwm": duty})
        elif brakes:
            way = next(pin for pin in numbers if pin != brakes[0])
            yield DraftMotor("shield", {"dir": way, "pwm": duty, "brake": brakes[0]})
        else:
            yield DraftMotor("hbridge", {"in1": numbers[0], "in2": numbers[1], "en": duty})
    apart = [pin for pin in dict.fromkeys(duties) if pin not in used]
    inputs = _directions(steps, {*duties} | used, 2 * len(apart))
    if not inputs and len(apart) == 1 and not used:
        # One duty for the enables of both bridges.
        inputs = _directions(steps, {*duties}, 4)
        apart = apart * 2 if inputs else apart
    if inputs:
        for at, duty in enumerate(apart):
            yield DraftMotor(
                "hbridge", {"in1": inputs[2 * at], "in2": inputs[2 * at + 1], "en": duty}, sure=False
            )
        return
    named = _paired([pin for pin in apart if not _DUTY.search(names[pin])], names)
    for (one, other), _ in [(pair, 0) for pair in named] or pairs.most_common():
        if one != other and not used & {one, other}:
            used |= {one, other}
            yield DraftMotor("pwm2", {"in1": one, "in2": other})


def _by_name(sides: list[tuple[int, str]], duties: Sequence[str]) -> list[tuple[int, str]]:
    """Directions in the order of their duties: by what their names have beside these words, else as they
    are."""
    stems = {_ROLE.sub("", name).lower(): (pin, name) for pin, name in sides}
    wanted = [_ROLE.sub("", name).lower() for name in duties]
    return [stems[each] for each in wanted] if {*wanted} == {*stems} and len(stems) == len(sides) else sides


def _together(sides: list[tuple[int, str]], names: Mapping[int, str]) -> list[tuple[int, str]]:
    """Directions of several motors with both of each side by side, as their names tell, else as they are."""
    places = {pin: place for place, (pin, _) in enumerate(sides)}
    pairs = (sorted(pair, key=places.__getitem__) for pair in _paired([*places], names))
    ordered = [sides[places[pin]] for pair in sorted(pairs, key=lambda pair: places[pair[0]]) for pin in pair]
    return ordered or sides


def _directions(steps: Sequence[SketchStep], taken: set[int], count: int) -> tuple[int, ...]:
    """The digital pins that functions without a duty set together, if they are as many as asked for:
    directions in one function, duties in another. The most frequent ones, in their order; else none."""
    votes: Counter[tuple[int, ...]] = Counter()
    levels: dict[int, None] = {}
    for step in steps:
        if step.call == "digitalWrite" and step.pin not in taken and not LAMP.search(step.name):
            levels[step.pin] = None
        elif step.call != "digitalWrite":
            if count and len(levels) == count:
                votes[tuple(levels)] += 1
            levels = {}
    return votes.most_common(1)[0][0] if votes else ()


def _without_duties(
    steps: Sequence[SketchStep], used: set[int], declared: Sequence[int]
) -> Iterator[DraftMotor]:
    """The motors of H-bridges without a PWM: pins that are set together, in a function or a block of one."""
    if any(step.pin in used for step in steps):
        return
    groups: Counter[tuple[int, ...]] = Counter()
    names: dict[int, str] = {}
    levels: dict[int, None] = {}
    for step in (*steps, END):
        if step.call == "digitalWrite":
            if not LAMP.search(step.name) and not STANDBY.search(step.name):
                levels[step.pin] = None
                names.setdefault(step.pin, step.name)
            continue
        groups[tuple(sorted(levels, key=list(names).index))] += 1
        levels = {}
    blocks: dict[int, dict[int, None]] = {}
    for step in steps:
        if step.pin in names:
            blocks.setdefault(step.block, {})[step.pin] = None
    groups.update(tuple(sorted(pins, key=list(names).index)) for pins in blocks.values())
    del groups[()]
    for group, _ in sorted(groups.items(), key=lambda each: (-len(each[0]), -each[1])):
        is_motor = len(group) > 3 or all(_MOTOR.search(names[pin]) for pin in group)
        if len(group) % 2 or used.intersection(group) or not is_motor:
            continue
        used.update(group)
        if {*group} <= {*declared}:
            group = tuple(pin for pin in declared if pin in group)
        for one, other in _paired(group, names) or zip(group[::2], group[1::2], strict=True):
            yield DraftMotor("hbridge", {"in1": one, "in2": other}, sure=False)


def _paired(group: Sequence[int], names: Mapping[int, str]) -> list[tuple[int, int]]:
    """Pins in the pairs that their names tell: `AIN1` and `AIN2`, `leftForward` and `leftBack`. None if a pin
    is alone, has a number for a name, or shares its name, as a member of a class does."""
    if any(names[pin].isdecimal() for pin in group) or len({names[pin] for pin in group}) < len({*group}):
        return []
    if len(group) > 2 and (lettered := _lettered(group, names)):
        return lettered
    sides: dict[tuple[str, int], list[int]] = {}
    for pin in group:
        name = _WAYS.sub("", names[pin])
        number = re.search(r"([0-9])\D*$", name) if name == names[pin] else None
        stem = name if number is None else name[: number.start()] + name[number.end(1) :]
        sides.setdefault((stem.lower(), 0 if number is None else (int(number[1]) + 1) // 2), []).append(pin)
    if any(len(pins) != 2 for pins in sides.values()):
        return []
    ordered = (sorted(pins, key=lambda pin: _order(names[pin])) for pins in sides.values())
    return [(one, other) for one, other in ordered]


def _lettered(group: Sequence[int], names: Mapping[int, str]) -> list[tuple[int, int]]:
    """Pins in pairs by the last letter of their names, A and B: `M1A` and `M1B`, `A_IA` and `A_IB`. None if
    one has another name."""
    found: dict[str, dict[str, int]] = {}
    for pin in group:
        match = re.fullmatch(r"(\w*(?:[0-9]|[^\W_]_?I|IN_?))([AB])", names[pin], re.IGNORECASE)
        if match is None:
            return []
        found.setdefault(match[1].lower(), {})[match[2].lower()] = pin
    if any(len(each) != 2 for each in found.values()):
        return []
    return [(each["a"], each["b"]) for each in found.values()] if 2 * len(found) == len({*group}) else []


def _order(name: str) -> tuple[bool, str]:
    """Forward before backward, and 1 before 2."""
    return bool(re.search("back|rev|bwd|minus|neg|ccw", name, re.IGNORECASE)), name


def oriented(motor: DraftMotor, ahead: Mapping[int, float]) -> DraftMotor:
    """The motor with its inputs in the order in which the sketch's own function drives ahead."""
    pins = motor.pins
    if "dir" in pins:
        return DraftMotor(motor.driver, pins, ahead.get(pins["dir"]) == 0.0, motor.sure)
    first, second = (ahead.get(pins[name]) for name in ("in1", "in2"))
    if first == 0.0 and second:
        return DraftMotor(motor.driver, {**pins, "in1": pins["in2"], "in2": pins["in1"]}, sure=motor.sure)
    return motor


def _runs(
    steps: Sequence[SketchStep], duties: set[int]
) -> Iterator[tuple[list[tuple[int, str]], list[int], list[tuple[int, str]]]]:
    """Runs of duties with the levels before and after each: `(levels, duties, levels after)`."""
    levels: list[tuple[int, str]] = []
    analog: list[int] = []
    before: list[tuple[int, str]] = []
    for step in (*steps, END):
        if step.call == "digitalWrite":
            # An enable that is switched off digitally, the standby of a TB6612, and lamps are no direction.
            no_direction = LAMP.search(step.name) or STANDBY.search(step.name)
            is_direction = step.pin not in duties and not no_direction
            if is_direction and all(pin != step.pin for pin, _ in levels):
                levels.append((step.pin, step.name))
            continue
        if step.call == "analogWrite" and analog and not levels:
            if step.pin not in analog:
                analog.append(step.pin)
            continue
        if analog:
            yield before, analog, [] if before else levels
            # Levels after the duty belong to it if none were before.
            levels = levels if before else []
            analog = []
        if step.call == "analogWrite":
            before, analog, levels = levels, [step.pin], []
        else:
            levels = []
