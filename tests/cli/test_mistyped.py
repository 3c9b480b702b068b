"""Lines that people type on the first day, and the words of the answers, with a line that works."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from simmer_tui import platform_has
from simmer_tui.cli import run_life
from simmer_tui.cli.command_line import ExitCode
from simmer_tui.cli.main import main
from simmer_tui.config.loader import find_set, load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.errors import ConsoleCommandError, printable
from simmer_tui.live.operating.line_advice import line_advice
from simmer_tui.live.operating.orders import Local, read_console_command
from simmer_tui.run.events import Action
from simmer_tui.sim.command import Command, parse_command, utf8_text
from simmer_tui.sim.records import Status
from simmer_tui.sim.simulator import Simulator
from simmer_tui.sim.specs import SimulationSpec

posix = pytest.mark.skipif(sys.platform == "win32", reason="the line to type is quoted as for a Unix shell")
_FILES = {
    "wander.py": "print('hi')\n",
    "my robot/go.py": "",
    "robot.cpp": "int main() {}\n",
    "Main.ino": "",
    "rover/rover.ino": "",
    "wired/sensors.csv": "",
    "wired/wiring.toml": "",
    "lab.ipynb": "{}",
    "data.csv": "a,b\n1,2\n",
    "run.jsonl": "{}\n",
}
_SETTINGS = {
    "path": 'server.host = "C:\\Users\\me"\n',
    "curly": "server.host = “localhost”\n",
    "bare": "server.host = localhost\n",
    "python": "motion.block_solid = True\n",
    "comma": "motion.time_scale = 3,5\n",
    "colon": "seed: 3\n",
}
_SENSORS = {"workbook": "sensors.xlsx", "ending": "sensors.csv.txt", "copy": "sensors - Copy.csv"}


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a student: programs, sets with mistakes, a log, a table."""
    folder = tmp_path_factory.mktemp("desk")
    for name, text in _FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    for name in ("good", *_SETTINGS, *_SENSORS):
        (folder / name).mkdir()
        for file in bundled_folder().glob("*.*"):
            shutil.copy(file, folder / name)
    for name, text in _SETTINGS.items():
        (folder / name / "settings.toml").write_text(text, encoding="utf-8")
    for name, instead in _SENSORS.items():
        (folder / name / "sensors.csv").rename(folder / name / instead)
    return folder


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        # Commands of the robot, typed into the shell.
        ("u1", ['"u1" is a command for the robot: type simmer-tui, and u1 in its last line']),
        ("d1-3", ["command for the robot", "d1-3"]),
        ("d1 3", ["command for the robot", "d1-3"]),
        ("d1=3,5", ["command for the robot", "d1-3.5"]),
        ("d1–3", ["command for the robot", "d1-3"]),
        # Programs in place of commands.
        ("wander.py", ['"wander.py" is a program: type simmer-tui --run "python wander.py"']),
        ("./wander.py", ['--run "python wander.py"']),
        ("run wander.py", ['--run "python wander.py"']),
        ("python wander.py 20", ['--run "python wander.py 20"']),
        ("--no-ui start wander.py", ['type simmer-tui --no-ui --run "python wander.py"']),
        pytest.param("my robot/go.py", ["""--run "python 'my robot/go.py'\""""], marks=posix),
        pytest.param(
            "go.py", ["there is no file go.py in", """--run "python 'my robot/go.py'\""""], marks=posix
        ),
        ("other.py", ["there is no file other.py in", "cd", '--run "python other.py"']),
        ("robot.cpp", ["must be compiled", "g++ -o robot", "--run ./robot"]),
        ("Main.ino", ["Main.ino makes a robot of it", "simmer-tui --serial PORT"]),
        ("rover", ['"rover" is a sketch for a board', "init my-robot --sketch rover"]),
        ("--no-ui --sketch rover", ["has a sketch and no set", "init my-robot --sketch rover"]),
        ("wired", ["type simmer-tui --sketch wired"]),
        ("compile Main.ino", ["type simmer-tui check DIR"]),
        ("upload Main.ino", ["type simmer-tui --sketch DIR"]),
        ("help d1", ["type :help d1 in simmer-tui"]),
        ("log", ["type simmer-tui report"]),
        ("my~rover.ino", ["init my-robot --sketch 'my rover.ino'"]),
        ("lab.ipynb", ["notebook", "Start simmer-tui"]),
        ("--run python wander.py", ['needs quotes: --run "python wander.py"']),
        ("--run “python wander.py”", ["quotes of documents", 'type --run "python wander.py"']),
        ("--config “good”", ["quotes of documents", 'type --config "good"']),
        ("trials wander.py", ['type simmer-tui trials --run "python wander.py"']),
        ("trials --run nosuch.py", ["there is no file nosuch.py in"]),
        ("trials --run nosuch", ["there is no program nosuch"]),
        ("trials --run=pyhton~wander.py", ['there is no program pyhton; did you mean "python"?']),
        ("trials --run=python~nosuch.py", ["there is no file nosuch.py in"]),
        # Words and options of other programs.
        ("start", ["simmer-tui starts the screen", "--run"]),
        ("gui", ["type simmer-tui"]),
        ("simmer-tui --mission", ["type it once, simmer-tui --mission"]),
        ("exit", ["nothing runs here", ":quit"]),
        ("version", ["type simmer-tui --version"]),
        ("-v", ["type simmer-tui --version"]),
        ("?", ["type simmer-tui help"]),
        ("/?", ["type simmer-tui help"]),
        ("-help", ['did you mean "--help"?']),
        ("-mission", ['did you mean "--mission"?']),
        ("--no_ui", ['did you mean "--no-ui"?']),
        ("—no-ui", ['unknown option "—no-ui"; did you mean "--no-ui"?']),
        ("--headless --mission", ["type simmer-tui --no-ui --mission"]),
        ("--mission=yes", ["--mission takes no value: type --mission alone"]),
        ("--log", ["--log needs a value: --log FILE"]),
        ("/no-ui", ['unknown option "/no-ui"; did you mean "--no-ui"?']),
        ("init", ["DIR is missing: simmer-tui init DIR"]),
        ("import wander.py", ["DIR is missing: simmer-tui import FILE DIR"]),
        # Sets and their files.
        ("good", ['"good" is a configuration set: type simmer-tui --config good']),
        ("good/sensors.csv", ["type simmer-tui --config good"]),
        ("mission", ["type simmer-tui --config mission"]),
        ("check good/sensors.csv", ["is not a folder", "the set of this file is good"]),
        ("check wander.py", ["is not a folder", "simmer-tui init DIR"]),
        ("check goood", ["no such folder", 'did you mean "good"?']),
        (
            "check workbook",
            ["sensors.csv: is missing from workbook", "sensors.xlsx", "save it as", "CSV UTF-8"],
        ),
        pytest.param(
            "check ending", ["is missing", "ending/sensors.csv.txt ending/sensors.csv"], marks=posix
        ),
        ("check copy", ["is missing", "sensors - Copy.csv"]),
        ("check path", ["settings.toml:1", "backslash", "write 'C:\\Users\\me'"]),
        ("check curly", ["settings.toml:1", "curly quotes", 'write server.host = "localhost"']),
        ("check bare", ["settings.toml:1", 'write server.host = "localhost"']),
        ("check python", ["settings.toml:1", "write motion.block_solid = true"]),
        ("check comma", ["settings.toml:1", "write motion.time_scale = 3.5"]),
        ("check colon", ["settings.toml:1", "write seed = 3"]),
        # Values and files of another kind.
        ("--no-ui --seed abc", ["--seed: must be a whole number", '"abc"']),
        ("--no-ui --port COM3", ["a serial port is --serial COM3"]),
        ("--no-ui --port localhost:9000", ["did you mean --host localhost --port 9000?"]),
        ("--no-ui --port 0 --log .", ["it is a folder", "--log run.jsonl"]),
        ("run.jsonl", ["type simmer-tui replay run.jsonl"]),
        ("report data.csv", ["data.csv is not a run log", "--log FILE"]),
        ("report .", ["it is a folder", "the newest log there is run.jsonl"]),
        ("report nosuch.jsonl", ["there is no such file", "run.jsonl"]),
        ("grade wander.py", ["wander.py: is no TOML file of a course", "simmer-tui trials --run"]),
        ("init good", ["good: has", "nothing is overwritten", "name another folder"]),
    ],
)
def test_a_mistyped_line_is_answered_with_one_that_works(
    desk: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: str,
    answer: list[str],
) -> None:
    monkeypatch.chdir(desk)
    try:
        code = main([word.replace("~", " ") for word in words.split()])
    except SystemExit as ended:
        code = int(ended.code or 0)
    shown = capsys.readouterr()
    assert code == ExitCode.PROBLEM
    assert not shown.out
    assert len(shown.err.splitlines()) <= 2
    missing = [part for part in answer if part not in shown.err]
    assert not missing, shown.err
    assert not list(desk.glob("trials_*"))


