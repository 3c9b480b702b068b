"""Warnings about a set: values that are valid, but perhaps unexpected for its author."""

from collections.abc import Iterator

from simmer_tui.config.loader import Configuration
from simmer_tui.config.reply_formats import NUMBER_SIZES
from simmer_tui.config.settings import BITS_OF_A_BYTE, USUAL_BAUD
from simmer_tui.sim.distance_errors import stretches_per_second
from simmer_tui.sim.maze import looks_inverted
from simmer_tui.sim.sensors import LidarSpec

# SLAMTEC's data sheet of the RPLIDAR A1M8: 8000 samples a second.
MOST_RAYS_A_SECOND = 8000
"""Rays a second above which a lidar exceeds those of the public teams."""
# Programs of packet dialects call recv(1024) once: 140 rays of 7 characters.
MOST_IN_A_PACKET = 150
"""Most rays of a packet that one such call reads completely."""
_SLOW_LINK = "hc-05"
# Judged: a robot whose program waits so long for each scan drives past the things it should see.
_LONG = 0.5
"""Seconds on a real robot's line from which a scan is slow."""

# Measured: 0.05 ms each in an empty maze. A tenth of a core is left for one robot on a page or in trials.
MOST_STRETCHES = 2000
"""Stretches of errors a simulated second above which continuous motion takes much of a processor."""


def set_warnings(configuration: Configuration) -> tuple[str, ...]:
    """The warnings about a set, each a line."""
    return (*_inverted(configuration), *_lidars(configuration), *_stretches(configuration))


def _inverted(configuration: Configuration) -> Iterator[str]:
    if looks_inverted(configuration.simulation.maze):
        yield (
            "maze.csv seems to have 1 for a wall, as those of other courses; here 0 is a wall and 1 is free. "
            "If so, exchange them: sed -i.old y/01/10/ maze.csv"
        )


def _stretches(configuration: Configuration) -> Iterator[str]:
    spec = configuration.simulation
    stretches = stretches_per_second(spec.drives, spec.num_segments)
    if stretches > MOST_STRETCHES and any(each.enabled for each in spec.velocities):
        most = int(spec.num_segments * MOST_STRETCHES / stretches)
        yield (
            f"num_segments = {spec.num_segments} cuts continuous motion into up to {stretches:,.0f} parts a "
            f"second, which may be slower than real time: --num-segments {most} has {MOST_STRETCHES:,}"
        )


def _lidars(configuration: Configuration) -> Iterator[str]:
    settings = configuration.settings
    server = settings.server
    for sensor in configuration.simulation.sensors:
        if not (sensor.enabled and isinstance(sensor, LidarSpec)):
            continue
        samples = sensor.rays * sensor.scan_rate
        if samples > MOST_RAYS_A_SECOND:
            yield (
                f"{sensor.id} takes {samples:g} ranges a second (Rays times Scan Rate); lidars of the public "
                f"teams take at most {MOST_RAYS_A_SECOND}"
            )
        if sensor.rays > MOST_IN_A_PACKET and "packets" in server.listeners:
            yield (
                f"{sensor.id} has {sensor.rays} rays, and a packet of more than {MOST_IN_A_PACKET} is not "
                "read by one recv(1024): read on up to the closing bracket, or set Rays lower"
            )
        size = NUMBER_SIZES.get(server.reply_format, 0)
        if settings.link_profile == _SLOW_LINK and size and "binary" in server.listeners:
            seconds = (sensor.rays + 1) * size * BITS_OF_A_BYTE / USUAL_BAUD
            yield (
                f"a scan of {sensor.id} takes {seconds:.1f} s at the {_SLOW_LINK}'s {USUAL_BAUD} baud, of "
                "which the simulated link knows nothing: set Rays lower, or ask for single rays"
            )
        serial = settings.serial
        size = NUMBER_SIZES.get(
            serial.robot_reply if serial.robot_reply != "same" else server.reply_format, 0
        )
        seconds = (sensor.rays + 1) * size * BITS_OF_A_BYTE / serial.baud
        if serial.port and seconds > _LONG:
            yield (
                f"a scan of {sensor.id} takes {seconds:.1f} s from {serial.port} at {serial.baud} baud: set "
                "a higher rate here (--baud) and on the robot, or let it answer in float32 or with fewer rays"
            )
