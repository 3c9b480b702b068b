from __future__ import annotations

import re
import tomllib
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.config.loader import load
from simmer_tui.config.sensors_csv import HEADERS, optional_headers
from simmer_tui.config.sets import bundled_folder
from simmer_tui.sim.columns import (
    ACCELERATION,
    DRIVE_GAIN,
    REACH,
    ROTATION_SPEED,
    SPEED,
    START_LAG,
    TRANSLATION_SPEED,
    WIDTH,
    CsvColumn,
)
from simmer_tui.sim.rules import listed
from simmer_tui.sim.sensors import KINDS, LidarSpec
from simmer_tui.sim.specs import Axes, DriveKind, DriveSpec, GripperSpec, SensorSpec

DRIVES = ", ".join(f'"{kind.value}"' for kind in DriveKind)
IDS = f'{DRIVES}, "grip", "velocity", "velocity-x", "velocity-y", "velocity-r"'
RANGES = listed(kind.name for kind in KINDS.values() if kind.is_range)
Edit = Callable[[str, str, str], None]
Problems = Callable[..., list[str]]


def write_sensors(folder: Path, *rows: str, columns: tuple[str, ...] = ()) -> None:
    (folder / "sensors.csv").write_text("\n".join([",".join((*HEADERS, *columns)), *rows]))


def only_sensor(folder: Path) -> SensorSpec:
    (sensor,) = load(folder).simulation.sensors
    return sensor


def test_optional_columns_are_found_by_name_in_any_order(folder: Path) -> None:
    columns = ("Rays", "Wrap", "", "Resolution", "Gain", "Absolute Error", "Bias", "Drift (per s)")
    write_sensors(
        folder,
        "ultra1,u1,0,1,2,3,4,0.5,6,,9,360,a note,0.1,-1,7.2,0.1,0.2,1,30",
        columns=(*columns, "Min Range (in)", "Max Range (in)"),
    )
    sensor = only_sensor(folder)
    assert not sensor.enabled
    assert (sensor.x, sensor.y, sensor.z, sensor.rotation, sensor.error, sensor.field_of_view) == (
        1, 2, 3, 4, 0.5, 6,
    )  # fmt: skip
    assert (sensor.rays, sensor.wrap, sensor.resolution, sensor.gain) == (9, 360, 0.1, -1)
    assert (sensor.absolute_error, sensor.bias, sensor.drift) == (7.2, 0.1, 0.2)
    assert (sensor.min_range, sensor.max_range) == (1, 30)


def test_blank_optional_cells_mean_the_column_were_absent(folder: Path) -> None:
    row = "tof1,t1,1,3,0,4,0,0.03,25,"
    write_sensors(folder, row)
    absent = only_sensor(folder)
    write_sensors(folder, row + "," * len(optional_headers()), columns=optional_headers())
    assert only_sensor(folder) == absent
    assert absent.max_range == 47


def test_detects_white_is_for_line_sensors(folder: Path, problems: Problems) -> None:
    write_sensors(folder, "ir1,i1,1,2,0,1,0,0.05,40,0.8,White", columns=("Detects",))
    assert only_sensor(folder).detects_white
    write_sensors(folder, "gyro1,g1,1,,,,,0.05,,,white", columns=("Detects",))
    assert problems() == ['sensors.csv:2:Detects: is for ir only; leave it blank for gyro, not "white"']
    write_sensors(folder, "ir1,i1,1,2,0,1,0,0.05,40,0.8,wite", columns=("Detects",))
    assert problems() == [
        'sensors.csv:2:Detects: must be "black" or "white", not "wite"; did you mean "white"?'
    ]