@pytest.fixture(scope="module")
def default_spec() -> SimulationSpec:
    return load(find_set("default")).simulation


def answer_of(line: str, spec: SimulationSpec) -> str:
    """The console's answer to a line: an error, the robot's refusal, or `does` and what is done."""
    try:
        order = read_console_command(line, spec)
    except ConsoleCommandError as error:
        return str(error)
    if isinstance(order, Local | Action):
        return f"does {order.name}"
    result = Simulator(spec).begin(order)
    refusal = getattr(result, "reason", "")
    if getattr(result, "status", None) is Status.UNKNOWN or order.problem:
        return line_advice(order.text, spec) or refusal
    return refusal or f"does {order.text}"


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("q", "does quit"),
        (":q", "does quit"),
        ("?", "does help"),
        (":wq", "type :quit"),
        ("exit()", "type :quit"),
        (":quit()", 'did you mean "quit"?'),
        ("u 1", "did you mean u1?"),
        ("U1", "did you mean u1?"),
        ("u1;", "did you mean u1?"),
        ("u1()", "did you mean u1?"),
        ('"u1"', "did you mean u1?"),
        ("“u1”", "did you mean u1?"),
        ("[u1]", "did you mean u1?"),
        ("D1-3", "did you mean d1-3?"),
        ("d1 - 3", "did you mean d1-3?"),
        ("d1-3;", "did you mean d1-3?"),
        ("d1(3)", "did you mean d1-3?"),
        ("d1-3in", "did you mean d1-3?"),
        ("d1-3,5", "'3,5' is not a finite decimal number; did you mean d1-3.5?"),
        ("d1-1,000", "such as 3, -2.5 or 1e-3"),
        ("d1-3cm", "such as 3, -2.5 or 1e-3"),
        ("r1-90°", "'90°' is not a finite decimal number; did you mean r1-90?"),
        ("r1−90", "does r1-90"),
        ("d1–3", "does d1-3"),
        ("d1-−3", "does d1--3"),
        ("ｄ１－３", "does d1-3"),
        ("u1 u2", "one command a line"),
        ("forward 3", "did you mean d1-3?"),
        ("right", "did you mean r1--90?"),
        ("reset", "type :reset"),
        ("teleport 5 6 90", "type :teleport 5 6 90"),
        ("python wander.py", 'for a second terminal, or: simmer-tui --run "python wander.py"'),
        ("wander.py", 'for a second terminal, or: simmer-tui --run "python wander.py"'),
        (":run wander.py", "--run"),
        ("simmer-tui --mission", "type :quit, and then simmer-tui --mission"),
        ("cd ..", "for a terminal: open a second one"),
        ("robot = tcpip('localhost', 9000)", "a line of a program"),
        ("fwrite(s, 'u1')", "a line of a program"),
        ("zz", "no sensor or drive has the code zz"),
    ],
)
def test_a_mistyped_line_of_the_console_is_answered_too(
    default_spec: SimulationSpec, line: str, answer: str
) -> None:
    assert answer in answer_of(line, default_spec)


