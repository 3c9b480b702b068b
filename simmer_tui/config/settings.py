"""All settings, each defined once: name, type, default, unit, help and allowed values.

The reader of settings.toml, its JSON schema, the command-line options and their help, the comments of new
sets and the reference are made from the fields below. A new setting is one field; a new table is one class
and one field of `Settings`. Annotations are evaluated here: they contain the descriptions.
"""

import functools
import os
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar

from msgspec import Struct
from msgspec.structs import asdict, replace

from simmer_tui.config import dialects
from simmer_tui.config.reply_formats import BYTE_ORDERS, NUMBER_LETTERS, ReplyEnd
from simmer_tui.sim.noise import SEEDS
from simmer_tui.sim.rules import (
    LARGEST_PORT,
    ChoiceRule,
    FlagRule,
    IntegerRule,
    NamesRule,
    NumberOrAutoRule,
    NumberOrOffRule,
    NumberRule,
    PairRule,
    PortOrOffRule,
    SeveralRule,
    TextRule,
    listed,
)
from simmer_tui.sim.specs import WheelLayout
from simmer_tui.sim.values import CourseRule, Value

# A start bit, eight data bits and a stop bit: 8N1, the default of every Arduino.
BITS_OF_A_BYTE = 10
"""Bits on a serial line for each byte."""
# The usual rate of Arduino sketches, and that of an HC-05 as it is sold.
USUAL_BAUD = 9600
"""Bits a second of a line whose rate is not known."""
AUTO_CLOCK = "auto"
"""The clock that fits the program: see the setting."""
ELSE_REAL = "program, else real"
"""The program's clock, or the real one for programs that cannot run with it."""
CLOCKS = ("real", "program", ELSE_REAL)
"""The clocks that can be chosen."""
TIME_SCALES = NumberRule(0.01, 1000)
"""Simulated seconds that may pass in a second of timed motion."""
# Powers of two, so that doubling and halving by key meets both bounds.
PACES = NumberOrOffRule(0.125, 1024)
"""Paces at which movements may be shown, times real speed; off is as fast as possible."""
USUAL_DRIVE, USUAL_LINK = "omni-4", "usb"
"""The profiles of the drive and of the link of `realistic`."""
USUAL_SENSORS = {
    "ultra": "hc-sr04",
    "tof": "vl53l0x",
    "ir": "qtr",
    "gyro": "mpu-6050",
    "comp": "qmc5883l",
    "odom": "encoder",
    "lidar": "rplidar-a1m8",
}
"""Its profiles of sensors, by the name of the kind."""
# The headings in `--help` of settings outside tables, by the first setting under each.
_HEADINGS = {
    "bot_center": "start positions",
    "num_segments": "movement and random errors",
    "sim": "robot and screen",
}


class Setting(Value, frozen=True, kw_only=True):
    """One setting, for readers and options. In the fields below, attributes that follow from the field are
    left out.

    `name` is dotted for one in a table (`server.port`). `group` is its heading in `--help`, for one in a
    table the table's name. `option` is its long option, by default that of its table; if it ends
    in a hyphen, the name is appended. `metavar` is the rule's unless given. `alone` is the value if the
    option is given without one; empty if it needs one.
    """

    group: str = ""
    option: str = ""
    metavar: str = ""
    alone: str = ""


class SettingsTable(Struct, frozen=True, kw_only=True):
    """A table of settings.toml. What is special about all its settings is said by the class."""

    option: ClassVar[str] = "--"
    """The beginning of the options. Only for settings whose names are unclear alone: `track` is
    --wheels-track, `fps` is --fps."""
    is_of_screen: ClassVar[bool] = False
    """True if it changes a screen or a page alone: commands without one have no options of it."""
    is_of_robot: ClassVar[bool] = True
    """True if it changes the robot or its task: comparisons of trials name what differs."""


_Pair = tuple[float, float]
_Names = tuple[str, ...]
_NUMBERS, _ORDERS = tuple(NUMBER_LETTERS), tuple(BYTE_ORDERS)
# Names of [serial] that other tables have too, or that are unclear alone.
_SERIAL = "--serial-"
# Free for a course's robot: they only concern the communication of its program.
_talk = functools.partial(Setting, course=CourseRule.FREE)


def _port(port: dialects.DialectPort) -> Setting:
    return _talk(IntegerRule(0, LARGEST_PORT), port.help, metavar="PORT")


