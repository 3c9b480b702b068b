"""The scan of a lidar on the screen: panels, answers, radar, events, and the picture over time."""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder, init_set
from simmer_tui.live.operating.switches import SHOWN
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Action, ActionName
from simmer_tui.run.state import SensorRow
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Pose, SimulationSpec, Simulator, parse_command
from simmer_tui.sim.arcs import Twist
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.records import CommandResult, LidarScan
from simmer_tui.sim.scan_rays import rays_of
from simmer_tui.sim.sensors import Lidar, LidarSpec
from simmer_tui.tui.answers import scan_answer
from simmer_tui.tui.event_text import reply_text
from simmer_tui.tui.line_panel import text_of
from simmer_tui.tui.maze.glyphs import signs_for
from simmer_tui.tui.maze.palette import Look, Role, palette_for
from simmer_tui.tui.maze.scene import Scene, scene_of
from simmer_tui.tui.radar import radar_cells, radar_scale
from simmer_tui.tui.readouts import Room, status_line
from simmer_tui.tui.recorded import RecordedRun
from simmer_tui.tui.sensor_facts import sensor_facts
from simmer_tui.tui.terminal import ColorDepth, GlyphMode
from tests.tui.conftest import KEYS, Cockpit
from tests.tui.test_readouts import Run, texts

LIDAR = LidarSpec(kind=Lidar, number=1, code="sc", z=4.0, error=0.0, min_range=0.0, dropout=0.0)
SENSORS = (bundled_folder() / "sensors.csv").read_text(encoding="utf-8")


def with_lidar(lidar: str = "lidar1,sc,1,0,0,4,0,0.01,,") -> str:
    """The default set's sensors.csv with one more row."""
    return f"{SENSORS.rstrip()}\n{lidar}\n"


@pytest.fixture
def spec(course_spec: SimulationSpec) -> SimulationSpec:
    return replace(course_spec, sensors=(*course_spec.sensors, LIDAR))


@pytest.fixture
def run(spec: SimulationSpec) -> Run:
    return Run(spec)


def scene(run: Run, shown: frozenset[str] = SHOWN) -> Scene:
    spec = run.engine.simulator.spec
    return scene_of(spec, Maze(spec.maze), run.snapshot(), shown=shown)


def row(run: Run) -> SensorRow:
    return run.snapshot().state.sensors["sc"]


# -- panels ----------------------------------------------------------------------------------------


def test_a_lidar_has_the_first_row_with_its_nearest_echo(run: Run) -> None:
    unread = run.sensors(36)
    assert unread[1].startswith("sc ○   –   lidar ")
    assert unread[1].endswith("not read")
    run.give("u1", "sc")
    near = row(run).reading.scan
    assert near is not None
    line = run.sensors(36)[1]
    assert line == f"sc ○ 360 points, nearest {near.ranges.min():.1f} in ←"
    assert run.sensors(51)[1] == f"{line} farthest {near.ranges.max():.1f} in"
    assert run.sensors(13)[:2] == ["range    0–48", "sc ○ 360 pts"]


def test_a_far_wall_in_a_scan_leaves_the_scale_of_the_bars_alone(spec: SimulationSpec) -> None:
    run = Run(replace(spec, sensors=(replace(LIDAR, gain=2.0), *spec.sensors[:-1])))
    run.give("sc", "u1")
    assert max(row(run).history) > 48.0
    assert "range 0–48  " in run.sensors(36)[0]


def test_a_scan_without_any_echo_says_so(spec: SimulationSpec) -> None:
    run = Run(replace(spec, sensors=(replace(LIDAR, max_range=0.5),))).give("sc")
    assert run.sensors(36)[1] == "sc ○ 360 points, no echo"
    assert "no echo all around" in texts(facts(run))[-1]
    answer = scan_answer(run.snapshot(), plain=False)
    assert answer is not None
    assert text_of(answer.lines[1]) == "no echo 360 points"


def test_ascii_has_letters_for_the_direction(run: Run) -> None:
    run.give("sc")
    line = run.sensors(36, glyphs=GlyphMode.ASCII)[1]
    assert line.startswith("sc   360 points, nearest ")
    assert line.endswith(" in L")
    assert line.isascii()


def facts(run: Run) -> list[tuple[tuple[str, str], ...]]:
    return sensor_facts(run.snapshot(), 54, "sc", {}, run.engine.simulator.spec.sensors, plain=False)


