"""Every setting, once: name, type, default, unit, help and allowed values.

The readers of settings.toml, the command-line options and their help are made from the fields
below. A new setting is one field here and one line in settings.toml; a new table is one class
and one field of `Settings` made with `table`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from simmer_tui.config.rules import (
    Choice,
    Flag,
    Integer,
    Names,
    Number,
    NumberOrOff,
    Pair,
    Rule,
    Several,
    Text,
)

MAX_SEED = 2**63 - 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """One setting as readers and options see it.

    `name` is dotted for one in a table (`server.port`). `option` is its long option.
    """

    name: str
    default: Any
    rule: Rule[Any]
    help: str
    unit: str
    group: str
    option: str
    metavar: str


def setting(
    rule: Rule[Any], help_text: str, *, unit: str = "", group: str = "", option: str = "", metavar: str = ""
) -> dict[str, Any]:
    """Field metadata of one setting.

    `unit` is empty for a bare number. `group` is a heading in `--help`; a setting in a table has
    the table's. `option` defaults to the name with hyphens.
    """
    return {
        "rule": rule,
        "help": help_text,
        "unit": unit,
        "group": group,
        "option": option,
        "metavar": metavar or rule.metavar,
    }


def table(group: str) -> dict[str, Any]:
    """Field metadata of a table of settings; `group` is its heading in `--help`."""
    return {"group": group}


PLACES = "start positions"
ERRORS = "movement and random errors"
SCREEN = "robot and screen"


@dataclass(frozen=True, slots=True, kw_only=True)
class ServerSettings:
    """The ports and the form of replies."""

    host: str = field(
        default="127.0.0.1", metadata=setting(Text(), "address the ports are taken on", metavar="ADDRESS")
    )
    listeners: tuple[str, ...] = field(
        default=("binary",),
        metadata=setting(
            Several(("binary", "packets")), "which programs are served: binary, packets or both"
        ),
    )
    port: int = field(
        default=9000,
        metadata=setting(Integer(0, 65535), "port that takes commands, 0 for any free one", metavar="PORT"),
    )
    reply_port: int = field(
        default=9001,
        metadata=setting(Integer(0, 65535), "port that sends replies, 0 for any free one", metavar="PORT"),
    )
    reply_format: str = field(
        default="float64", metadata=setting(Choice(("float64", "float32")), "size of a reply")
    )
    byte_order: str = field(
        default="big", metadata=setting(Choice(("big", "little")), "order of a reply's bytes")
    )
    grace: float = field(
        default=0.005,
        metadata=setting(
            Number(0, 10), "how long bytes without a newline stay alone to be a command", unit="s"
        ),
    )
    packet_port: int = field(
        default=61200,
        metadata=setting(Integer(0, 65535), "port that takes packets, 0 for any free one", metavar="PORT"),
    )
    packet_reply_port: int = field(
        default=61201,
        metadata=setting(
            Integer(0, 65535), "port that sends the replies to packets, 0 for any free one", metavar="PORT"
        ),
    )
    legacy_reply: str = field(
        default="float64",
        metadata=setting(Choice(("float64", "float32", "text")), "how packets without brackets are answered"),
    )
    idle: float = field(
        default=10.0,
        metadata=setting(
            Number(0.1, 3600), "silence after which a program that sends packets has left", unit="s"
        ),
    )
    belief_port: int = field(
        default=9002,
        metadata=setting(
            Integer(0, 65535), "port where programs say what they believe, 0 for any", metavar="PORT"
        ),
    )
    any_user: bool = field(
        default=False,
        metadata=setting(Flag(), "let programs of other users of this machine connect (Linux)"),
    )
    token: str = field(
        default="",
        metadata=setting(
            Text(blank=True),
            "word that programs must send as their first line; also from SIMMER_TOKEN",
            metavar="WORD",
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionSettings:
    """How the robot moves."""

    motion: str = field(
        default="instant",
        metadata=setting(Choice(("instant", "timed")), "whether a movement takes its time"),
    )
    reply: str = field(
        default="auto",
        metadata=setting(
            Choice(("auto", "done", "accepted")),
            "when a timed drive is answered: at its end, at once, or as its dialect does",
        ),
    )
    time_scale: float = field(
        default=1.0,
        metadata=setting(Number(0.01, 1000), "simulated seconds that pass in a second of timed motion"),
    )
    contact: str = field(
        default="drive",
        metadata=setting(
            Choice(("drive", "stop")),
            "what ends a movement at a wall: only the commanded motion, or any contact, by an error too",
        ),
    )
    block_solid: bool = field(
        default=False, metadata=setting(Flag(), "the block stops the robot as a wall does")
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkSettings:
    """What lies between a program and the simulated robot, each way."""

    latency: float = field(
        default=0.0,
        metadata=setting(
            Number(0, 10),
            "simulated time a message is under way between program and robot, each way",
            unit="s",
            option="--link-latency",
        ),
    )
    jitter: float = field(
        default=0.0,
        metadata=setting(
            Number(0, 10), "most that is added to it at random", unit="s", option="--link-jitter"
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialSettings:
    """The port of a real robot, and how it talks."""

    port: str = field(
        default="",
        metadata=setting(
            Text(blank=True),
            "serial port or URL of a real robot, which is then driven",
            option="--serial",
            metavar="PORT",
        ),
    )
    baud: int = field(default=9600, metadata=setting(Integer(50, 4_000_000), "bits a second on the port"))
    timeout: float = field(
        default=5.0,
        metadata=setting(
            Number(0.01, 3600),
            "after how long a command without a reply is answered NaN",
            unit="s",
            option="--serial-timeout",
        ),
    )
    suffix: str = field(
        default="none",
        metadata=setting(
            Choice(("none", "lf", "crlf")),
            "line end added to commands that have none",
            option="--serial-suffix",
        ),
    )
    reply_end: str = field(
        default="auto",
        metadata=setting(
            Choice(("auto", "float64", "float32", "newline", "bracket", "quiet")),
            "what ends a reply of the robot; auto: as robot_reply or the program's dialect has it",
        ),
    )
    robot_reply: str = field(
        default="same",
        metadata=setting(
            Choice(("same", "text", "float32", "float64")),
            "form of the robot's replies, converted for the program unless the same",
        ),
    )
    robot_byte_order: str = field(
        default="little",
        metadata=setting(Choice(("big", "little")), "order of the bytes in such a float32 or float64 reply"),
    )
    stop: str = field(
        default="xx",
        metadata=setting(Text(), "what stops the robot at once", option="--serial-stop"),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ScreenSettings:
    """How the terminal app looks and how far its keys drive."""

    fps: int = field(default=10, metadata=setting(Integer(1, 20), "pictures a second"))
    pace: float = field(
        default=4.0,
        metadata=setting(
            NumberOrOff(0.125, 1024),
            "how fast movements are shown when motion is instant, times real speed",
            metavar="N|off",
        ),
    )
    color: str = field(
        default="auto",
        metadata=setting(Choice(("auto", "truecolor", "256", "16", "none")), "colours of the terminal"),
    )
    glyphs: str = field(
        default="auto",
        metadata=setting(
            Choice(("auto", "quadrant", "sextant", "octant", "half", "ascii")),
            "characters the maze is drawn with",
        ),
    )
    theme: str = field(
        default="dark", metadata=setting(Choice(("dark", "light", "high-contrast")), "colours of the screen")
    )
    mouse: bool = field(
        default=True, metadata=setting(Flag(), "use the mouse, else it is left to the terminal")
    )
    step: float = field(default=3.0, metadata=setting(Number(0, 1000), "length of a key's drive", unit="in"))
    fine_step: float = field(default=0.5, metadata=setting(Number(0, 1000), "the same with Shift", unit="in"))
    turn: float = field(default=15.0, metadata=setting(Number(0, 3600), "angle of a key's turn", unit="deg"))
    fine_turn: float = field(
        default=3.0, metadata=setting(Number(0, 3600), "the same with Shift", unit="deg")
    )


def _key(default: str, help_text: str, name: str) -> str:
    """A field for the keys of one action, comma-separated names as Textual has them; empty for none."""
    made: str = field(
        default=default, metadata=setting(Text(blank=True), help_text, option=f"--key-{name}", metavar="KEYS")
    )
    return made


@dataclass(frozen=True, slots=True, kw_only=True)
class KeySettings:
    """Keys while the maze has the focus; Shift with a driving key is fine. Comma-separated, or empty."""

    forward: str = _key("up,w", "drive forward", "forward")
    back: str = _key("down,s", "drive back", "back")
    turn_left: str = _key("left,a", "turn left", "turn-left")
    turn_right: str = _key("right,d", "turn right", "turn-right")
    sideways_left: str = _key("q", "drive to the left", "sideways-left")
    sideways_right: str = _key("e", "drive to the right", "sideways-right")
    stop: str = _key("space", "stop the robot", "stop")
    poll: str = _key("p", "read all sensors", "poll")
    reset: str = _key("r", "back to the start", "reset")
    pause: str = _key("b", "pause: commands wait", "pause")
    step: str = _key("n", "while paused, let the next command through", "step")
    slower: str = _key("left_square_bracket", "show movements half as fast", "slower")
    faster: str = _key("right_square_bracket", "show movements twice as fast", "faster")
    full_speed: str = _key("backslash", "movements as fast as possible", "full-speed")
    trail: str = _key("t", "show the trail", "trail")
    rays: str = _key("y", "show what the sensors see", "rays")
    truth: str = _key("v", "show true values beside readings", "truth")
    zoom_in: str = _key("plus,equals_sign", "zoom in", "zoom-in")
    zoom_out: str = _key("minus", "zoom out", "zoom-out")
    fit: str = _key("f", "show the whole maze", "fit")
    follow: str = _key("o", "keep the robot in sight", "follow")
    pan_left: str = _key("ctrl+left", "look further left", "pan-left")
    pan_right: str = _key("ctrl+right", "look further right", "pan-right")
    pan_up: str = _key("ctrl+up", "look further up", "pan-up")
    pan_down: str = _key("ctrl+down", "look further down", "pan-down")
    floor: str = _key("l", "tell the floor's tiles apart: if lines are read, always, never", "floor")
    help: str = _key("question_mark", "help", "help")


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """settings.toml and the options together. Units: inches, degrees, seconds."""

    bot_center: tuple[float, float] = field(
        default=(9.5, 42.0),
        metadata=setting(Pair(), "where the robot's centre starts", unit="in", group=PLACES),
    )
    bot_rot: float = field(
        default=0.0,
        metadata=setting(
            Number(), "start heading, counter-clockwise from +X", unit="deg", group=PLACES, metavar="ANGLE"
        ),
    )
    block_center: tuple[float, float] = field(
        default=(25.0, 41.0), metadata=setting(Pair(), "where the block's centre is", unit="in", group=PLACES)
    )
    blocksize: float = field(
        default=3.0,
        metadata=setting(
            Number(0), "side length of the block, 0 for no block at all", unit="in", group=PLACES
        ),
    )
    num_segments: int = field(
        default=10,
        metadata=setting(Integer(1, 10_000), "equal parts each movement is cut into", group=ERRORS),
    )
    step_time: float = field(
        default=0.0,
        metadata=setting(
            Number(0, 3600), "pause after every command, before its reply", unit="s", group=ERRORS
        ),
    )
    randerror: bool = field(
        default=True,
        metadata=setting(Flag(), "random errors differ from run to run, else come from seed", group=ERRORS),
    )
    seed: int = field(
        default=0,
        metadata=setting(
            Integer(0, MAX_SEED), "seed of the random errors; the option implies --no-randerror", group=ERRORS
        ),
    )
    randbias: bool = field(
        default=True,
        metadata=setting(
            Flag(), "draw the drives' biases at random at start, not from drive.csv", group=ERRORS
        ),
    )
    strength: tuple[float, float] = field(
        default=(0.05, 1.0),
        metadata=setting(
            Pair(Number(0)),
            "strength of the random bias of translations and of rotations",
            group=ERRORS,
            metavar="T,R",
        ),
    )
    drive_profile: str = field(
        default="",
        metadata=setting(
            Text(blank=True),
            "errors and speeds of a usual drive in place of those in drive.csv",
            group=ERRORS,
            metavar="NAME",
        ),
    )
    sensor_profile: tuple[str, ...] = field(
        default=(),
        metadata=setting(
            Names(), "errors and ranges of usual sensors in place of those in sensors.csv", group=ERRORS
        ),
    )
    link_profile: str = field(
        default="",
        metadata=setting(
            Text(blank=True),
            "delays of a usual link to the robot in place of those in [link]",
            group=ERRORS,
            metavar="NAME",
        ),
    )
    realistic: bool = field(
        default=False,
        metadata=setting(
            Flag(),
            "simulate a robot with real faults and delays: the profiles omni-4, hc-sr04, vl53l0x, qtr, "
            "mpu-6050, qmc5883l, encoder and usb where no other is chosen; not the real robot on the serial "
            "port (that is --serial)",
            group=ERRORS,
        ),
    )
    sim: bool = field(
        default=True,
        metadata=setting(Flag(), "simulate the robot, else drive the one on the serial port", group=SCREEN),
    )
    plot_robot: bool = field(
        default=True, metadata=setting(Flag(), "draw the maze and the robot on the screen", group=SCREEN)
    )
    plot_sense: bool = field(
        default=True, metadata=setting(Flag(), "draw what the sensors see on the screen", group=SCREEN)
    )
    server: ServerSettings = field(default_factory=ServerSettings, metadata=table("server"))
    motion: MotionSettings = field(default_factory=MotionSettings, metadata=table("motion"))
    link: LinkSettings = field(default_factory=LinkSettings, metadata=table("link"))
    serial: SerialSettings = field(default_factory=SerialSettings, metadata=table("serial"))
    screen: ScreenSettings = field(default_factory=ScreenSettings, metadata=table("screen"))
    keys: KeySettings = field(default_factory=KeySettings, metadata=table("keys"))


def all_settings() -> tuple[Setting, ...]:
    """Every setting, those outside tables first, in the order of the fields."""
    return tuple(_walk(Settings(), "", ""))


def _walk(defaults: Any, prefix: str, group: str) -> Iterator[Setting]:
    for item in fields(defaults):
        metadata = item.metadata
        default = getattr(defaults, item.name)
        if "rule" not in metadata:
            yield from _walk(default, f"{prefix}{item.name}.", metadata["group"])
            continue
        yield Setting(
            name=prefix + item.name,
            default=default,
            rule=metadata["rule"],
            help=metadata["help"],
            unit=metadata["unit"],
            group=metadata["group"] or group,
            option=metadata["option"] or "--" + item.name.replace("_", "-"),
            metavar=metadata["metavar"],
        )


def settings_from(values: Mapping[str, Any]) -> Settings:
    """Settings with `values` (checked, by dotted name) in place of the defaults."""
    return _build(Settings(), "", values)  # type: ignore[no-any-return]  # built by field names


def _build(defaults: Any, prefix: str, values: Mapping[str, Any]) -> Any:
    made = {}
    for item in fields(defaults):
        name, default = prefix + item.name, getattr(defaults, item.name)
        is_setting = "rule" in item.metadata
        made[item.name] = values.get(name, default) if is_setting else _build(default, f"{name}.", values)
    return type(defaults)(**made)