@pytest.mark.parametrize(
    ("row", "column", "cell", "field", "value"),
    [
        ("ultra1,u1,1,1,0,4,0,0.02,5,", "Read Time (s)", "0.06", "read_time", 0.06),
        ("load1,u1,1,,,,,0,,", "Read Time (s)", "0.06", "read_time", 0.06),
        ("tof1,u1,1,1,0,4,0,0.02,5,", "Incidence Limit (deg)", "20", "incidence_limit", 20),
        ("tof1,u1,1,1,0,4,0,0.02,5,", "Dropout", "0.01", "dropout", 0.01),
        ("ir1,u1,1,1,0,4,0,0.02,5,0.5", "Outlier", "0.01", "outlier", 0.01),
        ("ultra1,u1,1,1,0,4,0,0.02,5,", "Cross-Talk", "0.5", "cross_talk", 0.5),
        ("odom1,u1,1,1,0,4,0,0.02,,", "Ticks per Inch", "48", "ticks_per_inch", 48),
        ("gyro1,u1,1,,,,,0.02,,", "Random Walk (deg/sqrt s)", "0.005", "random_walk", 0.005),
        ("comp1,u1,1,,,,0,0.02,,", "Hard Iron (deg)", "-8", "hard_iron", -8),
        ("comp1,u1,1,,,,0,0.02,,", "Soft Iron (deg)", "3", "soft_iron", 3),
        ("ir1,u1,1,1,0,4,0,0.02,5,0.5", "Answer", "Analog", "analog", True),
        ("ir1,u1,1,1,0,4,0,0.02,5,0.5", "Answer", "digital", "analog", False),
    ],
)
def test_columns_of_faults_are_read(
    folder: Path, row: str, column: str, cell: str, field: str, value: float
) -> None:
    write_sensors(folder, f"{row},{cell}", columns=(column,))
    assert getattr(only_sensor(folder), field) == value
    write_sensors(folder, f"{row},", columns=(column,))
    assert not getattr(only_sensor(folder), field)


@pytest.mark.parametrize(
    ("column", "bad", "allowed"),
    [
        ("Read Time (s)", "-1", "a number, 0 or more"),
        ("Dropout", "1.1", "a number from 0 to 1"),
        ("Outlier", "-0.1", "a number from 0 to 1"),
        ("Incidence Limit (deg)", "91", "a number from 0 to 90"),
        ("Cross-Talk", "2", "a number from 0 to 1"),
    ],
)
def test_columns_of_faults_are_checked(
    folder: Path, problems: Problems, column: str, bad: str, allowed: str
) -> None:
    write_sensors(folder, f"ultra1,u1,1,1,2,3,4,0,5,,{bad}", columns=(column,))
    assert problems() == [f'sensors.csv:2:{column}: must be {allowed}, not "{bad}"']


def test_the_vertical_field_of_view_is_read(folder: Path) -> None:
    write_sensors(folder, "ultra1,u1,1,1,0,4,0,0.02,5,,15", columns=("Vertical FOV (deg)",))
    assert only_sensor(folder).vertical_field_of_view == 15
    write_sensors(folder, "tof1,u1,1,1,0,4,0,0.02,5,,", columns=("Vertical FOV (deg)",))
    assert only_sensor(folder).vertical_field_of_view == 0


@pytest.mark.parametrize("column", ["Min Range (in)", "Max Range (in)", "Rays", "Vertical FOV (deg)"])
def test_range_columns_are_for_range_sensors_only(folder: Path, problems: Problems, column: str) -> None:
    write_sensors(folder, "comp1,c1,1,,,,0,0.1,,,5", columns=(column,))
    assert problems() == [f'sensors.csv:2:{column}: is for {RANGES} only; leave it blank for comp, not "5"']


@pytest.mark.parametrize(
    "row",
    [
        "gyro1,g1,1,,,,,0.01,,",
        "comp1,c1,1,,,,90,0.1,,",
        "odom1,o1,1,3,0,,90,0.02,,",
        "tof1,t1,1,1,2,3,4,0,5,",
    ],
)
def test_cells_that_do_not_apply_to_a_type_may_be_blank(folder: Path, problems: Problems, row: str) -> None:
    write_sensors(folder, row)
    assert problems() == []


