"""wiring.toml: the boards of a set and their pins, and every mistake with its line."""

from __future__ import annotations

import tomllib
from pathlib import Path

import jsonschema
import pytest

from simmer_tui.cli.main import main
from simmer_tui.config.loader import load
from simmer_tui.config.new_set import wiring_schema
from simmer_tui.config.set_sketches import main_files, source_paths
from simmer_tui.config.sets import bundled_sets, init_set
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.specs import WheelLayout, WheelsSpec
from simmer_tui.sketch.wiring import WiredGyro, WiredRanger, Wiring, WiringParts, read_wiring

TWO_BOARDS = """\
[boards.sensor]
sketch = "SensorUno.ino"
board = "uno"
[boards.rover]
sketch = "RoverUno"
board = "nano"
[laptop]
board = "sensor"
rx = 9
tx = 10
[[wires]]
from = "sensor.A0"
to = "rover.A4"
[[motors]]
board = "rover"
driver = "hbridge"
en = 5
in1 = "D6"
in2 = 7
wheel = "left"
top_speed = 45
[[motors]]
board = "rover"
driver = "shield"
dir = 12
pwm = 3
wheel = "right"
top_speed = 45
dead_band = 0
reversed = true
[[sensors]]
code = "u1"
board = "sensor"
part = "hc-sr04"
trig = 8
echo = 4
[[sensors]]
board = "rover"
part = "encoder"
wheel = "left"
a = 2
edges_per_inch = 20
[[sensors]]
code = "i1"
board = "rover"
part = "line"
pin = 8
active = "low"
[[sensors]]
code = "u2"
board = "rover"
part = "analog"
pin = "a6"
points = [[0, 900], [12.5, 100]]
[[servos]]
board = "rover"
pin = 11
gripper = { open = 130, closed = 180 }
"""


@pytest.fixture(scope="module")
def parts() -> WiringParts:
    return WiringParts(
        load(bundled_sets()["mission"]).simulation.sensors, WheelsSpec(layout=WheelLayout.DIFF)
    )


def read(text: str, parts: WiringParts) -> tuple[Wiring | None, list[str]]:
    problems: list[Problem] = []
    wiring = read_wiring(text, parts, problems)
    return wiring, [str(each) for each in problems]