def test_the_facts_of_a_lidar_have_its_revolution_and_its_extremes(run: Run) -> None:
    run.give("d1-6", "sc")
    scan = row(run).reading.scan
    assert scan is not None
    looks, sits, read, nearest = texts(facts(run))[1:]
    assert looks == "looks    all around, clockwise, 5.5 scans a second"
    assert sits == "sits     at the centre, 4 in up"
    assert read.startswith("read     360 points at 00:0")
    assert read.endswith(f", revolution {scan.revolution}")
    assert nearest.startswith(f"nearest  {scan.ranges.min():.1f} in ")
    assert max(map(len, texts(facts(run)))) <= 54


def test_a_scan_read_while_the_robot_stands_is_the_answer(run: Run) -> None:
    run.give("sc")
    answer = scan_answer(run.snapshot(), plain=True)
    assert answer is not None
    assert answer.title == "sc"
    lines = texts(list(answer.lines))
    assert lines[0] == "360 points, 1 deg apart"
    assert lines[1].startswith("nearest ")
    assert lines[1].endswith(" in to the left")
    assert lines[3] == "no echo 0 points"
    assert len(answer.shown(Room(36, 7))) <= 7
    run.give("u1")
    assert scan_answer(run.snapshot(), plain=True) is None
    run.give("sc", "d1-3")
    assert scan_answer(run.snapshot(), plain=True) is None
    run.give("sc")
    snapshot = run.snapshot()
    driving = replace(snapshot.state, velocity=Twist(3.0, 0.0, 0.0))
    assert scan_answer(dataclasses.replace(snapshot, state=driving), plain=True) is None


def test_the_line_of_a_small_screen_has_nearest_and_farthest(run: Run) -> None:
    run.give("d1-6", "sc")
    line = text_of(status_line(run.snapshot(), run.snapshot().entries, brief=True))
    assert line.startswith("sc 360 points, nearest ")
    assert ", farthest " in line
    assert len(line) <= 80
    assert text_of(status_line(run.snapshot(), (), brief=False)).startswith("last reply  sc -> 360 ranges")


# -- events ----------------------------------------------------------------------------------------


def test_the_list_of_events_keeps_no_scans_of_a_program(run: Run) -> None:
    """Entries are kept by the thousand, and a scan has some kilobytes."""
    for _ in range(5):
        run.give("sc", "d1-1")
    run.give("sc", source="console")
    entries = run.snapshot().entries
    kept = [each.event for entry in entries for each in (entry.kept or (entry,))]
    read = [each for each in kept if isinstance(each, CommandResult) and each.reading is not None]
    assert len(read) == 6
    for each in read:
        assert each.ranges is not None
        assert each.ranges.strides == (0,)  # one number in memory
        assert reply_text(each).startswith("360 ranges, nearest 6.0 in at ")


def test_one_ray_of_a_lidar_is_a_number_and_a_ray(run: Run) -> None:
    run.give("sc-90")
    assert row(run).reading.scan is None
    assert run.sensors(36)[1].startswith("sc ○ ")
    assert scene(run).scans == ()
    assert [each.sensor for each in scene(run).views] == ["sc"]


# -- picture ---------------------------------------------------------------------------------------


def test_a_newer_scan_replaces_the_older_and_a_drive_does_not(run: Run) -> None:
    run.give("sc")
    (first,) = scene(run).scans
    assert scene(run).views == ()
    assert scene(run).scan_is_newest
    run.give("d1-8")
    (still,) = scene(run).scans
    assert (still.ends == first.ends).all()
    run.give("sc", "u1")
    (second,) = scene(run).scans
    assert second.origins[:, 0].mean() > first.origins[:, 0].mean() + 5.0
    assert not scene(run).scan_is_newest
    run.engine.perform(Action(ActionName.RESET))
    assert scene(run).scans == ()


def test_the_radar_is_filled_by_a_scan_and_its_scale_holds_it(run: Run) -> None:
    run.give("sc")
    shown = scene(run)
    near = np.sort(shown.scans[0].ranges)
    assert radar_scale(shown) == next((each for each in (24, 36, 48) if each >= near[269]), 48)
    palette = palette_for(ColorDepth.TRUECOLOR, Look.DARK)
    signs = signs_for(GlyphMode.QUADRANT, ColorDepth.TRUECOLOR)

    def dots(scene: Scene) -> int:
        cells = radar_cells(scene, Maze(scene.maze), 21, 42, signs, palette)
        return int((cells.foreground == palette[Role.RAY_STRONG]).sum())

    assert dots(shown) > 40
    assert dots(scene(run, SHOWN - {"plot_sense"})) == 0