def test_cells_that_do_not_apply_may_hold_any_number_but_no_nonsense(
    folder: Path, problems: Problems
) -> None:
    write_sensors(folder, "gyro1,g1,1,0,0,-4,0,0.01,999,50")
    assert problems() == []
    write_sensors(folder, "gyro1,g1,1,0,0,4,0,0.01,n/a,50")
    assert problems() == ['sensors.csv:2:Field of View (deg): must be a number, not "n/a"']


@pytest.mark.parametrize(
    ("row", "column"),
    [
        ("ultra1,,1,1,2,3,4,0,5,", "Poll Character"),
        ("ultra1,u1,,1,2,3,4,0,5,", "Enabled"),
        ("ultra1,u1,1,,2,3,4,0,5,", "X Position (in)"),
        ("ultra1,u1,1,1,,3,4,0,5,", "Y Position (in)"),
        ("ultra1,u1,1,1,2,,4,0,5,", "Z Position (in)"),
        ("ultra1,u1,1,1,2,3,,0,5,", "Rotation (deg)"),
        ("gyro1,u1,1,,,,,,,", "Percent Error (0-1)"),
        ("tof1,u1,1,1,2,3,4,0,,", "Field of View (deg)"),
        ("ir1,u1,1,1,2,3,4,0,5,", "Threshold"),
    ],
)
def test_blank_cell_where_a_value_is_needed_is_a_problem(
    folder: Path, problems: Problems, row: str, column: str
) -> None:
    write_sensors(folder, row)
    (line,) = problems()
    assert line.startswith(f"sensors.csv:2:{column}: is blank; must be ")


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        (",u1,1,1,2,3,4,0,5,", "ID: must be a type and a number, such as ultra1, not blank"),
        ("ultr2,u1,1,1,2,3,4,0,5,", 'ID: must be a type and a number, such as ultra1, not "ultr2"; did you '
         f'mean "ultra2"? (types: {listed(KINDS)})'),
        ("ultra,u1,1,1,2,3,4,0,5,", 'ID: must be a type and a number, such as ultra1, not "ultra"; did you '
         'mean "ultra1"?'),
        ("ultra1,u12,1,1,2,3,4,0,5,", "Poll Character: must be two printable ASCII characters without"),
        ('ultra1,"u 1",1,1,2,3,4,0,5,', "Poll Character: must be two printable ASCII characters"),
        ("ultra1,ü1,1,1,2,3,4,0,5,", 'Poll Character: must be two printable ASCII characters without a '
         'space, such as u1, not "ü1"'),
        ("ultra1,u1,yes,1,2,3,4,0,5,", 'Enabled: must be 0 (off) or 1 (on), not "yes"'),
        ("ultra1,u1,1,1e999,2,3,4,0,5,", 'X Position (in): must be a number, not "1e999"'),
        ("ultra1,u1,1,1,inf,3,4,0,5,", 'Y Position (in): must be a number, not "inf"'),
        ("ultra1,u1,1,1,2,-3,4,0,5,", 'Z Position (in): must be a number, 0 or more, not "-3"'),
        ("ultra1,u1,1,1,2,3,4_0,0,5,", 'Rotation (deg): must be a number, not "4_0"'),
        ("ultra1,u1,1,1,2,3,4,1.01,5,", 'Percent Error (0-1): must be a number from 0 to 1, not "1.01"'),
        ("ultra1,u1,1,1,2,3,4,5%,5,", 'Percent Error (0-1): must be a number from 0 to 1, not "5%"'),
        ("ultra1,u1,1,1,2,3,4,0,361,", 'Field of View (deg): must be a number from 0 to 360, not "361"'),
        ("ir1,u1,1,1,2,3,4,0,180,1", 'Field of View (deg): must be a number from 0 to below 180, not "180"'),
        ("ir1,u1,1,1,2,3,4,0,40,1.5", 'Threshold: must be a number from 0 to 1, not "1.5"'),
    ],
)  # fmt: skip
def test_sensor_mistakes_name_the_cell_and_what_is_allowed(
    folder: Path, problems: Problems, row: str, expected: str
) -> None:
    write_sensors(folder, row)
    (line,) = problems()
    assert line.startswith(f"sensors.csv:2:{expected}")


