"""`simmer-tui trials`: parallel runs; as a process, Ctrl-C, kill -9 and going on."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from simmer_tui.cli.trials_command import run_trials
from simmer_tui.trials.folder import TrialFolder

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 300.0
HELD_RUN = 3
LINES = f"""
with open(os.environ["STARTED"], "a") as file:
    file.write(f"{{number}} ")
if number == {HELD_RUN} and "HOLD" in os.environ:
    hold = socket.create_connection(("127.0.0.1", int(os.environ["HOLD"])))
    hold.recv(1)
robot.drive("r1", 90)
sys.exit(number == 2)
"""
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals are those of POSIX")


class Trials:
    """`simmer-tui trials` in an empty folder of its own, of a program whose second run fails."""

    def __init__(self, folder: Path, command: str, printed: pytest.CaptureFixture[str]) -> None:
        self.folder = folder
        self.started = folder / "started.txt"
        self._command = command
        self._printed = printed

    def arguments(self, *options: str) -> list[str]:
        return ["trials", "--run", self._command, "--config", "default", "--seed", "1", *options]

    def open(self, *options: str, **environment: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "simmer_tui", *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            text=True,
            cwd=self.folder,
            env=os.environ | environment | {"STARTED": str(self.started), "PYTHONPATH": str(ROOT)},
            start_new_session=True,
        )

    def run(self, *options: str) -> tuple[int, str, str]:
        """Runs in this process, which has imported what they need: exit code and what was printed."""
        self._printed.readouterr()
        code = run_trials(self.arguments(*options)[1:])
        return code, *self._printed.readouterr()

    def runs_started(self) -> list[int]:
        return sorted(map(int, self.started.read_text().split()))

    @contextlib.contextmanager
    def held(self, *options: str) -> Iterator[tuple[subprocess.Popen[str], socket.socket]]:
        """The process, and a connection that ends with the program of the run that is held."""
        with socket.create_server(("127.0.0.1", 0)) as server:
            server.settimeout(SECONDS)
            process = self.open(*self.arguments(*options), HOLD=str(server.getsockname()[1]))
            try:
                connection, _ = server.accept()
                with connection:
                    connection.settimeout(SECONDS)
                    yield process, connection
            finally:
                process.kill()
                process.communicate()


@pytest.fixture
def trials(
    tmp_path: Path,
    program: Callable[[str], str],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> Trials:
    folder = tmp_path / "here"
    folder.mkdir()
    made = Trials(folder, program(LINES), capfd)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("STARTED", str(made.started))
    return made


@pytest.mark.slow
def test_runs_in_parallel_give_one_table_whatever_their_number(trials: Trials) -> None:
    code, one, _ = trials.run("--runs", "5", "--out", "a", "--jobs", "1")
    assert code == 0
    [page] = (trials.folder / "a" / "runs").glob("*.html")
    assert f"href='runs/{page.name}'" in (trials.folder / "a" / "report.html").read_text("utf-8")
    assert "id='recording'" in page.read_text("utf-8"), "the failed run can be played"
    code, two, errors = trials.run("--runs", "5", "--out", "b", "--jobs", "3", "--require", "0.9")
    assert code == 1
    assert "the success rate is below the 0.9 required" in errors
    assert (trials.folder / "a/trials.csv").read_bytes() == (trials.folder / "b/trials.csv").read_bytes()
    assert one == two.replace("b/runs", "a/runs").replace("b/trials", "a/trials").replace(
        "b/report", "a/report"
    )
    assert "0.800 (0.376 to 0.964)" in one
    assert " simmer-tui replay a/runs/0002.jsonl " in one
    page = (trials.folder / "a/report.html").read_text()
    assert "4 of 5 runs succeeded" in page
    assert "http:" not in page.replace("http://www.w3.org/2000/svg", "")


def test_the_answer_as_json_is_all_that_is_printed(trials: Trials) -> None:
    code, out, _ = trials.run("--runs", "3", "--require", "0.9", "--json")
    answer = json.loads(out)
    assert code == 1
    record = answer["trials"]
    assert (record["runs"], record["runs_planned"], record["successes"], record["seed"]) == (3, 3, 2, 1)
    assert [each["success"] for each in answer["runs"]] == [True, False, True]
    assert record["success_rate_low"] < record["success_rate"] == pytest.approx(2 / 3)
    assert (trials.folder / record["folder"] / "report.html").exists()
    assert answer["text"]["answer"].startswith("2 of 3 runs succeeded")


@posix
@pytest.mark.slow
def test_kill_9_loses_nothing_and_nothing_is_done_twice(trials: Trials) -> None:
    with trials.held("--runs", "5", "--out", "killed", "--jobs", "1") as (process, connection):
        process.send_signal(signal.SIGKILL)
        assert connection.recv(1) == b""  # the program of the run under way is ended as well
    results = trials.folder / "killed/results.jsonl"
    assert results.read_text().count("\n") == 2
    with results.open("a") as file:
        file.write('{"number":3,"se')  # as a disk that was full leaves it
    code, _, _ = trials.run("--resume", "--out", "killed", "--jobs", "1")
    assert code == 0
    assert trials.runs_started() == [1, 2, 3, 3, 4, 5]
    trials.run("--runs", "5", "--out", "whole", "--jobs", "2")
    killed, whole = (trials.folder / name / "trials.csv" for name in ("killed", "whole"))
    assert killed.read_bytes() == whole.read_bytes()


@pytest.mark.slow
@posix
def test_ctrl_c_keeps_what_is_done_prints_the_table_and_says_how_to_go_on(trials: Trials) -> None:
    with trials.held("--runs", "4", "--out", "half", "--jobs", "1") as (process, connection):
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does it
        assert connection.recv(1) == b""
        out, err = process.communicate(timeout=SECONDS)
    assert process.returncode == 130
    assert "2 of 4" in out
    assert err.endswith("interrupted; to resume: simmer-tui trials --resume --out half\n")
    assert (trials.folder / "half/trials.csv").read_text().count("\n") == 3
    assert (trials.folder / "half/report.html").exists()
    process = trials.open("trials", "--resume", "--out", "half", "--jobs", "1", "--runs", "5")
    out, _ = process.communicate(timeout=SECONDS)
    assert process.returncode == 0
    assert " runs           5 " in out
    assert trials.runs_started() == [1, 2, 3, 3, 4, 5]


@pytest.mark.slow
@posix
def test_newest_trials_of_the_folder_are_gone_on_with_when_none_are_named(trials: Trials) -> None:
    assert trials.run("--runs", "1")[0] == 0
    (folder,) = trials.folder.glob("trials_*")
    assert run_trials(["--resume", "--runs", "2", "--jobs", "1"]) == 0
    assert sorted(TrialFolder.read(folder).results) == [1, 2]


@pytest.mark.slow
def test_fixed_ports_are_those_of_the_settings_one_run_at_a_time(
    tmp_path: Path, program: Callable[[str], str], capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    command = program(f'robot.read("u1")\nsys.exit(os.environ["SIMMER_PORT"] != "{port}")')
    out = str(tmp_path / "out")
    options = ["--run", command, "--runs", "3", "--config", "default", "--out", out, "--fixed-ports"]
    options += ["--port", str(port), "--reply-port", "0", "--belief-port", "0"]
    assert run_trials([*options, "--jobs", "2"]) == 2
    assert "--fixed-ports is for one run at a time" in capfd.readouterr().err
    assert run_trials([*options, "--require", "1"]) == 0


@pytest.mark.parametrize("runs", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_each_run_has_a_maze_of_a_folder_in_turn(
    tmp_path: Path, program: Callable[[str], str], capfd: pytest.CaptureFixture[str], runs: int
) -> None:
    mazes = tmp_path / "mazes"
    mazes.mkdir()
    (mazes / "a.csv").write_text("2,1,3\n")
    (mazes / "b.csv").write_text("2,0,3\n1,1,1\n")
    lines = """
