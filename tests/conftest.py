"""Fixtures shared by all tests."""

from __future__ import annotations

import ast
import gc
import json
import math
import os
import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

# Several workers share few cores, and linear algebra's own threads would wait for each other on them.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Without bytecode files every worker, and each of the hundreds of programs that tests start, compiles all
# modules again: 19 s of CPU in place of 6 to collect the tests, 0.6 s in place of 0.3 to import the server.
if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):
    sys.dont_write_bytecode = False

import hypothesis
import pytest

from simmer_tui import platform_has
from simmer_tui.config.sets import bundled_folder, bundled_sets, init_set
from simmer_tui.sim import (
    Axes,
    DriveKind,
    DriveSpec,
    MazeSpec,
    RobotSpec,
    SimulationSpec,
)
from simmer_tui.sim.sensors import (
    Compass,
    CompassSpec,
    Gyro,
    GyroSpec,
    LineSensor,
    LineSpec,
    Odometer,
    OdometerSpec,
    RangeSpec,
    TimeOfFlight,
    Ultrasonic,
    UltrasonicSpec,
)
from tests.stepped_clock import Clock
from tests.windows_stubs import imports_posix, posix_functions

# Deterministic, and no deadline: these machines are shared, and nothing here measures time.
hypothesis.settings.register_profile("suite", deadline=None, derandomize=True, max_examples=50)
hypothesis.settings.load_profile("suite")

GOLDEN = Path(__file__).parent / "golden"
BEGAN = pytest.StashKey[float]()


def cpu_seconds() -> float:
    """CPU time of this process and of its children that have ended, seconds."""
    return sum(os.times()[:4])


@pytest.hookimpl(tryfirst=True)  # before it is known how many workers there are
def pytest_cmdline_main(config: pytest.Config) -> None:
    """With KEEP=1, keep the answers of slow tests too, in one process: several would write the same file."""
    if os.environ.get("KEEP"):
        vars(config.option)["numprocesses"] = 0
        if config.option.markexpr == "not slow":
            config.option.markexpr = ""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--cpu", type=int, default=0, metavar="N", help="list the N tests that cost most CPU")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    item.stash[BEGAN] = cpu_seconds()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if call.when == "teardown":  # workers hand attributes of reports over to their controller
        vars(report)["cpu_seconds"] = cpu_seconds() - item.stash.get(BEGAN, math.inf)
    return report


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    most = terminalreporter.config.getoption("cpu")
    reports = [each for of_kind in terminalreporter.stats.values() for each in of_kind]
    cost = {each.nodeid: each.cpu_seconds for each in reports if hasattr(each, "cpu_seconds")}
    if most and cost:
        terminalreporter.section(
            f"{sum(cost.values()):.0f} s of CPU in {len(cost)} tests; the {most} longest"
        )
        for name, seconds in sorted(cost.items(), key=lambda each: -each[1])[:most]:
            terminalreporter.line(f"{seconds:6.2f} s  {name}")


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Leave out files that cannot even be imported where there is no POSIX."""
    if platform_has.POSIX or collection_path.suffix != ".py":
        return None
    return imports_posix(ast.parse(collection_path.read_text("utf-8"))) or None


@pytest.hookimpl(tryfirst=True)  # before others select by marks
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the later cases of tests with `quick_cases` as slow, and the tests that need POSIX, the only place
    that does: on Windows they are skipped. Elsewhere they are looked for if somebody selects by the mark."""
    quick: Counter[tuple[Path, str]] = Counter()
    for item in items:
        if (limit := item.get_closest_marker("quick_cases")) and not item.get_closest_marker("slow"):
            function = item.path, getattr(item, "originalname", item.name)
            quick[function] += 1
            if quick[function] > limit.args[0]:
                item.add_marker("slow")
    if platform_has.POSIX and "posix" not in config.option.markexpr:
        return
    needing = {path: posix_functions(path) for path in {item.path for item in items}}
    for item in items:
        function, holder = getattr(item, "originalname", item.name), getattr(item, "cls", None)
        if {function, getattr(holder, "__name__", "")} & needing[item.path]:
            item.add_marker("posix")
            if not platform_has.POSIX:
                item.add_marker(pytest.mark.skip(reason="it needs POSIX"))