@pytest.mark.parametrize(
    ("column", "bad", "allowed"),
    [
        ("Gain", "x", "a number"),
        ("Absolute Error", "-1", "a number, 0 or more"),
        ("Bias", "inf", "a number"),
        ("Drift (per s)", "1e400", "a number"),
        ("Min Range (in)", "-1", "a number, 0 or more"),
        ("Max Range (in)", "inf", "a number, 0 or more"),
        ("Resolution", "-0.1", "a number, 0 or more"),
        ("Rays", "0", "a whole number from 1 to 1000"),
        ("Rays", "1001", "a whole number from 1 to 1000"),
        ("Rays", "2.5", "a whole number from 1 to 1000"),
        ("Wrap", "-360", "a number, 0 or more"),
    ],
)
def test_optional_columns_are_checked(
    folder: Path, problems: Problems, column: str, bad: str, allowed: str
) -> None:
    write_sensors(folder, f"ultra1,u1,1,1,2,3,4,0,5,,{bad}", columns=(column,))
    assert problems() == [f'sensors.csv:2:{column}: must be {allowed}, not "{bad}"']


@pytest.mark.parametrize(
    ("limits", "column", "what"),
    [
        ("433,", "Min Range (in)", "must be below the longest distance in this maze, "),
        ("9,9", "Min Range (in)", "must be below the greatest range, 9 in, not 9: "),
        (",0", "Max Range (in)", "must be below the greatest range, 0 in, not 0: "),
    ],
)
def test_a_sensor_that_can_read_nothing_is_a_problem(
    folder: Path, problems: Problems, limits: str, column: str, what: str
) -> None:
    row = f"ultra1,u1,1,1,2,3,4,0,5,,{limits}"
    write_sensors(folder, row, columns=("Min Range (in)", "Max Range (in)"))
    (line,) = problems()
    assert line.startswith(f"sensors.csv:2:{column}: {what}")
    assert "could not read anything" in line


@pytest.mark.parametrize(
    ("row", "column", "greatest"),
    [
        ("ultra1,u1,1,1,2,3,4,0,5,,10,9", "Min Range (in)", 9),
        ("tof1,u1,1,1,2,3,4,0,5,,48,", "Min Range (in)", 47),
    ],
)
def test_least_range_above_the_greatest_is_a_problem(
    folder: Path, problems: Problems, row: str, column: str, greatest: int
) -> None:
    write_sensors(folder, row, columns=("Min Range (in)", "Max Range (in)"))
    (line,) = problems()
    assert line.startswith(f"sensors.csv:2:{column}: the least range, ")
    assert line.endswith(f"must not be above the greatest, {greatest}")


def test_codes_are_unique_over_both_files_among_all_rows(edit: Edit, problems: Problems) -> None:
    edit("sensors.csv", "ultra2,u2,1", "ultra2,u1,0")
    edit("drive.csv", "rot,r1", "rot,g1")
    unique = "codes must be unique over both files"
    assert problems() == [
        f'sensors.csv:3:Poll Character: "u1" is the code of sensors.csv:2 already; {unique}',
        f'drive.csv:6:Poll Character: "g1" is the code of sensors.csv:16 already; {unique}',
    ]


def test_ids_are_unique_by_type_and_number(edit: Edit, problems: Problems) -> None:
    edit("sensors.csv", "ultra2", "Ultra01")
    edit("drive.csv", "down", "UP")
    assert problems() == [
        'sensors.csv:3:ID: "ultra1" is in line 2 already; every ID must occur once',
        'drive.csv:3:ID: "up" is in line 2 already; every ID must occur once',
    ]


