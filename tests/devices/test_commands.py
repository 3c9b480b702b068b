"""Sets with devices of their own in every command: with trust, without, and from their logs."""

from __future__ import annotations

import asyncio
import io
import itertools
import json
import os
import pty
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from simmer_tui.cli.main import main
from simmer_tui.config.device_trust import trusted_hashes
from simmer_tui.runlog.index import RunLogIndex
from simmer_tui.runlog.reader import LogReader
from simmer_tui.tui.recorded import RecordedRun
from simmer_tui.tui.sensor_readouts import kind_name
from tests.devices.conftest import DEVICE, THERMAL, MakeSet, trust

PORTS = ("--port", "0", "--reply-port", "0", "--belief-port", "0")
PROGRAM = """
import math
from simmer_tui.client import Robot
with Robot() as robot:
    for _ in range(4):
        answer = robot.send("h1")
        assert math.isnan(answer) or 10 < answer < 30, answer
        robot.send("d1-1")
"""
UNTRUSTED = "is code of this set that you have not trusted yet"


@pytest.fixture
def program(tmp_path: Path) -> str:
    path = tmp_path / "program.py"
    path.write_text(PROGRAM)
    return f"{sys.executable} {path}"


def simmer(*arguments: object) -> subprocess.CompletedProcess[str]:
    """The program, with nothing on its standard input."""
    command = [sys.executable, "-m", "simmer_tui", *map(str, arguments)]
    return subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False, timeout=120
    )


def logged(folder: Path, program: str, log: Path) -> Path:
    """A log of a run of the set, in which its device is trusted for this once."""
    done = simmer(
        *("--config", folder, "--no-ui", *PORTS, "--seed", 5, "--run", program),
        *("--log", log, "--trust-devices"),
    )
    assert done.returncode == 0, done.stderr
    return log


@pytest.mark.slow
def test_without_a_terminal_only_the_option_runs_it(make_set: MakeSet, program: str, tmp_path: Path) -> None:
    folder = make_set(trusted=False)
    done = simmer("--config", folder, "--no-ui", *PORTS, "--run", program)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("settings.toml:")
    assert f"{DEVICE} (SHA-256 " in line
    assert "--trust-devices" in line
    logged(folder, program, tmp_path / "run.jsonl")
    assert not trusted_hashes(), "the option is for one command"


@pytest.mark.slow
def test_a_device_that_fails_leaves_the_run_going(make_set: MakeSet, program: str, tmp_path: Path) -> None:
    text = THERMAL.replace("return self", "return 1 / 0 if pose.x > 10.9 else self")
    folder = make_set(text, trusted=False)
    path = logged(folder, program, tmp_path / "run.jsonl")
    done = simmer("--config", folder, "--no-ui", *PORTS, "--seed", 5, "--run", program, "--trust-devices")
    assert f"no answer to 'h1': {DEVICE}:" in done.stderr
    assert "Thermal.observe raised ZeroDivisionError: division by zero" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.returncode == 0
    assert simmer("rerun", path, "--trust-devices").returncode == 0
    assert "ZeroDivisionError" in simmer("report", path).stdout.replace("\n", "")


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(("answer", "runs"), [("y", True), ("", False), ("no", False)])
def test_the_question_on_a_terminal(make_set: MakeSet, tmp_path: Path, answer: str, runs: bool) -> None:
    folder = make_set(f"# \x1b[2J not for terminals\n{THERMAL}", trusted=False)
    ours, theirs = pty.openpty()
    command = ["atlas", tmp_path / "a.npz", "--config", folder, "--step", "12", "--sensors", "h1"]
    with subprocess.Popen(
        [sys.executable, "-m", "simmer_tui", *map(str, command)],
        stdin=theirs,
        stdout=subprocess.PIPE,
        stderr=theirs,
    ) as process:
        os.close(theirs)
        said = b""
        while b"[y/N]" not in said:
            said += os.read(ours, 1000)
        os.write(ours, f"{answer}\n".encode())
        assert process.stdout is not None
        process.stdout.read()
        code = process.wait()
    os.close(ours)
    text = said.decode().replace("\r\n", "\n")
    assert str(folder / DEVICE) in text
    assert "SHA-256 " in text
    assert "  1 # \\x1b[2J not for terminals\n" in text
    assert "lines more: read them in an editor" in text
    assert (code == 0, bool(trusted_hashes()), (tmp_path / "a.npz").exists()) == (runs, runs, runs)


