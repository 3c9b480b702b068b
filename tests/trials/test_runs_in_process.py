"""Runs whose program is a thread of this process: every ending, with its figures, its log and its output."""

from __future__ import annotations

import socket
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from msgspec import structs

from simmer_tui.config.loader import find_set, load
from simmer_tui.errors import InterruptedTrialError, ProgramError
from simmer_tui.links.ports import take_port
from simmer_tui.program import ProgramOutput, RunningProgram
from simmer_tui.program.program_output import OutputReader
from simmer_tui.runlog.reader import LogReader
from simmer_tui.trials import run as module
from simmer_tui.trials.run import TrialRun
from simmer_tui.trials.trial import Trial, TrialResult
from tests.kept_numbers import Fields, assert_kept, usual_of

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals have no names there")
KEPT = Path(__file__).with_name("kept_runs.json")
SOLVE = ("d1-5", "p1-1", "a1-9", "p1-0")
"""The mission of `exact_mission` in four commands."""


class Program:
    """A program of some commands; it ends with a code, or stays until it is ended."""

    def __init__(self, commands: tuple[str, ...], code: int | None, lines: tuple[str, ...] = ()) -> None:
        self.commands, self.code, self.lines = commands, code, lines
        self.variables: dict[str, str] = {}
        self.ended = threading.Event()
        self.closed = 0
        self.can_be_ended, self.last_lines = True, 1.0

    take = staticmethod(take_port)

    def start(
        self,
        command: str,
        variables: Mapping[str, str],
        on_end: Callable[[int], None],
        on_line: Callable[[str], None],
        *,
        output: ProgramOutput,
    ) -> RunningProgram:
        if command == "not there":
            raise ProgramError("not there: no such program")
        self.variables = dict(variables)
        for line in self.lines:
            output.stderr.add(f"{line}\n".encode())
            on_line(line)
        return RunningProgram(self.run, self.stop, OutputReader([]), on_end, self.last_lines)

    def stop(self) -> None:
        if self.can_be_ended:
            self.ended.set()

    def run(self) -> int:
        address = self.variables["SIMMER_HOST"]
        ports = [int(self.variables[name]) for name in ("SIMMER_PORT", "SIMMER_REPLY_PORT")]
        with (
            socket.create_connection((address, ports[0])) as sending,
            socket.create_connection((address, ports[1])) as replies,
        ):
            sending.sendall("".join(f"{each}\n" for each in self.commands).encode())
            left = 8 * len(self.commands)
            while left and (got := replies.recv(left)):
                left -= len(got)
            if self.code is None:
                self.ended.wait()
                return -9
        return self.code

    def close(self) -> None:
        self.closed += 1


Run = Callable[..., TrialResult]


@pytest.fixture
def trial(exact_mission: Path) -> Trial:
    return Trial(
        number=7, seed=5, configuration=load(exact_mission), maze="", command="x", fixed_ports=False,
        time_limit=60.0,
    )  # fmt: skip


@pytest.fixture
def run(trial: Trial, tmp_path: Path) -> Run:
    """Does a run of a program in a sandbox of ours."""

    def done(program: Program, most_log: float = float("inf"), **fields: object) -> TrialResult:
        changed = replace(trial, **fields)  # type: ignore[arg-type]
        made = TrialRun(changed, tmp_path, sandbox=lambda: program, most_log=most_log)
        try:
            return made.run()
        finally:
            program.ended.set()
            assert program.closed == 1

    return done


def figures(result: TrialResult) -> Fields:
    """A result without what depends on the machine."""
    assert result.real_seconds > 0.0
    assert result.simulator_seconds > 0.0
    fields = structs.asdict(result)
    evidence = [each for each in result.verdict["evidence"] if not each.startswith("Real time")]
    fields["verdict"] = {**result.verdict, "evidence": evidence}
    of_the_machine = ("real_seconds", "simulator_seconds")
    told = {name: each for name, each in fields.items() if name not in of_the_machine}
    return Fields(told, usual_of(TrialResult))


@pytest.mark.parametrize(
    ("name", "commands", "code"),
    [
        ("solved and ended", SOLVE, 4),
        ("against a wall", ("d1-100",), None),
        ("too slow", ("r1-999",) * 20, None),
        ("ended too early", SOLVE[:2], 0),
        ("ended with an error", SOLVE[:1], 3),
        ("silent", (), 0),
        ("silent with an error", (), 2),
    ],
)
def test_missions_end_in_many_ways(
    run: Run, tmp_path: Path, name: str, commands: tuple[str, ...], code: int | None
) -> None:
    result = run(Program(commands, code, ("a line", "KeyError: 1")))
    assert_kept(figures(result), KEPT, f"mission {name}")
    assert (tmp_path / "0007.jsonl.gz").exists()
    assert (tmp_path / "0007.txt").read_text() == "a line\nKeyError: 1\n"


