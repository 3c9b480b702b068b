"""A kind of sensor is one class: this file adds some, and nothing else knows of them beforehand."""

from __future__ import annotations

import filecmp
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from msgspec.structs import replace

from simmer_tui.config.importer.imported import Imported
from simmer_tui.config.importer.set_writer import write_set
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.set_summary import summarize
from simmer_tui.config.sets import bundled_folder, init_set
from simmer_tui.errors import ConfigurationError
from simmer_tui.links.protocol.packets import RequestStyle, encode
from simmer_tui.report.content import report_tables
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.report.sensor_differences import least_error
from simmer_tui.robot.engine import Engine
from simmer_tui.runlog.reader import LogReader
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import ObservingSensor, Pose, SensorSpec, Simulator, World, parse_command, sensor_kinds
from simmer_tui.sim import columns as known
from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.rules import NumberRule, listed
from simmer_tui.sim.sensors import KINDS as BUILT_IN
from simmer_tui.sim.sensors import Compass, Sensor, Ultrasonic, sensor_of
from simmer_tui.tui.help import help_text


class ThermometerSpec(SensorSpec, frozen=True, kw_only=True):
    ambient: float = 20.0


class Thermometer(ObservingSensor):
    """Warmer by a degree for each 10 in to the right."""

    name = "temp"
    meaning = "temperature"
    unit = "C"
    spec_type = ThermometerSpec
    columns = (known.ERROR, known.RESOLUTION, CsvColumn(NumberRule(), name="Ambient (C)", field="ambient"))

    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        assert isinstance(self.spec, ThermometerSpec)
        return self.spec.ambient + pose.x / 10.0, None


class Alarm(ObservingSensor):
    """True if the robot is in the right half."""

    name = "alarm"
    meaning = "1 in the right half"
    is_yes_or_no = True
    columns = ()

    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        return float(pose.x > world.maze.width / 2), None


KINDS = sensor_kinds(Thermometer, Alarm)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "set"
    init_set(made, bundled_folder())
    path = made / "sensors.csv"
    head, *rows = path.read_text().splitlines()
    rows = [f"{row}," for row in rows]
    rows += ["temp1,h1,1,,,,,0.1,,,17", "temp2,h2,1,,,,,0,,,", "alarm1,a9,1,,,,,0,,,"]
    path.write_text("\n".join([f"{head},Ambient (C)", *rows]))
    return made


@pytest.fixture
def configuration(folder: Path) -> Configuration:
    return load(folder, kinds=KINDS)


def test_its_rows_are_read_with_columns_and_defaults_of_its_own(configuration: Configuration) -> None:
    first, second, alarm = configuration.simulation.sensors[-3:]
    assert first == ThermometerSpec(kind=Thermometer, number=1, code="h1", error=0.1, ambient=17.0)
    assert second == ThermometerSpec(kind=Thermometer, number=2, code="h2")
    assert (alarm.id, alarm.kind, alarm.unit) == ("alarm1", Alarm, "")
    assert "temp1" in summarize(configuration)
    assert "ambient 17" in summarize(configuration)


def test_mistakes_in_its_rows_are_told(folder: Path) -> None:
    path = folder / "sensors.csv"
    path.write_text(path.read_text().replace("temp2,h2,1,,,,,0,,,", "temp2,h2,1,,,,,2,,,warm"))
    with pytest.raises(ConfigurationError) as raised:
        load(folder, kinds=KINDS)
    assert [str(problem).split(":", 2)[2] for problem in raised.value.problems] == [
        'Percent Error (0-1): must be a number from 0 to 1, not "2"',
        'Ambient (C): must be a number, not "warm"',
    ]
    with pytest.raises(ConfigurationError) as raised:
        load(folder)
    assert "is not a column that is known" in str(raised.value)
    assert f"(types: {listed(BUILT_IN)})" in str(raised.value)