def _number(low: float, high: float, help_text: str, unit: str = "", option: str = "") -> Setting:
    """A number within bounds, the bounds included."""
    return Setting(NumberRule(low, high), help_text, unit, option=option)


def _whole(low: int, high: int, help_text: str) -> Setting:
    """A whole number within bounds, the bounds included."""
    return Setting(IntegerRule(low, high), help_text)


def _flag(help_text: str, option: str = "") -> Setting:
    """True or false."""
    return Setting(FlagRule(), help_text, option=option)


def _key(help_text: str) -> Setting:
    """The keys of one action, comma-separated Textual names; empty for none."""
    return _text(help_text, "KEYS")


def _choice(words: str, help_text: str, option: str = "") -> Setting:
    """One of a few words; `words` has them separated by spaces."""
    return Setting(ChoiceRule(tuple(words.split())), help_text, option=option)


def _text(help_text: str, metavar: str = "", option: str = "", *, blank: bool = True) -> Setting:
    """A line of text, which may be empty if `blank`."""
    return Setting(TextRule(blank), help_text, option=option, metavar=metavar)


class ServerSettings(SettingsTable, frozen=True, kw_only=True):
    """The ports and the form of replies."""

    is_of_robot = False
    host: Annotated[str, _text("address of the ports", "ADDRESS", blank=False)] = "127.0.0.1"
    listeners: Annotated[_Names, _talk(SeveralRule(()), "dialects that are served")] = ("binary",)
    port: Annotated[int, _port(dialects.COMMANDS)] = dialects.COMMANDS.default
    reply_port: Annotated[int, _port(dialects.REPLIES)] = dialects.REPLIES.default
    reply_format: Annotated[str, _talk(ChoiceRule(_NUMBERS), "size of a reply")] = "float64"
    byte_order: Annotated[str, _talk(ChoiceRule(_ORDERS), "order of a reply's bytes")] = "big"
    # Programs of Sep and Oct 2020 send no newline, and one command a write: after 5 ms nothing more comes.
    grace: Annotated[
        float, _talk(NumberRule(0, 10), "silence after which bytes without a newline are a command", "s")
    ] = 0.005
    packet_port: Annotated[int, _port(dialects.PACKETS)] = dialects.PACKETS.default
    packet_reply_port: Annotated[int, _port(dialects.PACKET_REPLIES)] = dialects.PACKET_REPLIES.default
    legacy_reply: Annotated[
        str,
        _talk(ChoiceRule((*_NUMBERS, "text")), "form of the reply to a packet without brackets"),
    ] = "float64"
    idle: Annotated[
        float, _number(0.1, 3600, "silence after which a program that sends packets has left", "s")
    ] = 10.0
    belief_port: Annotated[int, _port(dialects.BELIEFS)] = dialects.BELIEFS.default
    dialect_port: Annotated[int, _port(dialects.SERIAL)] = dialects.SERIAL.default
    line: Annotated[
        str, _choice("baud instant", "time of a byte on a dialect's line: by its baud rate, or none")
    ] = "baud"
    serial_names: Annotated[
        _Names,
        Setting(
            NamesRule(),
            "serial ports that lead a dialect's program to the robot; all if none is named",
        ),
    ] = ()
    pty: Annotated[
        str, _text("path of a pseudo-terminal that is a dialect's serial port (not on Windows)", "PATH")
    ] = ""
    any_user: Annotated[bool, _flag("let programs of other users of this machine connect (Linux)")] = False
    token: Annotated[
        str, _text("token that programs must send as their first line; also from SIMMER_TOKEN", "WORD")
    ] = ""
    added_ports: tuple[tuple[str, int], ...] = ()
    """Ports of dialects that are not built in, as (setting, number)."""