rows = open(os.environ["SIMMER_MAZE"]).read().split()
sys.exit(rows != (["2,1,3"] if number != 2 else ["2,0,3", "1,1,1"]))
"""
    command = program(lines)
    options = ["--run", command, "--runs", str(runs), "--mazes", str(mazes), "--seed", "1", "--jobs", "1"]
    out = tmp_path / "out"
    assert run_trials([*options, "--out", str(out)]) == 0
    assert [result.maze for result in TrialFolder.read(out).done] == ["a.csv", "b.csv", "a.csv"][:runs]
    assert [result.exit_code for result in TrialFolder.read(out).done] == [0] * runs
    assert "By maze" in capfd.readouterr().out
    assert "<h3>b.csv</h3>" in (out / "report.html").read_text()


def test_maze_that_the_mission_cannot_be_done_in_is_refused_by_name(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    mazes = tmp_path / "mazes"
    mazes.mkdir()
    (mazes / "a.csv").write_text("1,1,3\n")
    assert run_trials(["--run", "python", "--mazes", str(mazes), "--out", str(tmp_path / "out")]) == 2
    assert capfd.readouterr().err.startswith("a.csv: maze.csv has no cell of value 2 to start from\n")


@pytest.mark.slow
def test_random_mazes_are_drawn_on_the_page_where_runs_failed(
    tmp_path: Path, program: Callable[[str], str]
) -> None:
    command = program("sys.exit(1)")
    out = tmp_path / "out"
    options = ["--run", command, "--runs", "2", "--random-mazes", "--out", str(out), "--jobs", "1"]
    assert run_trials(options) == 0
    page = (out / "report.html").read_text()
    assert "<h3>run 1</h3>" in page
    assert "<h3>run 2</h3>" in page
    folder = TrialFolder.read(out)
    assert folder.maze(1) != folder.maze(2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "code", "error"),
    [
        (["--runs", "3"], 2, "--run is missing"),
        (["--run", "x", "--runs", "0"], 2, 'must be a whole number from 1 to 1000000, not "0"'),
        (["--run", "x", "--require", "1.5"], 2, 'must be a number above 0 and at most 1, not "1.5"'),
        (["--run", "x", "--bot-rot", "3"], 2, "--bot-rot: has no effect in a mission"),
        (["--run", "x", "--serial", "COM1"], 2, "trials: are for the simulated robot"),
        (["--run", "x", "--mazes", ""], 2, "argument --mazes: the name is blank"),
        (["--run", "x", "--mazes", "nowhere"], 2, "--mazes: nowhere is not a folder"),
        (["--run", "x", "--runns", "3"], 2, "did you mean"),
        (["--resume", "--out", "nowhere"], 2, "nowhere holds no trials"),
        (["--run", "no-such-program", "--jobs", "1"], 2, "--run 'no-such-program'"),
    ],
)
def test_what_cannot_be_done_is_said_at_once(
    options: list[str],
    code: int,
    error: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        found = run_trials(options)
    except SystemExit as exit_:
        found = int(str(exit_.code))
    assert found == code
    assert error in capfd.readouterr().err
