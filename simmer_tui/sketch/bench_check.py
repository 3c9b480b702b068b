"""The boards of a set run for a second without a program, and each of their parts read once: for `check`."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

from simmer_tui.config.loader import Configuration
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Event, Notice
from simmer_tui.sim import Simulator
from simmer_tui.sim.command import BOARD_SOURCE, Command, counted, cut
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.parts import analog_counts, echo_length, range_millimetres
from simmer_tui.sketch.sketch_robot import SketchRobot, compile_set, with_boards
from simmer_tui.sketch.wiring import (
    WiredAnalog,
    WiredEncoder,
    WiredGyro,
    WiredLineSensor,
    WiredRanger,
    WiredSonar,
    Wiring,
)

BENCH_TIME = 1.0
"""Simulated seconds for which the boards run."""
_LONGEST_NOTICE = 600
"""Characters of a notice: six tasks that wait for each other, with their lines."""
_SEED = 1
_MICROSECOND = 1000


class _StoppedClock(asyncio.SelectorEventLoop):
    """A loop whose time stands: simulated time passes with the boards alone."""

    def time(self) -> float:
        return 0.0


def bench_lines(configuration: Configuration, wiring: Wiring, problems: list[Problem]) -> Iterator[str]:
    """Lines about a run of the boards, and about a reading of each part at the start.

    Errors of the compiler, and boards that die or hang, go to `problems`. Without a compiler nothing runs.
    """
    configuration = with_boards(configuration)
    simulator = Simulator(configuration.simulation, _SEED)
    engine = Engine(simulator, timed=True)
    clock = _StoppedClock()
    engine.start(clock)
    try:
        yield from _readings(engine, wiring)
        yield from _run(configuration, wiring, engine, problems)
    finally:
        clock.close()


def _run(
    configuration: Configuration, wiring: Wiring, engine: Engine, problems: list[Problem]
) -> Iterator[str]:
    """The lines about a run of the boards."""
    if find_compiler() is None:
        yield "The boards were not run: there is no C++ compiler (simmer-tui doctor)"
        return
    try:
        sketches = compile_set(wiring, configuration.directory)
    except ConfigurationError as error:
        problems += error.problems
        return
    for name, built in sketches.built.items():
        for warning in built.warnings:
            place, _, what = warning.partition(": ")
            problems.append(Problem(place, what or f"a number does not fit ({name})"))
    events: list[Event] = []
    engine.watch(events.append)
    boards = SketchRobot(sketches, engine)
    try:
        reached = 0.0
        while reached < BENCH_TIME:
            reached = boards.run_to(BENCH_TIME)
        sent = bytes(value for _, value in boards.lockstep.sent).decode("latin-1")
    finally:
        boards.close()
    if boards.failed:
        problems.append(Problem(configuration.name, boards.failed))
    start, pose = configuration.simulation.start_pose, engine.simulator.pose
    moved = "the robot stands where it was"
    if (pose.x, pose.y, pose.heading) != (start.x, start.y, start.heading):
        moved = f"the robot is at {pose.x:.1f}, {pose.y:.1f}, {pose.heading:.0f} deg"
    said = "sent nothing to the laptop"
    if sent:
        first = sent.splitlines()[0]
        said = f'sent {counted(len(sent), "byte")} to the laptop, first "{cut(first)}"'
    yield f"The boards ran for {BENCH_TIME:g} s without a program: {said}; {moved}"
    yield from (f"  {cut(event.text, _LONGEST_NOTICE)}" for event in events if isinstance(event, Notice))


def _readings(engine: Engine, wiring: Wiring) -> Iterator[str]:
    """A reading of each part at the start, and what its pin makes of it."""
    units = {each.code: each.unit for each in engine.simulator.spec.sensors}
    for part in wiring.sensors:
        if isinstance(part, WiredEncoder):
            continue
        value = engine.peek(Command(part.code, part.code, source=BOARD_SOURCE)).reply
        unit = units[part.code]
        shown = f"{value:.2f}".rstrip("0").rstrip(".") + (f" {unit}" if unit else "")
        if isinstance(part, WiredSonar):
            made = f"an echo of {echo_length(value) / _MICROSECOND:.0f} us"
        elif isinstance(part, WiredLineSensor):
            made = "HIGH" if (value == 1.0) == part.active_high else "LOW"
        elif isinstance(part, WiredRanger):
            made = f"a range of {range_millimetres(value)} mm"
        elif isinstance(part, WiredGyro):
            rate = engine.simulator.count_rate(part.code)
            made = f"turning at {rate:.2f} deg/s"
        else:
            assert isinstance(part, WiredAnalog)
            made = (
                f"analogRead gives {analog_counts(part, value, wiring.boards[part.board].kind.most_counts)}"
            )
        yield f"{part.label} {part.code}: {shown} at the start, {made}"
    wired = {each.code for each in wiring.sensors if not isinstance(each, WiredEncoder)}
    rows = [each.code for each in engine.simulator.spec.sensors if each.enabled and each.code not in wired]
    if rows:
        yield f"No part of wiring.toml is {', '.join(rows)} of sensors.csv: no sketch can read them"