class MotionSettings(SettingsTable, frozen=True, kw_only=True):
    """Motion of the robot."""

    motion: Annotated[
        str, _choice("instant timed", "instant: a movement is over at once; timed: it takes its time")
    ] = "instant"
    reply: Annotated[
        str,
        _talk(
            ChoiceRule(("auto", "done", "accepted")),
            "reply to a timed drive; done: at its end, accepted: at once, auto: as its dialect does",
        ),
    ] = "auto"
    clock: Annotated[
        str,
        Setting(
            ChoiceRule((AUTO_CLOCK, *CLOCKS)),
            "clock of timed motion: the real one, or that of the Python program that is run, which stands "
            "still while it computes; auto: the program's in trials and gradings of a set with a dialect, "
            "and in trials with --sketch",
        ),
    ] = AUTO_CLOCK
    time_scale: Annotated[
        float, Setting(TIME_SCALES, "simulated seconds that pass in a second of timed motion")
    ] = 1.0
    contact: Annotated[
        str,
        _choice(
            "drive stop",
            "end of a movement at a wall; drive: if the commanded motion is blocked, stop: at any contact",
        ),
    ] = "drive"
    clearance: Annotated[
        float, _number(0, 1, "distance before a contact at which the robot stops, along its path", "in")
    ] = 0.0
    block_solid: Annotated[bool, _flag("the block stops the robot as a wall does")] = False
    velocity_timeout: Annotated[
        float,
        _number(0, 3600, "simulated time after which a velocity ends if it is not sent again, 0: never", "s"),
    ] = 0.0
    loop_time: Annotated[
        float,
        _number(
            *(0.001, 1),
            "simulated time that a pass of a program's loop takes in instant motion while its robot drives",
            "s",
        ),
    ] = 0.02
    wall_friction: Annotated[float, _number(0, 1, "friction of a robot that slides along a wall")] = 0.3
    control_period: Annotated[
        float, _number(0.001, 0.2, "period of the robot's speed control: steps of a ramp", "s")
    ] = 0.02

    @property
    def timing(self) -> str:
        """The clock of simulated time: `instant`, `timed` (the real clock), or `program` (its clock)."""
        return "program" if self.is_by_program else self.motion

    @property
    def is_by_program(self) -> bool:
        """True if simulated time follows the program's clock."""
        return self.clock in ("program", ELSE_REAL)


class SensorsSettings(SettingsTable, frozen=True, kw_only=True):
    """Kinds of sensors that a team wrote itself."""

    devices: Annotated[
        _Names, Setting(NamesRule(), "files of the set with sensors of its own, such as devices/thermal.py")
    ] = ()


NO_WHEELS = "none"
"""The layout of a robot whose wheels are not described."""


class WheelsSettings(SettingsTable, frozen=True, kw_only=True):
    """The robot's wheels, for commands of rim speeds."""

    option = "--wheels-"
    layout: Annotated[
        str,
        Setting(
            ChoiceRule((NO_WHEELS, *(layout.value for layout in WheelLayout))),
            "arrangement of the wheels; with none there is no command for rim speeds",
        ),
    ] = NO_WHEELS
    track: Annotated[float, _number(0.1, 24, "distance of left and right wheels", "in")] = 6.0
    wheelbase: Annotated[float, _number(0.1, 24, "distance of front and rear wheels", "in")] = 6.0
    radius: Annotated[float, _number(0.1, 12, "distance of omni wheels from the centre", "in")] = 3.0
    top_speed: Annotated[float, _number(0.1, 1000, "greatest speed of a rim", "in/s")] = 12.0


class LinkSettings(SettingsTable, frozen=True, kw_only=True):
    """The simulated link between a program and the robot, in each direction."""

    option = "--link-"
    latency: Annotated[
        float,
        _number(0, 10, "simulated time that a message takes between program and robot, each way", "s"),
    ] = 0.0
    jitter: Annotated[float, _number(0, 10, "largest random addition to it", "s")] = 0.0


# A sketch on an Uno, Nano or Mega begins 1.5 to 2 s after its port was opened: the boot loader waits first.
BOOT_TIME = 2.0
"""Seconds that a board takes to start when its port is opened."""
AUTO_BOOT = "auto"
"""The time that fits the kind of the port: see the setting."""


class SerialSettings(SettingsTable, frozen=True, kw_only=True):
    """The port of a real robot, and the form of its messages."""

    is_of_robot = False
    port: Annotated[
        str, _text("serial port or URL of a real robot, which is then driven", "PORT", "--serial")
    ] = ""
    baud: Annotated[int, _whole(50, 4_000_000, "bits a second on the port")] = USUAL_BAUD
    timeout: Annotated[
        float, _number(0.01, 3600, "time after which a command without a reply is answered NaN", "s", _SERIAL)
    ] = 5.0
    boot: Annotated[
        str,
        Setting(
            NumberOrAutoRule(0, 60),
            "time that commands wait after the port is opened, unless the board says something before; auto: "
            f"{BOOT_TIME:g} for a USB adapter, else 0",
            "s",
            option=_SERIAL,
        ),
    ] = AUTO_BOOT
    dtr: Annotated[
        bool,
        _flag("opening the port moves its line DTR, at which most boards start again", _SERIAL),
    ] = True
    suffix: Annotated[str, _choice("none lf crlf", "line end added to commands that have none", _SERIAL)] = (
        "none"
    )
    reply_end: Annotated[
        str,
        _choice(
            " ".join(("auto", *ReplyEnd)),
            "end of a reply of the robot; auto: as robot_reply or the program's dialect has it",
        ),
    ] = "auto"
    robot_reply: Annotated[
        str,
        _choice(
            " ".join(("same", "text", *reversed(_NUMBERS))),
            "form of the robot's replies, converted for the program unless the same",
        ),
    ] = "same"
    robot_byte_order: Annotated[
        str, _choice(" ".join(_ORDERS), f"order of the bytes in such a {listed(reversed(_NUMBERS))} reply")
    ] = "little"
    record: Annotated[str, _text("file for the bytes to and from the real robot", "FILE")] = ""
    velocity: Annotated[bool, _flag("the robot knows the commands of continuous motion", _SERIAL)] = False
    stop: Annotated[str, _text("command that stops the robot at once", option=_SERIAL, blank=False)] = "xx"


