"""One run of a program: how it ends, and what is kept of it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from simmer_tui.config.loader import find_set, load
from simmer_tui.errors import InterruptedTrialError, ProgramError
from simmer_tui.run.events import CommandResult
from simmer_tui.run.mission import MissionRule
from simmer_tui.runlog.header import rebuild
from simmer_tui.runlog.reader import Logged, LogReader
from simmer_tui.trials.run import TrialRun, fault_result
from simmer_tui.trials.trial import RANDOM, Ending, Trial, TrialResult, prepare, run_seed
from simmer_tui.trials.trials_summary import failure_text

FETCH = """
robot.drive("d1", 5)
robot.drive("p1", 1)
robot.drive("a1", 9)
robot.drive("p1", 0)
"""


@pytest.fixture
def trial(exact_mission: Path) -> Trial:
    return Trial(
        number=3,
        seed=run_seed(7, 3),
        configuration=load(exact_mission),
        maze="",
        command="",
        fixed_ports=False,
        time_limit=60.0,
    )


def test_mission_done_is_success_whatever_the_program_does_then(
    trial: Trial, program: Callable[[str], str], tmp_path: Path
) -> None:
    result = TrialRun(replace(trial, command=program(FETCH + "sys.exit(9)")), tmp_path).run()
    assert result.success
    assert (result.ending, result.exit_code, result.reason) == (Ending.SUCCESS, None, "")
    assert result.reached is not None
    assert result.taken is not None
    assert 0 < result.reached <= result.taken < result.time == result.delivered
    assert (result.commands, result.contacts) == (4, 0)
    assert result.distance == pytest.approx(14)
    assert (result.start, result.block, result.drop_zone) == ((30, 42, 180), (20, 42), (30, 42))
    assert result.end == pytest.approx((34, 42, 180))


def test_a_run_that_breaks_a_rule_has_an_ending_of_its_name() -> None:
    assert {rule.value for rule in MissionRule} <= {ending.value for ending in Ending}


def test_log_of_a_run_repeats_it(trial: Trial, program: Callable[[str], str], tmp_path: Path) -> None:
    result = TrialRun(replace(trial, command=program(FETCH)), tmp_path).run()
    with LogReader(tmp_path / "0003.jsonl") as log:
        assert log.header.seed == result.seed
        assert log.header.run is None, "only --run of a single run is kept"
        assert rebuild(log.header).simulation.bot_center == result.start[:2]
        events = [told.event for told in log if isinstance(told, Logged)]
        assert len([event for event in events if isinstance(event, CommandResult)]) == result.commands


def test_contact_that_is_not_allowed_ends_the_run(
    trial: Trial, program: Callable[[str], str], tmp_path: Path
) -> None:
    command = program('robot.drive("d1", 100)\nthreading.Event().wait()')
    result = TrialRun(replace(trial, command=command), tmp_path).run()
    assert (result.success, result.ending) == (False, Ending.CONTACTS)
    assert result.reason == "1 contact with a wall, 0 allowed"
    (point,) = result.contact_points
    assert point == pytest.approx((0.0, 42.0), abs=1e-6)


def test_time_limit_of_the_mission_ends_the_run(
    trial: Trial, program: Callable[[str], str], tmp_path: Path
) -> None:
    command = program('while True: robot.drive("r1", 360)')
    result = TrialRun(replace(trial, command=command), tmp_path).run()
    assert (result.ending, result.time) == (Ending.TIME_LIMIT, 60.0)


def test_program_that_ends_too_early_has_its_exit_code_and_last_words_kept(
    trial: Trial, program: Callable[[str], str], tmp_path: Path
) -> None:
    command = program('robot.drive("r1", 90)\nprint("one")\nsys.exit("I am \\x1b[1mlost")')
    result = TrialRun(replace(trial, command=command), tmp_path).run()
    assert (result.ending, result.exit_code, result.commands) == (Ending.EXIT, 1, 1)
    assert result.last_output == "I am lost", "without the sequences of colours"
    assert (tmp_path / "0003.txt").read_text() == "one\nI am lost\n"


def test_command_sent_without_waiting_for_its_reply_counts(
    trial: Trial, program: Callable[[str], str], tmp_path: Path
) -> None:
    lines = """