def test_a_wiring_is_read_with_numbers_of_pins(parts: WiringParts) -> None:
    wiring, problems = read(TWO_BOARDS, parts)
    assert problems == []
    assert wiring is not None
    assert wiring.laptop is not None
    assert (wiring.laptop.rx, wiring.laptop.tx, wiring.laptop.baud) == (9, 10, None)
    assert [(each.from_board, each.tx, each.to_board, each.rx) for each in wiring.wires] == [
        ("sensor", 14, "rover", 18)
    ]
    left, right = wiring.motors
    assert (left.label, left.pins, left.wheel_index) == ("motors[1]", {"en": 5, "in1": 6, "in2": 7}, 0)
    assert (left.dead_band, left.reversed, right.dead_band, right.reversed) == (0.1, False, 0, True)
    assert right.pins == {"dir": 12, "pwm": 3}
    uses = {(each.board, each.pin, each.label, each.name) for each in wiring.pin_uses()}
    assert {("rover", 20, "sensors[4]", "pin"), ("rover", 11, "servos[1]", "pin")} <= uses
    assert ("sensor", 8, "sensors[1]", "trig") in uses
    assert left.place_of("in2") == "wiring.toml:19:motors.1.in2"
    assert left.place_of("reversed") == "wiring.toml:14:motors.1.reversed"


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (
            'board = "uno"',
            'board = "esp8266"',
            'wiring.toml:3:boards.sensor.board: "esp8266" cannot be simulated; uno, nano, mega and esp32 can',
        ),
        (
            'board = "uno"',
            'board = "unno"',
            'must be "uno", "nano", "mega" or "esp32", not "unno"; did you mean "uno"?',
        ),
        (
            'board = "sensor"\nrx',
            'board = "sensr"\nrx',
            'wiring.toml:8:laptop.board: there is no board "sensr"; did you mean "sensor"?',
        ),
        ("rx = 9", "rx = 20", "wiring.toml:9:laptop.rx: the Uno has no pin 20; it has 0 to 13 and A0 to A5"),
        (
            "rx = 9",
            'rx = "9V"',
            'must be a pin such as 9 or "A0", not "9V"',
        ),
        ('from = "sensor.A0"', 'from = "A0"', "wiring.toml:12:wires.1.from: must be a board and a pin"),
        (
            'from = "sensor.A0"',
            'from = "rover.A0"',
            "wiring.toml:13:wires.1.to: must be a pin of another board",
        ),
        (
            'driver = "hbridge"',
            'driver = "hbrige"',
            'wiring.toml:16:motors.1.driver: must be "hbridge", "shield", "pwm2", "servo360", "step_dir", '
            '"stepper4" or "uln2003", not "hbrige"; did you mean "hbridge"?',
        ),
        (
            'driver = "hbridge"',
            'driver = "esc"',
            '"esc" cannot be simulated; servo360 can: 1,500 us is its stop',
        ),
        ('driver = "hbridge"', 'driver = "pwm2"', "wiring.toml:17:motors.1.en: is not known here"),
        ("in2 = 7\n", "", "wiring.toml:14:motors.1.in2: is missing; must be a pin"),
        ("in2 = 7", "in2 = 5", "pin 5 of rover is already en of motors[1] (wiring.toml:17:motors.1.en)"),
        ("pin = 11", "pin = 20", "wiring.toml:57:servos.1.pin: A6 of the Nano is for analogRead only"),
        ('wheel = "right"', 'wheel = "rihgt"', 'there is no wheel "rihgt"; did you mean "right"?'),
        ('wheel = "right"', 'wheel = "left"', 'the wheel "left" has motors[1]; motors that run together'),
        (
            'code = "u1"',
            'code = "q9"',
            'wiring.toml:32:sensors.1.code: no row of sensors.csv has the code "q9"',
        ),
        ('code = "u2"', 'code = "u1"', "u1 is at wiring.toml:31:sensors.1 already"),
        ('code = "i1"', 'code = "u3"', "which does not read 0 or 1"),
        (
            'part = "hc-sr04"\ntrig = 8\necho = 4',
            'part = "compass"',
            "of the parts on Wire (I2C), mpu6050 and vl53l0x can",
        ),
        ('pin = "a6"', "pin = 9", "must be an analog pin, A0 to A7, not 9"),
        ("[12.5, 100]", "[0, 100]", "with readings that rise"),
        ("closed = 180", "closed = 130", "open and closed must be two different angles"),
        ("closed = 180", "shut = 180", "servos.1.gripper.closed: is missing"),
        ("[[servos]]", "[[servo]]", 'servo: is not known here; did you mean "servos"?'),
        ("[[wires]]", "[wires]", "wires: must be tables: [[wires]]"),
    ],
)
def test_a_mistake_is_told_with_its_place(parts: WiringParts, old: str, new: str, problem: str) -> None:
    assert TWO_BOARDS.count(old) >= 1
    problems = read(TWO_BOARDS.replace(old, new, 1), parts)[1]
    assert problem in "\n".join(problems)
    assert len(problems) <= 3


STEPPER = """
[boards.rover]
sketch = "rover.ino"
board = "uno"
[[motors]]
board = "rover"
driver = "step_dir"
step = 2
dir = 5
enable = 8
steps_per_inch = 127.3
wheel = "left"
[[motors]]
board = "rover"
driver = "uln2003"
in1 = 9
in2 = 10
in3 = 11
in4 = 12
steps_per_inch = 300
reversed = true
wheel = "right"
"""


def test_steppers_have_steps_an_inch_and_no_duty(parts: WiringParts) -> None:
    wiring, problems = read(STEPPER, parts)
    assert problems == []
    assert wiring is not None
    first, second = wiring.steppers
    assert (first.steps_per_inch, first.enable_high, first.reversed) == (127.3, False, False)
    assert parts.wheels is not None
    assert first.top_speed == parts.wheels.top_speed
    assert (second.driver, second.reversed) == ("uln2003", True)
    assert wiring.motors == ()
    jsonschema.validate(tomllib.loads(STEPPER), wiring_schema())
    for old, new, problem in (
        (
            "steps_per_inch = 127.3\n",
            "",
            "motors.1.steps_per_inch: is missing; must be a number from",
        ),
        ("dir = 5\n", "", "motors.1.dir: is missing; must be a pin"),
        ("enable = 8\n", 'enable = 8\nenable_on = "HIGH"\n', ""),
        ("enable = 8\n", "enable = 8\ntop_speed = 12\n", "motors.1.top_speed: is not known here"),
        ("in4 = 12\n", "in4 = 2\n", "pin 2 of rover is already step of motors[1]"),
        ('"right"', '"left"', 'the wheel "left" has motors[1]'),
    ):
        told = "\n".join(read(STEPPER.replace(old, new), parts)[1])
        assert problem in told
        assert bool(told) == bool(problem)


