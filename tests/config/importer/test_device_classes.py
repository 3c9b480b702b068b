"""Numbers of a team's own device classes, read and never executed."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simmer_tui.config.importer.device_classes import read_device_classes
from simmer_tui.config.importer.files import read_path

CONFIG = """
walls = [[1, 1], [1, 1]]
block_size = 3
robot_start_position = [12, 12]
sensors = {'t0': ToF({'position': [0, 3], 'height': 2, 'error': 0.01})}
"""
GET = """
class ToF(Device):
    def __init__(self, info):
        super().__init__(info)
        self.beamwidth = info.get('beamwidth', 15)
        self.num_rays = int(info.get('num_rays', 13))
        self.min_range = info.get('min_range', 1.1)
        open('ran', 'w')
"""
BRANCHES = """
class ToF(Device):
    def __init__(self, info):
        self.fov = info['fov'] if 'fov' in info else 15
        if 'num_rays' in info:
            self.num_rays = info['num_rays']
        else:
            self.num_rays = 13
        try:
            self.min_range = info['min_range']
        except KeyError:
            self.min_range = 1.1
"""
CONSTANTS = """
FLOOR = 1.1

class Ranger:
    RAYS = 13
    BEAM = 15.0

class ToF(Ranger):
    def __init__(self, info):
        self.num_rays, self.beam_width = self.RAYS, ToF.BEAM
        self.min_distance = FLOOR
    BEAM = 15.0
    RAYS = 13
"""
ARGUMENTS = """
class Ranger:
    def __init__(self, info, num_rays=13, *, min_range=1.1):
        self.num_rays, self.min_range = num_rays, min_range

class ToF(Ranger):
    beamwidth = 15
"""
TABLE = """
DEFAULTS = {'num_rays': 13, 'min_range': 1.1}

class ToF(Device):
    BEAM = {'beamwidth': 15}
    UNUSED = {'min_range': 9.9}
    def __init__(self, info):
        info = {**DEFAULTS, **self.BEAM, **info}
        self.num_rays, self.min_range = info['num_rays'], info['min_range']
        self.beamwidth = info['beamwidth']
"""
SET_DEFAULT = """
class ToF(Device):
    def __init__(self, info):
        info.setdefault('num_rays', 13)
        self.num_rays = info['num_rays']
        self.beamwidth = info.setdefault('beamwidth', 15)
        self.min_range = float(info.pop('min_range', 1.1))
"""


def team(folder: Path, text: str) -> Path:
    (folder / "devices").mkdir()
    (folder / "devices" / "ToF.py").write_text(text)
    (folder / "config.py").write_text(CONFIG)
    return folder


@pytest.mark.parametrize("text", [GET, BRANCHES, CONSTANTS, ARGUMENTS, TABLE, SET_DEFAULT])
def test_a_class_gives_what_the_description_does_not(text: str, tmp_path: Path) -> None:
    imported = read_path(team(tmp_path, text))
    (sensor,) = imported.sensors
    assert (sensor.rays, sensor.min_range) == (13, 1.1)
    # Their rays stand in the middles of 13 parts of 15 degrees.
    assert sensor.field_of_view == pytest.approx(15 * 12 / 13)
    assert sensor.vertical_field_of_view == 15.0
    assert not (tmp_path / "ran").exists()
    (what,) = [each.what for each in imported.left_out if each.where.endswith(":t0")]
    assert what.startswith(
        "ToF is taken as an ultra row, which reads the nearest distance; numbers of ultra0 from its class: "
    )
    assert "num_rays 13 (devices/ToF.py:" in what
    assert "min_range 1.1 (devices/ToF.py:" in what
    assert what.endswith(
        "numbers of ultra0 that are assumed, because no file gives them as numbers: max_range inf, rotation 0"
    )


def test_the_description_wins_over_the_class(tmp_path: Path) -> None:
    folder = team(tmp_path, GET)
    text = CONFIG.replace("'height': 2", "'height': 2, 'num_rays': 5, 'fov': 20, 'min_range': 0")
    (folder / "config.py").write_text(text)
    (sensor,) = read_path(folder).sensors
    assert (sensor.rays, sensor.field_of_view, sensor.min_range) == (5, 16.0, 0.0)


def test_a_number_of_a_class_that_is_not_allowed_is_told_with_its_place(tmp_path: Path) -> None:
    imported = read_path(team(tmp_path, GET.replace("13", "0")))
    (sensor,) = imported.sensors
    assert sensor.rays == 7
    (what,) = [each.what for each in imported.left_out if each.where.endswith("t0.num_rays")]
    assert what == "devices/ToF.py:6: must be a whole number from 1 to 1000, not 0; 7 is taken"


def test_files_that_are_no_python_and_values_that_are_no_numbers_are_left_out(tmp_path: Path) -> None:
    folder = team(tmp_path, "class ToF:\n    def __init__(self, info):\n        self.num_rays = True\n")
    (folder / "devices" / "broken.py").write_text("class ToF(:")
    (folder / "devices" / "link.py").symlink_to(folder / "nowhere.py")
    (sensor,) = read_path(folder).sensors
    assert sensor.rays == 7


def test_a_class_that_is_nested_too_deeply_to_read_is_left_out(tmp_path: Path) -> None:
    branches = "".join(f"        elif info == {number}: pass\n" for number in range(1500))
    folder = team(tmp_path, f"class ToF:\n    def __init__(self, info):\n        if info: pass\n{branches}")
    (sensor,) = read_path(folder).sensors
    assert sensor.rays == 7


@given(st.text(max_size=200))
def test_any_text_is_read_or_left_out(text: str) -> None:
    with TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "devices").mkdir()
        (folder / "devices" / "any.py").write_text(text, encoding="utf-8", errors="replace")
        assert read_device_classes(folder) is not None


def test_classes_that_are_each_other_s_base_end(tmp_path: Path) -> None:
    folder = team(tmp_path, "class ToF(B):\n    num_rays = 3\nclass B(ToF):\n    min_range = 2\n")
    numbers = read_device_classes(folder).numbers["ToF"]
    assert {name: each.value for name, each in numbers.items()} == {"num_rays": 3, "min_range": 2}
