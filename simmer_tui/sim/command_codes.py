"""Command codes of a robot in words: a code of its own for each sensor, drive and velocity, and `wt`."""

from simmer_tui.sim.specs import SimulationSpec
from simmer_tui.sim.velocity_commands import WAIT


def code_meanings(spec: SimulationSpec, *, all_rows: bool = True) -> dict[str, str]:
    """The meanings of a robot's command codes in a few words, by code: sensors, drives, gripper, velocities
    and `wt`. Rows that are switched off are left out with `all_rows` false."""
    meanings = {each.code: each.id for each in spec.sensors if all_rows or each.enabled}
    meanings |= {each.code: each.kind.meaning for each in spec.drives if all_rows or each.enabled}
    gripper = spec.gripper
    if gripper is not None and (all_rows or gripper.enabled):
        meanings[gripper.code] = "gripper: 1 closes, 0 opens"
    lasting = (each for each in spec.velocities if all_rows or each.enabled)
    meanings |= {each.code: f"{each.kind.value}: a velocity that lasts" for each in lasting}
    # A set may have a row of that code: then it does not wait.
    meanings.setdefault(WAIT, "wait so many seconds")
    return meanings
