"""A logged run done again gives the same replies, and where it does not, that is found."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from simmer_tui.cli.rerun_command import run_rerun
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import ActionName
from simmer_tui.runlog.log_records import ActionRecord, AnswerRecord, PlanRecord, ReadingRecord
from simmer_tui.runlog.reader import LogReader
from simmer_tui.runlog.rerun import Rerun
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator, Status, parse_command


def rerun(path: Path) -> Rerun:
    with Rerun(path) as run:
        for _ in run.steps():
            pass
    return run


def rewrite(path: Path, line: int, **changes: object) -> None:
    """Change fields of a line, counted from 1."""
    lines = path.read_text().splitlines()
    lines[line - 1] = json.dumps({**json.loads(lines[line - 1]), **changes})
    path.write_text("\n".join(lines) + "\n")


def give(log: RunLog, simulator: Simulator, *texts: str) -> None:
    """Do commands at once, and log them."""
    engine = Engine(simulator)
    engine.watch(log)
    session = engine.session()
    for text in texts:
        session.submit(parse_command(text), lambda outcome: None)


@pytest.mark.parametrize("seed", [0, *(pytest.param(each, marks=pytest.mark.slow) for each in range(1, 6))])
@pytest.mark.parametrize("answer_at_end", [True, False])
@pytest.mark.parametrize("timed", [True, False])
def test_random_runs_come_out_the_same(
    random_run: Callable[..., Any], seed: int, timed: bool, answer_at_end: bool
) -> None:
    path = random_run(seed, timed=timed, answer_at_end=answer_at_end).path
    run = rerun(path)
    assert run.difference is None
    with LogReader(path) as log:
        lines = [line for _, line in log.lines()]
    begun: list[object] = [line for line in lines if isinstance(line, ReadingRecord)]
    begun += [line for line in lines if isinstance(line, PlanRecord) and not line.again]
    begun += [line for line in lines if isinstance(line, AnswerRecord) and line.status is not Status.ACCEPTED]
    assert run.commands == len(begun)
    assert run.actions == sum(isinstance(line, ActionRecord) for line in lines)
    assert run.notes == []


def test_a_seed_of_any_length_is_logged_to_its_last_digit(start_run: Callable[..., Any]) -> None:
    run = start_run()
    run.perform(ActionName.SEED, 2**128 - 1)
    run.send("d1-3", "u1")
    assert run.simulator.seed == 2**128 - 1
    assert (rerun(run.path).difference, rerun(run.path).actions) == (None, 1)
    run.perform(ActionName.SEED, 2**128)
    assert run.simulator.seed == 2**128 - 1


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("seed", [1, 0, 2, 3])
def test_runs_cut_anywhere_come_out_the_same(random_run: Callable[..., Any], seed: int) -> None:
    path = random_run(seed, timed=True).path
    data = path.read_bytes()
    first = data.index(b"\n") + 1
    commands = set()
    for cut in range(len(data) - 100, first, -len(data) // 15):
        os.truncate(path, cut)
        run = rerun(path)
        assert run.difference is None
        assert all("cut off" in note for note in run.notes)
        commands.add(run.commands)
    assert len(commands) > 5


def test_the_same_run_is_reported_in_one_line(varied_log: Path, capsys: Any) -> None:
    assert run_rerun([str(varied_log)]) == 0
    out, err = capsys.readouterr()
    assert out == (
        f"{varied_log}: 18 commands and 4 actions repeated, every reply the same "
        "(seed 7, configuration default)\n"
    )
    assert err == ""


@pytest.mark.parametrize(
    ("line", "changes", "found"),
    [
        (3, {"reply": 36.25}, "line 3, command 'u1': reply is 36.25 in the log and 36."),
        (3, {"true": 1.0}, "line 3, command 'u1': true is 1.0 in the log and 35.5 now"),
        (12, {"status": "busy"}, "line 12, command 'zz': status is busy in the log and unknown now"),
        (11, {"pose": [1, 2, 3]}, "line 11, command 'd1-3': pose is (1.0, 2.0, 3.0) in the log and (12."),
        (16, {"contact": None}, "line 16, command 'd1-60': contact is None in the log and ("),
        (19, {"refused": True}, "line 19, action teleport: refused is true in the log and false now"),
    ],
)
def test_the_first_difference_is_named(
    varied_log: Path, capsys: Any, line: int, changes: dict[str, object], found: str
) -> None:
    rewrite(varied_log, line, **changes)
    assert run_rerun([str(varied_log)]) == 1
    assert found in capsys.readouterr().out


def test_another_seed_gives_a_difference(varied_log: Path, capsys: Any) -> None:
    rewrite(varied_log, 1, seed=8, program="0.0.1")
    assert run_rerun([str(varied_log)]) == 1
    out = capsys.readouterr().out
    assert "line 3, command 'u1': reply is" in out
    assert "the log is from simmer-tui 0.0.1" in out


def test_a_broken_line_fails_and_is_named(varied_log: Path, capsys: Any) -> None:
    lines = varied_log.read_bytes().splitlines(keepends=True)
    lines[5] = b'{"t":0.0,"kind":"comm\n'
    varied_log.write_bytes(b"".join(lines))
    assert run_rerun([str(varied_log)]) == 2
    assert "line 6 is broken: " in capsys.readouterr().err


def test_a_missing_command_is_noticed(varied_log: Path, capsys: Any) -> None:
    lines = varied_log.read_bytes().splitlines(keepends=True)
    del lines[9:11]
    varied_log.write_bytes(b"".join(lines))
    assert run_rerun([str(varied_log)]) == 2
    assert "line 10: command number 8 is missing" in capsys.readouterr().err


def test_a_configuration_that_is_refused_is_shown(varied_log: Path, capsys: Any) -> None:
    header = json.loads(varied_log.read_text().splitlines()[0])
    rewrite(varied_log, 1, files={**header["files"], "maze.csv": "1,9\n"})
    assert run_rerun([str(varied_log)]) == 2
    assert "maze.csv:1:B" in capsys.readouterr().err


def test_options_of_the_run_count(tmp_path: Path, configuration: Any) -> None:
    from simmer_tui.config.loader import Override, load

    overrides = {
        "bot_center": Override("--bot-center", "30,42"),
        "strength": Override("--strength", "0.2,5"),
        "num_segments": Override("--num-segments", "3"),
        "seed": Override("--seed", "11"),
        "server.port": Override("--port", "9100"),
    }
    changed = load(configuration.directory, overrides)
    simulator = Simulator(changed.simulation, 11)
    path = tmp_path / "options.jsonl"
    with RunLog(path, changed, simulator) as log:
        give(log, simulator, "u1", "d1-3", "r1-50", "u1")
    run = rerun(path)
    assert (run.difference, run.commands) == (None, 4)


def test_a_run_with_a_gripper_and_profiles_comes_out_the_same(tmp_path: Path) -> None:
    from simmer_tui.config.loader import Override, load
    from simmer_tui.config.sets import find_set

    overrides = {
        "drive_profile": Override("--drive-profile", "mecanum"),
        "bot_center": Override("--bot-center", "18,41"),
        "block_center": Override("--block-center", "23,41"),
    }
    configuration = load(find_set("mission"), overrides)
    assert configuration.simulation.gripper is not None
    grip = configuration.simulation.gripper.code
    simulator = Simulator(configuration.simulation, 3)
    path = tmp_path / "mission.jsonl"
    with RunLog(path, configuration, simulator) as log:
        held = []
        for text in (f"{grip}-1", "d1-2", "r1-30", f"{grip}-0", "d1--3", f"{grip}-2"):
            give(log, simulator, text)
            held.append(simulator.holding)
    assert held == [True, True, True, False, False, False]
    run = rerun(path)
    assert (run.difference, run.commands) == (None, 6)
    rewrite(path, 2, grip={"closed": True, "holding": False, "block": [1, 2, 3]})
    assert rerun(path).difference is not None


def test_a_log_begun_before_the_first_command_but_after_actions_is_whole(
    tmp_path: Path, configuration: Any, start_run: Any
) -> None:
    run = start_run(timed=True)
    run.loop.run_until(run.loop.now + 3.0)
    for action in ((ActionName.TELEPORT, 30.0, 42.0, 20.0), (ActionName.NOISE, 0.0), (ActionName.BIAS, 0.0)):
        run.perform(*action)
    run.perform(ActionName.BLOCK, 35.0, 44.0)
    path = tmp_path / "late.jsonl"
    with RunLog(path, configuration, run.simulator) as log:
        run.engine.watch(log)
        run.send("u1", "d1-3")
        run.loop.run_until(run.loop.now + 3.0)
        run.send("u1")
    again = rerun(path)
    assert (again.difference, again.commands, again.notes) == (None, 3, [])


def test_a_log_begun_mid_run_counts_from_the_next_reset(
    tmp_path: Path, configuration: Any, start_run: Any, capsys: Any
) -> None:
    run = start_run()
    run.send("u1", "d1-3")
    path = tmp_path / "middle.jsonl"
    with RunLog(path, configuration, run.simulator) as log:
        run.engine.watch(log)
        run.send("u1", "d1-3")
        assert run_rerun([str(path)]) == 2
        assert "begins after 2 commands and holds no reset" in capsys.readouterr().err
        run.perform(ActionName.SEED, 5.0)
        run.send("u1", "d1-3", "u1")
    assert run_rerun([str(path)]) == 0
    out, err = capsys.readouterr()
    assert "3 commands and 1 action repeated" in out
    assert "compared from the seed in line 5 on" in err


def test_noise_that_was_switched_before_the_reset_counts_after_it(
    tmp_path: Path, configuration: Any, start_run: Any
) -> None:
    run = start_run()
    run.send("u1", "d1-3")
    run.perform(ActionName.NOISE, 0.0)
    path = tmp_path / "middle.jsonl"
    with RunLog(path, configuration, run.simulator) as log:
        run.engine.watch(log)
        run.send("u1")
        run.perform(ActionName.NOISE, 1.0)
        run.perform(ActionName.RESET)
        run.send("u1", "d1-3", "u1")
    again = rerun(path)
    assert (again.difference, again.commands) == (None, 3)


def test_the_log_of_a_real_robot_cannot_be_run_again(varied_log: Path, capsys: Any) -> None:
    header = json.loads(varied_log.read_text().splitlines()[0])
    rewrite(varied_log, 1, settings={**header["settings"], "sim": False})
    assert run_rerun([str(varied_log)]) == 2
    assert "is the log of a real robot" in capsys.readouterr().err


def test_a_file_that_is_not_there_is_an_error(tmp_path: Path, capsys: Any) -> None:
    assert run_rerun([str(tmp_path / "none.jsonl")]) == 2
    assert "there is no such file" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["u1", "d1-1", "xx"])
def test_what_was_busy_because_too_many_waited_is_so_again(tmp_path: Path, text: str) -> None:
    configuration = load(bundled_folder())
    simulator = Simulator(configuration.simulation, 3)
    with RunLog(tmp_path / "run.jsonl", configuration, simulator) as log:
        give(log, simulator, "u1", "d1-1")
        engine = Engine(simulator)
        engine.watch(log)
        assert engine.refuse(replace(parse_command(text), stops=text == "xx")).status is Status.BUSY
        give(log, simulator, "u1", "d1-1")
    run = rerun(tmp_path / "run.jsonl")
    assert run.difference is None
    assert run.commands == 5