def test_check_parses_what_is_not_trusted_and_says_so(
    make_set: MakeSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ran = tmp_path / "ran"
    folder = make_set(f"import pathlib\nprint(pathlib.Path({str(ran)!r}).touch())\n{THERMAL}", trusted=False)
    assert main(["check", str(folder)]) == 0
    out = capsys.readouterr().out
    assert f"{DEVICE}: temp, SHA-256 " in out
    assert "not trusted, so only parsed: its columns, cells and readings are not checked" in out
    assert main(["check", str(folder), "--json"]) == 0
    (device,) = json.loads(capsys.readouterr().out)["devices"]
    assert len(device.pop("sha256")) == 64
    assert device == {"path": DEVICE, "trusted": False, "ran": False, "kinds": ["temp"], "unfinished": []}
    assert not ran.exists()
    assert main(["check", str(folder), "--json", "--trust-devices"]) == 0
    out = capsys.readouterr().out
    assert json.loads(out)["devices"][0]["ran"] is True, "what it prints is not among the JSON"
    assert ran.exists()
    (folder / DEVICE).write_text("class Thermal(:\n")
    assert main(["check", str(folder), "--json"]) == 2
    (problem,) = json.loads(capsys.readouterr().out)["problems"]
    assert problem == {"where": f"{DEVICE}:1", "text": "is not Python: invalid syntax"}


@pytest.mark.slow
def test_a_file_that_changes_between_check_and_run_is_not_run(make_set: MakeSet, program: str) -> None:
    folder = make_set()
    assert main(["check", str(folder)]) == 0
    (folder / DEVICE).write_text(THERMAL + "\nprint('swapped')\n")
    done = simmer("--config", folder, "--no-ui", *PORTS, "--run", program)
    assert done.returncode == 2
    assert UNTRUSTED in done.stderr
    assert "swapped" not in done.stderr


def test_a_log_holds_readings_and_a_hash_and_no_code(
    make_set: MakeSet, program: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_set(trusted=False)
    path = logged(folder, program, tmp_path / "run.jsonl")
    for word in ("observe", "class Thermal", "pose.x"):
        assert word not in path.read_text()
    (folder / DEVICE).unlink()
    with LogReader(path) as log:
        assert [each.path for each in log.header.devices] == [DEVICE]
        sensor = log.configuration.simulation.sensors[-1]
    assert (sensor.id, sensor.unit, sensor.kind.meaning) == ("temp1", "C", "temperature")
    assert sensor.kind.__name__ == "Thermal"
    assert (
        main(["report", str(path), "--html", str(tmp_path / "r.html"), "--svg", str(tmp_path / "r.svg")]) == 0
    )
    out = capsys.readouterr().out
    assert "h1 temp1" in out
    assert main(["export", str(path), "--svg", str(tmp_path / "e.svg")]) == 0


@pytest.mark.slow
def test_a_rerun_needs_the_same_file_trusted(
    make_set: MakeSet, program: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_set(trusted=False)
    path = logged(folder, program, tmp_path / "run.jsonl")

    def refusal(*arguments: object) -> str:
        assert main(["rerun", str(path), *map(str, arguments)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        return line

    assert "is code that you have not trusted yet" in refusal()
    assert main(["rerun", str(path), "--trust-devices"]) == 0
    trust(folder)
    assert main(["rerun", str(path)]) == 0
    capsys.readouterr()
    moved = folder.rename(tmp_path / "moved")
    assert f'"{DEVICE}" is not in the set' in refusal()
    assert main(["rerun", str(path), "--config", str(moved)]) == 0
    (moved / DEVICE).write_text(THERMAL + "\n")
    trust(moved)
    capsys.readouterr()
    assert "it is another" in refusal("--config", moved)


@pytest.mark.slow
def test_a_take_over_needs_it_too_and_its_log_has_it_again(
    make_set: MakeSet, program: str, tmp_path: Path
) -> None:
    folder = make_set(trusted=False)
    path = logged(folder, program, tmp_path / "run.jsonl")
    over = (
        "replay",
        path,
        "--take-over",
        "0.3",
        "--no-ui",
        "--run",
        program,
        "--log",
        tmp_path / "over.jsonl",
    )
    done = simmer(*over)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert "not trusted yet" in done.stderr
    done = simmer(*over, "--trust-devices")
    assert done.returncode == 0, done.stderr
    assert simmer("rerun", tmp_path / "over.jsonl", "--trust-devices").returncode == 0


@pytest.mark.slow
def test_trials_run_it_in_their_workers_and_go_on_by_its_copy(
    make_set: MakeSet, program: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_set(trusted=False)
    out = tmp_path / "trials"
    given = ["trials", "--run", program, "--config", str(folder), "--runs", "2", "--out", str(out)]
    assert main(given) == 2
    assert UNTRUSTED in capsys.readouterr().err
    assert main([*given, "--trust-devices", "--seed", "5"]) == 0
    assert (out / "set" / DEVICE).read_text() == THERMAL
    (folder / DEVICE).unlink()
    more = ["trials", "--resume", "--out", str(out), "--runs", "3"]
    capsys.readouterr()
    assert main(more) == 2
    assert UNTRUSTED in capsys.readouterr().err
    assert main([*more, "--trust-devices"]) == 0
    assert main(["compare", str(out), str(out)]) == 0, "it reads no sensor, and needs no trust"


def test_dask_and_gradings_refuse_it_in_a_line(
    make_set: MakeSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_set()
    given = ["trials", "--run", "true", "--config", str(folder), "--dask", "tcp://127.0.0.1:1"]
    assert main([*given, "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert (
        line == f"simmer-tui trials: --dask: {DEVICE} of the set runs on this machine only: leave out --dask"
    )
    assert not (tmp_path / "out").exists()


def test_atlas_doctor_and_env_with_it(
    make_set: MakeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_set()
    out = tmp_path / "a.npz"
    assert main(["atlas", str(out), "--config", str(folder), "--step", "6", "--sensors", "u1,h1"]) == 0
    with np.load(io.BytesIO(out.read_bytes())) as found:
        assert list(found["codes"]) == ["u1", "h1"]
    (folder / DEVICE).write_text(THERMAL.replace("return self", "return 'x' or self"))
    trust(folder)
    capsys.readouterr()
    assert main(["atlas", str(out), "--config", str(folder), "--step", "6", "--sensors", "h1"]) == 2
    assert f"{DEVICE}: a reading of Thermal must be a number" in capsys.readouterr().err
    (folder / DEVICE).write_text(THERMAL + "\n")
    folder.rename(tmp_path / "config")
    monkeypatch.chdir(tmp_path)
    main(["doctor"])
    assert "mistake" not in capsys.readouterr().out, "the machine is looked at, not the sensors"


def test_a_copy_of_a_set_has_the_same_file_trusted(
    make_set: MakeSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, copy = make_set(), tmp_path / "copy"
    assert main(["init", str(copy), "--from", str(folder), "--mission"]) == 0
    assert DEVICE in capsys.readouterr().out
    assert (copy / DEVICE).read_bytes() == (folder / DEVICE).read_bytes()
    assert main(["check", str(copy), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["devices"][0]["ran"] is True


CALIBRATED = """
from simmer_tui.client import Robot
with Robot() as robot:
    for step in range(32):
        robot.read("u1", "u2", "u3", "u4", "h1", "o1", "o2", "o3", "o4", "g1")
        robot.send(("r1-20", "d1-3", "r1--20", "d1--3")[step % 4])
"""


@pytest.mark.slow
def test_calibrate_leaves_it_as_it_is_and_copies_it(
    make_set: MakeSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_set(trusted=False)
    (tmp_path / "steps.py").write_text(CALIBRATED)
    path = logged(folder, f"{sys.executable} {tmp_path / 'steps.py'}", tmp_path / "run.jsonl")
    out = tmp_path / "learned"
    assert main(["calibrate", str(path), "--out", str(out)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "the kind temp (temperature) has no observation model" in said
    assert (out / DEVICE).read_text() == THERMAL
    assert "temp1,h1,1" in (out / "sensors.csv").read_text()
    (folder / DEVICE).unlink()
    assert main(["calibrate", str(path), "--out", str(tmp_path / "more")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "put it there, since the set that is written needs it too" in line


@pytest.mark.slow
def test_a_file_that_never_ends_is_ended_by_ctrl_c(make_set: MakeSet) -> None:
    folder = make_set("print('it loops', flush=True)\nwhile True:\n    pass\n", trusted=False)
    command = [sys.executable, "-m", "simmer_tui", "check", str(folder), "--trust-devices"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "it loops\n"
        process.send_signal(signal.SIGINT)
        assert process.stderr.read() == ""
        assert process.wait() == 130


@pytest.mark.slow
def test_a_reading_that_never_ends_is_ended_by_ctrl_c(make_set: MakeSet, program: str) -> None:
    loops = "print('it loops', flush=True)\n        while True:\n            pass\n        return self"
    folder = make_set(THERMAL.replace("return self", loops), trusted=False)
    command = [sys.executable, "-m", "simmer_tui", "--config", str(folder), "--no-ui", *PORTS]
    command += ["--run", program, "--trust-devices"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        # Another thread may write into the same line.
        told = list(itertools.takewhile(lambda line: "it loops" not in line, process.stderr))
        assert process.poll() is None, "".join(told)
        process.send_signal(signal.SIGINT)
        rest = process.stderr.read()
        assert process.wait() == 130, "".join(told) + rest


@pytest.mark.slow
def test_a_device_that_fails_in_timed_motion(make_set: MakeSet, program: str) -> None:
    folder = make_set(THERMAL.replace("return self", "return 1 / 0 if pose.x > 9.9 else self"), trusted=False)
    done = simmer(
        *("--config", folder, "--no-ui", *PORTS, "--run", program, "--trust-devices"),
        *("--motion", "timed", "--time-scale", "50"),
    )
    assert done.returncode == 0, done.stderr
    assert "no answer to 'h1'" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_replay_shows_it_without_its_file(make_set: MakeSet, program: str, tmp_path: Path) -> None:
    folder = make_set(trusted=False)
    path = logged(folder, program, tmp_path / "run.jsonl")
    (folder / DEVICE).unlink()
    with RunLogIndex(path) as index:
        run = RecordedRun(index)
        run.stand_at_end()
        snapshot = asyncio.run(run.snapshot(0, True))
    reading = snapshot.state.sensors["h1"].reading
    assert 17 < reading.value < 20
    assert kind_name(reading.sensor.kind) == "temp"


def test_env_parses_it_and_runs_nothing(
    make_set: MakeSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_set(f"open({str(tmp_path / 'ran')!r}, 'w')\n{THERMAL}", trusted=False)
    (folder / "dialect.toml").write_text('[[command]]\nmatch = "t"\nreply = "{h1:.1f}"\n')
    assert main(["env", "--config", str(folder), "--form", "json", "--dialect-port", "9131"]) == 0
    assert json.loads(capsys.readouterr().out)["SIMMER_DIALECT_PORT"] == "9131"
    assert not (tmp_path / "ran").exists()


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("fails", [False, True])
def test_the_verdict_of_a_run_is_that_of_its_log(
    make_set: MakeSet, program: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], fails: bool
) -> None:
    own = "\n    def error(self, true, reply):\n        return 99.0\n"
    text = THERMAL.replace("return self", "return 1 / 0 if pose.x > 10.9 else self") if fails else THERMAL
    folder, log = make_set(text + own), tmp_path / "run.jsonl"
    done = simmer("--config", folder, "--no-ui", *PORTS, "--seed", 5, "--run", program, "--log", log)
    (live,) = [line for line in done.stderr.splitlines() if line.startswith("verdict: ")]
    assert main(["report", str(log), "--json"]) == 0
    assert live == f"verdict: {json.loads(capsys.readouterr().out)['text']['verdict']}"


@pytest.mark.slow
def test_trials_end_a_reading_that_never_ends_by_their_time_limit(
    make_set: MakeSet, program: str, tmp_path: Path
) -> None:
    folder = make_set(THERMAL.replace("return self", "while True:\n            pass\n        return self"))
    out = tmp_path / "trials"
    done = simmer(
        "trials", "--run", program, "--config", folder, "--runs", 1, "--time-limit", 1, "--out", out
    )
    assert "Traceback" not in done.stderr
    assert (done.returncode, len((out / "trials.csv").read_text().splitlines())) == (0, 2)


@pytest.mark.slow
def test_its_columns_are_in_the_json_of_check_and_can_be_varied(
    make_set: MakeSet, program: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_set()
    assert main(["check", str(folder), "--json"]) == 0
    *others, own = json.loads(capsys.readouterr().out)["sensors"]
    assert (own["id"], own["ambient"]) == ("temp1", 17.0)
    assert not any("ambient" in each for each in others), "a column of one kind is no other's"
    out = tmp_path / "trials"
    given = ["trials", "--run", program, "--config", str(folder), "--runs", "1", "--out", str(out)]
    assert main([*given, "--vary", "h1.ambent=15,18"]) == 2
    assert 'did you mean "ambient"' in capsys.readouterr().err
    assert main([*given, "--vary", "h1.ambient=15,18"]) == 0