def test_codes_may_be_any_two_printable_ascii_characters(folder: Path, problems: Problems) -> None:
    rows = [
        f"ultra{n},{code},1,1,2,3,4,0,5," for n, code in enumerate(["--", "-1", '""""""', "~!", "U1", "u1"])
    ]
    write_sensors(folder, *rows)
    assert problems() == []
    assert [sensor.code for sensor in load(folder).simulation.sensors] == ["--", "-1", '""', "~!", "U1", "u1"]


def test_unknown_header_is_an_error_with_a_suggestion(edit: Edit, problems: Problems) -> None:
    edit("sensors.csv", "Threshold", "Threshold,Gian")
    edit("drive.csv", "Rotation Bias", "Rotation Bias,Speeed")
    assert [line.partition(" (a column")[0] for line in problems()] == [
        'sensors.csv:1:Gian: is not a column that is known; did you mean "Gain"?',
        'drive.csv:1:Speeed: is not a column that is known; did you mean "Speed"?',
    ]


def test_misspelled_needed_header_is_named_once_and_as_missing(edit: Edit, problems: Problems) -> None:
    edit("sensors.csv", "Z Position (in)", "Z Position (cm)")
    lines = problems()
    assert len(lines) == 2
    assert lines[0].startswith(
        'sensors.csv:1:Z Position (cm): is not a column that is known; did you mean "Z Position (in)"?'
    )
    assert lines[1] == "sensors.csv:1:Z Position (in): this column is missing from the header row"


def test_columns_and_rows_of_notes_without_header_are_left_alone(folder: Path, problems: Problems) -> None:
    write_sensors(folder, "gyro1,g1,1,,,,,0.01,,,,my note", ",,,,,,,,,,,only a note", "", columns=("", ""))
    assert problems() == []


def test_doubled_header_is_a_problem(edit: Edit, problems: Problems) -> None:
    edit("drive.csv", "Rotation Bias", "Rotation Bias,enabled")
    assert problems() == ["drive.csv:1:enabled: is a column already (column C); each column must occur once"]


@pytest.mark.parametrize("name", ["sensors.csv", "drive.csv"])
def test_file_without_header_row_is_one_problem(folder: Path, problems: Problems, name: str) -> None:
    text = (folder / name).read_text().split("\n", 1)[1]
    (folder / name).write_text(text)
    (line,) = problems()
    assert line.startswith(f"{name}:1: the first row must be the header row: ID,Poll Character,")


def test_drive_gain_and_speed_are_optional_by_name(folder: Path) -> None:
    text = (folder / "drive.csv").read_text().splitlines()
    text[0] += ",Speed,Gain"
    text[1] = "up,w1,0,0.1,0.2,0.3,0.4,0.5,-0.6,12,-1"
    (folder / "drive.csv").write_text("\n".join(text))
    up, *others = load(folder).simulation.drives
    assert (up.enabled, up.speed, up.gain) == (False, 12, -1)
    assert (up.error, up.bias) == (Axes(x=0.2, y=0.1, r=0.3), Axes(x=0.5, y=0.4, r=-0.6))
    assert [drive.speed for drive in others] == [6, 6, 6, 120]


def test_start_lag_and_acceleration_are_for_movements(folder: Path, problems: Problems) -> None:
    text = (folder / "drive.csv").read_text().splitlines()
    text[0] += ",Start Lag (s),Acceleration"
    text[1] += ",0.08,20"
    (folder / "drive.csv").write_text("\n".join(text))
    up, *others = load(folder).simulation.drives
    assert (up.start_lag, up.acceleration) == (0.08, 20)
    assert {(drive.start_lag, drive.acceleration) for drive in others} == {(0, 0)}
    text[1] = text[1].replace(",0.08,20", ",-1,fast")
    text.append("grip,gr,1,,,,,,,0.1,")
    (folder / "drive.csv").write_text("\n".join(text))
    assert problems() == [
        'drive.csv:2:Start Lag (s): must be a number, 0 or more, not "-1"',
        'drive.csv:2:Acceleration: must be a number, 0 or more, not "fast"',
        "drive.csv:12:Start Lag (s): is for movements only; leave it blank for grip",
    ]


