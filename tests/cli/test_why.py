"""`simmer-tui why`: one saved run again, with one change at a time; and the commands that it never runs."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.sets import bundled_sets, init_set
from simmer_tui.run.events import Event, ProgramEnded
from simmer_tui.runlog.header import TakenOver
from simmer_tui.runlog.run_command import RunCommand, run_command
from simmer_tui.runlog.saved_runs import saved_runs_folder
from simmer_tui.runlog.writer import ReplayedPrefix, RunLog
from simmer_tui.sim import Simulator, parse_command
from simmer_tui.trials.sweep import files_at
from tests.in_process import simmer

ROOT = Path(__file__).parents[2]
# From the start of the bundled set, the wall ahead of u1 is 35.5 in away.
BY_U1 = """
import os, sys
sys.path.insert(0, {root!r})
from simmer_tui.client import Robot
robot = Robot({port})
said = robot.read("u1")
robot.read("u2")
{more}
sys.exit(abs(said - 35.5) > 3)
"""
Make = Callable[..., Path]


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's data folder, for this process and others."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setattr("platformdirs.user_data_path", lambda *_, **__: tmp_path / "data/simmer-tui")
    return tmp_path / "data"


@pytest.fixture
def configuration() -> Configuration:
    return load(bundled_sets()["default"])


@pytest.fixture
def log(tmp_path: Path, configuration: Configuration) -> Make:
    """Makes a log of a run whose program ended with an exit code, 1 unless another is given."""

    def make(
        run: RunCommand | None = None,
        path: Path | None = None,
        *,
        code: int = 1,
        source: str = "",
        events: tuple[Event, ...] | None = None,
        prefix: ReplayedPrefix | None = None,
        changed: Configuration = configuration,
    ) -> Path:
        path = path or tmp_path / "run.jsonl"
        path.parent.mkdir(parents=True, exist_ok=True)
        simulator = Simulator(changed.simulation, 1)
        with RunLog(path, changed, simulator, run=run, prefix=prefix) as file:
            if source:
                file(simulator.begin(parse_command("u1", source)))
            for event in (ProgramEnded(0.0, code),) if events is None else events:
                file(event)
        return path

    return make


# -- commands of others ----------------------------------------------------------------------------


@pytest.fixture
def hostile(tmp_path: Path) -> RunCommand:
    """The command of a log from somebody else: a program that leaves a mark."""
    (tmp_path / "mark.py").write_text("open('ran', 'w').close()")
    return RunCommand(str(tmp_path), shlex.join([sys.executable, "mark.py"]), "0" * 64)


@pytest.mark.parametrize("options", [(), ("--yes",), ("--yes", "--json")])
@pytest.mark.parametrize("place", ["elsewhere", "saved runs", "link"])
def test_a_command_from_somebody_else_never_runs_without_a_question(
    log: Make, hostile: RunCommand, tmp_path: Path, place: str, options: tuple[str, ...]
) -> None:
    path = log(hostile, None if place != "saved runs" else saved_runs_folder() / "run.jsonl")
    if place == "link":
        saved_runs_folder().mkdir(parents=True)
        path = saved_runs_folder() / "run.jsonl"
        path.symlink_to(tmp_path / "run.jsonl")
    done = simmer("why", path, *options)
    assert done.returncode == 2
    told = ["The program of this run:", f"  {hostile.line}", f"  in {hostile.folder}"]
    assert done.stderr.splitlines()[:3] == told
    assert "runs only after a yes on a terminal" in done.stderr
    assert "--run" in done.stderr
    assert not (tmp_path / "ran").exists()


def test_an_own_command_from_elsewhere_does_not_run_either(log: Make, tmp_path: Path) -> None:
    """The folder of saved runs and the seal count together: anybody may send back a log of one's own."""
    (tmp_path / "mark.py").write_text("open('ran', 'w').close()")
    line = shlex.join([sys.executable, str(tmp_path / "mark.py")])
    done = simmer("why", log(run_command(line)), "--yes")
    assert done.returncode == 2
    assert not (tmp_path / "ran").exists()