OFF = "off"
"""The value of a port that is not used."""
WEB_PORT = "9080"
"""The usual port of the page, near those of programs, which begin at 9000."""


class WebSettings(SettingsTable, frozen=True, kw_only=True):
    """The page that shows the run in browsers."""

    option = "--web-"
    is_of_screen = True
    is_of_robot = False
    port: Annotated[
        str,
        Setting(
            PortOrOffRule(),
            f"show the run in browsers: port of the page, 0 for any free one; without a number {WEB_PORT}",
            option="--web",
            metavar="PORT",
            alone=WEB_PORT,
        ),
    ] = OFF
    host: Annotated[
        str,
        _text(
            "address on which other machines may look too, with the link that is shown at the start",
            "ADDRESS",
        ),
    ] = ""
    names: Annotated[
        _Names,
        Setting(
            NamesRule(),
            "names under which a port forwarder shows the page; the link then ends in a secret word",
        ),
    ] = ()
    control: Annotated[bool, _flag("let the page drive, as console and keys do")] = False


class ScreenSettings(SettingsTable, frozen=True, kw_only=True):
    """Appearance of the terminal app, and lengths of its keys' drives."""

    is_of_screen = True
    is_of_robot = False
    fps: Annotated[int, _whole(1, 20, "pictures a second")] = 16
    pace: Annotated[
        float,
        Setting(
            PACES,
            "rate at which movements of instant motion are shown, times real speed",
        ),
    ] = 4.0
    color: Annotated[str, _choice("auto truecolor 256 16 none", "colours of the terminal")] = "auto"
    glyphs: Annotated[str, _choice("auto quadrant sextant octant half ascii", "characters for the maze")] = (
        "auto"
    )
    theme: Annotated[str, _choice("dark light high-contrast", "colours of the screen")] = "dark"
    mouse: Annotated[bool, _flag("use the mouse, else it is left to the terminal")] = True
    step: Annotated[float, _number(0, 1000, "length of a key's drive", "in")] = 3.0
    fine_step: Annotated[float, _number(0, 1000, "the same with Shift", "in")] = 0.5
    turn: Annotated[float, _number(0, 3600, "angle of a key's turn", "deg")] = 15.0
    fine_turn: Annotated[float, _number(0, 3600, "the same with Shift", "deg")] = 3.0
    keys_velocity: Annotated[
        bool, _flag("a key that is held drives at a velocity until it is released, not by steps")
    ] = False
    # 6 in/s crosses a cell of the course's maze in 2 s, and 45 deg/s a quarter turn: slow enough to react to.
    keys_speed: Annotated[
        float, _number(0, 1000, "velocity of a held key; with Shift less, as steps are", "in/s")
    ] = 6.0
    keys_turn_speed: Annotated[float, _number(0, 3600, "the same of a turn", "deg/s")] = 45.0


