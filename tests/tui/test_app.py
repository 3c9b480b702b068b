"""The app under a pilot: every key, every order, the panels, and what must not end it."""

from __future__ import annotations

import asyncio
import contextlib
import queue
import shlex
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from textual.geometry import Region
from textual.widgets import Input
from textual.widgets._toast import Toast

from simmer_tui.live.operating.orders import CONSOLE_COMMANDS
from simmer_tui.sim.angles import half_turn
from simmer_tui.sim.records import Pose
from simmer_tui.sim.specs import Axes
from simmer_tui.tui import shell
from simmer_tui.tui.help import CommandProvider, HelpScreen
from simmer_tui.tui.log_panel import LogPanel
from simmer_tui.tui.maze.view import MazeView
from simmer_tui.tui.terminal import GlyphMode
from simmer_tui.tui.textual_internals import rows_of
from tests.tui.conftest import KEYS

Fly = Callable[..., int | None]
Cockpit = Any


# -- keys ------------------------------------------------------------------------------------


def test_keys_drive_turn_and_go_sideways_and_with_shift_finely(fly: Fly) -> None:
    groups = (
        ("d1-3", "up", "w"),
        ("a1-3", "down", "s"),
        ("r1-15", "left", "a"),
        ("r1--15", "right", "d"),
        ("w1-3", "q"),
        ("s1-3", "e"),
        ("d1-0.5", "shift+up", "W"),
        ("a1-0.5", "shift+down", "S"),
        ("r1-3", "shift+left", "A"),
        ("r1--3", "shift+right", "D"),
        ("w1-0.5", "Q"),
        ("s1-0.5", "E"),
    )
    keys = {key: command for command, *group in groups for key in group}

    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.press(*keys)
        await cockpit.until(lambda: len(cockpit.commands("keys")) == len(keys))
        assert cockpit.commands("keys") == list(keys.values())

    fly(scenario)


