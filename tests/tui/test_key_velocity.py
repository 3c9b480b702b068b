"""Keys that drive at a velocity while they are held."""

import asyncio
from collections.abc import Callable
from typing import cast

import pytest

from simmer_tui.config.loader import Override, load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.links.backend import BackendSwitch, Message
from simmer_tui.links.link import typed_message
from simmer_tui.live.operating.robot_operator import Operator
from simmer_tui.live.server import Server
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.sessions import Session
from simmer_tui.run.events import Event, VelocityEnd, VelocityEnded
from simmer_tui.sim.command import Command
from simmer_tui.sim.records import CommandResult
from simmer_tui.sim.simulator import Simulator
from simmer_tui.tui.key_velocity import KeyVelocity
from tests.tui.conftest import KEYS, Cockpit

Fly = Callable[..., "int | None"]


class NoServer:
    """A robot without ports or a thread: all is done at once."""

    def __init__(self, options: dict[str, object]) -> None:
        self.configuration = load(
            bundled_folder(), {name: Override(f"--{name}", value) for name, value in options.items()}
        )
        motion = self.configuration.settings.motion
        self.simulator = Simulator(self.configuration.simulation, 5)
        self.engine = Engine(self.simulator, timed=motion.motion == "timed", time_scale=motion.time_scale)
        self.robot = None

        self.submit = BackendSwitch(self.engine).submit

    def open_session(self, lane: str = "") -> Session:
        return self.engine.session(answer_at_end=False, lane=lane)

    def message(self, command: Command) -> Message:
        return typed_message(self.configuration.settings.server, command)

    def call(self, function: Callable[..., object], *arguments: object) -> None:
        function(*arguments)


class Hand:
    """Presses keys by a clock of its own."""

    def __init__(self, **options: object) -> None:
        server = NoServer({name.replace("__", "."): value for name, value in options.items()})
        self.simulator, self.engine = server.simulator, server.engine
        self.now = 1000.3
        self.told: list[Event] = []
        self.engine.watch(self.told.append)
        as_server = cast("Server", server)
        self.velocity = KeyVelocity(Operator(as_server), as_server, lambda: self.now)

    def press(self, key: str, name: str, *, fine: bool = False, age: float = 0.01) -> str:
        self.velocity.note_key(key, age)
        return self.velocity.drive(name, fine)

    @property
    def commands(self) -> list[str]:
        return [event.command.shown for event in self.told if isinstance(event, CommandResult)]

    @property
    def x(self) -> float:
        return self.simulator.pose.x


@pytest.fixture
def hand() -> Hand:
    return Hand()


def test_a_first_press_lasts_longer_than_a_repeat(hand: Hand) -> None:
    for _ in range(3):
        hand.press("w", "forward")
    assert hand.commands == ["vv-6;0;0;0.7", "vv-6;0;0;0.25", "vv-6;0;0;0.25"]


@pytest.mark.parametrize(
    ("key", "name", "fine", "velocity"),
    [
        ("s", "back", False, "-6;0;0"),
        ("a", "turn_left", False, "0;0;45"),
        ("d", "turn_right", False, "0;0;-45"),
        ("q", "sideways_left", False, "0;6;0"),
        ("e", "sideways_right", False, "0;-6;0"),
        ("W", "forward", True, "1;0;0"),
        ("D", "turn_right", True, "0;0;-9"),
    ],
)
def test_each_driving_key_has_its_velocity(
    hand: Hand, key: str, name: str, fine: bool, velocity: str
) -> None:
    hand.press(key, name, fine=fine)
    assert hand.commands == [f"vv-{velocity};0.7"]


def test_a_held_key_drives_by_real_time_in_instant_motion(hand: Hand) -> None:
    begun = hand.x
    hand.press("w", "forward")
    for _ in range(30):  # two seconds of looks at it: 0.7 of them count
        hand.now += 1 / 15
        hand.velocity.pass_time()
    ended = [event for event in hand.told if isinstance(event, VelocityEnded)]
    assert [event.reason for event in ended] == [VelocityEnd.TIME]
    assert hand.x - begun == pytest.approx(0.7 * 6, abs=0.6)
    assert not hand.simulator.velocity.moves


