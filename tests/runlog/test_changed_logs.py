"""Logs that somebody has changed: which values a line may have, and what a reader and a rerun say of the
others."""

from __future__ import annotations

import copy
import json
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.config.loader import Configuration
from simmer_tui.errors import RunLogError
from simmer_tui.run.events import ActionName
from simmer_tui.runlog import rerun
from simmer_tui.runlog.log_records import AnyRecord, BrokenLine, decode_line
from simmer_tui.runlog.reader import LogReader
from simmer_tui.runlog.rerun import InOrder, Rerun
from simmer_tui.sim import Simulator, Status, parse_command
from simmer_tui.sim.fingerprint import math_fingerprint
from tests.kept_numbers import assert_kept
from tests.runlog.conftest import StartRun

KEPT = Path(__file__).with_name("kept_changes.json")

# Numbers on both sides of every limit that a field has.
NUMBERS = (
    *(-1.0, -0.0, 0.0, 0.5, 1.0, 1.5, 2.0, 1e10, 1.1e10, -1e10, -1.1e10),
    *(1e12, 1.1e12, -1e12, -1.1e12, -1, 0, 1, 10**14, 10**14 + 1, -(10**14), -(10**14) - 1),
    *(10**15, 10**15 + 1, -(10**15), -(10**15) - 1),
)
POSE = {"pose": [1.0, 2.0, 3.0]}
FROM = {"from": [1.0, 2.0, 3.0]}
LINES: tuple[dict[str, Any], ...] = (
    {
        "kind": "read", "n": 1, "cmd": "u1", "reply": 1.0, "taken": 0.0, "link": 0.0, "true": 1.0,
        "revolution": 1,
    },
    {
        "kind": "answer", "n": 1, "cmd": "wt-1", "reply": 1.0, "taken": 0.0, "link": 0.0, "status": "done",
        "waits": 1.0, "velocity": {"twist": [1.0, 2.0, 3.0], "expires": 1.0, "slip": [1.0], "limited": 1.0},
    },
    {"kind": "plan", "n": 1, "cmd": "d1-1", "begin": -1e12, **FROM, "total": [1.0, 2.0, 3.0]},
    {
        "kind": "end", "n": 1, "cmd": "d1-1", "begin": -1e12, **FROM, **POSE, "total": [1.0, 2.0, 3.0],
        "contact": {"t": 1.0, "at": [1, 0.5, 0.5], "point": [1.0, 2.0], "cell": [1, 1]},
        "stop": [1, 0.5, 0.5],
        "grip": {"closed": True, "holding": True, "block": [1.0, 2.0, 3.0]},
    },
    {
        "kind": "leg", "n": 1, "cmd": "vv-1;0;0", "end": 1e12, "velocity": [1.0, 2.0], "rate": 1.0,
        "spin": 1.0, "told": [1.0, 2.0, 3.0], **FROM, "to": [1.0, 2.0, 3.0],
    },
    {
        "kind": "leg_end", "n": 1, "cmd": "vv-1;0;0", "begin": -1e12, "velocity": [1.0, 2.0], "rate": 1.0,
        "spin": 1.0, "told": [1.0, 2.0, 3.0], **FROM, **POSE,
    },
    {"kind": "velocity", "reason": "its time was over"},
    {"kind": "action", "n": 1, "action": "speed", "source": "", "arguments": [1.0], "text": "", **POSE},
    {"kind": "belief", "believed": [1.0, 2.0, 3.0], **POSE, "spread": 1.0, "particles": [[1], [1], [1]]},
    {"kind": "notice", "about": "fault", "text": ""},
    {"kind": "wire", "data": ""},
    {"kind": "mission", "goal": "block taken", "text": ""},
    {"kind": "program", "exit_code": 1, "stderr": [{"t": 1.0, "text": ""}]},
    {"kind": "twin", "cmd": "u1", "code": "u1", "robot": 1.0, "simulated": 1.0},
    {
        "kind": "checkpoint", "n": 1, **POSE, "block": [1.0, 2.0, 3.0], "seed": 1, "holding": False,
        "noise": True, "paused": False, "time_scale": 1.0, "contacts": 1, "distance": 1.0, "client": "",
        "driving": 1.0, "link": 1.0, "reading": {"u1": 1.0},
        "mission": {
            "goals": {"block taken": 1.0}, "result": "failed", "reason": "", "helped": False,
            "end": {"time": 1.0, "distance": 1.0, "commands": 1, "contacts": 1, "driving": 1.0, "link": 1.0,
                    "reading": {}},
        },
    },
)  # fmt: skip