@pytest.mark.slow
@pytest.mark.parametrize("size", [(80, 24), (120, 36), (200, 60)])
def test_every_size_shows_a_scan_and_a_key_hides_it(
    fly: Callable[..., int | None], size: tuple[int, int]
) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        robot = cockpit.client()
        await asyncio.to_thread(robot.scan, "sc")
        await cockpit.until(lambda: "sc ○ 360 p" in cockpit["sensors"])
        legend = cockpit.maze.legend
        await cockpit.until(lambda: "scan" in legend(size[0] - 40).text)
        assert cockpit.maze.scene is not None
        assert len(cockpit.maze.scene.scans) == 1
        await cockpit.press(KEYS.rays)
        await cockpit.until(lambda: "scan" not in legend(size[0] - 40).text)
        if size[0] == 120:
            await cockpit.until(lambda: "360 points, 1 deg apart" in cockpit["answer"])
        if size[0] == 200:
            await cockpit.until(lambda: "revolution" in cockpit["facts"])

    fly(scenario, size=size, files={"sensors.csv": with_lidar()})


@pytest.mark.slow
def test_a_program_that_scans_as_it_drives_is_never_held_up(fly: Callable[..., int | None]) -> None:
    """In timed motion, with scans at every turn of the head."""

    async def scenario(cockpit: Cockpit) -> None:
        robot = cockpit.client()

        def drive() -> list[float]:
            robot.send("vv-3;0;40")
            return [len(robot.scan("sc")) for _ in range(8)]

        counts = await asyncio.to_thread(drive)
        assert counts == [360] * 8
        await cockpit.until(lambda: cockpit.maze.scene is not None and cockpit.maze.scene.scans)
        state = cockpit.maze.scene
        assert state is not None
        assert len(state.scans) == 1
        assert cockpit.maze.fault == ""

    fly(scenario, files={"sensors.csv": with_lidar()}, motion__motion="timed", motion__time_scale=20.0)


def test_a_replay_shows_the_scan_of_its_moment(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    init_set(folder, bundled_folder())
    (folder / "sensors.csv").write_text(with_lidar(), encoding="utf-8")
    configuration = load(folder)
    engine = Engine(Simulator(configuration.simulation, 5))
    scans: list[LidarScan] = []
    moments = []
    with RunLog(tmp_path / "run.jsonl", configuration, engine.simulator) as log:
        engine.watch(log)
        session = engine.session()
        for command in ("d1-3", "sc", "r1-90", "vv-3;0;40", "wt-0.4", "sc", "wt-0.5"):
            session.submit(parse_command(command), lambda result: scans.extend(_scans(result)))
            moments.append(engine.simulator.time)
    with RunLogIndex(tmp_path / "run.jsonl") as index:
        recorded = RecordedRun(index)
        # Forwards, and back again.
        for moment, shown in ((moments[6], 1), (moments[2], 0), (0.0, None), (moments[5], 1)):
            recorded.move_to(moment + 1e-3)
            snapshot = asyncio.run(recorded.snapshot(0, True))
            spec = configuration.simulation
            drawn = scene_of(spec, Maze(spec.maze), snapshot).scans
            if shown is None:
                assert drawn == ()
                continue
            (rays,) = drawn
            exact = rays_of(scans[shown], snapshot.state.sensors["sc"].reading.sensor, Pose(0.0, 0.0, 0.0))
            assert (rays.ends == exact.ends).all()


def _scans(result: CommandResult) -> list[LidarScan]:
    return [] if result.reading is None or result.reading.scan is None else [result.reading.scan]


def test_a_real_robots_other_rays_are_drawn_from_where_it_read(run: Run) -> None:
    """Nobody knows when each ray of such a scan was sent."""
    run.give("sc")
    snapshot = run.snapshot()
    known = snapshot.state.sensors["sc"]
    scan = known.reading.scan
    assert scan is not None
    other = replace(scan, ranges=scan.ranges[::2], bearings=scan.bearings[::2], poses=np.empty((0, 3)))
    changed = replace(known, reading=replace(known.reading, scan=other))
    (rays,) = scene_of(
        run.engine.simulator.spec,
        Maze(run.engine.simulator.spec.maze),
        dataclasses.replace(snapshot, state=replace(snapshot.state, sensors={"sc": changed})),
    ).scans
    assert rays.ends.shape == (180, 2)
    assert (rays.origins == (known.pose.x, known.pose.y)).all()