class KeySettings(SettingsTable, frozen=True, kw_only=True):
    """Keys while the maze has the focus; Shift with a driving key is fine. Comma-separated, or empty."""

    option = "--key-"
    is_of_screen = True
    is_of_robot = False
    forward: Annotated[str, _key("drive forward")] = "up,w"
    back: Annotated[str, _key("drive back")] = "down,s"
    turn_left: Annotated[str, _key("turn left")] = "left,a"
    turn_right: Annotated[str, _key("turn right")] = "right,d"
    sideways_left: Annotated[str, _key("drive to the left")] = "q"
    sideways_right: Annotated[str, _key("drive to the right")] = "e"
    stop: Annotated[str, _key("stop the robot")] = "space"
    poll: Annotated[str, _key("read all sensors")] = "p"
    reset: Annotated[str, _key("back to the start")] = "r"
    pause: Annotated[str, _key("pause: commands wait")] = "b"
    step: Annotated[str, _key("while paused, let the next command through")] = "n"
    slower: Annotated[str, _key("show movements half as fast")] = "left_square_bracket"
    faster: Annotated[str, _key("show movements twice as fast")] = "right_square_bracket"
    full_speed: Annotated[str, _key("movements as fast as possible")] = "backslash"
    trail: Annotated[str, _key("show the trail")] = "t"
    rays: Annotated[str, _key("show what the sensors see")] = "y"
    truth: Annotated[str, _key("show true values beside readings")] = "v"
    zoom_in: Annotated[str, _key("zoom in")] = "plus,equals_sign"
    zoom_out: Annotated[str, _key("zoom out")] = "minus"
    fit: Annotated[str, _key("show the whole maze")] = "f"
    follow: Annotated[str, _key("keep the robot in sight")] = "o"
    pan_left: Annotated[str, _key("look further left")] = "ctrl+left"
    pan_right: Annotated[str, _key("look further right")] = "ctrl+right"
    pan_up: Annotated[str, _key("look further up")] = "ctrl+up"
    pan_down: Annotated[str, _key("look further down")] = "ctrl+down"
    floor: Annotated[str, _key("show the floor's black tiles: if lines are read, always, never")] = "l"
    heat: Annotated[str, _key("draw a belief that is a grid as a map, or only its best cell")] = "H"
    help: Annotated[str, _key("help")] = "question_mark"


class Settings(Struct, frozen=True, kw_only=True):
    """settings.toml and the options together. Units: inches, degrees, seconds."""

    bot_center: Annotated[_Pair, Setting(PairRule(), "start of the robot's centre", "in")] = (9.5, 42.0)
    bot_rot: Annotated[
        float, Setting(NumberRule(), "start heading, counter-clockwise from +X", "deg", metavar="ANGLE")
    ] = 0.0
    block_center: Annotated[_Pair, Setting(PairRule(), "place of the block's centre", "in")] = (25.0, 41.0)
    blocksize: Annotated[
        float, Setting(NumberRule(0), "side length of the block, 0 for no block at all", "in")
    ] = 3.0
    num_segments: Annotated[int, _whole(1, 10_000, "equal parts of each movement")] = 10
    step_time: Annotated[float, _number(0, 3600, "pause after every command, before its reply", "s")] = 0.0
    randerror: Annotated[
        bool, _flag("random errors differ from run to run; otherwise they come from seed")
    ] = True
    seed: Annotated[int, Setting(SEEDS, "seed of the random errors; the option implies --no-randerror")] = 0
    randbias: Annotated[bool, _flag("draw the drives' biases at random at start, not from drive.csv")] = True
    strength: Annotated[
        _Pair,
        Setting(
            PairRule(NumberRule(0)),
            "strength of the random bias of translations and of rotations",
            metavar="T,R",
        ),
    ] = (0.05, 1.0)
    drive_profile: Annotated[
        str, _text("errors and speeds of a usual drive in place of those in drive.csv", "NAME")
    ] = ""
    sensor_profile: Annotated[
        _Names, Setting(NamesRule(), "errors and ranges of usual sensors in place of those in sensors.csv")
    ] = ()
    link_profile: Annotated[
        str, _text("delays of a usual link to the robot in place of those in [link]", "NAME")
    ] = ""
    nominal: Annotated[str, _text("the set that this one was made from: reports compare the two", "SET")] = ""
    realistic: Annotated[
        bool,
        _flag(
            "simulate a robot with real faults and delays: the profiles "
            f"{', '.join((USUAL_DRIVE, *USUAL_SENSORS.values()))} and {USUAL_LINK} where no other is chosen; "
            "not the real robot (that is --serial)",
        ),
    ] = False
    sim: Annotated[bool, _flag("simulate the robot, else drive the one on the serial port")] = True
    plot_robot: Annotated[bool, _flag("draw the maze and the robot on the screen")] = True
    plot_sense: Annotated[bool, _flag("draw what the sensors see on the screen")] = True
    server: ServerSettings = ServerSettings()
    motion: MotionSettings = MotionSettings()
    wheels: WheelsSettings = WheelsSettings()
    sensors: SensorsSettings = SensorsSettings()
    link: LinkSettings = LinkSettings()
    serial: SerialSettings = SerialSettings()
    web: WebSettings = WebSettings()
    screen: ScreenSettings = ScreenSettings()
    keys: KeySettings = KeySettings()

    @property
    def uses_profiles(self) -> bool:
        """True if a profile replaces values of the set."""
        return bool(self.realistic or self.sensor_profile or self.drive_profile or self.link_profile)

    def run_seed(self) -> int:
        """The seed of a run: `seed`, or one drawn for this run if random errors differ from run to run."""
        # Not with the module secrets, whose import takes time.
        return int.from_bytes(os.urandom(4)) if self.randerror else self.seed