@pytest.mark.slow
def test_step_sizes_and_keys_come_from_the_settings(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.press("k", "K", "up", "j", "w")
        await cockpit.until(lambda: len(cockpit.commands("keys")) == 3)
        assert cockpit.commands("keys") == ["d1-2", "d1-0.25", "r1-10"]

    fly(
        scenario,
        keys__forward="k",
        keys__turn_left="j",
        keys__poll="ctrl+k",
        screen__step=2.0,
        screen__fine_step=0.25,
        screen__turn=10.0,
    )


@pytest.mark.slow
def test_p_reads_every_sensor_once(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.press(KEYS.poll)
        codes = [sensor.code for sensor in cockpit.server.configuration.simulation.sensors]
        await cockpit.until(lambda: len(cockpit.commands("keys")) == len(codes))
        assert cockpit.commands("keys") == codes
        await cockpit.until(lambda: "not read" not in cockpit["sensors"])

    fly(scenario)


@pytest.mark.slow
def test_space_stops_a_movement_that_takes_its_time(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("d1-12")
        await cockpit.until(lambda: "moving" in cockpit["robot"])
        await cockpit.press("space")
        await cockpit.until(lambda: "standing" in cockpit["robot"])
        assert cockpit.server.simulator.pose.x < 9.5 + 11
        await cockpit.until(lambda: "stopped" in cockpit["log"])

    fly(scenario, motion__motion="timed", motion__time_scale=0.5)


@pytest.mark.slow
def test_r_puts_everything_back_to_the_start(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.press("w", "a", KEYS.reset)
        await cockpit.until(lambda: "back at the start" in cockpit["log"])
        assert cockpit.server.simulator.pose == Pose(9.5, 42.0, 0.0)

    fly(scenario)


@pytest.mark.slow
def test_while_paused_a_clients_command_waits_and_is_let_through_one_by_one(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.press(KEYS.step)
        await cockpit.until(lambda: "nothing is paused" in cockpit["hint"])
        robot = cockpit.client()
        await cockpit.press(KEYS.pause)
        await cockpit.until(lambda: "paused" in cockpit["robot"])
        replies: list[float] = []
        program = threading.Thread(target=lambda: replies.extend((robot.send("c1"), robot.send("d1-1"))))
        program.start()
        await cockpit.until(lambda: "paused, a command waits" in cockpit["robot"])
        assert not replies
        await cockpit.press(KEYS.step)
        await cockpit.until(lambda: "c1" in cockpit["log"])
        await cockpit.until(lambda: "a command waits" in cockpit["robot"])
        assert "d1-1" not in cockpit["log"]
        await cockpit.press(KEYS.pause)
        await cockpit.until(lambda: len(replies) == 2)
        program.join()
        await cockpit.until(lambda: "standing" in cockpit["robot"])

    fly(scenario)


@pytest.mark.slow
def test_keys_show_or_hide_trail_rays_and_true_values(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.until(lambda: cockpit.maze.scene is not None)
        for key, name in ((KEYS.trail, "trail"), (KEYS.rays, "plot_sense")):
            await cockpit.press(key)
            await cockpit.until(lambda name=name: name not in cockpit.maze.scene.shown)
            await cockpit.press(key)
            await cockpit.until(lambda name=name: name in cockpit.maze.scene.shown)
        await cockpit.until(lambda: "not read" in cockpit["sensors"])
        before = cockpit["sensors"]
        await cockpit.press(KEYS.truth)
        await cockpit.until(lambda: "true value" in cockpit["sensors"])
        assert "35.5" in cockpit["sensors"]
        await cockpit.press(KEYS.truth)
        await cockpit.until(lambda: cockpit["sensors"] == before)

    fly(scenario)


@pytest.mark.slow
def test_keys_zoom_fit_follow_and_look_elsewhere(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        zoom, follow = cockpit.maze.zoom, cockpit.maze.follow
        await cockpit.press("plus")
        await cockpit.until(lambda: cockpit.maze.zoom > zoom)
        await cockpit.press("minus")
        await cockpit.until(lambda: cockpit.maze.zoom == zoom)
        await cockpit.press(KEYS.follow)
        await cockpit.until(lambda: cockpit.maze.follow != follow)
        assert cockpit["hint"] == f"follow the robot: {'off' if follow else 'on'}"
        await cockpit.press("plus", "plus", "plus")
        place = cockpit.maze.to_inches(5, 5)
        await cockpit.press("ctrl+right", "ctrl+down")
        await cockpit.until(lambda: cockpit.maze.to_inches(5, 5)[0] > place[0])
        assert cockpit.maze.to_inches(5, 5)[1] < place[1]
        await cockpit.press(KEYS.fit)
        await cockpit.until(lambda: cockpit.maze.zoom_is_automatic)
        floor = cockpit.maze.painter.floor
        await cockpit.press(KEYS.floor)
        await cockpit.until(lambda: cockpit.maze.painter.floor != floor)
        assert "tiles" in cockpit["hint"]
        assert cockpit.maze.painter.heat
        await cockpit.press(KEYS.heat)
        await cockpit.until(lambda: not cockpit.maze.painter.heat)
        assert cockpit["hint"] == "map of the belief: off"

    fly(scenario)


@pytest.mark.slow
def test_help_opens_closes_and_the_run_goes_on_behind_it(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.press("question_mark")
        await cockpit.until(lambda: isinstance(cockpit.app.screen, HelpScreen))
        cockpit.client().send("u1")
        await cockpit.until(lambda: cockpit.commands("client") == ["u1"])
        await cockpit.pilot.resize_terminal(90, 30)
        await cockpit.pilot.press("escape")
        await cockpit.until(lambda: not isinstance(cockpit.app.screen, HelpScreen))
        await cockpit.until(lambda: "u1 -> " in cockpit["hint"])

    fly(scenario)


@pytest.mark.slow
def test_colon_and_escape_go_to_the_console_and_back(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        assert cockpit.app.query_one("#line").has_focus
        await cockpit.pilot.press("escape")
        await cockpit.until(lambda: cockpit.maze.has_focus)
        await cockpit.pilot.press("colon")
        await cockpit.until(lambda: cockpit.app.query_one("#line").has_focus)
        assert cockpit.line == ":"
        await cockpit.pilot.press(*"bias", "escape")
        await cockpit.press("enter")
        await cockpit.until(lambda: cockpit.app.query_one("#line").has_focus)
        assert cockpit.line == ":bias"

    fly(scenario)


@pytest.mark.slow
def test_a_robot_without_a_drive_takes_the_opposite_one_or_says_so(fly: Fly, tmp_path: Path) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.press("s", "q")
        await cockpit.until(lambda: cockpit.commands("keys") == ["w0--3"])
        await cockpit.until(lambda: "no drive for sideways left" in cockpit["hint"])

    text = (
        "ID,Poll Character,Enabled,Y-Axis Error,X-Axis Error,Rotation Error,Y-Axis Bias,X-Axis Bias,"
        "Rotation Bias\nright,w0,1,0,0,0,0,0,0\n"
    )
    fly(scenario, files={"drive.csv": text})


# -- orders ----------------------------------------------------------------------------------


def test_orders_that_change_the_simulation(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        simulator, engine = cockpit.server.simulator, cockpit.server.engine
        for line, done in (
            (":teleport 6 30 -90", lambda: simulator.pose == Pose(6.0, 30.0, -90.0)),
            (":block 54 30", lambda: (simulator.block.x, simulator.block.y) == (54.0, 30.0)),
            (":noise off", lambda: not simulator.noise),
            (":noise on", lambda: simulator.noise),
            (":bias off", lambda: all(simulator.bias[each.kind] == Axes() for each in simulator.spec.drives)),
            (":bias on", lambda: any(axes.r for axes in simulator.bias.values())),
            (":speed 4", lambda: engine.time_scale == 4.0),
            (":pause", lambda: engine.paused),
            (":resume", lambda: not engine.paused),
            (":seed 12", lambda: simulator.seed == 12),
            (":reset", lambda: simulator.pose == Pose(9.5, 42.0, 0.0)),
            (":stop", lambda: "nothing was moving" in cockpit["log"]),
        ):
            await cockpit.type(line)
            await cockpit.until(done)
        assert "seed 12" in cockpit["run"]

    fly(scenario)


@pytest.mark.slow
def test_a_person_drives_at_a_velocity_for_a_second(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        simulator = cockpit.server.simulator
        await cockpit.type(":noise off")
        await cockpit.type(":bias off")
        await cockpit.type(":vv 4 0 0")
        await cockpit.until(lambda: simulator.time == 1.0)
        assert simulator.pose == Pose(13.5, 42.0, 0.0)
        assert not simulator.velocity.moves
        await cockpit.until(lambda: "forward 4.0 in/s" in cockpit["log"])

    fly(scenario)


@pytest.mark.slow
def test_an_action_that_is_refused_is_explained_in_the_console(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type(":teleport 54 42 0")
        await cockpit.until(lambda: "teleport: " in cockpit["hint"] and "wall" in cockpit["hint"])
        assert cockpit.server.simulator.pose == Pose(9.5, 42.0, 0.0)
        await cockpit.type("u1")
        await cockpit.until(lambda: "wall" not in cockpit["hint"])

    fly(scenario)


@pytest.mark.slow
def test_speed_says_that_it_has_no_effect_on_instant_motion(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type(":speed 2")
        await cockpit.until(lambda: "motion is instant" in cockpit["hint"])

    fly(scenario)

    async def timed(cockpit: Cockpit) -> None:
        await cockpit.type(":speed 2")
        await cockpit.until(lambda: "2 simulated seconds" in cockpit["log"])
        assert "no effect" not in cockpit["hint"]

    fly(timed, motion__motion="timed")


@pytest.mark.slow
def test_bias_shows_the_bias_of_every_drive(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type(":bias")
        await cockpit.until(lambda: "rot" in cockpit["answer"])
        right = next(iter(cockpit.server.simulator.bias.values()))
        assert f"{right.x:+.4f}" in cockpit["answer"]

    fly(scenario)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "served"), [((80, 24), "binary"), ((120, 36), "packets")], ids=["small", "large"]
)
def test_before_the_first_client_the_screen_says_how_to_begin(
    fly: Fly, size: tuple[int, int], served: str
) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        def shown() -> str:
            return "\n".join(row.text for row in rows_of(cockpit.app.screen))

        await cockpit.until(lambda: "python samples/wander.py" in shown())
        assert "w a s d" in shown()
        assert ":help" in shown()
        port = cockpit.server.ports[{"binary": "commands", "packets": "packets"}[served]]
        assert str(port) in cockpit["header"]
        assert "WAITING for a program" in cockpit["header"]
        await cockpit.type("u1")
        await cockpit.until(lambda: "python" not in shown())

    fly(
        scenario,
        size=size,
        server__listeners=(served,),
        server__packet_port=0,
        server__packet_reply_port=0,
    )


@pytest.mark.slow
def test_one_key_runs_the_sample_program_while_a_robot_waits_for_one(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        app, given = cockpit.app, []
        await cockpit.until(
            lambda: "F5" not in cockpit["answer"] and "python samples/wander.py" in cockpit["answer"]
        )
        app.run_program = given.append
        app.refresh_frame()
        await cockpit.until(lambda: "F5 runs the example, wander.py" in cockpit["answer"])
        await cockpit.type("u1")
        await cockpit.until(lambda: "F5" not in cockpit["answer"])
        await cockpit.pilot.press("f5")
        assert given == []
        await cockpit.press(KEYS.reset)
        await cockpit.until(lambda: "F5" in cockpit["answer"])
        await cockpit.pilot.press("f5")
        (command,) = given
        program = Path(shlex.split(command)[1])
        assert program.name == "wander.py"
        assert program.is_file()

    fly(scenario)


@pytest.mark.slow
def test_driving_through_a_block_that_is_not_solid_is_said_once(fly: Fly) -> None:
    def said(cockpit: Cockpit) -> int:
        assert not cockpit.app.query(Toast), "nothing may lie over the maze"
        return cockpit["log"].count("drives through the block")

    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("d1-5")
        await cockpit.until(lambda: "d1-5" in cockpit["log"])
        assert not said(cockpit)
        await cockpit.type("d1-20")
        await cockpit.until(lambda: said(cockpit) == 1)
        await cockpit.type("a1-20")
        await cockpit.until(lambda: "a1-20" in cockpit["log"])
        assert said(cockpit) == 1

    fly(scenario)

    async def solid(cockpit: Cockpit) -> None:
        await cockpit.type("d1-20")
        await cockpit.until(lambda: "contact" in cockpit["log"])
        assert not said(cockpit)

    fly(solid, motion__block_solid=True)


@pytest.mark.slow
def test_a_block_put_on_the_path_behind_the_robot_was_not_driven_through(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type("d1-10")
        await cockpit.until(lambda: "d1-10" in cockpit["log"])
        await cockpit.type(":block 13 42")
        await cockpit.until(lambda: "block at (13, 42)" in cockpit["log"])
        frames = cockpit.app.frames
        await cockpit.type("u1")
        await cockpit.until(lambda: "u1" in cockpit["log"] and cockpit.app.frames > frames + 1)
        assert "drives through the block" not in cockpit["log"]
        await cockpit.type("a1-6")
        await cockpit.until(lambda: "drives through the block" in cockpit["log"])

    fly(scenario, randerror=False, randbias=False)


@pytest.mark.slow
def test_a_maze_that_is_not_drawn_has_no_legend(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.until(lambda: "robot" in cockpit.maze.legend(80).text)
        await cockpit.type(":plot_robot off")
        await cockpit.until(lambda: not cockpit.maze.legend(80).text)
        await cockpit.type(":plot_robot on")
        await cockpit.until(lambda: "robot" in cockpit.maze.legend(80).text)

    fly(scenario)


@pytest.mark.slow
def test_views_are_switched_by_orders_at_run_time(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.type(":plot_sense off")
        await cockpit.until(lambda: "plot_sense" not in cockpit.maze.scene.shown)
        await cockpit.type(":plot_sense")
        await cockpit.until(lambda: "plot_sense" in cockpit.maze.scene.shown)
        await cockpit.type(":trail off")
        await cockpit.until(lambda: "trail" not in cockpit.maze.scene.shown)
        await cockpit.type(":truth on")
        await cockpit.until(lambda: "true value" in cockpit["sensors"])
        await cockpit.type(":plot_robot off")
        await cockpit.until(lambda: "The maze is not drawn" in cockpit.maze.render_line(0).text)
        await cockpit.type(":plot_robot on")
        await cockpit.until(lambda: "loading" in cockpit.maze.render_line(1).text)

    fly(scenario)


@pytest.mark.slow
def test_plot_settings_hold_from_the_start(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.until(lambda: "The maze is not drawn" in cockpit.maze.render_line(0).text)
        await cockpit.type(":plot_robot")
        await cockpit.until(
            lambda: cockpit.maze.scene is not None and "plot_sense" not in cockpit.maze.scene.shown
        )

    fly(scenario, plot_robot=False, plot_sense=False)


@pytest.mark.slow
def test_shot_save_and_copy_hand_the_screen_and_the_log_out(fly: Fly, tmp_path: Path) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        cockpit.client().send("u1")
        await cockpit.until(lambda: "u1 -> " in cockpit["hint"])
        await cockpit.type(f":shot {tmp_path / 'a picture.svg'}")
        await cockpit.until(lambda: (tmp_path / "a picture.svg").exists())
        picture = (tmp_path / "a picture.svg").read_text(encoding="utf-8")
        assert picture.startswith("<svg ")
        assert "ultrasonic" in picture
        assert "<script" not in picture
        await cockpit.type(f":save {tmp_path / 'log.txt'}")
        await cockpit.until(lambda: (tmp_path / "log.txt").exists())
        saved = (tmp_path / "log.txt").read_text(encoding="utf-8")
        assert "u1" in saved
        assert cockpit["log"].startswith(saved.rstrip()), "what was written is told after it"
        await cockpit.type(":copy")
        await cockpit.until(lambda: cockpit.app.clipboard == cockpit["log"])
        await cockpit.type("u2")
        await cockpit.until(lambda: "by console" in cockpit["log"])
        await cockpit.type(f":save {tmp_path / 'log.txt'}")  # its own file may be written again
        await cockpit.until(lambda: (tmp_path / "log.txt").read_text(encoding="utf-8") != saved)
        for order, name in ((":save", "good.py"), (":shot", "good.svg")):
            (tmp_path / name).write_text("work")
            await cockpit.type(f"{order} {tmp_path / name}")
            await cockpit.until(lambda: "it exists already and is not overwritten" in cockpit["hint"])
            assert (tmp_path / name).read_text() == "work"
            await cockpit.type("u1")
            await cockpit.until(lambda: "it exists already" not in cockpit["hint"])
        await cockpit.type(f":save {tmp_path / 'none' / 'log.txt'}")
        await cockpit.until(lambda: "No such file or directory" in cockpit["hint"])

    fly(scenario)


@pytest.mark.slow
@pytest.mark.parametrize("keys", [[*":quit", "enter"], ["ctrl+q"]], ids=["order", "key"])
def test_quit_and_ctrl_q_end_with_code_0(fly: Fly, keys: list[str]) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.pilot.press(*keys)
        await cockpit.until(lambda: not cockpit.app.is_running)

    assert not fly(scenario)


@pytest.mark.slow
def test_the_palette_holds_every_order_word_for_word_and_does_it(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        provider = CommandProvider(cockpit.app.screen)
        entries = {str(hit.display): hit async for hit in provider.discover()}
        assert {order.usage for order in CONSOLE_COMMANDS.values()} <= set(entries)
        await entries[":truth [on|off]"].command()
        await cockpit.until(lambda: "true value" in cockpit["sensors"])
        await entries[":teleport X Y HEADING"].command()
        await cockpit.until(lambda: cockpit.line == ":teleport ")
        await entries["Poll"].command()
        await cockpit.until(lambda: "t1" in cockpit.commands("keys"))
        found = [str(hit.text) async for hit in provider.search("noise")]
        assert ":noise on|off" in found
        names = list(entries)
        assert names[: len(CONSOLE_COMMANDS)] == [order.usage for order in CONSOLE_COMMANDS.values()]
        assert "Theme" in names  # Textual's own come last, found or not
        ranked = sorted([hit async for hit in provider.search("he")], key=lambda hit: -hit.score)
        orders = [str(hit.text).startswith(":") for hit in ranked]
        assert orders == sorted(orders, reverse=True)

    fly(scenario)


@pytest.mark.slow
@pytest.mark.parametrize(
    "size", [(80, 24), *(pytest.param(each, marks=pytest.mark.slow) for each in ((120, 36), (200, 60)))]
)
def test_the_palette_leaves_most_of_the_maze_to_be_seen(fly: Fly, size: tuple[int, int]) -> None:
    """It hides the events, and neither sensors nor answers."""

    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.pilot.press("ctrl+p")
        await cockpit.until(lambda: cockpit.app.screen.query("OptionList").first().option_count)
        await cockpit.pilot.pause()
        maze = cockpit.maze.region
        palette = cockpit.app.screen
        for box in (palette.query_one("#--container"), palette.query_one("#--results")):
            assert maze.intersection(box.region).area <= 0.4 * maze.area
            for name in ("sensors", "answer"):
                panel = cockpit.app.screen_stack[0].query_one(f"#{name}")
                assert not panel.display or not panel.region.intersection(box.region).area, name
            assert box.region.bottom <= size[1]

    fly(scenario, size=size)


@pytest.mark.slow
def test_the_palette_opens_over_the_app_and_finds_an_order(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.pilot.press("ctrl+p", *"everything back")
        await cockpit.until(lambda: cockpit.app.screen.query("OptionList").first().option_count)
        await cockpit.pilot.press("enter")
        await cockpit.until(lambda: "back at the start" in cockpit["log"])

    fly(scenario)


# -- what the panels say ---------------------------------------------------------------------


@pytest.mark.slow
def test_text_from_clients_is_escaped_and_never_markup(fly: Fly) -> None:
    hostile = b"[b]x[/b]\x1b[2J\xe2\x80\xae[/x]\n"

    async def scenario(cockpit: Cockpit) -> None:
        with socket.create_connection(("127.0.0.1", cockpit.server.ports["commands"])) as sock:
            sock.sendall(hostile)
            assert sock.recv(8)
        await cockpit.until(lambda: "disconnected after 1 command" in cockpit["log"])
        await cockpit.pilot.resize_terminal(80, 24)
        await cockpit.until(lambda: "disconnected after" in cockpit["answer"])
        for place in ("log",):
            assert "[b]x[/b]\\x1b[2J" in cockpit[place], place
            assert cockpit[place].replace("\n", "").isprintable()
        rows = range(cockpit.app.query_one(LogPanel).size.height)
        shown = "".join(cockpit.app.query_one(LogPanel).render_line(row).text for row in rows)
        assert shown.isprintable()

    fly(scenario)


def test_a_belief_is_drawn_with_its_error_and_logged(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        robot = cockpit.client()
        robot.believe(12.5, 46.0, 350.0, 1.5, [(12, 45), (13, 47, 90)], note="[i]lost\x07")
        await cockpit.until(lambda: "off 5.0 in 10 deg, lost" in cockpit["robot"])
        belief = cockpit.maze.scene.belief
        assert belief.pose == Pose(12.5, 46.0, 350.0)
        assert belief.particles.tolist() == [[12, 45], [13, 47]]
        await cockpit.until(
            lambda: "12.5, 46.0 in  -10.0 deg" in cockpit["log"] and "[i]lost\\x07" in cockpit["log"]
        )

    fly(scenario)


@pytest.mark.slow
def test_a_movement_in_time_is_drawn_on_its_way_and_the_trail_follows(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        seen: list[tuple[float, float]] = []
        await cockpit.type("d1-9")

        def arrived() -> bool:
            scene = cockpit.maze.scene
            if scene is not None and len(scene.trail):
                assert scene.trail[-1][-1, :2].tolist() == [scene.pose.x, scene.pose.y]
                seen.append((scene.pose.x, scene.pose.y))
            return "standing" in cockpit["robot"] and scene.pose.x > 17

        await cockpit.until(arrived)
        assert len(set(seen)) > 5
        assert [x for x, _ in seen] == sorted(x for x, _ in seen)

    fly(scenario, motion__motion="timed", randbias=False)


@pytest.mark.slow
def test_what_is_wrong_with_the_station_shows_in_the_app(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.until(lambda: "no beliefs will be shown" in cockpit["log"])
        assert not cockpit.app.query(Toast), "nothing may lie over the maze"
        assert "beliefs" not in cockpit["header"]

    with socket.create_server(("127.0.0.1", 0)) as taken:
        fly(scenario, server__belief_port=taken.getsockname()[1])


# -- sizes -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_resizing_keeps_zoom_page_console_and_place_in_the_log(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        for _ in range(15):
            await cockpit.press("w", "s")
        log = cockpit.app.query_one(LogPanel)
        await cockpit.until(lambda: log.max_scroll_y > 20)
        await cockpit.press("plus")
        zoom = cockpit.maze.zoom
        console = cockpit.app.query_one("#line", Input)
        console.value = "d1-1"
        log.scroll_to(y=10, animate=False)
        top = log.render_line(1).text.strip()
        for size in ((80, 24), (200, 60), (30, 10), (120, 36)):
            await cockpit.pilot.resize_terminal(*size)
            await cockpit.until(lambda size=size: cockpit.app.size == size)
        await cockpit.until(lambda: log.size.height > 5)
        assert log.render_line(1).text.strip() == top
        assert cockpit.maze.zoom == zoom
        assert console.value == "d1-1"

    fly(scenario)


@pytest.mark.slow
def test_too_small_a_terminal_says_so_and_the_robot_goes_on(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        assert "The terminal is too small:\nat least 40 x 12 please" in cockpit["small"]
        assert cockpit.app.query_one("#small").display
        assert not cockpit.maze.display
        cockpit.client().send("d1-1")
        assert cockpit.server.simulator.commands == 1
        await cockpit.pilot.resize_terminal(80, 24)
        await cockpit.until(lambda: cockpit.maze.display)
        await cockpit.until(lambda: cockpit.app.query_one("#line").has_focus)

    fly(scenario, size=(39, 20))


@pytest.mark.slow
def test_the_end_of_the_start_is_told_once(fly: Fly, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shell, "_STARTED", 1e6)
    told: list[bool] = []

    async def scenario(cockpit: Cockpit) -> None:
        app = cockpit.app
        app.after_start = lambda: told.append(True)
        (timer,) = [each for each in app._timers if each._interval == 1e6]
        timer._callback()  # type: ignore[misc]
        await cockpit.until(lambda: told)

    fly(scenario)


@pytest.mark.slow
def test_news_of_an_earlier_layout_leaves_no_panel_blank(fly: Fly, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a busy machine the app hears of a layout when the panes have other boxes already, whose layout comes
    after the next picture."""
    monkeypatch.setattr(shell, "draw_at_once", lambda screen: None)  # Textual itself draws, but later

    async def scenario(cockpit: Cockpit) -> None:
        app, pose = cockpit.app, cockpit.app.query_one("#pose")
        laid_out, refresh_bindings = app.screen_stack[0].screen_layout_refresh_signal, app.refresh_bindings

        def hear_late() -> None:
            refresh_bindings()
            laid_out.publish(app.screen_stack[0])

        app.refresh_bindings = hear_late  # type: ignore[method-assign]
        assert not pose.display, "the first steps are in its place"
        cockpit.client()
        await cockpit.until(lambda: pose.size.width == 80)
        await cockpit.until(lambda: cockpit["pose"].startswith(" pose "))

    fly(scenario, size=(80, 24))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["line", "maze"])
def test_the_focus_comes_back_when_a_terminal_is_no_longer_too_small(fly: Fly, name: str) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        widget = cockpit.app.query_one(f"#{name}")
        widget.focus()
        # Only a widget that has been laid out is told that it is hidden.
        await cockpit.until(lambda: widget.has_focus and widget.region.area)
        await cockpit.pilot.resize_terminal(20, 5)
        await cockpit.until(lambda: cockpit.app.focused is None)
        small = cockpit.app.query_one("#small")
        await cockpit.pilot.resize_terminal(21, 5)
        await cockpit.until(lambda: small.region.width == 21)
        await cockpit.pilot.pause()
        assert cockpit.app.focused is None, "nothing that is typed goes to what cannot be seen"
        await cockpit.pilot.resize_terminal(80, 24)
        await cockpit.until(lambda: widget.has_focus)

    fly(scenario, size=(80, 24))


@pytest.mark.slow
def test_a_small_screen_shows_one_page_at_a_time(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        app = cockpit.app

        def shown() -> list[str]:
            names = ("maze", "sensors", "robot", "run", "events")
            return [name for name in names if app.query_one(f"#{name}").region.area]

        await cockpit.until(lambda: shown() == ["maze", "sensors"])
        pages = (("2", ["sensors"]), ("3", ["robot", "run"]), ("4", ["events"]), ("1", ["maze", "sensors"]))
        for key, names in pages:
            await cockpit.pilot.press("escape", key)
            await cockpit.until(lambda names=names: shown() == names)
        for _, names in pages:
            await cockpit.pilot.press("f2")
            await cockpit.until(lambda names=names: shown() == names)
        await cockpit.pilot.resize_terminal(120, 36)
        await cockpit.until(lambda: len(shown()) == 5)
        await cockpit.pilot.press("f2", "2")
        await cockpit.pilot.pause()
        assert len(shown()) == 5

    fly(scenario, size=(80, 24))


@pytest.mark.slow
@pytest.mark.parametrize(
    "glyphs",
    [
        GlyphMode.QUADRANT,
        GlyphMode.ASCII,
        *(
            pytest.param(each, marks=pytest.mark.slow)
            for each in GlyphMode
            if each not in (GlyphMode.QUADRANT, GlyphMode.ASCII)
        ),
    ],
)
def test_every_size_draws_maze_and_status(fly: Fly, glyphs: GlyphMode) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        cockpit.client().send("u1")
        await cockpit.until(lambda: "u1 -> " in cockpit["hint"])
        for size in ((40, 12), (80, 24), (120, 36), (200, 60)):
            await cockpit.pilot.resize_terminal(*size)
            status = {40: "standing   127", 80: "then 1 reading"}.get(size[0], "u1 -> ")
            await cockpit.until(
                lambda status=status: any(status in strip.text for strip in rows_of(cockpit.app.screen))
            )
            strips = rows_of(cockpit.app.screen)
            assert [strip.cell_length for strip in strips] == [size[0]] * size[1]
            if glyphs is GlyphMode.ASCII:
                assert all(strip.text.isascii() for strip in strips)

    fly(scenario, glyphs=glyphs)


# -- what must not end it --------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("broken", "place"),
    [
        ("readouts.half_turn", "robot"),
        pytest.param("panes.sensor_lines", "sensors", marks=pytest.mark.slow),
        pytest.param("readouts.spent_lines", "run", marks=pytest.mark.slow),
        ("log_panel.entry_line", "log"),
    ],
)
def test_a_panel_that_fails_says_so_and_everything_goes_on(
    fly: Fly, monkeypatch: pytest.MonkeyPatch, broken: str, place: str
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("[/broken]\x1b")

    monkeypatch.setattr(f"simmer_tui.tui.{broken}", fail)

    async def scenario(cockpit: Cockpit) -> None:
        robot = cockpit.client()
        robot.send("d1-1")
        await cockpit.until(lambda: "cannot be shown: RuntimeError: [/broken]\\x1b" in cockpit[place])
        assert robot.send("c1") is not None
        await cockpit.type(":reset")
        await cockpit.until(lambda: cockpit.server.simulator.pose.x == 9.5)

    fly(scenario)


@pytest.mark.slow
def test_a_maze_that_cannot_be_drawn_says_so_and_everything_goes_on(
    fly: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("no scene")

    monkeypatch.setattr("simmer_tui.tui.panes.scene_of", fail)

    async def scenario(cockpit: Cockpit) -> None:
        await cockpit.until(lambda: "cannot be shown: RuntimeError" in cockpit.maze.render_line(0).text)
        assert cockpit.client().send("c1") is not None

    fly(scenario)


@pytest.mark.slow
def test_a_fault_of_the_app_itself_is_kept_as_one_line(fly: Fly, monkeypatch: pytest.MonkeyPatch) -> None:
    apps = []

    async def scenario(cockpit: Cockpit) -> None:
        apps.append(cockpit.app)

        def fail(self: MazeView, crop: Region) -> None:
            raise RuntimeError("cannot\nrender")

        monkeypatch.setattr(MazeView, "render_lines", fail)
        # The pilot raises what it met itself, too, and may take each picture before the app does.
        for _ in range(2000):
            cockpit.maze.refresh()
            with contextlib.suppress(RuntimeError):
                await cockpit.pilot.pause()
            if cockpit.app.fault:
                break

    with pytest.raises(RuntimeError, match="cannot"):  # a pilot raises what the app has met
        fly(scenario)
    assert "RuntimeError: cannot\\nrender (test_app.py:" in apps[0].fault
    assert not apps[0]._exit_renderables


@pytest.mark.slow
def test_nothing_is_drawn_while_the_terminal_does_not_read_and_then_all_is(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        app, robot = cockpit.app, cockpit.client()
        waiting: queue.Queue[str] = queue.Queue()
        app._driver._writer_thread = SimpleNamespace(_queue=waiting)
        for _ in range(3):
            waiting.put("a write")
        await cockpit.until(lambda: app.skipped > 0)
        frames = app.frames
        for _ in range(50):
            robot.send("d1-0.1")
        skipped = app.skipped
        await cockpit.until(lambda: app.skipped > skipped + 2)
        assert app.frames == frames
        assert app._batch_count == 1, "neither a blinking cursor nor anything else may write"
        await cockpit.pilot.resize_terminal(140, 40)
        while not waiting.empty():
            waiting.get()
        await cockpit.until(lambda: "commands 50 " in cockpit["run"])
        assert app._batch_count == 0
        del app._driver._writer_thread

    fly(scenario)


@pytest.mark.slow
def test_thousands_of_commands_do_not_pile_up(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        with socket.create_connection(("127.0.0.1", cockpit.server.ports["commands"])) as sock:

            def flood() -> None:
                for _ in range(30):
                    sock.sendall(b"c1\n" * 100)
                    taken = 0
                    while taken < 800:
                        taken += len(sock.recv(65536))

            program = threading.Thread(target=flood)
            program.start()
            await cockpit.until(lambda: "commands 3,000 " in cockpit["run"])
            program.join()
        assert len(cockpit["log"].splitlines()) <= 2000

    fly(scenario)


@pytest.mark.slow
def test_the_pace_is_chosen_by_key_and_by_order(fly: Fly) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        server = cockpit.server
        await cockpit.type(":pace 400")
        await cockpit.until(lambda: server.pace == 400.0)
        await cockpit.press("left_square_bracket")
        await cockpit.until(lambda: server.pace == 200.0)
        await cockpit.press("right_square_bracket", "right_square_bracket")
        await cockpit.until(lambda: server.pace == 800.0)
        await cockpit.press("backslash")
        await cockpit.until(lambda: server.pace == 0.0)
        await cockpit.press("right_square_bracket")
        await cockpit.until(lambda: server.pace == 4.0)
        await cockpit.type(":pace off")
        await cockpit.until(lambda: server.pace == 0.0)
        await cockpit.type(":pace fast")
        await cockpit.until(lambda: "0.125 to 1024, or off" in cockpit["hint"])

    fly(scenario)


@pytest.mark.slow
def test_every_picture_shows_one_moment(fly: Fly) -> None:
    """Pose, sensor read last and maze are of the same snapshot, and what is history follows."""

    async def scenario(cockpit: Cockpit) -> None:
        over = threading.Event()

        def spin() -> None:
            with cockpit.client() as robot:
                while not over.is_set():
                    robot.send("r1-37")
                    robot.read("u1", "u4")

        program = threading.Thread(target=spin)
        program.start()
        try:
            for _ in range(12):
                frames = cockpit.app.frames
                await cockpit.until(lambda frames=frames: cockpit.app.frames > frames)
                scene = cockpit.maze.scene
                assert scene is not None
                heading = round(half_turn(scene.pose.heading))
                assert f"{scene.pose.x:.1f}, {scene.pose.y:.1f} in  {heading} deg" in cockpit["robot"]
        finally:
            over.set()
            program.join()
        count = len(cockpit.given)
        await cockpit.until(lambda: f"commands {count:,} " in cockpit["run"] and "r1-37" in cockpit["log"])

    fly(scenario, screen__pace=0)


@pytest.mark.slow
@pytest.mark.parametrize("where", ["timer", "worker", "callback", "panic", "driver"])
def test_a_fault_anywhere_on_the_screen_is_one_line_and_leaves_the_robot(fly: Fly, where: str) -> None:
    apps: list[Any] = []
    readings: list[float] = []

    def fail() -> None:
        raise RuntimeError("cannot\ngo on")

    async def work() -> None:
        fail()

    async def scenario(cockpit: Cockpit) -> None:
        app = cockpit.app
        apps.append(app)
        client = cockpit.client()
        begin: dict[str, Callable[[], object]] = {
            "timer": lambda: app.set_timer(0.001, fail),
            "worker": lambda: app.run_worker(work()),
            "callback": lambda: app.call_later(fail),
            "panic": lambda: app.call_later(app.panic, "a fault of Textual's"),
            "driver": lambda: asyncio.get_running_loop().call_soon(app._handle_exception, RuntimeError("x")),
        }
        begin[where]()
        for _ in range(2000):
            with contextlib.suppress(Exception):
                await cockpit.pilot.pause()
            if app.fault:
                break
        readings.append(await asyncio.to_thread(client.read, "u1"))

    with contextlib.suppress(Exception):  # a pilot raises what the app has met
        fly(scenario)
    assert readings
    assert apps[0].fault
    assert "\n" not in apps[0].fault
