"""The cards beside the maze, as lines for a room."""

from __future__ import annotations

from simmer_tui.run.events import OutputLine, ProgramEnded
from simmer_tui.sim.specs import Axes, DriveKind
from simmer_tui.tui.answers import bias_answer, first_steps, program_output
from simmer_tui.tui.help import folded
from simmer_tui.tui.line_panel import text_of
from simmer_tui.tui.readouts import Room


def test_where_lines_are_left_out_the_last_one_is_not_the_tail_of_a_line() -> None:
    card = first_steps("F5", "d1-3", "w a s d")
    shown = [text_of(line) for line in card.shown(Room(60, plain=False, rows=3))]
    assert len(shown) == 3
    assert shown[-1].startswith(" 3 or press Esc, then w a s d drives")
    assert max(map(len, shown)) <= 60


def test_the_first_steps_are_commands_that_can_be_typed_anywhere() -> None:
    shown = [text_of(line).strip() for line in first_steps("F5", "d1-3", "w a s d").lines]
    at = shown.index("simmer-tui examples samples")
    assert shown[at + 1] == "python samples/wander.py"


def test_the_bias_of_every_drive_has_room_on_the_smallest_screen() -> None:
    bias = {kind: Axes(0.01 * n, -0.3, 0.7) for n, kind in enumerate(DriveKind)}
    shown = [text_of(line) for line in bias_answer(bias).shown(Room(78, plain=False, rows=3))]
    assert len(shown) == 3
    assert max(map(len, shown)) <= 78
    for number, kind in enumerate(bias):
        assert f"{kind.value} {0.01 * number:+.4f}" in shown[0]


def test_a_program_s_last_lines_are_whole_in_a_narrow_room_and_an_empty_output_is_left_out() -> None:
    error = "InvalidInputError: 'u99' is no command code: a code is exactly two printable ASCII characters"
    told = ("Traceback (most recent call last):", '  File "robot.py", line 4, in <module>', error)
    ended = ProgramEnded(0.5, 1, stderr=tuple(OutputLine(0.5, line) for line in told))
    shown = folded(program_output(ended), 60).splitlines()
    assert max(map(len, shown)) <= 60
    assert error in " ".join(" ".join(shown).split())
    assert '    File "robot.py", line 4, in <module>' in shown
    assert not any("standard output" in line for line in shown)
    assert program_output(ProgramEnded(0.5, 1)) == "The program printed nothing."


def test_the_first_steps_name_a_port_that_programs_do_not_know() -> None:
    for example in ("F5", ""):
        usual = first_steps(example, "d1-3", "w a s d")
        assert not any("SIMMER_PORT" in text_of(line) for line in (*usual.lines, *usual.brief))
        other = first_steps(example, "d1-3", "w a s d", "SIMMER_PORT=41843")
        assert any(text_of(line).strip() == "with SIMMER_PORT=41843" for line in other.lines)
        assert "with SIMMER_PORT=41843" in text_of(other.brief[0])
        assert len(text_of(other.brief[0])) <= 78
