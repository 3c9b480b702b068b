"""Faults that teams make, planted: what check and a run say about them, and the sample with a bug to find."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from simmer_tui.cli.main import main
from simmer_tui.config.loader import load
from simmer_tui.run.events import Event, Notice, NoticeKind
from simmer_tui.sim.records import CommandResult
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.sketch.sketch_check import facts_of, sketch_problems
from simmer_tui.sketch.wiring import wiring_of
from tests.sketch.running import Sent, run_boards, set_of

FAULTS = Path(__file__).parent / "faults"
SAMPLE = Path(__file__).parents[2] / "scripts" / "arduino" / "line_follower"


def compiler_or_skip() -> None:
    if find_compiler() is None:
        pytest.skip("there is no C++ compiler")


def test_check_names_the_line_of_a_wrong_polarity(tmp_path: Path) -> None:
    configuration = set_of(FAULTS / "polarity", tmp_path / "set")
    wiring = wiring_of(configuration)
    assert wiring is not None
    facts = facts_of(wiring, configuration.directory, [])
    (problem,) = sketch_problems(wiring, facts, configuration.simulation.wheels)
    assert str(problem) == (
        "polarity.ino:16: goForward() turns the robot right: motors[2] turns backward; change reversed "
        "of a motor in wiring.toml if its wires are swapped, else correct the sketch"
    )


@pytest.mark.slow
def test_a_stop_behind_a_delay_comes_when_the_delay_is_over(tmp_path: Path) -> None:
    compiler_or_skip()
    configuration = set_of(FAULTS / "lost_stop", tmp_path / "set")
    run = run_boards(configuration, 3.0, ((0.5, b"F"), (1.05, b"S")))
    wheels = [
        (event.time, event.command.text)
        for event in run.events
        if isinstance(event, CommandResult) and event.command.text.startswith("ww")
    ]
    started, stopped = wheels[0][0], next(time for time, text in reversed(wheels))
    assert wheels[-1][1] in ("ww-0;0", "ww-0.0;0.0")
    # A pass of loop() takes 200 ms: the byte of 1.05 s is read at the next pass.
    passes = [float(line) / 1000 for line in run.text.splitlines()]
    assert started == pytest.approx(min(each for each in passes if each > 0.5), abs=0.01)
    assert stopped == pytest.approx(min(each for each in passes if each > 1.05), abs=0.01)
    assert stopped > 1.1


@pytest.mark.slow
def test_the_sample_goes_too_far_until_its_bug_is_mended(tmp_path: Path) -> None:
    compiler_or_skip()
    folder = tmp_path / "set"
    shutil.copytree(SAMPLE, folder)
    sent = ((0.5, b"g 20\n"),)
    wrong = run_boards(load(folder), 5.0, sent)
    assert wrong.text.endswith("done 405 396\r\n")
    assert wrong.pose[0] == pytest.approx(34.7, abs=0.1)
    assert "an edge at pin 2 was lost at follower.ino:26: interrupts were off" in " ".join(wrong.notices)
    sketch = folder / "follower" / "follower.ino"
    text = sketch.read_text("utf-8")
    assert text.splitlines()[25].startswith("    bluetooth.print(")
    sketch.write_text(text.replace("leftTicks % 40 == 0", "false"), "utf-8")
    right = run_boards(load(folder), 5.0, sent)
    assert right.text == "done 400 400\r\n"
    assert right.pose[0] == pytest.approx(34.0, abs=0.02)
    assert right.notices == []


@pytest.mark.slow
def test_the_samples_program_drives_its_boards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    compiler_or_skip()
    monkeypatch.chdir(tmp_path)
    shutil.copytree(SAMPLE, tmp_path / "line")
    # Its bug is one that the text shows.
    assert main(["check", "line"]) == 1
    checked = capsys.readouterr().out
    assert "motors[1] left: forward turns the robot right" in checked
    assert "  follower.ino:26: bluetooth.print in leftEdge(), the function of an interrupt: " in checked
    command = [sys.executable, "-m", "simmer_tui", "--no-ui", "--sketch", "line", "--clock", "program"]
    command += ["--seed", "1", "--port", "0", "--reply-port", "0", "--belief-port", "0"]
    done = subprocess.run(
        [*command, "--run", f"{sys.executable} line/follow.py"],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "done 405 396\n" in done.stdout


def told(run_events: list[Event]) -> list[Notice]:
    return [each for each in run_events if isinstance(each, Notice) and each.kind is NoticeKind.BOARD]


@pytest.mark.slow
def test_a_late_stop_and_a_contact_in_a_delay_are_told_with_their_line(tmp_path: Path) -> None:
    compiler_or_skip()
    configuration = set_of(FAULTS / "lost_stop", tmp_path / "set")
    late = told(run_boards(configuration, 2.0, ((0.5, b"F"), (1.05, b"S"))).events)
    (stop,) = (each for each in late if each.text.startswith("the byte 'S' waited"))
    assert stop.subject == "lost_stop.ino:25"
    assert "board main was in delay() at lost_stop.ino:25; the robot went" in stop.text
    run = run_boards(configuration, 12.0, ((0.5, b"F"),))
    met = [
        each
        for each in told(run.events)
        if each.text.startswith("at the contact, board main was in delay() at")
    ]
    assert [each.subject for each in met] == ["lost_stop.ino:25"]


@pytest.mark.slow
def test_a_function_that_turns_instead_of_driving_ahead_is_told_when_it_runs(tmp_path: Path) -> None:
    compiler_or_skip()
    run = run_boards(set_of(FAULTS / "polarity", tmp_path / "set"), 1.5, ((0.5, b"F"),))
    (wrong,) = told(run.events)
    assert wrong.subject == "polarity.ino:16"
    assert "goForward() turns the robot right: motors[2] turns backward, at polarity.ino:16" in wrong.text
    sources = {each.command.source for each in run.events if isinstance(each, CommandResult)}
    assert "boards, main at polarity.ino:16" in sources, "the block that writes the pins"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "sent", "seconds", "fact", "about"),
    [
        (FAULTS / "lost_stop", ((0.5, b"F"), (1.05, b"S")), 2.0, "the byte 'S' waited", 1.2),
        (SAMPLE, ((0.5, b"g 20\n"),), 3.0, "board follower: an edge at pin 2 was lost", 0.7),
    ],
)
def test_a_fact_has_its_own_time_whatever_slices_are(
    source: Path, sent: Sent, seconds: float, fact: str, about: float, tmp_path: Path
) -> None:
    compiler_or_skip()
    configuration = set_of(source, tmp_path / "set") if source.parent == FAULTS else load(source)
    runs = [run_boards(configuration, seconds, sent, slice_length=each) for each in (100_000, 20_000_000)]
    first, last = (told(each.events) for each in runs)
    assert [(each.text, each.moment) for each in first] == [(each.text, each.moment) for each in last]
    (found,) = (each for each in first if each.text.startswith(fact))
    assert found.moment is not None
    assert found.moment == pytest.approx(about, abs=0.2)
    # They come in the order of their times, among all other events.
    times = [getattr(each, "moment", None) or getattr(each, "time", 0.0) for each in runs[0].events]
    assert times == sorted(times)
    assert repr(runs[0].events) == repr(runs[1].events)
    if source.parent == FAULTS:
        # The sketch reads the byte right before it stops the wheels.
        stops = [
            event.time
            for event in runs[0].events
            if isinstance(event, CommandResult) and event.command.text in ("ww-0;0", "ww-0.0;0.0")
        ]
        assert 0.0 < stops[-1] - found.moment < 0.001