def tables() -> dict[str, type[SettingsTable]]:
    """The classes of all tables, by name."""
    fields = asdict(Settings())
    return {name: type(each) for name, each in fields.items() if isinstance(each, SettingsTable)}


def all_settings() -> tuple[Setting, ...]:
    """Every setting, those outside tables first, in the order of the fields."""
    # The table is the key of the cache, so that an added dialect adds its ports.
    return _all_settings(tuple(dialects.DIALECTS.items()))


@functools.cache
def _all_settings(_: tuple[tuple[str, dialects.Dialect], ...]) -> tuple[Setting, ...]:
    """The settings with a table of dialects, by which they are cached: options request them many times."""
    return tuple(_described(Settings(), "", ""))


def _described(defaults: Struct, prefix: str, group: str) -> Iterator[Setting]:
    table = type(defaults) if isinstance(defaults, SettingsTable) else SettingsTable
    for name, annotation in type(defaults).__annotations__.items():
        default = getattr(defaults, name)
        if isinstance(default, Struct):
            yield from _described(default, f"{name}.", name)
            continue
        # Settings outside tables need a heading, since they have no table's name.
        group = _HEADINGS.get(name, group) if not prefix else group
        # Ports of dialects that are not built in are settings like the others, without a field each.
        if name == "added_ports":
            known = type(defaults).__annotations__
            for port in dialects.all_ports():
                if port.setting not in known:
                    yield _completed(_port(port), port.setting, port.default, prefix, group, table)
            continue
        item: Setting = annotation.__metadata__[0]
        # The dialects are read here, not at the field, because one may be added at any time.
        if name == "listeners":
            names = dialects.choices()
            item = replace(item, rule=SeveralRule(names), help=f"{item.help}: {', '.join(names)}")
        yield _completed(item, name, default, prefix, group, table)


def _completed(
    item: Setting, name: str, default: object, prefix: str, group: str, table: type[SettingsTable]
) -> Setting:
    """A setting with what follows from its field."""
    option = item.option or table.option
    return replace(
        item,
        name=prefix + name,
        default=default,
        group=group,
        option=option + name.replace("_", "-") if option.endswith("-") else option,
        metavar=item.metavar or item.rule.metavar,
    )


def value_of(settings: Struct, name: str) -> Any:
    """The value of a setting by its dotted name, from `Settings` or from one of its tables."""
    table, dot, key = name.partition(".")
    if dot:
        return value_of(getattr(settings, table), key)
    if isinstance(settings, ServerSettings) and name not in type(settings).__annotations__:
        added = {port.setting: port.default for port in dialects.all_ports()} | dict(settings.added_ports)
        return added[name]
    return getattr(settings, name)


def settings_from(values: Mapping[str, Any], usual: Settings = Settings()) -> Settings:  # noqa: B008 - frozen
    """Settings with `values` (checked, by dotted name) instead of the `usual` ones."""
    tables: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        table, _, key = name.rpartition(".")
        tables.setdefault(table, {})[key] = value
    server = tables.get("server", {})
    added = [name for name in server if name not in ServerSettings.__annotations__]
    if added:
        numbers = dict(usual.server.added_ports) | {name: server.pop(name) for name in added}
        defaults = {port.setting: port.default for port in dialects.all_ports()}
        # Those at their defaults are left out, as in `Settings()`: the same settings are equal.
        server["added_ports"] = tuple(each for each in numbers.items() if each not in defaults.items())
    made = {table: replace(getattr(usual, table), **inner) for table, inner in tables.items() if table}
    return replace(usual, **tables.get("", {}), **made)


def with_any_ports(settings: Settings) -> Settings:
    """The same settings, with any free number for every port, and no path that another process may use."""
    numbers = {f"server.{port.setting}": 0 for port in dialects.all_ports()}
    return settings_from({**numbers, "server.pty": ""}, settings)