@pytest.mark.parametrize(
    ("sent", "shown", "reason"),
    [
        (
            "d1–3",
            "d1–3",
            "the sign after d1 is a dash or letter of several bytes, not a hyphen; did you mean d1-3?",
        ),
        ("d1-３", "d1-３", "'３' is not a finite decimal number; did you mean d1-3?"),
        ("ｄ１－３", "ｄ１－３", "no sensor or drive has the code ｄ１; did you mean d1-3?"),
        ("d1-3\u202e", "d1-3\\u202e", "'3\\u202e' is not a finite decimal number, such as 3, -2.5 or 1e-3"),
        ("d1-\x1b[2J", "d1-\\x1b[2J", "'\\x1b[2J' is not a finite decimal number, such as 3, -2.5 or 1e-3"),
    ],
)
def test_a_programs_command_is_shown_in_its_own_letters(
    default_spec: SimulationSpec, sent: str, shown: str, reason: str
) -> None:
    """Links decode one character a byte; what was sent is UTF-8."""
    command = parse_command(sent.encode().decode("latin-1"))
    assert printable(command.shown) == shown
    assert printable(getattr(Simulator(default_spec).begin(command), "reason", "")) == reason


def test_bytes_that_are_no_text_are_shown_as_bytes() -> None:
    assert printable(utf8_text("r1-90\xb0")) == "r1-90°"  # Latin-1, as MATLAB sends it
    assert printable(utf8_text("\xff\x00\x80")) == "\\xff\\x00\\x80"
    assert printable(Command("u1\x1b").shown) == "u1\\x1b"


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("folder", ["", "./"])
def test_a_python_file_that_cannot_start_by_itself_is_run_by_python(
    desk: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], folder: str
) -> None:
    monkeypatch.chdir(desk)
    # The program ends without a command, which is exit code 1.
    assert main(["--no-ui", "--quiet", "--port", "0", "--run", f"{folder}wander.py"]) == ExitCode.NO
    assert capfd.readouterr().out.splitlines()[-1:] == ["hi"] or not platform_has.POSIX


@pytest.mark.slow
def test_a_program_without_a_connection_is_told_the_address(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    told = tmp_path / "told"
    program = tmp_path / "quiet.py"
    program.write_text(
        f"import pathlib, time\nwhile not pathlib.Path({str(told)!r}).exists(): time.sleep(0.01)\n"
    )
    lines: list[str] = []

    def say(line: str, stream: object = None) -> None:
        lines.append(line)
        if "no connection from the program" in line:
            told.touch()

    monkeypatch.setattr(run_life, "CONNECT_WITHIN", 0.1)
    monkeypatch.setattr("simmer_tui.cli.headless.say", say)
    main(["--no-ui", "--port", "0", "--run", f"{sys.executable} {program}"])
    hint = next(line for line in lines if "no connection from the program" in line)
    port = (
        next(line for line in lines if line.startswith("seed ")).split("commands on port ")[1].split(",")[0]
    )
    assert f"use 127.0.0.1, port {port} (SIMMER_PORT)" in hint
