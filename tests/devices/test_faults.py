"""Device files that fail: at import, in the constructor, in a reading, and by what they return."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import astuple

from simmer_tui.client import CommandRefusedError, UnknownCodeError
from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.config.loader import load
from simmer_tui.errors import ConfigurationError, DeviceError
from simmer_tui.links.protocol.packets import RequestStyle, encode
from simmer_tui.sim import CommandResult, ObservingSensor, Simulator
from simmer_tui.sim.command import parse_command
from simmer_tui.sim.records import Status
from simmer_tui.sim.sensors import sensor_of
from tests.devices.conftest import DEVICE, THERMAL, MakeSet, trust
from tests.links.test_questions import robot_of, serving

READS = "        return self.spec.ambient + pose.x / 10, None\n"


def line_of(text: str, part: str) -> int:
    """The line of a text in which a part stands."""
    return text[: text.index(part)].count("\n") + 1


def refused(make_set: MakeSet, text: str) -> list[str]:
    """The mistakes of a set with a trusted device of this text."""
    with pytest.raises(ConfigurationError) as raised:
        load(make_set(text))
    return [str(each) for each in raised.value.problems]


def read(folder: Path, code: str = "h1") -> CommandResult:
    simulator = Simulator(load(folder).simulation, 7)
    simulator.execute("d1-3")
    result = simulator.execute(code)
    assert simulator.execute("u1").status is Status.READING, "the run goes on"
    return result


@pytest.mark.parametrize(
    ("raises", "said"),
    [
        ("1 / 0", "raised ZeroDivisionError: division by zero"),
        ("raise SystemExit(3)", "raised SystemExit: 3"),
        ("import nosuch", "raised ModuleNotFoundError: No module named 'nosuch'"),
        ("raise type('Odd', (Exception,), {'__str__': lambda self: 1 / 0})()", "raised Odd: (its text"),
        ("raise ValueError('a\\n\\x1b[2J' * 99)", "raised ValueError: a \\x1b[2J"),
    ],
)
def test_a_file_that_raises_is_a_mistake_with_its_line(make_set: MakeSet, raises: str, said: str) -> None:
    (problem,) = refused(make_set, f"{THERMAL}\n\n{raises}\n")
    assert problem.startswith(f"{DEVICE}:{THERMAL.count(chr(10)) + 3}: the file {said}")
    assert len(problem) < 400


def test_a_constructor_that_raises_is_a_mistake_with_its_line(make_set: MakeSet) -> None:
    text = THERMAL + "\n    def __init__(self, spec):\n        super().__init__(spec)\n        {}['a']\n"
    assert refused(make_set, text) == [
        f"{DEVICE}:{line_of(text, '{}[')}: Thermal.__init__ raised KeyError: 'a'"
    ]


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("return self.lookup[3], None", "Thermal.observe raised AttributeError: 'Thermal' object has no"),
        ("return self.observe(world, pose)", "Thermal.observe raised RecursionError"),
        ("raise SystemExit", "Thermal.observe raised SystemExit"),
        ("raise NotImplementedError('the curve')", "Thermal.observe is not written yet: the curve"),
        ("return 21.5", "observe() must return it as in (21.5, None): cannot unpack non-iterable float"),
        ("pass", "observe() must return it as in (21.5, None): cannot unpack non-iterable NoneType"),
        (
            "return math.nan, None",
            "must be a number, and observe() must return it as in (21.5, None): NaN is none",
        ),
        ("return 1j, None", "must be a string or a real number, not 'complex'"),
        ("return 'hot', None", "could not convert string to float: 'hot'"),
        ("return np.zeros(10**7), None", "can be converted to Python scalars"),
        ("return 10**400, None", "int too large to convert to float"),
        ("return 1.0, RangeScan((0, 0), (1, 2), (1,))", "a RangeScan has a distance for each bearing"),
        ("return 1.0, RangeScan((0, math.nan), (1,), (1,))", "NaN is none"),
        (
            "return 1.0, FloorPatch((0, 0), 1, np.zeros((9, 3)), np.zeros(9))",
            "cannot reshape array of size 27",
        ),
    ],
)
def test_a_reading_that_fails_has_no_answer_and_the_run_goes_on(
    make_set: MakeSet, body: str, said: str
) -> None:
    head = "import math\nimport numpy as np\nfrom simmer_tui.sim import FloorPatch, RangeScan\n"
    text = head + THERMAL.replace(READS, f"        {body}\n")
    result = read(make_set(text))
    assert (result.status, result.reading) == (Status.UNANSWERED, None)
    assert math.isnan(result.reply)
    assert said in result.reason
    line = line_of(text, f"        {body}")
    assert result.reason.startswith(
        (f"{DEVICE}:{line}: ", f"{DEVICE}: a reading of Thermal must be a number")
    )


def test_the_client_names_the_fault_and_not_an_unknown_sensor(make_set: MakeSet) -> None:
    folder = make_set(THERMAL.replace(READS, "        1 / 0\n"))
    with serving(folder) as (server, _), robot_of(server) as robot:
        with pytest.raises(
            CommandRefusedError, match=rf"^the robot refused 'h1': {DEVICE}:\d+: .*zero"
        ) as raised:
            robot.read("u1", "h1")
        assert not isinstance(raised.value, UnknownCodeError)
        assert robot.read("u1") > 0.0, "the connection is still good"


@pytest.mark.parametrize(
    ("body", "value"),
    [
        ("return True, None", 1.0),
        ("return np.float32(2.5), None", 2.5),
        ("return np.int64(3), None", 3.0),
        ("return np.bool_(True), None", 1.0),
        ("return math.inf, None", math.inf),
        ("return 4, RangeScan((0, 0), [1, 2], [3, math.inf])", 4.0),
        ("return 4, 'nothing that can be drawn'", 4.0),
    ],
)
def test_all_that_is_a_number_is_a_reading(make_set: MakeSet, body: str, value: float) -> None:
    head = "import math\nimport numpy as np\nfrom simmer_tui.sim import RangeScan\n"
    result = read(make_set(head + THERMAL.replace(READS, f"        {body}\n")))
    assert (result.reply, type(result.reply)) == (value, float)


def test_a_reading_method_that_fails_says_so(make_set: MakeSet) -> None:
    text = THERMAL + "\n    def reading(self, true, random, time):\n        return 'warm'\n"
    reason = read(make_set(text)).reason
    assert reason.startswith(f"{DEVICE}: a reading of Thermal must be a number")
    assert reason.endswith("could not convert string to float: 'warm'")


def test_true_values_of_a_device_that_fails_are_nan(make_set: MakeSet) -> None:
    simulator = Simulator(load(make_set(THERMAL.replace(READS, "        1 / 0\n"))).simulation, 7)
    values = simulator.true_values()
    assert math.isnan(values["h1"])
    assert math.isfinite(values["u1"])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('name = "temp"', 'name = "ultra"', "has the name 'ultra' of a built-in kind; built in are ultra"),
        ('name = "temp"', 'name = "Temp 1"', "must be 1 to 20 letters a to z"),
        ('name = "temp"', "pass", "has no class of a sensor with a name"),
        ('meaning = "temperature"', "pass", "needs meaning = a line of text"),
        ("columns = (", "columns = 3, (", "needs columns = a tuple of columns"),
        ('field="ambient"', 'field="nosuch"', "fills 'nosuch', no field of its row"),
        ("ambient: float = 20.0", "ambient: float", "the fields that ThermalSpec adds to SensorSpec need"),
        ("spec_type = ThermalSpec", "spec_type = dict", "must be a class derived from SensorSpec"),
        ("def observe(self, world, pose)", "def look(self, world, pose)", "Thermal lacks observe"),
        ('unit = "C"', "is_range = 3", "is_range of Thermal must be True or False"),
        ('unit = "C"', "is_scan = True", "a reading of a device is one number"),
        (READS, f"{READS}\n    observe = len\n", "observe of Thermal must be a method"),
    ],
)
def test_classes_that_are_no_kind_are_mistakes(make_set: MakeSet, old: str, new: str, said: str) -> None:
    assert old in THERMAL
    found = refused(make_set, THERMAL.replace(old, new))
    assert said in found[0]
    assert found[0].startswith(DEVICE)


def test_a_mistake_that_a_second_class_inherits_is_told_of_both(make_set: MakeSet) -> None:
    text = THERMAL.replace("spec_type = ThermalSpec", "spec_type = 5")
    text += '\n\nclass Second(Thermal):\n    name = "second"\n'
    found = refused(make_set, text)
    assert [each for each in found if "spec_type of Thermal must be a class derived from SensorSpec" in each]


def test_two_kinds_of_one_name_are_a_mistake(make_set: MakeSet) -> None:
    folder = make_set()
    (folder / "devices" / "other.py").write_text(THERMAL.replace("class Thermal(", "class Other("))
    trust(folder, "devices/other.py")
    settings = folder / "settings.toml"
    settings.write_text(settings.read_text().replace(f'"{DEVICE}"', f'"{DEVICE}", "devices/other.py"'))
    for use in (DeviceUse.RUN, DeviceUse.PARSE):
        with pytest.raises(ConfigurationError) as raised:
            load(folder, devices=use)
        assert "Other has the name 'temp' of Thermal in devices/thermal.py" in str(raised.value)


def test_prints_of_a_device_leave_standard_output_alone(
    make_set: MakeSet, capsys: pytest.CaptureFixture[str]
) -> None:
    text = "import sys\nprint('hello')\nsys.stdout.write('there')\n"
    text += THERMAL.replace(READS, f"        print('again')\n{READS}")
    assert read(make_set(text)).status is Status.READING
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("hello\nthereagain\n")


def test_a_module_has_a_name_that_meets_no_other(make_set: MakeSet) -> None:
    import simmer_tui.sim

    folder = make_set()
    (folder / DEVICE).rename(folder / "devices" / "simmer-tui.py")
    settings = folder / "settings.toml"
    settings.write_text(settings.read_text().replace(DEVICE, "devices/simmer-tui.py"))
    kind = load(folder).simulation.sensors[-1].kind
    assert kind.__module__.startswith("simmer_device_")
    assert issubclass(kind, simmer_tui.sim.ObservingSensor)


def test_rules_and_class_methods_of_its_own_may_fail_too(make_set: MakeSet) -> None:
    rule = "class Odd(NumberRule, frozen=True):\n    def _accepted(self, value):\n        return 1 / 0\n\n\n"
    text = THERMAL.replace("class ThermalSpec", f"{rule}class ThermalSpec")
    text = text.replace("CsvColumn(NumberRule()", "CsvColumn(Odd()")
    assert refused(make_set, text) == [
        f"{DEVICE}:{line_of(text, 'return 1 / 0')}: Odd._accepted raised ZeroDivisionError: division by zero"
    ]


def test_a_contradiction_that_fails_is_a_mistake(make_set: MakeSet) -> None:
    text = THERMAL + "\n    @staticmethod\n    def contradiction(spec):\n        return spec.nosuch\n"
    (problem,) = refused(make_set, text)
    assert problem.startswith(f"{DEVICE}:{line_of(text, 'return spec.nosuch')}: Thermal.contradiction raised")


COUNTER = """
import numpy as np

