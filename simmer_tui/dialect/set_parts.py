"""The sensors and commands of a set, as a dialect needs them."""

from collections.abc import Sequence
from functools import cached_property

from msgspec import Struct

from simmer_tui.sim.specs import DriveSpec, GripperSpec, SensorSpec, VelocityKind, VelocitySpec
from simmer_tui.sim.velocity_commands import WAIT


class Parts(Struct, frozen=True, dict=True):
    """The parts of a set that a dialect may use. What follows from them is computed once."""

    sensors: Sequence[SensorSpec] = ()
    drives: Sequence[DriveSpec] = ()
    gripper: GripperSpec | None = None
    velocities: Sequence[VelocitySpec] = ()

    @cached_property
    def readable(self) -> frozenset[str]:
        """Codes of the sensors."""
        return frozenset(each.code for each in self.sensors if each.enabled)

    @cached_property
    def yes_or_no(self) -> frozenset[str]:
        """Codes of the sensors that read 1 or 0."""
        return frozenset(each.code for each in self.sensors if each.enabled and each.is_yes_or_no)

    @cached_property
    def lidars(self) -> dict[str, SensorSpec]:
        """The sensors whose reading is a list of numbers, by code."""
        return {each.code: each for each in self.sensors if each.enabled and each.kind.is_scan}

    @cached_property
    def behind(self) -> dict[str, tuple[str, ...]]:
        """The codes of the sensors that ray, scan and contact read, as far as there are any."""
        found: dict[str, tuple[str, ...]] = {}
        for sensor in self.sensors:
            for function in sensor.kind.dialect_functions if sensor.enabled else ():
                found[function] = (*found.get(function, ()), sensor.code)
        return found

    @cached_property
    def speeds(self) -> dict[str, tuple[float, float, float]]:
        """The velocity of each drive at its Speed, by code: x and y in in/s, rotation in deg/s."""
        found = {}
        for drive in self.drives:
            if drive.enabled:
                direction = drive.kind.direction
                found[drive.code] = (
                    *(direction.x * drive.speed, direction.y * drive.speed),
                    direction.r * drive.speed,
                )
        return found

    @cached_property
    def velocity(self) -> str:
        """Code of the command that sets the whole velocity; empty if the set has none."""
        rows = (each.code for each in self.velocities if each.enabled and each.kind is VelocityKind.ALL)
        return next(rows, "")

    @cached_property
    def commands(self) -> frozenset[str]:
        """Codes of all commands that a step may have."""
        codes = {WAIT, *self.speeds, *(each.code for each in self.velocities if each.enabled)}
        return frozenset(codes | ({self.gripper.code} if self.gripper and self.gripper.enabled else set()))
