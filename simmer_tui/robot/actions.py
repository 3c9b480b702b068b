"""Actions of people on the simulation, beside commands: move robot or block, reset, switch noise off."""

from __future__ import annotations

from collections.abc import Callable

from simmer_tui.config.settings import TIME_SCALES
from simmer_tui.errors import SimmerError
from simmer_tui.run.events import Action, ActionName
from simmer_tui.sim import noise
from simmer_tui.sim.command import counted
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.simulator import Simulator


def apply(simulator: Simulator, action: Action) -> str:
    """Apply an action to the simulator. Returns the sentence that describes the result.

    Actions on the engine alone (`pause`, `resume`, `speed`) change nothing here. Raises PlacementError for a
    place inside a wall, SimmerError for wrong arguments.
    """
    # Checked here, not in the parsers: actions come from keys, the console and logs alike.
    takes, function = _EFFECTS[action.name]
    if len(action.arguments) != takes:
        wanted = counted(takes, "number")
        raise SimmerError(f"{action.name.value} takes {wanted}, not {len(action.arguments)}")
    return function(simulator, *action.arguments)


def argument_count(name: ActionName) -> int:
    """Number of arguments of an action."""
    return _EFFECTS[name][0]


def _reset(simulator: Simulator) -> str:
    simulator.reset()
    return f"back at the start, seed {simulator.seed}"


def _teleport(simulator: Simulator, x: float, y: float, heading: float) -> str:
    # Raises PlacementError where the robot would overlap a wall; nothing has changed then.
    simulator.teleport(Pose(x, y, heading))
    return f"robot at ({x:g}, {y:g}) heading {heading:g}"


def _block(simulator: Simulator, x: float, y: float) -> str:
    simulator.move_block(x, y)
    return f"block at ({x:g}, {y:g})"


def _seed(simulator: Simulator, seed: float) -> str:
    # Arguments are numbers of any kind, as the log has them; numpy takes only whole, positive seeds.
    whole = int(seed) if float(seed).is_integer() else seed
    try:
        simulator.reset(noise.SEEDS.check(whole))
    except ValueError as error:
        raise SimmerError(f"the seed {error}") from None
    return f"back at the start with seed {simulator.seed}"


def _noise(simulator: Simulator, on: float) -> str:
    simulator.noise = bool(on)
    return f"random errors {'on' if on else 'off'}"


def _bias(simulator: Simulator, on: float) -> str:
    # Drawn from the seed: the same seed gives the same biases, in a rerun as well.
    simulator.set_bias(noise.drive_bias(simulator.spec, simulator.seed, random=bool(on)))
    return "random drive bias" if on else "drive bias as in drive.csv"


def _stop(simulator: Simulator) -> str:
    return "stopped" if simulator.stop() else "nothing was moving"


def _pause(_: Simulator) -> str:
    return "paused: commands wait"


def _resume(_: Simulator) -> str:
    return "continues"


def _time_scale(_: Simulator, scale: float) -> str:
    low, high = TIME_SCALES.low, TIME_SCALES.high
    if not low <= scale <= high:
        raise SimmerError(f"the time scale is between {low:g} and {high:g} simulated seconds a second")
    return f"{scale:g} simulated seconds a second"


_EFFECTS: dict[ActionName, tuple[int, Callable[..., str]]] = {
    ActionName.RESET: (0, _reset),
    ActionName.TELEPORT: (3, _teleport),
    ActionName.BLOCK: (2, _block),
    ActionName.SEED: (1, _seed),
    ActionName.NOISE: (1, _noise),
    ActionName.BIAS: (1, _bias),
    ActionName.STOP: (0, _stop),
    ActionName.PAUSE: (0, _pause),
    ActionName.RESUME: (0, _resume),
    ActionName.TIME_SCALE: (1, _time_scale),
}