def test_parts_share_pins_only_where_a_board_can(parts: WiringParts) -> None:
    shared = (
        TWO_BOARDS + '[[sensors]]\ncode = "u3"\nboard = "sensor"\npart = "hc-sr04"\ntrig = 8\necho = 12\n'
    )
    assert read(shared, parts)[1] == []
    one_pin = TWO_BOARDS.replace("echo = 4", "echo = 8")
    assert read(one_pin, parts)[1] == []
    assert "pin 4 of sensor is already" in read(shared.replace("echo = 12", "echo = 4"), parts)[1][0]


ON_A_BUS = (
    '[boards.rover]\nsketch = "r.ino"\nboard = "uno"\n'
    '[[sensors]]\ncode = "g1"\nboard = "rover"\npart = "mpu6050"\naddress = 0x69\nint = 2\n'
    '[[sensors]]\ncode = "t1"\nboard = "rover"\npart = "vl53l0x"\nxshut = 7\naddress = 0x30\n'
    '[[sensors]]\ncode = "u1"\nboard = "rover"\npart = "vl53l0x"\nint = 3\n'
)


def test_parts_on_a_bus_are_read_with_its_wires(parts: WiringParts) -> None:
    wiring, problems = read(ON_A_BUS, parts)
    assert problems == []
    assert wiring is not None
    gyro, first, second = wiring.sensors
    assert isinstance(gyro, WiredGyro)
    assert (gyro.address, gyro.interrupt) == (0x69, 2)
    assert isinstance(first, WiredRanger)
    assert isinstance(second, WiredRanger)
    assert (first.address, first.xshut, first.interrupt) == (0x30, 7, None)
    assert (second.address, second.xshut, second.interrupt) == (0x29, None, 3)
    uses = [(each.pin, each.label, each.name, each.writes) for each in wiring.pin_uses()]
    assert uses[:3] == [
        *((18, "sensors[1]", "sda", False), (19, "sensors[1]", "scl", False)),
        (2, "sensors[1]", "int", False),
    ]
    assert (7, "sensors[2]", "xshut", True) in uses
    jsonschema.validate(tomllib.loads(ON_A_BUS), wiring_schema())


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("xshut = 7\n", "", "sensors[2] has no xshut either, so both begin at 0x29 together"),
        ("int = 3", 'int = "A4"', "pin A4 of rover is already sda of sensors[1]"),
        ("int = 3", "xshut = 8\naddress = 0x30", "0x30 is the address of sensors[2] already"),
        ("0x69", "0x30", "an MPU6050 is at 0x68, with AD0 high at 0x69, never at 0x30"),
        ("0x69", "0x100", "must be an address from 0x01 to 0x7f, not 256"),
        ('"g1"', '"c1"', "which is no gyro; an mpu6050 is one"),
        ('"t1"', '"i1"', "which measures no distance; a vl53l0x does"),
        ('part = "mpu6050"', 'part = "mpu6050"\nxshut = 4', "sensors.1.xshut: is not known here"),
    ],
)
def test_a_mistake_on_a_bus_is_told(parts: WiringParts, old: str, new: str, problem: str) -> None:
    assert ON_A_BUS.count(old) >= 1
    problems = read(ON_A_BUS.replace(old, new, 1), parts)[1]
    assert problem in "\n".join(problems)


def test_a_set_without_wheels_or_boards_is_told_so(parts: WiringParts) -> None:
    problems = read(TWO_BOARDS, WiringParts(parts.sensors))[1]
    assert "wiring.toml:20:motors.1.wheel: the set has no wheels" in problems[0]
    assert "add [boards.NAME]" in read("[[motors]]\n", parts)[1][0]
    assert "is not TOML" in read("boards = {", parts)[1][0]


