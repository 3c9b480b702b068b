"""One sensor in detail: its place, its direction, and its reading."""

from collections.abc import Mapping, Sequence

from simmer_tui.live.snapshot import Snapshot
from simmer_tui.run.state import SensorRow
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.command import counted
from simmer_tui.sim.records import LidarScan
from simmer_tui.sim.scan_rays import extremes
from simmer_tui.sim.sensors import LidarSpec
from simmer_tui.sim.specs import SensorSpec
from simmer_tui.tui.event_text import clock_text
from simmer_tui.tui.gauges import bearing_sign, sparkline, with_unit
from simmer_tui.tui.line_panel import StyledLine, heading
from simmer_tui.tui.readouts import LABEL, fact_line
from simmer_tui.tui.sensor_readouts import age_of_reading

# Inches; the panel shows tenths.
_NEAR = 0.05


def sensor_facts(
    snapshot: Snapshot,
    width: int,
    chosen: str,
    past: Mapping[str, Sequence[float]],
    sensors: Sequence[SensorSpec],
    *,
    plain: bool,
) -> list[StyledLine]:
    """Lines about the sensor `chosen`, or otherwise the one read last, below a heading. `past` has earlier
    readings by code."""
    rows = sorted(snapshot.state.sensors.values(), key=lambda row: row.number)
    code = chosen or (rows[-1].reading.sensor.code if rows else "")
    sensor = next((each for each in sensors if each.code == code), None)
    if sensor is None:
        return [heading("sensor", "", width, plain=plain), (("none read yet", "dim"),)]
    note = "click on another" if chosen else f"read last; :help {code}"
    lines = [heading(f"sensor {code}", note, width, plain=plain)]
    facts = ("rolls" if sensor.kind.counts else "looks", _looks(sensor)), ("sits", _sits(sensor))
    lines += [fact_line(label, text) for label, text in facts if text]
    row = snapshot.state.sensors.get(code)
    if row is None:
        return [*lines, fact_line("read", "not yet", "dim")]
    if row.reading.scan is not None:
        return [*lines, *_scan_facts(row, row.reading.scan, plain=plain)]
    error = f", error {100 * sensor.error:g} %" if sensor.error else ""
    # An old reading is as dim here as in its row.
    role = "newest" if age_of_reading(row, snapshot) is None else "dim"
    read = fact_line("read", with_unit(row.reading.value, sensor), role)
    values = past.get(code, row.history)
    count = min(len(values), width - LABEL)
    curve = fact_line(f"last {count}", sparkline(values, count, plain=plain), role)
    return [*lines, (*read, (f" at {clock_text(row.time)}{error}", "value")), curve]


def _scan_facts(row: SensorRow, scan: LidarScan, *, plain: bool) -> list[StyledLine]:
    """The time of a scan, and its most important points."""
    sensor, found = row.reading.sensor, extremes(scan)
    taken = f" at {clock_text(row.time)}, revolution {scan.revolution:,}"
    read = (*fact_line("read", counted(len(scan.ranges), "point"), "newest"), (taken, "value"))
    if found.nearest is None or found.farthest is None:
        return [read, fact_line("nearest", "no echo all around")]
    (near, at), (far, beyond) = found.nearest, found.farthest
    signs = [bearing_sign(bearing, plain=plain) for bearing in (at, beyond)]
    missed = f", {found.missed} no echo" if found.missed else ""
    text = f"{near:.1f} {sensor.unit} {signs[0]}, farthest {far:.1f} {sensor.unit} {signs[1]}{missed}"
    return [read, fact_line("nearest", text)]


def _looks(sensor: SensorSpec) -> str:
    """Direction from the robot's front and width of the beam; empty for a sensor without a direction."""
    wide = "" if sensor.beam is None else f", {sensor.beam:g} deg wide"
    if isinstance(sensor, LidarSpec):
        direction = "clockwise" if sensor.clockwise else "counter-clockwise"
        return f"all around, {direction}, {sensor.scan_rate:g} scans a second"
    if not sensor.kind.has("rotation"):
        return f"straight down{wide}" if wide else ""
    angle = half_turn(sensor.rotation)
    if not angle:
        return f"ahead{wide}"
    if angle == 180.0:
        return f"to the rear{wide}"
    return f"{abs(angle):g} deg to the {'left' if angle > 0 else 'right'} of the front{wide}"


def _sits(sensor: SensorSpec) -> str:
    """Place from the robot's centre; empty for a sensor that may be anywhere."""
    if not sensor.kind.has("x"):
        return ""
    along = f"{abs(sensor.x):.1f} in {'ahead' if sensor.x > 0 else 'behind'}"
    aside = f"{abs(sensor.y):.1f} in {'left' if sensor.y > 0 else 'right'}"
    parts = [along] if abs(sensor.x) >= _NEAR else []
    parts += [aside] if abs(sensor.y) >= _NEAR else []
    height = [f"{sensor.z:g} in up"] if sensor.kind.has("z") else []
    return ", ".join((parts or ["at the centre"]) + height)