class Asked:
    """`simmer-tui why` on a terminal, which shows what it asks."""

    def __init__(self, *words: object, cwd: Path) -> None:
        self._master, slave = os.openpty()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "simmer_tui", "why", *map(str, words)],
            stdin=slave,
            stdout=subprocess.PIPE,
            stderr=slave,
            cwd=cwd,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            start_new_session=True,
        )
        os.close(slave)
        self.shown = ""

    def until(self, text: str) -> None:
        while text not in self.shown:
            part = os.read(self._master, 10_000)
            assert part, self.shown
            self.shown += part.decode("utf-8", "replace")

    def answer(self, text: str) -> None:
        os.write(self._master, text.encode())

    def rest(self) -> str:
        """Standard output, and all that was shown."""
        out = []
        try:
            while part := os.read(self._master, 10_000):
                self.shown += part.decode("utf-8", "replace")
        except OSError:  # the last process with the terminal has ended
            pass
        out.append(self.process.communicate()[0])
        os.close(self._master)
        return out[0]


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("typed", ["\n", "no\n", "\x04", "yesterday\n"])
def test_the_question_shows_the_command_and_only_a_yes_runs_it(
    log: Make, hostile: RunCommand, tmp_path: Path, typed: str
) -> None:
    hidden = replace(hostile, line=f"{hostile.line} \x1b[2K'\u202e'")
    asked = Asked(log(hidden), "--yes", cwd=tmp_path)
    asked.until("[y/N]")
    assert "mark.py" in asked.shown
    assert r"\x1b[2K" in asked.shown
    assert "\u202e" not in asked.shown
    assert "may be from somebody else" in asked.shown
    asked.answer(typed)
    asked.rest()
    assert asked.process.returncode == 1
    assert "nothing was run" in asked.shown
    assert not (tmp_path / "ran").exists()


@pytest.mark.slow
def test_a_yes_runs_it(log: Make, hostile: RunCommand, tmp_path: Path) -> None:
    asked = Asked(log(hostile), cwd=ROOT)
    asked.until("[y/N]")
    asked.answer("y\n")
    asked.rest()
    assert (tmp_path / "ran").exists(), "it ran in its folder"


# -- runs that cannot be done again ----------------------------------------------------------------


def refused(path: Path, *options: str) -> str:
    done = simmer("why", path, *options)
    assert done.returncode == 2
    assert done.stderr.count("\n") <= 4
    return done.stderr


def test_a_run_without_a_command_says_what_to_add(log: Make, tmp_path: Path) -> None:
    assert "started without --run" in (told := refused(log()))
    assert '--run "python my_robot.py"' in told
    secret = log(RunCommand(str(tmp_path)), tmp_path / "secret.jsonl")
    assert "password or token" in refused(secret)
    by_hand = log(path=tmp_path / "hand.jsonl", source="keys")
    assert "driven by hand" in refused(by_hand)
    by_client = log(path=tmp_path / "client.jsonl", source="")
    assert "driven by hand" not in refused(by_client)
    (tmp_path / "out/runs").mkdir(parents=True)
    (tmp_path / "out/trials.json").touch()
    of_trials = log(path=tmp_path / "out/runs/0001.jsonl")
    assert f"simmer-tui trials --resume --out {tmp_path / 'out'} --why" in refused(of_trials)


def test_a_run_that_cannot_begin_again_says_why(
    log: Make, tmp_path: Path, configuration: Configuration
) -> None:
    command = run_command("python robot.py")
    real = log(command, tmp_path / "real.jsonl", changed=configuration.with_settings({"sim": False}))
    assert "a real robot made this run" in refused(real, "--run", "true")
    prefix = ReplayedPrefix(TakenOver("other.jsonl", 3, 1.5), begun=1e9)
    prefix.end()
    other = log(command, tmp_path / "over.jsonl", prefix=prefix)
    assert "simmer-tui why other.jsonl" in refused(other, "--run", "true")
    going = log(command, tmp_path / "going.jsonl", source="client", events=())
    assert "has not ended" in refused(going, "--run", "true")


def test_a_program_that_is_gone_is_named(log: Make, tmp_path: Path) -> None:
    gone = RunCommand(str(tmp_path), "python no_robot.py")
    told = refused(log(gone))
    assert "there is no file no_robot.py" in told
    assert '--run "CMD"' in told
    folder = tmp_path / "no\x00folder"
    told = refused(log(RunCommand(str(folder), "python robot.py"), tmp_path / "folder.jsonl"))
    assert "folder" in told
    assert "\x00" not in told
    told = refused(tmp_path / "folder.jsonl", "--run", "python no_robot.py")
    assert "there is no file no_robot.py" in told


def test_a_run_that_did_not_fail_is_not_tried(log: Make) -> None:
    done = simmer("why", log(run_command("python robot.py"), code=0, source="client"), "--json")
    assert done.returncode == 0
    assert json.loads(done.stdout)["text"]["answer"].startswith(
        "This run did not fail, so no change is tried."
    )