def test_it_is_read_errs_and_repeats(configuration: Configuration) -> None:
    simulator = Simulator(replace(configuration.simulation, bot_center=(30.0, 42.0)), 7)
    assert simulator.execute("h2").reply == 23.0
    first = simulator.execute("h1")
    assert first.reading is not None
    assert first.reading.true == 20.0
    assert first.reply != 20.0
    again = Simulator(replace(configuration.simulation, bot_center=(30.0, 42.0)), 7)
    assert again.execute("h1").reply == first.reply
    assert "h1" not in simulator.ranging_codes()


def test_dialects_help_and_files_know_what_it_is(configuration: Configuration, tmp_path: Path) -> None:
    simulator = Simulator(configuration.simulation, 7)
    answers = [(parse_command(code), simulator.execute(code)) for code in ("h2", "a9")]
    assert encode(RequestStyle.FRAMED, "text", answers).message() == b"[h2:20.95,a9:False]"
    assert "h2     read temp2: temp" in help_text(configuration.settings.keys, simulator.spec)
    spec = configuration.simulation
    write_set(Imported(spec.maze, spec.robot, spec.sensors, spec.drives, {}, ()), tmp_path / "copy")
    assert load(tmp_path / "copy", kinds=KINDS).simulation.sensors == spec.sensors


def test_the_report_tells_its_errors(configuration: Configuration, tmp_path: Path) -> None:
    simulator = Simulator(configuration.simulation, 7)
    engine = Engine(simulator)
    path = tmp_path / "run.jsonl"
    with RunLog(path, configuration, simulator) as log:
        engine.watch(log)
        session = engine.session()
        for _ in range(20):
            for code in ("h1", "h2", "a9"):
                session.submit(parse_command(code), lambda _: None)
    with LogReader(path, configuration) as reader:
        run = RunStatistics(reader.header, configuration)
        for entry in reader:
            run.add((entry,))
        run.finish(reader.note)
    table = next(each for each in report_tables(run) if each.title == "Errors of readings")
    rows = {row["sensor"]: row for row in table.objects()}
    temperature = rows["temp1"]
    assert (temperature["readings"], temperature["unit"]) == (20, "C")
    assert isinstance(temperature["std"], float)
    assert 0.5 < temperature["std"] < 5.0, "a spread of 10 % of 18"
    assert rows["temp2"]["mean"] == 0.0
    assert rows["alarm1"]["wrong"] == 0


class Photocell(ObservingSensor):
    """A voltage, read to a thousandth."""

    name = "photo"
    meaning = "brightness"
    unit = "V"
    columns = ()
    least_error = 0.001

    def observe(self, world: World, pose: Pose) -> tuple[float, None]:
        return pose.x / 100.0, None


def test_the_least_error_that_matters_of_a_unit_of_its_own_follows_from_its_readings() -> None:
    def least(kind: type[Sensor]) -> float:
        return least_error(sensor_of(kind.spec_type(kind=kind, number=1, code="x1")))

    assert least(Photocell) == pytest.approx(0.05)
    assert [least(kind) for kind in (Ultrasonic, Compass)] == [1.0, 2.0]


# -- a kind as CONTRIBUTING says: a file of its own, and its line in sim/sensors/__init__.py ----------------

ROOT = Path(__file__).parent.parent
KINDS_OF_A_FILE = """
from simmer_tui.sim import columns
from simmer_tui.sim.sensors.base import ObservingSensor, Prior, ParameterKind
from simmer_tui.sim.sensors.range_sensors import RangeSensor


class Sonar(RangeSensor):
    '''The farthest distance at which any of its rays meets something.'''

    name = "sonar"
    meaning = "sonar range"

    def combined(self, distances):
        return max(distances)

    def combined_many(self, fans):
        return fans.max(axis=1)


class Thermometer(ObservingSensor):
    '''Warmer by a degree for each 10 in to the right.'''

    name = "temp"
    meaning = "temperature"
    unit = "C"
    columns = (columns.ERROR,)

    def observe(self, world, pose):
        return 20.0 + pose.x / 10.0, None


class LightSensor(ObservingSensor):
    '''Brighter to the right, with an observation model, in a unit that no other kind has.'''

    name = "light"
    meaning = "brightness"
    unit = "lux"
    columns = (columns.ERROR, columns.GAIN)
    parameters = (Prior("gain", "gain", ParameterKind.GAIN, 0.1),)

    def observe(self, world, pose):
        return 20.0 + pose.x, None
"""
PROGRAM = """
from simmer_tui.client import Robot

with Robot() as robot:
    for step in range(32):
        robot.read("u1", "u2", "u3", "u4", "z1", "h1", "k1", "o1", "o2", "o3", "o4", "g1")
        robot.send(("r1-20", "d1-3", "r1--20", "d1--3")[step % 4])
"""