from simmer_tui.sim.sensors import CountingSensor


class Wheel(CountingSensor):
    name = "wheel"
    meaning = "distance"
    unit = "in"
    columns = ()
    slips = True

    def increments(self, turn, move, draws):
        BODY

    def counted(self, trajectory, time):
        return 1.0

    def counted_on(self, turned, ahead, aside):
        return ahead
"""


def test_a_counter_that_fails_lets_the_robot_drive_and_tells_it_when_read(make_set: MakeSet) -> None:
    text = COUNTER.replace("BODY", "return {}[0]")
    folder = make_set(text, row="wheel1,h1,1,,,,,0,,")
    simulator = Simulator(load(folder).simulation, 7)
    assert simulator.execute("d1-3").status is Status.DONE
    result = simulator.execute("h1")
    assert result.status is Status.UNANSWERED
    assert result.reason == f"{DEVICE}:{line_of(text, 'return {}')}: Wheel.increments raised KeyError: 0"


def test_derivatives_for_calibration_and_atlas_raise_the_same(make_set: MakeSet) -> None:
    folder = make_set(THERMAL.replace(READS, "        return [], None\n"))
    sensor = sensor_of(load(folder).simulation.sensors[-1])
    assert isinstance(sensor, ObservingSensor)
    simulator = Simulator(load(folder).simulation, 7)
    with pytest.raises(DeviceError, match=r"must be a number, and .* not 'list'"):
        sensor.linearised(simulator.world, np.array([astuple(simulator.pose)]))


META = "class Odd(type(ObservingSensor)):\n    {}\n\n\nclass Thermal(ObservingSensor, metaclass=Odd):"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "class Thermal(ObservingSensor):",
            META.format("is_scan = property(lambda cls: 1 / 0)"),
            "a class of it raised ZeroDivisionError",
        ),
        (
            "class Thermal(ObservingSensor):",
            META.format("def __hash__(cls):\n        raise GeneratorExit"),
            "a class of it raised GeneratorExit",
        ),
        (
            "    ambient: float = 20.0",
            "    ambient: float = 20.0\n\n    def __post_init__(self):\n        1 / 0",
            "a class of it raised ZeroDivisionError",
        ),
        ('field="ambient"', 'field="kind"', "Thermal': the column 'Ambient (C)' of the kind temp fills what"),
        ('field="ambient"', "field=[]", "fills [], no field of its row"),
        ('name="Ambient (C)"', "name=3", "a column of Thermal needs a name of letters"),
        (
            'field="ambient"',
            'field="ambient", label="\\x1b[2J"',
            "a column of Thermal needs a name of letters",
        ),
        ('"temperature"', '"\\x1b[2J"', "Thermal needs meaning = a line of text"),
        ('    name = "temp"', '    name = "temp"\n    __qualname__ = "X"', ""),
    ],
)
def test_classes_that_run_code_when_they_are_judged_are_mistakes_too(
    make_set: MakeSet, old: str, new: str, said: str
) -> None:
    folder = make_set(THERMAL.replace(old, new))
    if not said:
        assert load(folder).devices
        return
    with pytest.raises(ConfigurationError) as raised:
        load(folder)
    (problem,) = raised.value.problems
    assert problem.where.startswith(DEVICE)
    assert said in problem.what


def test_a_class_beside_the_sensors_may_be_of_any_sort(make_set: MakeSet) -> None:
    text = f"{THERMAL}\n\nclass Same(type):\n    def __eq__(cls, other):\n        return False\n\n\n"
    assert load(make_set(f"{text}class Table(metaclass=Same):\n    pass\n")).devices


def test_a_class_of_another_name_than_its_own_is_a_mistake(make_set: MakeSet) -> None:
    text = THERMAL + "\n\nThermal.__name__ = 'cold \\x1b[2J'\n"
    with pytest.raises(ConfigurationError, match="must stand in the file under that name") as raised:
        load(make_set(text))
    assert str(raised.value).isprintable()


@pytest.mark.parametrize(
    "method",
    [
        "def __init__(self, spec):\n        pass",
        "def __new__(cls, spec):\n        return 3",
        "spec = property(lambda self: None, lambda self, row: None)",
    ],
)
def test_a_sensor_without_its_row_is_a_mistake(make_set: MakeSet, method: str) -> None:
    text = THERMAL.replace("    def observe", f"    {method}\n\n    def observe")
    with pytest.raises(ConfigurationError, match="Thermal has no row: its __init__ must call super"):
        load(make_set(text))


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("raise GeneratorExit", "Thermal.observe raised GeneratorExit"),
        ("raise type('Odd', (BaseException,), {})('x')", "Thermal.observe raised Odd: x"),
    ],
)
def test_no_exception_of_a_reading_ends_the_simulator(make_set: MakeSet, body: str, said: str) -> None:
    simulator = Simulator(load(make_set(THERMAL.replace(READS, f"        {body}\n"))).simulation, 7)
    for _ in range(2):
        assert said in simulator.execute("h1").reason
    assert math.isfinite(simulator.execute("u1").reply)


@pytest.mark.parametrize("raised", ["GeneratorExit", "type('Odd', (BaseException,), {})"])
def test_no_exception_of_a_file_ends_the_program(make_set: MakeSet, raised: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^{DEVICE}:1: the file raised"):
        load(make_set(f"raise {raised}\n"))


ALARM = """from simmer_tui.sim import ObservingSensor


