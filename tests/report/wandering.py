"""Runs in this process of a robot that wanders about and reads its sensors."""

from __future__ import annotations

import math

import numpy as np

from simmer_tui.config.nominal import Nominal
from simmer_tui.robot.engine import Engine
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.run_history import RunHistory
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import SimulationSpec, Simulator, parse_command


def wandered(spec: SimulationSpec, seed: int, nominal: Nominal | None = None) -> RunHistory:
    """The history of a run: 36 movements, each after a look all around. `nominal` is its nominal set."""
    simulator = Simulator(spec, seed)
    engine = Engine(simulator)
    history = RunHistory(checkpoint_of(simulator), nominal=lambda: nominal)
    engine.watch(Reducer(checkpoint_of(simulator), history=history).apply)
    session = engine.session()
    replies: list[float] = []

    def ask(text: str) -> float:
        session.submit(parse_command(text), lambda outcome: replies.append(outcome.reply))
        return replies[-1]

    random = np.random.default_rng(seed)
    codes = [each.code for each in spec.sensors]
    ahead, back, aside, turn = _codes(spec)
    for step in range(36):
        for code in codes:
            ask(code)
        if step % 3 == 1 and aside:
            ask(f"{random.choice(aside)}-{random.uniform(0.5, 2.0):.2f}")
        elif step % 3 == 2:
            ask(f"{turn}-{random.uniform(-90, 90):.1f}")
        else:
            # The true way that is free: wandering must go on whatever the fault.
            free = min(simulator.true_ranges(np.array([[*_pose(simulator)]]), [ahead[1]])[0, 0] - 1.0, 6.0)
            ask(f"{ahead[0]}-{max(free, 0.3):.2f}" if free > 0.5 else f"{turn}-{random.uniform(60, 180):.1f}")
            if back and math.isclose(free, 6.0):
                ask(f"{back}-1.5")
    return history


def _pose(simulator: Simulator) -> tuple[float, float, float]:
    return simulator.pose.x, simulator.pose.y, simulator.pose.heading


def _codes(spec: SimulationSpec) -> tuple[tuple[str, str], str, list[str], str]:
    """The drive ahead with the sensor that looks there, those back, aside and around."""
    kinds = {each.kind.value: each.code for each in spec.drives}
    sensor = next(each.code for each in spec.sensors if each.kind.is_range and each.rotation == 0.0)
    aside = [kinds[name] for name in ("up", "down") if name in kinds]
    return (kinds["right"], sensor), kinds.get("left", ""), aside, kinds["rot"]