def test_drives_may_be_fewer_than_five(folder: Path, problems: Problems) -> None:
    text = (folder / "drive.csv").read_text().splitlines()
    (folder / "drive.csv").write_text("\n".join(text[:2]))
    assert problems() == []


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ("upp,w1,1,0,0,0,0,0,0,,", f'ID: must be {IDS} or "wheels", not "upp"; did you mean "up"?'),
        ("up,w,1,0,0,0,0,0,0,,", 'Poll Character: must be two printable'),
        ("up,w1,2,0,0,0,0,0,0,,", 'Enabled: must be 0 (off) or 1 (on), not "2"'),
        ("up,w1,1,-1,0,0,0,0,0,,", 'Y-Axis Error: must be a number, 0 or more, not "-1"'),
        ("up,w1,1,0,,0,0,0,0,,", 'X-Axis Error: is blank; must be a number, 0 or more'),
        ("up,w1,1,0,0,0,0,0,nan,,", 'Rotation Bias: must be a number, not "nan"'),
        ("up,w1,1,0,0,0,0,0,0,inf,", 'Gain: must be a number, not "inf"'),
        ("up,w1,1,0,0,0,0,0,0,,0", 'Speed: must be a number above 0, not "0"'),
    ],
)  # fmt: skip
def test_drive_mistakes_name_the_cell_and_what_is_allowed(
    folder: Path, problems: Problems, row: str, expected: str
) -> None:
    header = (folder / "drive.csv").read_text().splitlines()[0]
    (folder / "drive.csv").write_text(f"{header},Gain,Speed\n{row}\n")
    (line,) = problems()
    assert line.startswith(f"drive.csv:2:{expected}")


def test_the_help_of_a_column_says_what_a_blank_cell_means() -> None:
    """In the last brackets: the default, and perhaps its meaning."""
    gripper = GripperSpec(code="p1")
    described: list[tuple[Any, CsvColumn]] = [
        *((DriveSpec(kind=DriveKind.UP, code="w1"), each) for each in (DRIVE_GAIN, START_LAG, ACCELERATION)),
        *((gripper, each) for each in (REACH, WIDTH)),
    ]
    for kind in KINDS.values():
        described += [(kind.spec_type(kind=kind, number=1, code="?"), each) for each in kind.columns]
    told, defaults = dict[str, str](), defaultdict[str, set[str]](set)
    for spec, column in described:
        # The reference names the kinds with another default than most beside it.
        found = re.search(r"\(([^() ]+?)(?:: [^()]*)?\)$", column.help)
        if found and not column.needed:
            told[column.name] = found[1].casefold()
            defaults[column.name].add(column.rule.shown(getattr(spec, column.field)).casefold())
    assert len(told) >= 20
    assert [name for name, default in told.items() if default not in defaults[name]] == []
    assert SPEED.help.endswith(f"({TRANSLATION_SPEED:g}, {ROTATION_SPEED:g}, {gripper.speed:g})")


def test_a_lidar_is_the_part_of_its_profile_unless_its_row_says_otherwise(folder: Path) -> None:
    profile = tomllib.loads((bundled_folder() / "profiles/sensors/rplidar-a1m8.toml").read_text("utf-8"))
    default = LidarSpec(kind=KINDS["lidar"], number=1, code="sc")
    given = {name: value for name, value in profile.items() if name not in ("title", "kind")}
    assert {name: getattr(default, name) for name in given} == given
