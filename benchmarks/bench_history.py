"""Memory of a run's history, live, and its share of the time of a command.

    python benchmarks/bench_history.py [--commands N]

A real run's events are applied again and again to a reducer with a history, with increasing numbers and
times. Goal: at most 30 MB at 200,000 commands and not more after them, for every kind of run.
"""

from __future__ import annotations

import argparse
import json
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Belief, CommandResult, Event, MovementEnded, MovementPlanned
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import Pose, Simulator, parse_command

RUNS = {
    "readings": ("u1", "u2", "u3", "u4", "i1", "g1", "o1", "c1"),
    "readings and movements": ("u1", "u2", "u3", "u4", "i1", "g1", "o1", "c1", "d1-2", "r1-25"),
    "movements into walls": ("d1-20", "r1-25"),
    "refusals": ("zz", "d1-"),
    "a belief a command": ("u1", "belief"),
}


def events_of(pattern: tuple[str, ...]) -> list[Event]:
    """Events of a simulator that did some hundred commands."""
    simulator = Simulator(load_default().simulation, 7)
    engine = Engine(simulator)
    told: list[Event] = []
    engine.watch(told.append)
    session = engine.session()
    for text in pattern * (600 // len(pattern)):
        if text == "belief":
            pose = simulator.pose
            engine.tell(Belief(simulator.time, Pose(pose.x + 1.0, pose.y, pose.heading), pose, 0.5))
        else:
            session.submit(parse_command(text), lambda outcome: None)
    return told


def laps(events: list[Event], commands: int) -> Callable[[Reducer], None]:
    """Function that applies the events again and again, up to a number of commands."""

    def apply(reducer: Reducer) -> None:
        done = 0
        while done < commands:
            for event in events:
                if isinstance(event, CommandResult):
                    done += 1
                    event = replace(event, number=done)
                elif isinstance(event, MovementPlanned | MovementEnded):
                    event = replace(event, number=done + 1)
                reducer.apply(event)

    return apply


def measured(pattern: tuple[str, ...], commands: int) -> tuple[float, float]:
    """Megabytes of the history, and microseconds of a core that it adds to a command."""
    events = events_of(pattern)
    run = laps(events, commands)
    checkpoint = checkpoint_of(Simulator(load_default().simulation, 7))
    seconds = []
    for history in (None, RunHistory(checkpoint)):
        reducer = Reducer(checkpoint, history=history)
        begin = time.process_time()
        run(reducer)
        seconds.append(time.process_time() - begin)
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        reducer = Reducer(checkpoint, history=RunHistory(checkpoint))
        run(reducer)
        memory = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    return memory / 1e6, 1e6 * (seconds[1] - seconds[0]) / commands


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--commands", type=int, help="default 220,000")
    parser.add_argument("--quick", action="store_true", help="fewer commands")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    options = parser.parse_args()
    # A tenth more than are kept, so that the oldest rows are dropped.
    commands = options.commands or (20_000 if options.quick else 220_000)
    figures = {}
    print(f"{commands:,} commands    MB   us a command")
    for name, pattern in RUNS.items():
        memory, seconds = measured(pattern, commands)
        figures[name] = {"MB": memory, "us a command": seconds}
        print(f"{name:22} {memory:6.1f} {seconds:8.2f}")
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