@pytest.mark.parametrize(
    ("name", "commands", "code"),
    [
        ("done", ("w1-3", "r1-90"), 0),
        ("failed", ("w1-3",), 1),
        ("silent", (), 0),
        ("against a wall", ("w1-99",), 0),
    ],
)
def test_without_a_mission_the_exit_code_decides(
    run: Run, name: str, commands: tuple[str, ...], code: int
) -> None:
    result = run(Program(commands, code), configuration=load(find_set("default")))
    assert_kept(figures(result), KEPT, f"no mission {name}")


@pytest.mark.parametrize("configuration", ["mission", "default"])
def test_a_program_that_stays_has_its_time(run: Run, configuration: str, exact_mission: Path) -> None:
    loaded = load(exact_mission if configuration == "mission" else find_set("default"))
    result = run(Program(("r1-90",), None, ("last",)), time_limit=0.3, configuration=loaded)
    assert (result.ending.value, result.exit_code, result.success) == ("real time limit", None, False)
    assert result.reason == "the real time limit of 0.3 s"


def test_a_program_that_cannot_be_ended_does_not_keep_its_run(run: Run) -> None:
    program = Program(("d1-100",), None)
    program.can_be_ended, program.last_lines = False, 0.01
    result = run(program)
    assert (result.ending.value, result.exit_code, result.verdict["program"]) == ("contacts", None, None)


def test_a_program_that_cannot_be_started_has_failed(run: Run, trial: Trial, tmp_path: Path) -> None:
    program = Program((), 0)
    result = run(program, command="not there")
    assert (result.ending.value, result.exit_code) == ("program ended", 127)
    assert result.verdict["text"].startswith("The program could not start: not there: no such program")
    assert not (tmp_path / "0007.txt").exists()


def test_variables_of_a_run(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sandbox sees no folder of ours; only a maze of its own is told."""
    monkeypatch.delenv("PYTHONHASHSEED", raising=False)
    (program := Program((), 0), run(program))
    assert program.variables["SIMMER_RUN"] == "7"
    assert program.variables["PYTHONHASHSEED"] == "0"
    assert not {"SIMMER_CONFIG", "SIMMER_MAZE"} & program.variables.keys()
    assert program.variables["SIMMER_PORT"] != "9000"
    monkeypatch.setenv("PYTHONHASHSEED", "9")
    (program := Program((), 0), run(program, repetition=3, maze="a.csv"))
    assert program.variables["SIMMER_RUN"] == "3"
    assert "PYTHONHASHSEED" not in program.variables
    assert program.variables["SIMMER_MAZE"] == str((tmp_path / "0007.maze.csv").resolve())
    assert (tmp_path / "0007.maze.csv").read_text().count("\n") == 4


def test_the_last_lines_of_the_output_are_kept(run: Run, tmp_path: Path) -> None:
    lines = ("first", *("x" * 1001 for _ in range(2000)))
    run(Program((), 0, lines))
    kept = (tmp_path / "0007.txt").read_text().splitlines()
    assert kept == ["x" * 997 + "..."] * 2000


def test_files_of_a_run_that_was_cut_off_are_replaced(run: Run, tmp_path: Path) -> None:
    (tmp_path / "0007.txt").write_text("old")
    (tmp_path / "0007.jsonl.gz").write_bytes(b"old")
    run(Program((), 0))
    assert not (tmp_path / "0007.txt").exists()
    assert (tmp_path / "0007.jsonl.gz").read_bytes() != b"old"


def test_a_log_that_grows_too_large_is_cut(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_LOOK_EVERY", 10)
    log = tmp_path / "0007.jsonl.gz"
    sizes = {}
    for most in (10**9, 0):
        run(Program(("r1-90",) * 50, 0), most_log=float(most))
        sizes[most] = log.stat().st_size
    assert sizes[0] < sizes[10**9]
    with LogReader(log) as cut:
        assert len(list(cut)) == 10, "its size was checked after so many events"


def test_an_interrupted_run_has_no_result(trial: Trial, tmp_path: Path) -> None:
    program = Program((), None)
    made = TrialRun(trial, tmp_path, sandbox=lambda: program)
    made.interrupt()
    with pytest.raises(InterruptedTrialError):
        made.run()
    assert program.closed == 1
    assert (tmp_path / "0007.jsonl.gz").exists()