def pytest_collection_finish() -> None:
    """Imported modules and collected tests stay: garbage collections that visit them take a sixth of all
    time."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def usual_signals() -> Iterator[dict[int, Any]]:
    """The signals that end programs do so here and in the processes that tests start: a shell that starts
    pytest in the background, or nohup, would have them ignored by all."""
    usual = {"SIGINT": signal.default_int_handler, "SIGTERM": signal.SIG_DFL, "SIGHUP": signal.SIG_DFL}
    numbers = {getattr(signal, name): handler for name, handler in usual.items() if hasattr(signal, name)}
    if threading.current_thread() is not threading.main_thread():
        numbers = {}  # only the main thread may change them
    ignored = [number for number in numbers if signal.getsignal(number) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, numbers[number])
    yield {number: signal.getsignal(number) for number in numbers}
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


@pytest.fixture(autouse=True)
def signals_stay(usual_signals: dict[int, Any]) -> Iterator[None]:
    """Signals do what they did at first, whatever a command that ran in this process has made of them: the
    interrupt of another test would end the whole worker."""

    def restore() -> None:
        for number, handler in usual_signals.items():
            if signal.getsignal(number) is not handler:
                signal.signal(number, handler)

    restore()  # a module's fixtures come before
    yield
    restore()


@pytest.fixture(scope="session")
def golden() -> Callable[[str], dict[str, Any]]:
    """Reads one of the files of numbers from the original simulator."""

    def read(name: str) -> dict[str, Any]:
        loaded: dict[str, Any] = json.loads((GOLDEN / f"{name}.json").read_text())
        return loaded

    return read


@pytest.fixture(scope="session")
def course_spec() -> SimulationSpec:
    """The course's maze, robot, sensors and drives, without any noise."""
    ultra = [
        ("u1", 3, 0, 6, 0),
        ("u2", 2.12, 2.12, 6, 45),
        ("u3", -3, 0, 6, 180),
        ("u4", 2.12, -2.12, 6, 315),
        ("u5", 3, 0, 2, 0),
    ]
    sensors = [
        UltrasonicSpec(
            kind=Ultrasonic, number=i + 1, code=code, x=x, y=y, z=z, rotation=rotation, field_of_view=5
        )
        for i, (code, x, y, z, rotation) in enumerate(ultra)
    ]
    sensors += [
        LineSpec(
            kind=LineSensor, number=i + 1, code=f"i{i + 1}", x=x, y=y, z=1, field_of_view=40, threshold=0.8
        )
        for i, (x, y) in enumerate(((2, 0), (0, 2), (-2, 0), (0, -2)))
    ]
    sensors += [
        OdometerSpec(kind=Odometer, number=i + 1, code=f"o{i + 1}", x=x, y=y, z=1, rotation=rotation)
        for i, (x, y, rotation) in enumerate(((3, 0, 90), (-3, 0, 90), (0, 3, 0), (0, -3, 0)))
    ]
    sensors += [
        CompassSpec(kind=Compass, number=1, code="c1", z=6),
        GyroSpec(kind=Gyro, number=1, code="g1", z=4),
        RangeSpec(kind=TimeOfFlight, number=1, code="t1", x=3, z=4, field_of_view=25, max_range=47),
    ]
    codes = {DriveKind.UP: "w1", DriveKind.DOWN: "s1", DriveKind.LEFT: "a1", DriveKind.RIGHT: "d1"}
    drives = [DriveSpec(kind=kind, code=code) for kind, code in codes.items()]
    drives.append(DriveSpec(kind=DriveKind.ROT, code="r1", speed=120))
    return SimulationSpec(
        maze=MazeSpec(
            (
                (3, 3, 1, 1, 0, 2, 0, 2),
                (3, 3, 0, 1, 1, 1, 1, 1),
                (1, 0, 2, 0, 0, 1, 0, 1),
                (1, 1, 1, 1, 1, 1, 0, 2),
            )
        ),
        robot=RobotSpec.circle(6),
        sensors=tuple(sensors),
        drives=tuple(drives),
        bot_center=(9.5, 42.0),
        randbias=False,
    )


@pytest.fixture(scope="session")
def noisy_spec(course_spec: SimulationSpec) -> SimulationSpec:
    """The same with the course's noise and random bias."""
    from msgspec.structs import replace

    errors = {"ultra": 0.02, "tof": 0.03, "ir": 0.05, "comp": 0.1, "odom": 0.02, "gyro": 0.01}
    drive = {
        DriveKind.UP: Axes(0.02, 0.05, 0.02),
        DriveKind.DOWN: Axes(0.02, 0.05, 0.02),
        DriveKind.LEFT: Axes(0.05, 0.02, 0.02),
        DriveKind.RIGHT: Axes(0.05, 0.02, 0.02),
        DriveKind.ROT: Axes(0.003, 0.003, 0.02),
    }
    return replace(
        course_spec,
        sensors=tuple(replace(s, error=errors[s.kind.name]) for s in course_spec.sensors),
        drives=tuple(replace(d, error=drive[d.kind]) for d in course_spec.drives),
        randbias=True,
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the default set."""
    made = tmp_path / "set"
    init_set(made, bundled_folder())
    return made


@pytest.fixture
def edit(folder: Path) -> Callable[[str, str, str], None]:
    """Replace a text, which must be there, in one of the set's files."""

    def replace(name: str, old: str, new: str) -> None:
        text = (folder / name).read_text(encoding="utf-8")
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1), encoding="utf-8", newline="")

    return replace


@pytest.fixture
def clock() -> Iterator[Clock]:
    """A clock that tests move on."""
    loop = Clock()
    yield loop
    loop.close()


@pytest.fixture
def exact_mission(tmp_path: Path) -> Path:
    """The bundled mission without errors: the robot faces the block, 10 in away, and stands in the
    drop zone."""
    folder = tmp_path / "set"
    init_set(folder, bundled_sets()["mission"])
    (folder / "mission.toml").write_text(
        "start = [30, 42]\nheading = 180\nblock = [20, 42]\ndrop_zone = [30, 42]\n"
        "time_limit = 60\ncontacts = 0\n"
    )
    rows = ["ID,Poll Character,Enabled,Y-Axis Error,X-Axis Error,Rotation Error,Y-Axis Bias,X-Axis Bias,"
            "Rotation Bias,Reach,Width"]  # fmt: skip
    codes = {"up": "w1", "down": "s1", "left": "a1", "right": "d1", "rot": "r1"}
    rows += [f"{name},{code},1,0,0,0,0,0,0,," for name, code in codes.items()]
    rows.append("grip,p1,1,,,,,,,3,4")
    (folder / "drive.csv").write_text("\n".join(rows) + "\n")
    settings = (folder / "settings.toml").read_text()
    (folder / "settings.toml").write_text(settings.replace("randbias = true", "randbias = false"))
    return folder