class Alarm(ObservingSensor):
    name = "alarm"
    meaning = "1 in the right half"
    is_yes_or_no = True
    columns = ()

    def observe(self, world, pose):
        return {}, None
"""
"""The text of a device that answers yes or no."""


@pytest.mark.parametrize(
    ("value", "reply", "item"),
    [
        ("float(pose.x > 0)", 1.0, b"[a9:True]"),
        ("float(pose.x < 0)", 0.0, b"[a9:False]"),
        ("pose.x > 0", 1.0, b"[a9:True]"),
    ],
)
def test_a_device_may_answer_yes_or_no(make_set: MakeSet, value: str, reply: float, item: bytes) -> None:
    folder = make_set(ALARM.replace("{}", value), row="alarm1,a9,1,,,,,0,,")
    configuration = load(folder)
    assert configuration.simulation.sensors[-1].is_yes_or_no
    result = read(folder, "a9")
    assert (result.status, result.reply) == (Status.READING, reply)
    assert encode(RequestStyle.FRAMED, "text", [(parse_command("a9"), result)]).message() == item


@pytest.mark.parametrize("value", ["None", "'yes'", "math.nan"])
def test_a_yes_or_no_that_is_neither_is_no_reading(make_set: MakeSet, value: str) -> None:
    folder = make_set("import math\n" + ALARM.replace("{}", value), row="alarm1,a9,1,,,,,0,,")
    result = read(folder, "a9")
    assert result.status is not Status.READING
    assert f"{DEVICE}:" in result.reason or "alarm1" in result.reason
