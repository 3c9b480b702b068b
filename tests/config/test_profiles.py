"""Profiles of usual drives and sensors lie over the values of a set."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec.structs import replace

from simmer_tui.cli.command_line import OneLineParser, add_setting_options, overrides_from
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.profiles import (
    DRIVE,
    LINK,
    SENSOR,
    drive_profile,
    link_profile,
    profile_names,
    sensor_profiles,
)
from simmer_tui.config.set_summary import summarize
from simmer_tui.config.sets import bundled_folder, find_set
from simmer_tui.config.settings import all_settings
from simmer_tui.config.settings_file import Override
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim import DriveKind, Simulator, Status
from simmer_tui.sim.sensors import KINDS, Compass, Ultrasonic

Problems = Callable[..., list[str]]
Edit = Callable[[str, str, str], None]
KIND_OF = {
    "hc-sr04": "ultra",
    "vl53l0x": "tof",
    "qtr": "ir",
    "mpu-6050": "gyro",
    "qmc5883l": "comp",
    "encoder": "odom",
    "rplidar-a1m8": "lidar",
}
EVERY_KIND = tuple(
    kind.spec_type(kind=kind, number=1, code=f"x{index}", error=0.5)
    for index, kind in enumerate(KINDS.values())
)


def loaded(**settings: object) -> Configuration:
    overrides = {name: Override(f"--{name}", value) for name, value in settings.items()}
    return load(bundled_folder(), overrides)


@pytest.mark.parametrize("name", profile_names(DRIVE))
def test_every_drive_profile_reads_without_a_problem(name: str) -> None:
    problems: list[Problem] = []
    profile = drive_profile(name, "here", problems)
    assert problems == []
    assert profile is not None
    assert profile.title
    assert {kind.value for kind in profile.movements} == {"up", "down", "left", "right", "rot"}
    # A differential robot cannot go sideways, which is along its Y axis: up and down.
    sideways = name in ("omni-4", "mecanum")
    assert profile.movements[DriveKind.UP]["enabled"] is sideways
    assert profile.movements[DriveKind.DOWN]["enabled"] is sideways
    assert all(
        profile.movements[kind]["enabled"] for kind in (DriveKind.LEFT, DriveKind.RIGHT, DriveKind.ROT)
    )


def test_there_are_the_profiles_of_the_course() -> None:
    assert profile_names(DRIVE) == ("diff-dc", "diff-stepper", "mecanum", "omni-4")
    assert set(profile_names(SENSOR)) == set(KIND_OF)


@pytest.mark.parametrize("name", profile_names(SENSOR))
def test_every_sensor_profile_reads_without_a_problem(name: str) -> None:
    problems: list[Problem] = []
    (profile,) = sensor_profiles([name], "here", EVERY_KIND, problems)
    assert problems == []
    assert profile.kind.name == KIND_OF[name]
    changed = profile.over(EVERY_KIND)
    assert [new.kind for new, old in zip(changed, EVERY_KIND, strict=True) if new != old] == [profile.kind]
    assert all((new.x, new.y, new.rotation) == (0, 0, 0) for new in changed)
    assert all(new.min_range <= new.max_range for new in changed)


@pytest.mark.parametrize(("name", "seconds"), [("hc-sr04", 0.06), ("vl53l0x", 0.033), ("mpu-6050", 0.002)])
def test_sensor_profiles_say_what_a_reading_takes(name: str, seconds: float) -> None:
    (profile,) = sensor_profiles([name], "here", EVERY_KIND, [])
    assert profile.values["read_time"] == seconds


@pytest.mark.parametrize("name", profile_names(SENSOR))
def test_no_sensor_is_read_in_no_time(name: str) -> None:
    (profile,) = sensor_profiles([name], "here", EVERY_KIND, [])
    # A lidar's reading takes as long as its next revolution.
    assert profile.kind.is_scan or profile.values["read_time"] >= 0.002


@pytest.mark.parametrize("name", profile_names(DRIVE))
def test_no_drive_starts_at_once_or_at_full_speed(name: str) -> None:
    profile = drive_profile(name, "here", [])
    assert profile is not None
    for movement in profile.movements.values():
        if movement["enabled"]:
            assert movement["start_lag"]
            assert movement["acceleration"]


def test_sound_leaves_a_wall_that_is_met_obliquely() -> None:
    (sound, light) = sensor_profiles(["hc-sr04", "vl53l0x"], "here", EVERY_KIND, [])
    assert sound.values["incidence_limit"] == 20.0
    assert "incidence_limit" not in light.values
    assert all(profile.values["dropout"] > 0 < profile.values["outlier"] for profile in (sound, light))


@pytest.mark.parametrize("folder_name", ["drive", "sensors", "link"])
def test_each_value_has_a_comment_with_its_source_or_reason(folder_name: str) -> None:
    """Or stands in a table that repeats another's; zeros, and gains of one, need no reason."""
    for path in (bundled_folder() / "profiles" / folder_name).glob("*.toml"):
        explained: set[str] = set()
        before = ""
        for line in path.read_text(encoding="utf-8").splitlines():
            key, _, value = line.partition(" = ")
            plain = key in ("title", "kind", "enabled") or value in ("0.0", "1.0")
            if value and not line.startswith("#") and not plain and key not in explained:
                assert before.startswith("#"), f"{path.name}: {line}"
                explained.add(key)
            before = line