def test_repeats_keep_it_going_and_a_pause_ends_it(hand: Hand) -> None:
    begun, steps = hand.simulator.time, 40
    hand.press("w", "forward")
    for _ in range(steps):
        hand.now += 0.04
        hand.press("w", "forward")
    hand.now += 5.0
    hand.velocity.pass_time()
    assert hand.simulator.time - begun == pytest.approx(steps * 0.04 + 0.25, abs=0.01)
    assert not hand.simulator.velocity.moves
    hand.press("w", "forward")  # not a repeat any more
    assert hand.commands[-1] == "vv-6;0;0;0.7"


def test_any_other_key_ends_it_first(hand: Hand) -> None:
    hand.press("w", "forward")
    hand.velocity.note_key("p", 0.0)
    assert hand.commands[-1] == "vv-0;0;0"
    hand.velocity.note_key("p", 0.0)
    assert hand.commands.count("vv-0;0;0") == 1


def test_the_key_that_stops_is_left_to_stop_it(hand: Hand) -> None:
    hand.press("w", "forward")
    hand.velocity.note_key("space", 0.0)
    hand.now += 0.1
    hand.velocity.pass_time()
    assert hand.commands == ["vv-6;0;0;0.7"]


def test_another_driving_key_replaces_it(hand: Hand) -> None:
    hand.press("w", "forward")
    hand.press("a", "turn_left")
    assert hand.commands[-1] == "vv-0;0;45;0.7"
    assert "vv-0;0;0" not in hand.commands


def test_presses_from_long_ago_are_dropped(hand: Hand) -> None:
    hand.press("w", "forward", age=0.21)
    assert not hand.commands


def test_it_lasts_as_long_by_the_real_clock_at_any_time_scale() -> None:
    async def press() -> list[str]:
        hand = Hand(motion__motion="timed", motion__time_scale=2.0)
        hand.engine.start(asyncio.get_running_loop())
        hand.press("w", "forward")
        hand.now += 0.3
        hand.velocity.pass_time()
        return hand.commands

    assert asyncio.run(press()) == ["vv-6;0;0;1.4"]  # and no wait: time passes by itself


@pytest.mark.slow
def test_a_set_without_the_row_and_a_pause_are_told(fly: Fly) -> None:
    drives = (bundled_folder() / "drive.csv").read_text()
    without = "\n".join(line for line in drives.splitlines() if not line.startswith("velocity"))

    async def no_row(cockpit: Cockpit) -> None:
        await cockpit.press("w")
        await cockpit.until(lambda: "no enabled row velocity" in cockpit["hint"])

    fly(no_row, screen__keys_velocity=True, files={"drive.csv": without})

    async def paused(cockpit: Cockpit) -> None:
        await cockpit.press(KEYS.pause)
        await cockpit.until(lambda: cockpit.server.engine.paused)
        await cockpit.press("w")
        await cockpit.until(lambda: "paused: a held key" in cockpit["hint"])

    fly(paused, screen__keys_velocity=True)


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["instant", "timed"])
def test_a_pressed_key_drives_on_the_screen_and_the_robot_stands_after_it(fly: Fly, motion: str) -> None:
    async def scenario(cockpit: Cockpit) -> None:
        robot = cockpit.server.simulator
        await cockpit.press("w")
        await cockpit.until(lambda: cockpit.commands("keys"))
        assert cockpit.commands("keys")[0] == "vv-6;0;0;0.7"
        # By itself, as nothing more is pressed.
        await cockpit.until(lambda: robot.pose.x > 11 and not robot.velocity.moves)
        await cockpit.press("a")
        await cockpit.until(lambda: "vv-0;0;45;0.7" in cockpit.commands("keys"))
        await cockpit.press("space")
        await cockpit.until(lambda: not robot.velocity.moves)

    fly(scenario, screen__keys_velocity=True, motion__motion=motion)