def test_an_empty_table_of_the_laptop_lacks_its_board(parts: WiringParts) -> None:
    empty = TWO_BOARDS.replace('[laptop]\nboard = "sensor"\nrx = 9\ntx = 10\n', "[laptop]\n")
    assert "laptop.board: is missing" in "\n".join(read(empty, parts)[1])


def test_the_schema_allows_what_the_reader_allows() -> None:
    jsonschema.Draft7Validator.check_schema(wiring_schema())
    jsonschema.validate(tomllib.loads(TWO_BOARDS), wiring_schema())
    for wrong in (
        '[laptop]\nboard = "a"\nspeed = 1\n',
        '[[motors]]\ndriver = "esc"\n',
        "[[servos]]\npin = -1\n",
    ):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(tomllib.loads(wrong), wiring_schema())


def test_many_headers_hide_no_sketch_and_another_encoding_is_told(tmp_path: Path) -> None:
    for number in range(120):
        (tmp_path / f"a{number}.h").touch()
    (tmp_path / "rover.ino").touch()
    assert source_paths(tmp_path)[0] == main_files(tmp_path)[0] == tmp_path / "rover.ino"
    init_set(tmp_path / "mine", bundled_sets()["mission"])
    (tmp_path / "mine" / "wiring.toml").write_bytes(b"# R\xe4der\n")
    with pytest.raises(ConfigurationError, match=r"wiring\.toml: is not UTF-8 text; save it as UTF-8"):
        load(tmp_path / "mine")


def test_tabs_beside_the_only_sketch_are_its_own_whatever_the_folder_is_called(tmp_path: Path) -> None:
    """As Arduino has them in a folder of the sketch's name; a hand-in often has another."""
    tab, rover, other = (tmp_path / name for name in ("motors.ino", "rover.ino", "sensor.ino"))
    tab.write_text("// as void setup() says\nvoid drive() {}\n", "utf-8")
    rover.write_text("int a;\nvoid  setup () {}\n", "utf-8")
    assert main_files(rover) == [rover, tab]
    other.write_text("#define A\n\tvoid setup()\n{}\n", "utf-8")
    assert main_files(rover) == [rover]
    assert main_files(other) == [other]


def test_a_set_with_a_wiring_is_copied_whole_and_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", "")  # without a compiler nothing is run
    init_set(tmp_path / "mine", bundled_sets()["mission"])
    (tmp_path / "mine" / "wiring.toml").write_text(
        '[boards.main]\nsketch = "drive"\nboard = "uno"\n[[servos]]\nboard = "main"\npin = 9\n', "utf-8"
    )
    assert main(["check", "mine"]) == 2
    assert 'wiring.toml:2:boards.main.sketch: there is no sketch "drive"' in capsys.readouterr().err
    (tmp_path / "mine" / "drive").mkdir()
    (tmp_path / "mine" / "drive" / "drive.ino").write_text("void loop() { arm.attach(9); }\n", "utf-8")
    beside = ("drive/src/a.cpp", "libraries/Own/Own.h", "drive/pins.h")
    for name in beside:
        (tmp_path / "mine" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "mine" / name).write_text("// code\n", "utf-8")
    assert main(["init", "copy", "--from", "mine"]) == 0
    assert [name for name in beside if not (tmp_path / "copy" / name).is_file()] == []
    assert (tmp_path / "copy" / "drive" / "drive.ino").read_text("utf-8").startswith("void loop()")
    assert (tmp_path / "copy" / "wiring.toml").read_text("utf-8").startswith("#:schema .schema/wiring.json\n")
    capsys.readouterr()
    assert main(["check", "copy"]) == 0
    out = capsys.readouterr().out
    assert "Boards: main (Uno, drive)\n  servos[1]: pin main.9\n" in out
    assert "The boards were not run: there is no C++ compiler (simmer-tui doctor)" in out
    (tmp_path / "copy" / "drive" / "drive.ino").write_text("void loop() { arm.attach(10); }\n", "utf-8")
    assert main(["check", "copy"]) == 1
    assert "wiring.toml:7:servos.1.pin: the sketch never writes pin 9" in capsys.readouterr().out
