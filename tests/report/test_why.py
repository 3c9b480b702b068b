"""Why the last movement ended as it did."""

from __future__ import annotations

import asyncio
import re

import pytest
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.config.loader import load
from simmer_tui.config.sets import MISSION_SET, bundled_sets
from simmer_tui.report.why import why
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Action, ActionName
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import SimulationSpec, Simulator, parse_command
from simmer_tui.tui.event_text import reply_text


class Run:
    def __init__(self, spec: SimulationSpec, *, timed: bool = False) -> None:
        self.spec = spec
        self.simulator = Simulator(spec, 4)
        self.simulator.advance(100.0)
        self.engine = Engine(self.simulator, timed=timed)
        self.reducer = Reducer(checkpoint_of(self.simulator))
        self.engine.watch(self.reducer.apply)
        self.session = self.engine.session(answer_at_end=False)

    def give(self, *commands: str) -> str:
        for command in commands:
            self.session.submit(parse_command(command), lambda outcome: None)
        return self.why

    @property
    def why(self) -> str:
        return "; ".join(f"{fact.label} {fact.text}" for fact in why(self.reducer.at(), self.spec))


@pytest.fixture
def run() -> Run:
    return Run(load_default().simulation)


def test_before_the_first_movement_there_is_nothing_to_say(run: Run) -> None:
    assert run.give("u1") == ""
    run.give("d1-2")
    run.engine.perform(Action(ActionName.RESET))
    assert run.why == ""


def test_a_movement_that_nothing_stopped(run: Run) -> None:
    said = run.give("d1-2")
    assert said.startswith("asked 2.0 in forward; went forward 1.7 in; errors bias -")
    assert said.endswith("; ended as asked; nothing in its way")
    assert run.give("r1--20").startswith("asked turn by -20.0 deg; went turned -")


def test_a_velocity_that_met_a_wall_is_a_movement_to_explain(run: Run) -> None:
    run.give("d1-2", "r1-90")
    said = run.give("vv-6;0;0", "wt-2", "vv-0;0;0")
    assert said.startswith("went ")
    assert "(X); hit the maze's outer wall at " in said
    ended = run.reducer.at().ended
    assert ended is not None
    assert ended.command.text == "vv-6;0;0"
    last = run.reducer.at().last
    assert last is not None
    assert reply_text(last, ended) == "standing"
    run.give("vv--6;0;0", "wt-0.5", "vv-0;0;0")
    assert run.why == said, "a velocity that meets nothing has no end of its own"
    assert run.give("d1--1").startswith("asked 1.0 in back")


@pytest.mark.parametrize("command", ["d1-20", "d1--20", "w1-5", "r1-40", "r1--40"])
def test_the_parts_of_the_error_add_up_to_it(run: Run, command: str) -> None:
    """Bias and noise along the way are all that parts what was asked from what became of it."""
    run.engine.perform(Action(ActionName.TELEPORT, (30.0, 8.0, 0.0)))
    said = run.give(command)
    assert "errors bias" in said, said
    bias, noise = (float(each) for each in re.findall(r"[+-]\d+\.\d", said.partition("errors")[2])[:2])
    kind, _, value = command.partition("-")
    ended = run.reducer.at().ended
    assert ended is not None
    totals, sign = ended.trajectory.totals, -1.0 if float(value) < 0 and kind != "r1" else 1.0
    went = {"d1": totals.x, "w1": totals.y, "r1": totals.r}[kind]
    assert sign * (went - float(value)) == pytest.approx(bias + noise, abs=0.11)
    assert "-0.0" not in said
    run.engine.perform(Action(ActionName.NOISE, (0.0,)))
    run.engine.perform(Action(ActionName.TELEPORT, (30.0, 8.0, 0.0)))
    said = run.give(command)
    assert "errors" not in said or re.search(r"noise [+-]0\.0", said), said


def test_a_wall_is_named_with_what_the_sensor_that_looks_there_had_read(course_spec: SimulationSpec) -> None:
    run = Run(course_spec)
    said = run.give("u1", "w1-30")  # to the maze's upper side
    assert said.startswith("asked 30.0 in left; went 3.0 in, stopped by a wall left (X); ")
    assert "hit the maze's outer wall at (9.5, 48.0)" in said
    assert said.endswith("errors exact drives would have hit it too")
    code = "u2"  # at 45 degrees: nearest to straight left
    assert f"{code}, 45 deg beside it, was not read" in said
    assert re.search(
        rf"{code}, 45 deg beside it, read \d+\.\d in, \d\.\d s before", run.give("s1-2", "u2", "w1-30")
    )


def test_a_wall_inside_the_maze_is_named_by_its_cell(course_spec: SimulationSpec) -> None:
    run = Run(replace(course_spec, bot_center=(30.0, 42.0)))
    run.give("d1-100")
    contact = run.reducer.at().contact
    assert contact is not None
    assert contact.cell is not None
    row, column = contact.cell
    assert f"the wall in row {row}, column {column} at " in run.why


def test_who_stopped_it_is_said(course_spec: SimulationSpec) -> None:
    async def play() -> str:
        run = Run(course_spec, timed=True)
        run.engine.start(asyncio.get_running_loop())
        run.give("d1-12")
        run.engine.perform(Action(ActionName.STOP, source="keys"))
        return run.why

    said = asyncio.run(play())
    assert re.search(r"went forward \d\.\d in; ended stopped by stop from keys at 10\d\.\d\d s$", said)


def test_the_gripper_says_what_it_holds() -> None:
    run = Run(load(bundled_sets()[MISSION_SET], {}).simulation)
    gripper = run.spec.gripper
    assert gripper is not None
    assert "holds nothing" in run.give(f"{gripper.code}-1")
    assert "opened the gripper" in run.give(f"{gripper.code}-0")