def test_a_drive_profile_replaces_errors_and_speeds_but_no_codes() -> None:
    plain, changed = loaded(), loaded(drive_profile="diff-dc")
    assert [drive.code for drive in changed.simulation.drives] == ["w1", "s1", "a1", "d1", "r1"]
    by_kind = {drive.kind: drive for drive in changed.simulation.drives}
    assert by_kind[DriveKind.RIGHT].speed == 10.0
    assert by_kind[DriveKind.RIGHT].error.r == 0.05
    up = next(drive for drive in plain.simulation.drives if drive.kind is DriveKind.UP)
    assert by_kind[DriveKind.UP] == replace(up, enabled=False)
    assert changed.simulation.strength == changed.settings.strength == (0.005, 1.0)
    assert changed.simulation.sensors == plain.simulation.sensors


def test_a_differential_robot_refuses_to_go_sideways() -> None:
    simulator = Simulator(loaded(drive_profile="diff-stepper").simulation, 1)
    outcome = simulator.execute("w1-3")
    assert outcome.status is Status.UNKNOWN
    assert outcome.reason == "the code w1 is disabled"
    assert simulator.execute("d1-3").status is Status.DONE


def test_the_option_for_the_strength_wins_over_the_profile() -> None:
    changed = loaded(drive_profile="mecanum", strength=(0.5, 2.0))
    assert changed.settings.strength == (0.5, 2.0)


def test_a_row_that_is_off_in_the_file_stays_off(folder: Path, edit: Edit) -> None:
    edit("drive.csv", "left,a1,1", "left,a1,0")
    edit("settings.toml", 'drive_profile = ""', 'drive_profile = "omni-4"')
    drives = {drive.kind: drive for drive in load(folder).simulation.drives}
    assert not drives[DriveKind.LEFT].enabled
    assert drives[DriveKind.RIGHT].speed == 7.0


def test_sensor_profiles_change_all_sensors_of_their_kind() -> None:
    plain, changed = loaded(), loaded(sensor_profile="hc-sr04, qmc5883l")
    for before, after in zip(plain.simulation.sensors, changed.simulation.sensors, strict=True):
        if before.kind is Ultrasonic:
            assert (after.field_of_view, after.max_range, after.rays) == (15.0, 157.5, 13)
            assert (after.x, after.y, after.z, after.rotation) == (
                before.x,
                before.y,
                before.z,
                before.rotation,
            )
        elif before.kind is Compass:
            assert (after.error, after.absolute_error, after.wrap) == (0.0, 2.0, 360.0)
        else:
            assert after == before


def test_the_options_take_names(monkeypatch: pytest.MonkeyPatch) -> None:
    parser = OneLineParser()
    add_setting_options(parser)
    argv = ["--drive-profile", "omni-4", "--sensor-profile", "vl53l0x,mpu-6050"]
    settings = load(bundled_folder(), overrides_from(parser.parse_args(argv))).settings
    assert settings.drive_profile == "omni-4"
    assert settings.sensor_profile == ("vl53l0x", "mpu-6050")


def test_the_summary_names_the_profiles() -> None:
    text = summarize(loaded(drive_profile="omni-4", sensor_profile=["qtr"]))
    assert "Profiles: omni-4, qtr." in text
    assert "Profiles" not in summarize(loaded())


@pytest.mark.parametrize("name", profile_names(LINK))
def test_a_link_takes_about_15_ms_there_and_back(name: str) -> None:
    problems: list[Problem] = []
    values = link_profile(name, "here", problems)
    assert problems == []
    assert values is not None
    assert 0.015 <= 2 * values["latency"] + values["jitter"] < 0.03


def test_link_profiles_set_latency_and_jitter_but_for_what_an_option_says() -> None:
    assert profile_names(LINK) == ("hc-05", "usb")
    assert loaded().settings.link.latency == 0.0
    assert loaded(link_profile="hc-05").settings.link.latency == 0.0075
    realistic = loaded(realistic=True).settings.link
    changed = loaded(**{"realistic": True, "link.latency": 0.5}).settings.link
    assert changed == replace(realistic, latency=0.5)
    with pytest.raises(ConfigurationError, match="no such link profile; there are hc-05 or usb"):
        loaded(link_profile="usb-c")