s = socket.create_connection((os.environ["SIMMER_HOST"], int(os.environ["SIMMER_PORT"])))
"""
    command = program("robot.close()" + lines + 's.sendall(b"d1-5\\np1-1\\na1-9\\np1-0\\n")')
    result = TrialRun(replace(trial, command=command), tmp_path).run()
    assert result.ending is Ending.SUCCESS


def test_real_time_limit_ends_a_run_that_stands_still(
    trial: Trial, program: Callable[[str], str], tmp_path: Path
) -> None:
    command = program("threading.Event().wait()")
    result = TrialRun(replace(trial, command=command, time_limit=0.3), tmp_path).run()
    assert (result.ending, result.reason) == (Ending.REAL_TIME_LIMIT, "the real time limit of 0.3 s")


def test_program_is_told_of_drop_zone_and_time_limit_but_not_of_the_seed(
    trial: Trial, program: Callable[[str], str], tmp_path: Path
) -> None:
    command = program('print(*sorted(n[7:] for n in os.environ if n.startswith("SIMMER_")))')
    told = TrialRun(replace(trial, command=command), tmp_path).run().last_output
    for name in ("DROP_ZONE", "HOST", "PORT", "REPLY_PORT", "RUN", "START", "TIME_LIMIT"):
        assert name in told.split()
    assert "SEED" not in told


@pytest.mark.parametrize(("code", "ending"), [(0, Ending.SUCCESS), (3, Ending.EXIT)])
def test_without_a_mission_the_exit_code_decides(
    trial: Trial, program: Callable[[str], str], tmp_path: Path, code: int, ending: Ending
) -> None:
    command = program(f'robot.drive("d1", 100)\nsys.exit({code})')
    configuration = load(find_set("default"))
    result = TrialRun(replace(trial, configuration=configuration, command=command), tmp_path).run()
    assert (result.ending, result.exit_code, result.contacts) == (ending, code, 1)
    assert len(result.contact_points) == 1
    assert result.drop_zone is None


@pytest.mark.parametrize("name", ["default", "mission"])
def test_program_that_sends_nothing_is_no_success(
    trial: Trial, program: Callable[[str], str], tmp_path: Path, name: str
) -> None:
    configuration = load(find_set(name))
    command = program('print("all is well")')
    result = TrialRun(replace(trial, configuration=configuration, command=command), tmp_path).run()
    assert (result.success, result.ending, result.exit_code) == (False, Ending.SILENCE, 0)
    assert result.reason == "nothing was sent"
    assert result.sent_nothing
    assert failure_text(result) == "Failed after 0.0 s: The program sent no command at all."
    assert result.verdict["evidence"] == ["Last output: all is well."]
    assert written_and_read(result) == result


def test_program_that_fails_before_it_sends_anything_keeps_its_exit_code(
    trial: Trial, program: Callable[[str], str], tmp_path: Path
) -> None:
    result = TrialRun(replace(trial, command=program("sys.exit(3)")), tmp_path).run()
    assert (result.ending, result.sent_nothing) == (Ending.EXIT, True)
    assert result.reason == "the program ended with exit code 3"


def test_interrupted_run_has_no_result(trial: Trial, program: Callable[[str], str], tmp_path: Path) -> None:
    run = TrialRun(replace(trial, command=program("threading.Event().wait()")), tmp_path)
    threading.Thread(target=run.interrupt).start()
    with pytest.raises(InterruptedTrialError):
        run.run()


def test_program_that_does_not_exist_is_an_error_and_no_result(trial: Trial, tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match="no-such-program"):
        TrialRun(replace(trial, command="no-such-program"), tmp_path).run()


def test_runs_have_seeds_of_their_own_that_depend_on_nothing_else() -> None:
    seeds = [run_seed(5, number) for number in range(1, 200)]
    assert len(set(seeds)) == len(seeds)
    assert seeds == [run_seed(5, number) for number in range(1, 200)]
    assert not set(seeds) & {run_seed(6, number) for number in range(1, 200)}


def test_random_maze_of_a_run_depends_on_its_seed_and_holds_the_mission(trial: Trial) -> None:
    configuration = load(find_set("mission"))
    mazes = set()
    for number in range(1, 21):
        each = replace(trial, configuration=configuration, maze=RANDOM, seed=run_seed(1, number))
        made, plan = prepare(each)
        assert plan is not None
        assert prepare(each)[0] == made
        assert made.files["maze.csv"].count("\n") == 4
        mazes.add(made.simulation.maze)
    assert len(mazes) == 20


def written_and_read(result: TrialResult, old: str = "", new: str = "") -> TrialResult:
    text = msgspec.json.encode(result).decode()
    assert old in text
    return msgspec.json.decode(text.replace(old, new), type=TrialResult)


def test_result_survives_its_line(trial: Trial, program: Callable[[str], str], tmp_path: Path) -> None:
    result = TrialRun(replace(trial, command=program('robot.drive("d1", 100)')), tmp_path).run()
    assert written_and_read(result) == result
    fault = fault_result(trial, "it broke")
    assert written_and_read(fault) == fault


def test_run_whose_simulator_failed_has_no_figures(trial: Trial) -> None:
    fault = fault_result(trial, "it broke")
    assert (fault.success, fault.ending, fault.reason) == (False, Ending.FAULT, "it broke")
    assert (fault.time, fault.distance, fault.commands, fault.contacts) == (0.0, 0.0, 0, 0)
    assert (fault.real_seconds, fault.simulator_seconds) == (0.0, 0.0)
    assert fault.start == fault.end


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('"seed":', '"sead":', "unknown field `sead`"),
        ('"number":3', '"number":0', "Expected `int` >= 1"),
        ('"commands":0', '"commands":"x"', r"Expected `int`, got `str` - at `\$.commands`"),
        ('"time":0.0', '"time":true', r"Expected `float`, got `bool` - at `\$.time`"),
        ('"ending":"fault"', '"ending":"bang"', "Invalid enum value 'bang'"),
        ('"contact_points":[]', '"contact_points":[[1]]', "Expected `array` of length 2"),
    ],
)
def test_broken_record_tells_the_field(trial: Trial, old: str, new: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        written_and_read(fault_result(trial, ""), old, new)
