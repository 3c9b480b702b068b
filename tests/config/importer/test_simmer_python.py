"""A simmer-python `config.py` becomes a set in our frame."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.cli.import_command import run_import
from simmer_tui.config.importer.imported import Imported
from simmer_tui.config.importer.set_writer import write_set
from simmer_tui.config.importer.simmer_python import read_simmer_python
from simmer_tui.config.loader import load
from simmer_tui.config.sets import find_set
from simmer_tui.errors import ConfigurationError
from simmer_tui.sim import Pose, Simulator
from simmer_tui.sim.sensors import (
    Compass,
    CompassSpec,
    Gyro,
    GyroSpec,
    LineSensor,
    LineSpec,
    Ultrasonic,
    UltrasonicSpec,
)
from simmer_tui.sim.specs import Axes, DriveKind, DriveSpec, RobotSpec, SensorSpec


def listed(imported: Imported, place: str) -> str:
    """The message about the one place that is listed."""
    (found,) = [problem.what for problem in imported.left_out if problem.where == f"config.py:{place}"]
    return found


def drive(text: str, code: str = "w0") -> tuple[DriveSpec | None, Imported]:
    imported = read_simmer_python(f"drives = {{'{code}': Drive({{{text}}})}}")
    return (imported.drives[0] if imported.drives else None), imported


def sensor(text: str, **names: Any) -> tuple[SensorSpec, Imported]:
    lines = "".join(f"{name} = {value!r}\n" for name, value in names.items())
    imported = read_simmer_python(f"{lines}sensors = {{'u0': {text}}}")
    return imported.sensors[0], imported


def test_the_stock_robot_is_the_bundled_set(stock: str, tmp_path: Path) -> None:
    imported = read_simmer_python(stock)
    assert imported.left_out == ()
    write_set(imported, tmp_path)
    ours, bundled = load(tmp_path), load(find_set("simmer-python"))
    # What its frames leave before a wall, half of 6 in/s in 1/60 s, is given to sets that are imported alone.
    assert ours.simulation == replace(bundled.simulation, clearance=0.05)
    motion = replace(bundled.settings.motion, clearance=0.05)
    assert ours.settings == replace(bundled.settings, motion=motion)


@pytest.mark.parametrize(
    ("text", "clearance"),
    [
        ("", 0.0),
        ("drives = {'w0': Drive({'velocity': [0, 12]}), 'r0': Drive({'ang_velocity': 120})}", 0.1),
        ("frame_rate = 30\ndrives = {'w0': Drive({'velocity': [0, 12]})}", 0.2),
        ("frame_rate = 0\ndrives = {'w0': Drive({'velocity': [0, 12]})}", 0.1),
        ("frame_rate = 1\ndrives = {'w0': Drive({'velocity': [0, 12]})}", 1.0),
    ],
)
def test_movements_end_half_a_frame_before_the_wall(text: str, clearance: float) -> None:
    imported = read_simmer_python(text)
    assert imported.settings["motion.clearance"] == clearance
    assert any("frame_rate" in str(note) for note in imported.left_out) == ("frame_rate = 0" in text)


def test_places_are_counted_from_the_bottom_and_headings_turn_round() -> None:
    text = "walls = [[1, 1], [1, 1], [1, 1]]\nrobot_start_position = [6, 10]\nblock_position = [20.5, 30]\n"
    imported = read_simmer_python(text + "robot_start_rotation = 30\n")
    assert imported.settings["bot_center"] == (6.0, 26.0)
    assert imported.settings["block_center"] == (20.5, 6.0)
    assert imported.settings["bot_rot"] == -120.0
    assert [len(row) for row in imported.maze.cells] == [2, 2, 2]


@pytest.mark.parametrize(
    "text",
    [
        "block_position = None",
        "block_size = 3\nblock_position = None",
        "block_size = 0\nblock_position = [66, 5]",
        "block_size = 0.0\nblock_position = [30, 20]",
    ],
)
def test_no_block_at_all_is_a_side_of_0(text: str, tmp_path: Path) -> None:
    imported = read_simmer_python(f"{text}\nrobot_start_position = [6, 6]")
    assert imported.settings["blocksize"] == 0.0
    assert not [problem for problem in imported.left_out if "block" in problem.where]
    write_set(imported, tmp_path)
    assert load(tmp_path).settings.blocksize == 0.0


@pytest.mark.parametrize(("theirs", "ours"), [(0, -90), (90, 180), (180, 90), (270, 0), (-90, 0), (450, 180)])
def test_a_start_rotation_becomes_a_heading(theirs: int, ours: int) -> None:
    assert read_simmer_python(f"robot_start_rotation = {theirs}").settings["bot_rot"] == ours


@pytest.mark.parametrize(
    ("velocity", "kind"),
    [
        ("[0, 5]", DriveKind.RIGHT),
        ("[0, -5]", DriveKind.LEFT),
        ("[5, 0]", DriveKind.UP),
        ("[-5, 0]", DriveKind.DOWN),
    ],
)
def test_a_translation_goes_to_the_row_of_its_direction(velocity: str, kind: DriveKind) -> None:
    spec, imported = drive(f"'velocity': {velocity}, 'ang_velocity': 0")
    assert spec == DriveSpec(kind=kind, code="w0", speed=5.0)
    assert not [problem for problem in imported.left_out if "w0" in problem.where]


def test_a_turn_is_clockwise_there() -> None:
    spec, _ = drive("'velocity': [0, 0], 'ang_velocity': 120", "r0")
    assert spec == DriveSpec(kind=DriveKind.ROT, code="r0", gain=-1.0, speed=120.0)


@pytest.mark.parametrize(
    ("motion", "sign"),
    [
        ("'velocity': [0, 5]", 1),
        ("'velocity': [5, 0]", 1),
        ("'velocity': [0, -5]", -1),
        ("'velocity': [-5, 0]", -1),
        ("'ang_velocity': 90", -1),
    ],
)
def test_biases_change_axes_and_signs(motion: str, sign: int) -> None:
    spec, _ = drive(f"{motion}, 'bias': {{'x': 0.1, 'y': 0.2, 'rotation': 0.3}}")
    assert spec is not None
    assert spec.bias == Axes(x=sign * 0.2, y=sign * 0.1, r=-sign * 0.3)


@pytest.mark.parametrize(
    ("motion", "kept", "ignored"),
    [
        ("'velocity': [0, 5]", Axes(x=0.2), "x, rotation"),
        ("'velocity': [0, -5]", Axes(x=0.2), "x, rotation"),
        ("'velocity': [5, 0]", Axes(y=0.1), "y, rotation"),
        ("'ang_velocity': 90", Axes(r=0.3), "x, y"),
    ],
)
def test_only_the_error_along_the_commanded_axis_is_kept(motion: str, kept: Axes, ignored: str) -> None:
    spec, imported = drive(f"{motion}, 'error': {{'x': 0.1, 'y': 0.2, 'rotation': 0.3}}")
    assert spec is not None
    assert spec.error == kept
    assert ignored in listed(imported, "1:w0.error")


def test_a_drive_that_never_moves_is_left_out() -> None:
    spec, imported = drive("'velocity': [0, 0]")
    assert spec is None
    assert "left out" in listed(imported, "1:w0")


@pytest.mark.parametrize(
    ("motion", "kind", "bias"),
    [
        # There any turning speed turns by 1 degree clockwise an inch.
        ("'velocity': [0, 6], 'ang_velocity': 0.01", DriveKind.RIGHT, Axes(r=-1.0)),
        ("'velocity': [0, -6], 'ang_velocity': 0.01", DriveKind.LEFT, Axes(r=1.0)),
        # 3-4-5: 0.8 in forward and 0.6 in to the left for each unit.
        ("'velocity': [3, 4]", DriveKind.RIGHT, Axes(x=-0.2, y=0.6)),
        ("'velocity': [0, 0.01], 'ang_velocity': 120", DriveKind.ROT, Axes(x=-1.0)),
    ],
)
def test_a_drive_along_several_axes_moves_as_it_does_there(
    motion: str, kind: DriveKind, bias: Axes, tmp_path: Path
) -> None:
    spec, imported = drive(motion)
    assert spec is not None
    assert spec.kind is kind
    assert spec.bias.x == pytest.approx(bias.x)
    assert (spec.bias.y, spec.bias.r) == (pytest.approx(bias.y), pytest.approx(bias.r))
    assert "more than one number" in listed(imported, "1:w0")
    assert ("turns 1 deg a unit there, whatever its size" in listed(imported, "1:w0")) == (bias.y == 0)
    write_set(imported, tmp_path)
    assert load(tmp_path).simulation.drives == (spec,)


@pytest.mark.parametrize(
    ("turning", "speed", "is_listed"), [(-2, 4.0, False), (2, 8.0, False), (-9, 3.0, True)]
)
def test_both_speeds_of_a_drive_are_added_with_their_signs(
    turning: float, speed: float, is_listed: bool
) -> None:
    spec, imported = drive(f"'velocity': [0, 6], 'ang_velocity': {turning}")
    assert spec is not None
    assert spec.speed == speed
    notes = [each.what for each in imported.left_out if each.where.endswith("w0.ang_velocity")]
    assert bool(notes) == is_listed


def test_a_second_drive_in_the_same_direction_takes_a_free_row() -> None:
    text = (
        "block_position = None\nrobot_start_position = [18, 42]\nrobot_start_rotation = 0\n"
        "walls = [[1] * 8] * 4\n"
        "drives = {'w0': Drive({'velocity': [0, 6]}),\n 'f0': Drive({'velocity': [0, 9]}),\n"
        "'r0': Drive({'ang_velocity': 90}), 'l0': Drive({'ang_velocity': -90})}"
    )
    imported = read_simmer_python(text)
    assert [(spec.code, spec.kind.value) for spec in imported.drives] == [
        *(("w0", "right"), ("f0", "left"), ("r0", "rot"), ("l0", "up")),
    ]
    assert "the row right is taken" in listed(imported, "6:f0")
    with tempfile.TemporaryDirectory() as folder:
        write_set(imported, Path(folder))
        simulator = Simulator(load(Path(folder)).simulation, 1)
    # It stands at (18, 6), heading -90, which is towards y 0: 2 in back, then 4 in with each row, then turns.
    for command, pose in (
        *(("f0--9", (18, 15, -90)), ("w0-4", (18, 11, -90)), ("f0-4", (18, 7, -90))),
        *(("r0-30", (18, 7, -120)), ("l0-30", (18, 7, -150))),
    ):
        simulator.execute(command)
        now = simulator.pose
        assert (now.x, now.y, now.heading) == pytest.approx(pose), command


def test_a_turn_below_zero_is_listed() -> None:
    spec, imported = drive("'ang_velocity': -90")
    assert spec is not None
    assert (spec.gain, spec.speed) == (-1.0, 90.0)
    assert "90" in listed(imported, "1:w0.ang_velocity")


def test_a_wheel_that_counts_the_other_way_is_listed() -> None:
    text = "'velocity': [0, 6], 'motors': [MotorSimple({'position': [2, 0]})], 'motor_direction': "
    assert "motor 1" in listed(drive(text + "[-1]")[1], "1:w0.motor_direction")
    assert not [p for p in drive(text + "[1]")[1].left_out if "motor_direction" in p.where]


def test_an_ultrasonic_sensor_changes_frame_and_keeps_its_rays() -> None:
    spec, _ = sensor(
        "Ultrasonic({'position': [-2.5, 1], 'height': 3.5, 'rotation': -90, 'error': 0.1, 'beamwidth': 30,"
        " 'num_rays': 5, 'min_range': 1, 'max_range': 40})"
    )
    assert spec == UltrasonicSpec(
        kind=Ultrasonic,
        number=0,
        code="u0",
        x=1.0,
        y=-2.5,
        z=3.5,
        rotation=90.0,
        error=0.2,
        field_of_view=24.0,
        vertical_field_of_view=30.0,
        rays=5,
        min_range=1.0,
        max_range=40.0,
    )


def test_an_ultrasonic_sensor_without_a_height_is_as_high_as_the_block() -> None:
    spec, _ = sensor("Ultrasonic({'position': [0, 3]})", block_size=4)
    assert (spec.z, spec.error, spec.rays, spec.field_of_view) == (4.0, 0.04, 7, 15 * 6 / 7)


def test_a_description_may_be_given_as_keywords() -> None:
    spec, _ = sensor("Ultrasonic(position=[1, 2], rotation=45)")
    assert (spec.x, spec.y, spec.rotation) == (2.0, 1.0, -45.0)


def test_a_gyroscope_counts_clockwise_and_drifts() -> None:
    spec, _ = sensor("Gyroscope({'error': 0.03, 'bias': 0.2})")
    assert spec == GyroSpec(kind=Gyro, number=0, code="u0", error=0.06, gain=-1.0, drift=0.2, wrap=360.0)


def test_a_compass_reads_their_rotation() -> None:
    spec, _ = sensor("Compass({'error': 0.01, 'bias': 2, 'rotation': 45})")
    assert spec == CompassSpec(
        kind=Compass,
        number=0,
        code="u0",
        rotation=90.0,
        gain=-1.0,
        bias=2.0,
        absolute_error=7.2,
        wrap=360.0,
    )


def test_a_line_sensor_looks_for_white() -> None:
    spec, imported = sensor("Infrared({'position': [1, -1], 'error': 0.05, 'bias': 0.1})")
    assert spec == LineSpec(
        kind=LineSensor,
        number=0,
        code="u0",
        x=-1.0,
        y=1.0,
        z=3.0,
        error=0.1,
        field_of_view=pytest.approx(81.786789),
        threshold=0.8,
        detects_white=True,
    )
    assert "no effect" in listed(imported, "1:u0.bias")


@pytest.mark.parametrize("fov", [0, 40, 60, 90, 150, 179])
def test_a_line_sensor_sees_a_disc_of_its_height_times_the_cosine(fov: float) -> None:
    spec, _ = sensor(f"Infrared({{'height': 1.5, 'fov': {fov}}})")
    ours = spec.z * math.tan(math.radians(spec.field_of_view / 2))
    assert ours == pytest.approx(1.5 * math.cos(math.radians(fov / 2)))


def test_the_stock_line_sensor_s_view_is_the_reference_s() -> None:
    (spec,) = [s for s in load(find_set("simmer-python")).simulation.sensors if s.kind is LineSensor]
    assert spec.field_of_view == pytest.approx(81.8, abs=0.05)
    assert spec.z * math.tan(math.radians(spec.field_of_view / 2)) == pytest.approx(1.299, abs=5e-4)


def test_the_stock_upper_sensor_sees_the_block_from_afar() -> None:
    """Its u1 stands 1 in above the block, whose front is at y = 41.5, and sees 7.5 degrees down."""
    simulator = Simulator(load(find_set("simmer-python")).simulation, 1)
    seen = {}
    for y in (36.0, 30.0):
        simulator.teleport(Pose(66, y, 90))
        seen[y] = simulator.true_value("u0"), simulator.true_value("u1")
    assert seen == {
        36.0: (pytest.approx(2.5), pytest.approx(11.0)),
        30.0: (pytest.approx(8.5), pytest.approx(10.5)),
    }


def test_the_stock_errors_are_twice_those_configured() -> None:
    sensors = {spec.code: spec for spec in load(find_set("simmer-python")).simulation.sensors}
    assert {code: sensors[code].error for code in ("u0", "u1", "g0", "i0", "c0", "m0")} == {
        "u0": 0.04,
        "u1": 0.04,
        "g0": 0.04,
        "i0": 0.1,
        "c0": 0.0,
        "m0": 0.0,
    }
    assert sensors["c0"].absolute_error == pytest.approx(14.4)


def test_an_error_that_doubled_is_beyond_1_is_listed() -> None:
    spec, imported = sensor("Ultrasonic({'error': 0.7})")
    assert spec.error == 1.0
    assert "1.4" in listed(imported, "1:u0.error")


def test_motors_are_wheel_encoders_with_numbers_of_their_own() -> None:
    text = "motors = {'m1': MotorSimple({'position': [3, 1], 'rotation': 90}), 'ma': MotorSimple({})}"
    imported = read_simmer_python(text)
    assert [(s.id, s.code, s.x, s.y, s.rotation) for s in imported.sensors] == [
        ("odom1", "m1", 1.0, 3.0, -90.0),
        ("odom0", "ma", 0.0, 0.0, 0.0),
    ]


def test_devices_with_longer_names_get_codes_that_are_told() -> None:
    """There a name may be any text, such as the angle of a sensor in a ring."""
    imported = read_simmer_python(
        "def ring(count):\n"
        "    made = {}\n"
        "    for number in range(count):\n"
        "        angle = 360 / count * number\n"
        "        made[f'{angle} deg'] = {'rotation': angle}\n"
        "    return made\n"
        "sensors = {name: Ultrasonic(each) for name, each in ring(12).items()}\n"
        "sensors['u0'] = Ultrasonic({'position': [0, 3]})\n"
        "drives = {'ahead': Drive({'velocity': [0, 6]}), 7: Drive({'ang_velocity': 60})}\n"
    )
    assert [drive.code for drive in imported.drives] == ["a0", "d0"]
    # There a turn is clockwise.
    assert [(s.code, s.rotation) for s in imported.sensors] == [
        *((f"u{n + 1}", -30.0 * n) for n in range(9)),
        *(("ua", -270.0), ("ub", -300.0), ("uc", -330.0), ("u0", 0.0)),
    ]
    told = listed(imported, "7:sensors")
    assert told.startswith('a code has two characters here: "0.0 deg" is u1, "30.0 deg" is u2, ')
    assert listed(imported, "9:drives") == 'a code has two characters here: "ahead" is a0, "7" is d0'


@pytest.mark.parametrize(
    ("entry", "place", "word"),
    [
        ("'l0': Lidar({'position': [0, 0]})", "2:l0", "Lidar is a device of the team's own"),
        ("'u10': 7", "2:u10", "two printable ASCII characters"),
        ("'w0': Ultrasonic({})", "2:w0", "in use"),
        ("'u9': Ultrasonic(make_info())", "2:u9", "cannot be read"),
        ("'u9': somewhere.else_", "2:u9", "cannot be read"),
        ("'u9': 7", "2:u9", "not a device"),
    ],
)
def test_what_has_no_equivalent_is_listed_with_its_line_and_left_out(
    entry: str, place: str, word: str
) -> None:
    text = f"sensors = {{'u0': Ultrasonic({{}}),\n{entry}}}\ndrives = {{'w0': Drive({{'velocity': [0, 6]}})}}"
    imported = read_simmer_python(text)
    assert [spec.code for spec in imported.sensors] == ["u0"]
    what = listed(imported, place)
    assert word in what
    assert "left out" in what


@pytest.mark.parametrize("name", ["TimeOfFlight", "ToF", "TOFSensor", "time_of_flight", "VL53L0X"])
def test_a_class_of_time_of_flight_sensors_becomes_ultra_rows(name: str) -> None:
    spec, imported = sensor(
        f"{name}({{'position': [1, 3], 'height': 2, 'fov': 25, 'num_rays': 5, 'max_range': 47}})"
    )
    assert spec == UltrasonicSpec(
        kind=Ultrasonic,
        number=0,
        code="u0",
        x=3.0,
        y=1.0,
        z=2.0,
        error=0.04,
        field_of_view=20.0,
        vertical_field_of_view=25.0,
        rays=5,
        max_range=47.0,
    )
    assert f"{name} is taken as an ultra row" in listed(imported, "1:u0")


def test_another_class_of_the_team_s_own_is_shown_as_the_row_to_add() -> None:
    text = (
        "sensors = {'l1': Lidar({'position': [-1, 2], 'height': 5, 'rotation': 90, 'error': 0.01}),\n"
        "'u0': Ultrasonic({}),\n'b0': Button({'pin': how()}),\n'b1': Lidar({'position': how()})}"
    )
    imported = read_simmer_python(text)
    assert [spec.code for spec in imported.sensors] == ["u0"]
    what = listed(imported, "1:l1")
    assert "Lidar is a device of the team's own or belongs elsewhere; left out" in what
    assert "add to sensors.csv: ultra1,l1,1,2,-1,5,-90,0.02,12.8571,;" in what
    # Numbers of a row that is proposed are told where they are assumed.
    assert what.endswith(
        "assumed, because no file gives them as numbers: num_rays 7, beamwidth 15, min_range 0, max_range inf"
    )
    assert "sensors.csv" not in listed(imported, "3:b0")
    assert "left out" in listed(imported, "4:b1")


@pytest.mark.parametrize(
    ("text", "place", "word"),
    [
        ("Ultrasonic({'laser': 1})", "1:u0.laser", "no equivalent"),
        ("Ultrasonic({'error': 2})", "1:u0.error", "from 0 to 1"),
        ("Ultrasonic({'error': how})", "1:u0.error", "cannot be read"),
        ("Ultrasonic({'position': 3})", "1:u0.position", "not a point"),
        ("Ultrasonic({'num_rays': 0})", "1:u0.num_rays", "from 1 to 1000"),
        ("Ultrasonic({'min_range': 9, 'max_range': 3})", "1:u0.max_range", "below min_range"),
        ("Ultrasonic({'min_range': 9, 'max_range': 9})", "1:u0.max_range", "below min_range"),
        # The course's maze is 96 by 48 in, and its diagonal 107.33.
        (
            "Ultrasonic({'min_range': 108})",
            "1:u0.min_range",
            "above the longest distance in the maze, 107.3 in",
        ),
    ],
)
def test_a_field_that_cannot_be_used_is_listed_and_the_sensor_kept(text: str, place: str, word: str) -> None:
    spec, imported = sensor(text)
    assert spec.code == "u0"
    assert word in listed(imported, place)


def test_an_outline_changes_axes() -> None:
    text = (
        "import math\nimport pygame.math as pm\nrobot_outline = [pm.Vector2(-3, -4), pm.Vector2(-3, 3),"
        " pm.Vector2(0, 5), pm.Vector2(3, 3), pm.Vector2(3, -4)]"
    )
    assert read_simmer_python(text).robot.vertices == ((-4, -3), (3, -3), (5, 0), (3, 3), (-4, 3))


def test_an_outline_may_be_worked_out_by_a_comprehension() -> None:
    text = (
        "import math\nimport pygame.math as pm\n"
        "robot_outline = [pm.Vector2(4*math.cos(math.pi*i/6), 4*math.sin(math.pi*i/6)) for i in range(12)]"
    )
    robot = read_simmer_python(text).robot
    assert len(robot.vertices) == 12
    assert robot.vertices[3] == pytest.approx((4.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(
    "loop",
    [
        "robot_outline = []\nfor i in range(8):\n    angle = 2*math.pi*i/8\n"
        "    robot_outline.append(pm.Vector2(4*math.cos(angle), 4*math.sin(angle)))",
        "robot_outline = []\nfor i in range(8):\n    robot_outline += [pm.Vector2(4, 0).rotate(45*i)]",
        "import numpy as np\nrobot_outline = []\nfor a in np.linspace(0, 2*np.pi, 8, endpoint=False):\n"
        "    robot_outline.append((4*np.cos(a), 4*np.sin(a)))",
    ],
    ids=["append", "rotate", "linspace"],
)
def test_an_outline_may_be_built_in_a_loop(loop: str) -> None:
    imported = read_simmer_python(f"import math\nimport pygame.math as pm\n{loop}\n")
    corners = imported.robot.vertices
    assert len(corners) == 8
    assert [math.hypot(x, y) for x, y in corners] == pytest.approx([4.0] * 8)
    assert corners[2] == pytest.approx((4.0, 0.0), abs=1e-9)
    assert not [problem for problem in imported.left_out if problem.where.count(":") > 1]


def test_four_right_corners_are_a_rectangle() -> None:
    text = "robot_outline = [(-2, -3), (-2, 3), (2, 3), (2, -3)]"
    assert read_simmer_python(text).robot == RobotSpec.rectangle(6.0, 4.0)


def test_without_an_outline_the_sizes_count() -> None:
    robot = read_simmer_python("robot_width = 4\nrobot_height = 7").robot
    assert robot == RobotSpec.rectangle(7.0, 4.0)


@pytest.mark.parametrize(
    "outline", ["[(1, 1), (2, 1), (2, 2)]", "[(0, 0)]", "5", "[1, 2, 3]", "unknown", "[]"]
)
def test_an_outline_that_is_none_is_listed_and_a_square_stands_in(outline: str) -> None:
    imported = read_simmer_python(f"robot_outline = {outline}")
    assert imported.robot == RobotSpec.rectangle(6.0, 6.0)
    assert "6 in" in listed(imported, "1:robot_outline")


@pytest.mark.parametrize(
    ("walls", "word"), [("[[1, 1], [1]]", "rectangle"), ("7", "rows"), ("[]", "rectangle")]
)
def test_walls_that_are_none_are_listed_and_the_course_s_maze_stands_in(walls: str, word: str) -> None:
    imported = read_simmer_python(f"walls = {walls}")
    assert (imported.maze.rows, imported.maze.columns) == (4, 8)
    assert word in listed(imported, "1:walls")


def test_an_unknown_kind_of_cell_is_empty() -> None:
    imported = read_simmer_python("walls = [[0, 7], ['a', 1]]")
    assert imported.maze.cells == ((0, 1), (1, 1))
    assert "7" in listed(imported, "1:walls")


@pytest.mark.parametrize(
    ("text", "place", "word"),
    [
        ("rand_bias = True", "1:rand_bias", "no effect"),
        ("wall_segment_length = 10", "1:wall_segment_length", "always 12"),
        ("round_digits = 2", "1:round_digits", "always 3"),
        ("num_robots = 1000", "1:num_robots", "no equivalent"),
        ("u9_info = {'id': 'u9'}", "1:u9_info", "no equivalent"),
        ("port_rx = 70000", "1:port_rx", "65535"),
        ("bias_strength = 5", "1:bias_strength", "keeps its default"),
        ("ppi = 12\nwall_color = (1, 2, 3)", "1", "ppi, wall_color"),
        ("while True:\n    pass", "1", "while is not followed"),
        ("sensors = make()", "1:sensors", "not a dict"),
        ("num_segments = count(3)", "1:num_segments", "not count(...)"),
        ("frame_rate = rate()", "1:frame_rate", "from 1 to 1000, not rate(...); 60 is taken"),
        ("robot_width = [1] - 2", "1:robot_width", "cannot be read: arithmetic"),
    ],
)
def test_other_names_are_taken_over_or_listed(text: str, place: str, word: str) -> None:
    assert word in listed(read_simmer_python(text), place)


def test_lists_within_lists_within_lists_cost_nothing() -> None:
    deep = "y = [1]\n" + "y = [y, y]\n" * 60
    names = ("walls = [[y]]", "robot_outline = y", "bias_strength = y", "ppi = [1][y]", "step_time = y")
    imported = read_simmer_python(deep + "\n".join(names))
    assert imported.maze.cells == ((1,),)


def test_settings_are_those_such_programs_need() -> None:
    settings = read_simmer_python("port_rx = 5000\nport_tx = 5001\nrand_error = True\nstep_time = 1").settings
    assert settings["server.listeners"] == ("packets",)
    assert (settings["server.packet_port"], settings["server.packet_reply_port"]) == (5000, 5001)
    assert (settings["motion.motion"], settings["motion.reply"]) == ("timed", "accepted")
    assert settings["motion.block_solid"] is True
    assert (settings["randerror"], settings["randbias"], settings["step_time"]) == (True, False, 1.0)


def test_a_file_from_before_the_brackets_says_so() -> None:
    assert "legacy_reply" in listed(read_simmer_python("ppi = 3"), "frame_start")


@pytest.mark.parametrize(
    ("place", "what"),
    [
        ("[78, 5]", "the block of 3 in at (78, 43) overlaps a wall"),
        ("[200, -50]", "(200, 98) lies outside the maze"),
        ("[-20, 24]", "(-20, 24) lies outside the maze"),
    ],
)
def test_a_block_outside_or_in_a_wall_is_none_and_a_robot_in_a_wall_is_moved(
    place: str, what: str, stock: str, tmp_path: Path
) -> None:
    text = stock.replace("[66, 5]", place).replace("[6, 42]", "[30, 20]")
    imported = read_simmer_python(text)
    lines = [line.partition(" =")[0] for line in text.split("\n")]
    block, start = (lines.index(name) + 1 for name in ("block_position", "robot_start_position"))
    assert listed(imported, f"{block}:block_position") == f"{what}; so there is no block (blocksize = 0)"
    assert "overlaps a wall" in listed(imported, f"{start}:robot_start_position")
    assert listed(imported, f"{start}:robot_start_position").endswith("; moved to (66, 42)")
    write_set(imported, tmp_path)
    assert load(tmp_path).simulation.start_block.size == 0.0


def test_a_set_without_a_block_has_no_mission(
    stock: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "config.py"
    config.write_text(stock.replace("[66, 5]", "[-9, -9]"), encoding="utf-8")
    assert run_import([str(config), str(tmp_path / "set"), "--mission"]) == 2
    said = capsys.readouterr().err
    assert "config.py:12:block_position: (-9, 57) lies outside the maze; so there is no block" in said
    assert "put it into a free cell, or import without --mission" in said
    assert not (tmp_path / "set").exists()


def test_text_from_the_file_is_shown_escaped() -> None:
    imported = read_simmer_python("sensors = {'\\x1b[31m': Lidar({})}")
    assert all(str(problem).isprintable() for problem in imported.left_out)


def test_what_is_not_python_is_refused_at_its_line() -> None:
    with pytest.raises(ConfigurationError, match=r"team\.py:2"):
        read_simmer_python("x = 1\nx = = 2", "team.py")


ODD = st.sampled_from(
    [
        *(
            "None",
            "[]",
            "{}",
            "'a'",
            "''",
            "0",
            "1",
            "-1",
            "2.5",
            "1e400",
            "1e200",
            "-1e7",
            "nan",
            "True",
            "f(1)",
        ),
        *(
            "[1, 2]",
            "[1, 'a']",
            "[[1, 2], [3, 4], [-9, 0]]",
            "[1e200, -1e200]",
            "{'x': 1e400, 'y': []}",
            "'u0'",
        ),
        *(
            "[[0, 1], [1]]",
            "[[9], [None]]",
            "[f(1)]",
            "Lidar({})",
            "Drive(3)",
            "(3, 4, 5)",
            "10**30",
            "'\\x1b'",
        ),
    ]
)
NAMES = (
    *(
        "walls",
        "robot_outline",
        "robot_width",
        "robot_height",
        "block_position",
        "block_size",
        "host",
        "port_rx",
    ),
    *(
        "robot_start_position",
        "robot_start_rotation",
        "rand_error",
        "rand_bias",
        "bias_strength",
        "step_time",
    ),
    *("num_segments", "error_seed", "frame_start", "sensors", "drives", "motors"),
)
KEYS = (
    *("position", "rotation", "height", "error", "bias", "beamwidth", "num_rays", "min_range", "max_range"),
    *("fov", "threshold", "velocity", "ang_velocity", "motors", "motor_direction"),
)
DEVICES = ("Ultrasonic", "Infrared", "Gyroscope", "Compass", "MotorSimple", "Drive")


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(
    names=st.dictionaries(st.sampled_from(NAMES), ODD, max_size=4),
    devices=st.lists(
        st.tuples(st.sampled_from(DEVICES), st.dictionaries(st.sampled_from(KEYS), ODD)), max_size=8
    ),
)
def test_whatever_a_file_holds_the_set_made_of_it_has_no_mistakes_but_places(
    names: dict[str, str], devices: list[tuple[str, dict[str, str]]]
) -> None:
    lines = []
    for table in ("sensors", "drives", "motors"):
        lines.append(f"{table} = {{}}")
        for number, (device, fields) in enumerate(devices):
            inner = ", ".join(f"{key!r}: {value}" for key, value in fields.items())
            lines.append(f"{table}['{table[0]}{number}'] = {device}({{{inner}}})")
    lines += [f"{name} = {value}" for name, value in names.items()]
    imported = read_simmer_python("\n".join(lines))
    with tempfile.TemporaryDirectory() as folder:
        write_set(imported, Path(folder))
        try:
            load(Path(folder))
        except ConfigurationError as error:
            problems = [str(problem) for problem in error.problems]
            assert all("_center" in problem for problem in problems), problems