def number_places(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Keys that lead to each number within a JSON value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, each in items:
        yield from number_places(each, (*place, key))
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield place


def changed(line: dict[str, Any], place: tuple[Any, ...], value: Any) -> dict[str, Any]:
    found = inner = copy.deepcopy(line)
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    return found


def is_line(line: dict[str, Any]) -> bool:
    return not isinstance(decode_line(json.dumps(line).encode(), 2), BrokenLine)


def test_numbers_of_lines_have_the_limits_that_were_kept() -> None:
    found = {}
    for line in LINES:
        whole = {"t": 0.5, "real": 0.5, **line}
        assert is_line(whole), line
        for place in number_places(whole):
            allowed = [is_line(changed(whole, place, number)) for number in NUMBERS]
            name = ".".join(map(str, (line["kind"], *place)))
            found[name] = "".join("+" if each else "-" for each in allowed)
    assert_kept(found, KEPT, "limits")


LEAST: tuple[dict[str, Any], ...] = (
    {"kind": "read", "n": 1, "cmd": "u1"},
    {"kind": "answer", "n": 1, "cmd": "u1", "reply": 1.0, "status": "done", "velocity": {"twist": [1, 2, 3]}},
    {
        "kind": "plan", "n": 1, "cmd": "d1-1", **FROM, "total": [1, 2, 3],
        "contact": {"t": 1.0, "at": [1, 0.5, 0.5], "point": [1.0, 2.0]},
    },
    {"kind": "end", "n": 1, "cmd": "d1-1", **FROM, "total": [1, 2, 3], **POSE},
    {
        "kind": "leg", "n": 1, "cmd": "vx-1", "velocity": [1, 2], "rate": 1, "told": [1, 2, 3], **FROM,
        "to": [1, 2, 3],
    },
    {"kind": "velocity", "reason": "its time was over"},
    {"kind": "action", "n": 1, "action": "reset", "source": "", "arguments": [], "text": "", **POSE},
    {"kind": "belief", "believed": [1.0, 2.0, 3.0], **POSE},
    {"kind": "notice", "about": "fault", "text": ""},
    {"kind": "wire", "data": ""},
    {"kind": "mission", "goal": "block taken", "text": ""},
    {"kind": "program", "exit_code": 1},
    {"kind": "twin", "cmd": "u1", "code": "u1", "robot": 1.0, "simulated": 1.0},
    {key: value for key, value in LINES[-1].items() if key not in ("driving", "link", "reading", "mission")},
)  # fmt: skip


def test_fields_that_a_line_leaves_out_have_the_values_that_were_kept() -> None:
    found = [decode_line(json.dumps({"t": 0.5, **line}).encode(), 2) for line in LEAST]
    assert_kept(found, KEPT, "defaults")


@pytest.mark.parametrize(
    ("line", "whole"),
    [
        *(({**LINES[place], "begin": 0.5}, True) for place in (2, 3, 5)),
        *(({**LINES[place], "begin": 0.6}, False) for place in (2, 3, 5)),
        ({**LINES[4], "end": 0.5}, True),
        ({**LINES[4], "end": 0.4}, False),
        ({**LINES[4], "end": None}, True),
        ({**LINES[7], "arguments": []}, False),
        ({**LINES[7], "arguments": [], "refused": True}, True),
        ({**LINES[7], "arguments": [1.0, 2.0]}, False),
        ({**LINES[8], "particles": [[1], [2]]}, True),
        ({**LINES[8], "particles": []}, True),
        ({**LINES[8], "particles": [[1]]}, False),
        ({**LINES[8], "particles": [[1], [2], [3], [4]]}, False),
        ({**LINES[8], "particles": [[1, 1], [2, 2], [3, None]]}, True),
        ({**LINES[8], "particles": [[1, 1], [2, None], [3, 3]]}, False),
        ({**LINES[8], "particles": [[None, 1], [2, 2], [3, 3]]}, False),
        ({**LINES[8], "particles": [[1, 1], [2, 2], [3]]}, False),
        ({**LINES[11], "result": "failed"}, False),
        ({"kind": "mission", "text": ""}, False),
        ({"kind": "mission", "text": "", "result": "failed"}, True),
    ],
)
def test_fields_of_a_line_fit_together(line: dict[str, Any], whole: bool) -> None:
    assert is_line({"t": 0.5, **line}) == whole


# -- read back ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def configuration() -> Configuration:
    return load_default()


Reasons = Callable[..., list[str]]


@pytest.fixture
def reasons(start_run: StartRun, configuration: Configuration) -> Reasons:
    """Reads lines after the header, and gives the reasons for broken ones."""

    def read(*lines: dict[str, Any]) -> list[str]:
        path = start_run().path
        head = path.read_text().splitlines()[0]
        path.write_text("\n".join([head, *(json.dumps({"t": 0.0, **line}) for line in lines)]) + "\n")
        with LogReader(path, configuration) as log:
            return [each.reason for each in log if isinstance(each, BrokenLine)]

    return read


LEG = {"kind": "leg", "n": 1, "cmd": "vv-1;0;0", "velocity": [0.0, 0.0], "rate": 0.0, "told": [1.0, 0.0, 0.0]}
LEG["from"] = [9.5, 42.0, 0.0]
DIAGONAL = math.hypot(96.0, 48.0)


@pytest.mark.parametrize(
    ("fields", "leads_out"),
    [
        ({"to": [96.0009, 48.0009, 0.0]}, False),
        ({"to": [-0.0009, -0.0009, 0.0]}, False),
        ({"to": [96.0 + 1e-3, 48.0 + 1e-3, 0.0]}, False),
        ({"to": [-1e-3, -1e-3, 0.0]}, False),
        ({"to": [96.0011, 24.0, 0.0]}, True),
        ({"to": [-0.0011, 24.0, 0.0]}, True),
        ({"to": [48.0, 48.0011, 0.0]}, True),
        ({"to": [48.0, -0.0011, 0.0]}, True),
        ({"velocity": [0.6, 0.8], "end": DIAGONAL + 0.0009}, False),
        ({"velocity": [0.6, 0.8], "end": DIAGONAL + 0.0011}, True),
        ({"velocity": [1.0, 0.0], "end": DIAGONAL + 1e-3}, False),
        ({"velocity": [0.0, 1.0]}, True),
        ({"velocity": [1.0, 0.0], "t": 500.0, "end": 500.0 + DIAGONAL}, False),
        ({"rate": 1.0}, True),
        ({"rate": 1.0, "end": 90.0 + 1e-3}, False),
        ({"rate": 1.0, "end": 90.0011}, True),
        ({"rate": -1.0, "t": 50.0, "end": 140.0011}, True),
        ({}, False),
    ],
)
def test_a_leg_stays_in_the_maze(reasons: Reasons, fields: dict[str, Any], leads_out: bool) -> None:
    ends = {"begin": fields.get("t", 0.0), "t": fields.get("end", 1e12), "pose": fields.get("to")}
    found = reasons({**LEG, "to": [48.0, 24.0, 0.0], **fields})
    if "end" in fields or "to" in fields:
        ended = {**LEG, "kind": "leg_end", **fields, **ends}
        assert reasons({**ended, "pose": ends["pose"] or [48.0, 24.0, 0.0]}) == found
    assert found == ["the leg of 'vv-1;0;0' leads out of the maze"] * leads_out


READ = {"kind": "read", "n": 1, "cmd": "u1", "reply": 1.0}
PLAN = {"kind": "plan", "n": 1, "cmd": "d1-3", "from": [9.5, 42.0, 0.0], "total": [3.0, 0.0, 0.0]}
END = {**PLAN, "kind": "end", "begin": 0.0, "pose": [12.5, 42.0, 0.0], "t": 0.5}
STAY = {**LEG, "to": [9.5, 42.0, 0.0]}
CONTACT = {"t": 0.2, "at": [0, 0.5, 0.5], "point": [1.0, 2.0]}


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([READ], []),
        ([{**READ, "cmd": "zz"}], ["zz reads no sensor of the log's configuration"]),
        ([{**READ, "cmd": "d1-3"}], ["d1-3 reads no sensor of the log's configuration"]),
        ([{key: READ[key] for key in ("kind", "n", "cmd")}], ["it has neither a reply nor a scan"]),
        ([PLAN], []),
        ([{**END, "cmd": "u1"}], ["u1 moves nothing in the log's configuration"]),
        ([{**END, "cmd": "d1-"}], ["d1- has no value: the value is missing, as in d1-3"]),
        ([{**END, "cmd": "d1-5.9e12"}], []),
        ([{**END, "cmd": "d1-6.1e12"}], ["d1-6.1e12 takes too long"]),
        ([{**END, "cmd": "d1--6.1e12"}], ["d1--6.1e12 takes too long"]),
        ([{**END, "stop": [0, 0.5, 0.5]}], []),
        ([{**END, "stop": [1, 0.5, 0.5]}], ["the rest of a movement has one segment"]),
        ([{**END, "contact": {**CONTACT, "at": [9, 0.5, 0.5]}}], []),
        ([{**END, "contact": {**CONTACT, "at": [10, 0.5, 0.5]}}], ["the movement has no segment 10"]),
        ([PLAN, END], []),
        ([END], []),
        ([PLAN, PLAN, {**END, "n": 2}], []),
        ([{**END, "begin": 0.6}], ["it ends before it begins"]),
        ([{**PLAN, "cmd": "u1"}], ["u1 moves nothing in the log's configuration"]),
    ],
)  # fmt: skip
def test_a_line_fits_those_before_it(reasons: Reasons, lines: list[dict[str, Any]], said: list[str]) -> None:
    assert reasons(*lines) == said