def test_realistic_chooses_a_profile_for_everything_there_is() -> None:
    changed = loaded(realistic=True)
    assert changed.settings.drive_profile == "omni-4"
    assert changed.settings.sensor_profile == ("hc-sr04", "vl53l0x", "qtr", "mpu-6050", "qmc5883l", "encoder")
    kinds = {sensor.kind.name: sensor for sensor in changed.simulation.sensors}
    assert set(kinds) == set(KIND_OF.values()) - {"lidar"}
    assert all(sensor.read_time for sensor in changed.simulation.sensors)
    assert kinds["odom"].ticks_per_inch == 149.0
    assert changed.simulation.strength == (0.01, 0.5)
    assert (changed.settings.link_profile, changed.settings.link.latency) == ("usb", 0.0065)
    assert changed.settings.sim
    assert "Profiles: omni-4, hc-sr04, vl53l0x, qtr, mpu-6050, qmc5883l, encoder, usb." in summarize(changed)


def test_the_help_of_realistic_names_every_profile_that_it_chooses() -> None:
    [setting] = [each for each in all_settings() if each.name == "realistic"]
    chosen = [*loaded(realistic=True).settings.sensor_profile]
    lidar = load(find_set("lidar"), {"realistic": Override("--realistic", True)})
    chosen += lidar.settings.sensor_profile
    assert "rplidar-a1m8" in chosen
    for name in ("omni-4", "usb", *chosen):
        assert f" {name}" in setting.help


def test_what_is_chosen_by_name_goes_before_what_realistic_chooses() -> None:
    settings = loaded(realistic=True, drive_profile="diff-dc", strength=(0.5, 2.0)).settings
    assert (settings.drive_profile, settings.strength) == ("diff-dc", (0.5, 2.0))
    settings = loaded(realistic=True, sensor_profile="vl53l0x").settings
    assert sorted(settings.sensor_profile) == sorted(set(KIND_OF) - {"rplidar-a1m8"})
    configuration = load(find_set("lidar"), {"realistic": Override("--realistic", True)})
    assert "rplidar-a1m8" in configuration.settings.sensor_profile


def test_realistic_asks_for_no_sensor_that_is_not_there(folder: Path, edit: Edit) -> None:
    edit("sensors.csv", "\ntof1,t1,1,3,0,4,0,0.03,25,", "")
    edit("settings.toml", "realistic = false", "realistic = true")
    assert "vl53l0x" not in load(folder).settings.sensor_profile


def test_unknown_names_list_what_there_is() -> None:
    with pytest.raises(ConfigurationError) as raised:
        loaded(drive_profile="omni4", sensor_profile="hc-sr05,mpu-6050")
    assert [str(problem) for problem in raised.value.problems] == [
        "--sensor_profile: there is no such sensor profile; there are encoder, hc-sr04, mpu-6050, qmc5883l, "
        'qtr, rplidar-a1m8 or vl53l0x; did you mean "hc-sr04"?',
        "--drive_profile: there is no such drive profile; there are diff-dc, diff-stepper, mecanum or "
        'omni-4; did you mean "omni-4"?',
    ]


def test_a_profile_for_sensors_that_are_not_there_is_a_problem(
    folder: Path, problems: Problems, edit: Edit
) -> None:
    edit("sensors.csv", "\ntof1,t1,1,3,0,4,0,0.03,25,", "")
    edit("settings.toml", "sensor_profile = []", 'sensor_profile = ["vl53l0x"]')
    (line,) = problems()
    assert line.startswith("settings.toml:")
    assert line.endswith('sensor_profile: "vl53l0x" is for sensors of the type tof, and sensors.csv has none')


def test_mistakes_in_a_profile_name_file_line_and_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("simmer_tui.config.profiles.bundled_folder", lambda: tmp_path)
    drives, sensors = tmp_path / "profiles" / "drive", tmp_path / "profiles" / "sensors"
    drives.mkdir(parents=True)
    sensors.mkdir()
    shipped = bundled_folder() / "profiles" / "drive" / "diff-dc.toml"
    text = shipped.read_text().replace("speed = 10.0", "sped = 10.0", 1).replace("[rot]", "[rotation]")
    (drives / "mine.toml").write_text(text)
    (sensors / "mine.toml").write_text('title = "mine"\nkind = "comp"\nwrap = -1\nfield_of_view = 3\n')
    problems: list[Problem] = []
    assert drive_profile("mine", "here", problems) is None
    lines = [str(problem) for problem in problems]
    assert [line.split(": ")[0].split(":")[-1] for line in lines] == [
        "rotation",
        "right.speed",
        "right.sped",
        "rot",
    ]
    problems.clear()
    sensor_profiles(["mine"], "here", (), problems)
    assert [str(problem) for problem in problems][:2] == [
        "mine.toml:3:wrap: must be a number, 0 or more, not -1",
        "mine.toml:4:field_of_view: is not known here",
    ]