def cli(home: Path, *arguments: object) -> str:
    """Output of `simmer-tui`, run from a copy of the package; it must succeed."""
    environment = {**os.environ, "PYTHONPATH": str(home), "COLUMNS": "200"}
    command = [sys.executable, "-m", "simmer_tui", *map(str, arguments)]
    done = subprocess.run(command, cwd=home, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0 or arguments == ("doctor",), done.stdout + done.stderr
    assert "Traceback" not in done.stderr  # doctor's exit code is 1 where a port is in use
    return done.stdout


def files_that_differ(one: filecmp.dircmp[str], below: str = "") -> list[str]:
    found = [f"{below}{name}" for name in one.diff_files + one.right_only if name != "__pycache__"]
    for name, part in one.subdirs.items():
        found += files_that_differ(part, f"{below}{name}/")
    return sorted(found)


@pytest.mark.slow
def test_a_range_sensor_costs_two_files_calibration_included(tmp_path: Path) -> None:
    # With what is compiled already, which is found by the times of the files: compiling takes seconds.
    for name in ("simmer_tui", "config"):
        shutil.copytree(ROOT / name, tmp_path / name)
    sensors = tmp_path / "simmer_tui" / "sim" / "sensors"
    (sensors / "sonar.py").write_text(KINDS_OF_A_FILE)
    text = (sensors / "__init__.py").read_text()
    here = "from simmer_tui.sim.sensors"
    for before, more in (
        ("    TimeOfFlight,\n    Line", "    Sonar,\n    Thermometer,\n    LightSensor,\n"),
        (f"{here}.yes_or_no", f"{here}.sonar import LightSensor, Sonar, Thermometer\n"),
    ):
        assert before in text
        text = text.replace(before, more + before)
    (sensors / "__init__.py").write_text(text)
    tree = filecmp.dircmp(ROOT / "simmer_tui", tmp_path / "simmer_tui")
    assert files_that_differ(tree) == ["sim/sensors/__init__.py", "sim/sensors/sonar.py"]

    made, log, program = tmp_path / "set", tmp_path / "run.jsonl", tmp_path / "program.py"
    init_set(made, bundled_folder())
    rows = made / "sensors.csv"
    rows.write_text(
        f"{rows.read_text()}sonar1,z1,1,3,0,3,0,0.02,4,\ntemp1,h1,1,,,,,0.1,,\nlight1,k1,1,,,,,0.02,,\n"
    )
    program.write_text(PROGRAM)
    assert "sonar1" in cli(tmp_path, "check", made)
    cli(tmp_path, "doctor")
    run = f"{sys.executable} {program}"
    cli(tmp_path, *("--no-ui", "--port", 0, "--config", made, "--seed", 5, "--log", log, "--run", run))
    assert "z1 sonar1" in cli(tmp_path, "report", log)
    said = cli(tmp_path, "calibrate", log, "--out", tmp_path / "learned")
    learned, left = said.split("Parameters left unchanged")
    figures = [line.split() for line in learned.splitlines() if line.split()[:1] == ["sonar1"]]
    assert {"gain", "bias", "mounting", "percent", "outliers"} <= {line[1] for line in figures}
    (gain,) = [line for line in figures if line[1] == "gain"]
    assert " light1  gain " in learned
    low, high = float(gain[4]), float(gain[6])
    assert low < 1.0 < high
    assert "the kind temp (temperature) has no observation model" in " ".join(left.split())
    assert "sonar range" in said, "held-back readings of it are predicted"