def test_a_report_ends_with_the_line_to_type(log: Make, tmp_path: Path) -> None:
    longer_than_a_line = tmp_path / ("a" * 90)
    longer_than_a_line.mkdir()
    path = log(run_command("python robot.py"), longer_than_a_line / "my run.jsonl", source="client")
    last = simmer("report", path).stdout.rstrip().splitlines()[-1]
    assert shlex.split(last)[-3:] == ["simmer-tui", "why", str(path)], "one line, as it is copied"
    page = tmp_path / "page.html"
    assert simmer("report", path, "--html", page).returncode == 0
    assert "simmer-tui why" in page.read_text()
    without = log(path=tmp_path / "other.jsonl", source="client")
    assert "simmer-tui why" not in simmer("report", without).stdout


# -- the runs --------------------------------------------------------------------------------------


@pytest.fixture
def failed(tmp_path: Path) -> Callable[..., Path]:
    """Makes the log of a run whose program decides by u1, which reads 1.3 times the distance."""
    folder = tmp_path / "wrong"
    init_set(folder, bundled_sets()["default"])
    for name, value in {"u1.gain": "1.3", "u1.percent_error": "0.01"}.items():
        for file, text in files_at({name: value}, folder).items():
            (folder / file).write_text(text)

    def make(path: Path, more: str = "", port: str = "") -> Path:
        program = tmp_path / "robot.py"
        program.write_text(BY_U1.format(root=str(ROOT), more=more, port=port))
        words = ("--no-ui", "--quiet", "--config", "wrong", "--seed", "1", "--port", "0", "--reply-port", "0")
        command = shlex.join([sys.executable, "robot.py"])
        path.parent.mkdir(parents=True, exist_ok=True)
        simmer(*words, "--run", command, "--log", path, cwd=tmp_path)
        return path

    return make


def answer_of(done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


@pytest.mark.slow
def test_the_change_that_saves_a_run_is_named_with_its_counts(
    failed: Callable[..., Path], tmp_path: Path
) -> None:
    failed(saved_runs_folder() / "run.jsonl")
    # From another folder, without a terminal: an own saved run.
    done = simmer("why", "--jobs", "1", "--json", cwd=ROOT)
    answer = answer_of(done)
    assert answer["text"]["headline"] == "With true readings of u1 it succeeds: 9 of 9; unchanged 0 of 9."
    assert "The likely cause is the sensor." in answer["text"]["answer"]
    tried = {each["change"]: each["result"] for each in answer["tried"]}
    assert list(tried)[:3] == ["nothing changed", "true readings of u1", "true readings of u2"]
    assert tried["nothing changed"] == tried["no noise and bias of u1"] == "fails"
    assert "1 of at most 1 runs: nothing changed: fails" in done.stderr


@pytest.mark.slow
def test_changes_that_save_nothing_leave_the_program(failed: Callable[..., Path], tmp_path: Path) -> None:
    path = failed(tmp_path / "run.jsonl", more="sys.exit(3)")
    command = shlex.join([sys.executable, "robot.py"])
    done = simmer("why", path, "--run", command, cwd=tmp_path)
    assert done.returncode == 0
    assert "The likely cause is the program itself." in " ".join(done.stdout.split())


@pytest.mark.slow
def test_a_port_that_is_built_in_is_noticed(failed: Callable[..., Path], tmp_path: Path) -> None:
    path = failed(tmp_path / "run.jsonl")
    (tmp_path / "robot.py").write_text("raise SystemExit('no simulator')")
    done = simmer("why", path, "--run", shlex.join([sys.executable, "robot.py"]), cwd=tmp_path)
    assert done.returncode == 2
    assert "the program sent 2 commands in the log, and none now" in done.stderr
    assert "--fixed-ports" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_ends_all_programs(
    failed: Callable[..., Path], tmp_path: Path, number: signal.Signals
) -> None:
    path = failed(tmp_path / "run.jsonl")
    waits = "open(f'pid{os.getpid()}', 'w').close(); import threading; threading.Event().wait()"
    (tmp_path / "robot.py").write_text(BY_U1.format(root=str(ROOT), more=waits, port=""))
    command = shlex.join([sys.executable, "robot.py"])
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    why = subprocess.Popen(
        [sys.executable, "-m", "simmer_tui", "why", str(path), "--run", command],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(temporary)},
        stderr=subprocess.PIPE,
        text=True,
    )
    while not (found := list(tmp_path.glob("pid*"))):
        assert why.poll() is None
    why.send_signal(number)
    told = why.communicate()[1]
    assert why.returncode == 130
    assert "interrupted after 0 runs: nothing is decided" in told
    for each in found:
        with pytest.raises(ProcessLookupError):
            os.kill(int(each.name.removeprefix("pid")), 0)
    assert not list(temporary.glob("simmer-tui-why-*"))
