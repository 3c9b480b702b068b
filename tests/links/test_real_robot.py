"""Results of a real robot: the twin's, but for what only the simulator knows."""

from __future__ import annotations

import math

import pytest
from msgspec import structs
from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.links.real_robot import as_real, real_reading
from simmer_tui.sim import CommandResult, Simulator, Status, parse_command
from simmer_tui.sim.records import Reading

OF_THE_TWIN = (
    *("number", "time", "command", "status", "before", "pose", "reason", "trajectory", "grip", "taken"),
    *("link", "velocity", "waits"),
)


class KnowingResult(CommandResult, frozen=True, gc=False):
    """A result with a field more, which only a simulator can fill in."""

    only_simulated: float | None = None


class KnowingReading(Reading, frozen=True):
    only_simulated: float | None = None


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return Simulator(load_default().simulation, seed=3)


@pytest.mark.parametrize("text", ["u1", "d1-3", "vv-1;0;0", "wt-1", "zz"])
def test_a_result_is_the_twins_with_the_robots_reply(simulator: Simulator, text: str) -> None:
    twin = replace(simulator.execute(parse_command(text)), link=0.25, taken=0.125)
    reading = None if twin.reading is None else real_reading(twin.reading, 4.5)
    real = as_real(twin, reply=4.5, reading=reading)
    assert (real.reply, real.reading) == (4.5, reading)
    assert {name for name in OF_THE_TWIN if getattr(real, name) is not getattr(twin, name)} == set()
    unanswered = as_real(twin, reply=math.nan, status=Status.UNANSWERED, reason="none")
    assert (unanswered.status, unanswered.reason, unanswered.reading) == (Status.UNANSWERED, "none", None)
    assert math.isnan(unanswered.reply)


def test_a_field_that_only_the_simulator_knows_is_not_the_robots(simulator: Simulator) -> None:
    twin = simulator.execute(parse_command("u1"))
    assert twin.reading is not None
    inner = KnowingReading(**structs.asdict(twin.reading), only_simulated=7.4)
    knowing = KnowingResult(**{**structs.asdict(twin), "reading": inner}, only_simulated=7.4)
    real = as_real(knowing, reply=4.5, reading=real_reading(inner, 4.5))
    assert type(real) is CommandResult
    assert type(real.reading) is Reading
    assert (real.reading.value, real.reading.true) == (4.5, twin.reading.true)