# -- run again ---------------------------------------------------------------------------------------


def changes_of(name: str, value: Any) -> list[Any]:
    """Other values of a field."""
    if name == "status":
        return [each.value for each in Status if each.value != value]
    if name == "cmd":
        return [f"{value}1"]
    nothing = [None] if name in ("contact", "taken", "true") else []
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int | float):
        return [value + 1, *nothing]
    if isinstance(value, list) and value:
        return [[value[0] + 1, *value[1:]], [*value[:-1], value[-1] + 1]]
    return nothing


def said_of(path: Path) -> str:
    """The message of a rerun of a log, with rounded numbers."""
    try:
        with Rerun(path) as run:
            for _ in run.steps():
                pass
            said = "; ".join([str(run.difference), *run.notes])
    except RunLogError as error:
        said = str(error).replace(str(path), "LOG")
    return re.sub(r"-?\d+\.\d+", lambda found: f"{float(found[0]):.5g}", said)


@pytest.mark.parametrize("timed", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_what_is_said_of_a_changed_log_is_what_was_kept(
    start_run: StartRun, configuration: Configuration, monkeypatch: pytest.MonkeyPatch, timed: bool
) -> None:
    # It is the same in all of them; reading it takes longer than the rerun.
    monkeypatch.setattr(rerun, "rebuild_to_run", lambda header, folder=None: configuration)
    monkeypatch.setattr("simmer_tui.runlog.reader.rebuild", lambda header: configuration)
    run = start_run(timed=timed)
    run.perform(ActionName.BLOCK, 30.0, 45.0)
    run.perform(ActionName.TELEPORT, -5.0, 42.0, 90.0)
    run.send("u1", "d1-70", "zz", "d1-x")
    if timed:
        run.loop.run_until(run.loop.now + 1.0)
        run.perform(ActionName.STOP)
    run.send("i1", "vr-9", "wt-0.5", "d1-0")
    stop = replace(parse_command("xx"), stops=True)
    run.session.submit(stop, lambda outcome: None)
    run.engine.refuse(stop)
    run.send("vr-9")
    run.loop.run_until(run.loop.now + 1.0)
    run.session.close()
    run.log.close()
    whole = run.path.read_text().splitlines()
    assert said_of(run.path) == "None"
    found: dict[str, list[str]] = {}
    for number, line in enumerate(whole[1:], 1):
        fields = json.loads(line)
        if timed and fields["kind"] not in ("plan", "end"):
            continue  # they are the same in both
        for name, value in fields.items():
            if name in ("kind", "real", "source", "text", "velocity", "rate", "told", "reason"):
                continue  # a rerun reads none of them
            for new in changes_of(name, value):
                changes = [json.dumps({**fields, name: new})]
                run.path.write_text("\n".join([*whole[:number], *changes, *whole[number + 1 :]]) + "\n")
                place = f"{number + 1} {fields['kind']} {name}"
                found[place] = [*found.get(place, []), said_of(run.path)]
    assert_kept(found, KEPT, "timed" if timed else "instant")


@pytest.mark.parametrize(
    ("place", "off", "differs"),
    [
        *((0, 1.1e-8, False), (0, 1.4e-8, True), (0, -1.1e-8, False), (0, -1.4e-8, True)),
        *((2, 0.9e-9, False), (2, 1.1e-9, True), (2, -0.9e-9, False), (2, -1.1e-9, True)),
    ],
)
def test_numbers_of_another_machine_are_equal_within_a_billionth(
    varied_log: Path, place: int, off: float, differs: bool
) -> None:
    """Absolutely or relatively: the robot is at x = 12.2 in, with a heading of 0.2 degrees."""
    lines = varied_log.read_text().splitlines()
    header, movement = json.loads(lines[0]), json.loads(lines[10])
    movement["pose"][place] += off
    lines[0], lines[10] = json.dumps({**header, "mathematics": "0123"}), json.dumps(movement)
    varied_log.write_text("\n".join(lines) + "\n")
    assert ("line 11, command 'd1-3': pose is" in said_of(varied_log)) == differs


@pytest.mark.parametrize(("name", "shown"), [("m" * 40, "m" * 40), ("m" * 41, "m" * 37 + "...")])
def test_notes_of_a_rerun_say_where_the_log_is_from(varied_log: Path, name: str, shown: str) -> None:
    lines = varied_log.read_text().splitlines()
    taken_over = {"log": "other.jsonl", "line": 3, "elapsed": 1.5}
    lines[0] = json.dumps({**json.loads(lines[0]), "mathematics": name, "taken_over": taken_over})
    varied_log.write_text("\n".join(lines) + "\n")
    with Rerun(varied_log) as run:
        first, second = run.notes
        assert not run.same_machine
    assert first == (
        f"the log was written on a machine with other mathematics ({shown}, here {math_fingerprint()}): the "
        "last bits of its sines differ, so numbers count as equal within 1e-09"
    )
    assert second == "the run took over from other.jsonl at 1.50 s; it is compared from its beginning"


# -- the order of a rerun ----------------------------------------------------------------------------


def record(**fields: Any) -> AnyRecord:
    found = decode_line(json.dumps(fields).encode(), 2)
    assert not isinstance(found, BrokenLine), found
    return found


def reading(number: int, t: float, taken: float | None = None) -> AnyRecord:
    return record(kind="read", n=number, t=t, taken=taken, cmd="u1", reply=1.0)


def action(name: str, t: float, number: int, *arguments: float) -> AnyRecord:
    pose = [0.0, 0.0, 0.0]
    return record(
        kind="action", action=name, t=t, n=number, source="", arguments=arguments, text="", pose=pose
    )


@pytest.fixture
def order(configuration: Configuration) -> Callable[..., InOrder]:
    """In timed motion, with a reading of 0.4 s and a link of 0.15 s at most, unless told otherwise."""

    def make(motion: str = "timed", scale: float = 2.0) -> InOrder:
        settings = configuration.settings
        first, *rest = configuration.simulation.sensors
        sensors = (replace(first, read_time=0.4), *rest)
        link = replace(settings.link, latency=0.1, jitter=0.05)
        moves = replace(settings.motion, motion=motion, time_scale=scale)
        simulation = replace(configuration.simulation, sensors=sensors)
        return InOrder(
            replace(configuration, settings=replace(settings, link=link, motion=moves), simulation=simulation)
        )

    return make


def numbers(taken: Iterator[tuple[int, AnyRecord]]) -> list[int]:
    return [line for line, _ in taken]


def test_records_come_in_the_order_in_which_their_commands_began(order: Callable[..., InOrder]) -> None:
    held = order()
    assert numbers(held.take(2, reading(2, 5.3, 5.2))) == [], "the first is still to come"
    assert numbers(held.take(3, reading(1, 5.4, 5.1))) == []
    assert numbers(held.take(4, record(kind="wire", data="", t=5.2))) == []
    assert numbers(held.take(5, reading(3, 5.5))) == []
    assert numbers(held.rest()) == [3, 2, 4, 5]


@pytest.mark.parametrize(
    ("motion", "scale", "begins", "late"),
    [
        ("timed", 2.0, (), 2.55),
        ("timed", 0.5, (), 1.05),
        ("timed", 0.5, (3.0,), 3.55),
        ("timed", 2.0, (1.0,), 2.55),
    ],
)
def test_a_record_is_held_as_long_as_an_earlier_one_may_come(
    order: Callable[..., InOrder], motion: str, scale: float, begins: tuple[float, ...], late: float
) -> None:
    """A reading, the link and a second of real time at the greatest speed so far."""
    held = order(motion, scale)
    lines = [line for each in begins for line in numbers(held.take(2, action("speed", 0.0, 0, each)))]
    assert lines == []
    assert numbers(held.take(3, reading(1, 10.0))) == [2] * len(begins)
    assert numbers(held.take(4, record(kind="wire", data="", t=9.9 + late))) == []
    assert numbers(held.take(5, record(kind="wire", data="", t=10.1 + late))) == [3]


def test_in_instant_motion_records_are_in_order_but_for_waits(order: Callable[..., InOrder]) -> None:
    held = order("instant")
    assert numbers(held.take(2, reading(1, 1.0))) == [2]
    assert numbers(held.take(3, reading(3, 2.0))) == []
    assert numbers(held.take(4, reading(2, 9.0, 1.5))) == [4, 3]
    assert numbers(held.take(5, action("reset", 0.0, 0))) == [5]
    assert numbers(held.take(6, reading(1, 0.5))) == [6]


# -- run again up to a moment ------------------------------------------------------------------------


def up_to(path: Path, last: int, time: float) -> Simulator:
    with Rerun(path) as run:
        for _ in run.until(last, time):
            pass
        return run.simulator


@pytest.mark.parametrize(
    ("time", "moving"), [(0.2, True), (0.4999, True), (0.5, False), (0.5 + 1e-12, False), (0.7, False)]
)
def test_a_movement_at_the_moment_is_still_under_way(start_run: StartRun, time: float, moving: bool) -> None:
    run = start_run()
    run.send("d1-3", "u1")
    run.log.close()
    simulator = up_to(run.path, 2, time)
    assert (simulator.moving, simulator.commands) == (moving, 1)
    assert simulator.time == pytest.approx(max(time, 0.5) if not moving else time)


def test_a_run_up_to_a_moment_needs_its_beginning_and_the_same_numbers(start_run: StartRun) -> None:
    run = start_run()
    run.send("u1")
    run.log.close()
    header, line = map(json.loads, run.path.read_text().splitlines())
    run.path.write_text(f"{json.dumps({**header, 'number': 2})}\n{json.dumps(line)}\n")
    with pytest.raises(RunLogError, match=r"begins after 2 commands: what was before is not known$"):
        up_to(run.path, 2, 0.0)
    for program, shown in (("p" * 40, "p" * 40), ("p" * 41, "p" * 37 + "...")):
        changed_header = json.dumps({**header, "program": program})
        run.path.write_text(f"{changed_header}\n{json.dumps({**line, 'reply': 1.0})}\n")
        with pytest.raises(RunLogError, match=rf"\(written by simmer-tui {re.escape(shown)}, this is "):
            up_to(run.path, 2, 0.0)
    run.path.write_text(f"{json.dumps(header)}\n{json.dumps({**line, 'reply': 1.0})}\n")
    with pytest.raises(
        RunLogError, match=r"does not repeat exactly: line 2, command 'u1': reply is 1.0 in the"
    ):
        up_to(run.path, 2, 0.0)
