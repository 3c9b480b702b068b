"""The console's history: moving in it, and its file."""

from __future__ import annotations

from pathlib import Path

from simmer_tui.tui.console import KEPT, History, default_history_file


def test_back_and_forward_come_home_to_the_draft(tmp_path: Path) -> None:
    history = History(tmp_path / "h.txt")
    assert history.back("draft") == "draft"
    for line in ("one", "two", "two", "  ", "three"):
        history.add(line)
    assert [history.back("draft") for _ in range(4)] == ["three", "two", "one", "one"]
    assert [history.forward() for _ in range(4)] == ["two", "three", "draft", "draft"]


def test_the_next_session_reads_what_was_kept_and_only_so_much(tmp_path: Path) -> None:
    file = tmp_path / "a" / "b" / "h.txt"
    history = History(file)
    for number in range(KEPT + 10):
        history.add(f"line {number} é")
    again = History(file)
    assert again.back("") == f"line {KEPT + 9} é"
    assert len(file.read_text(encoding="utf-8").splitlines()) == KEPT


def test_a_file_that_cannot_be_used_is_done_without(tmp_path: Path) -> None:
    in_the_way = tmp_path / "file"
    in_the_way.write_bytes(b"\xff\xfe one\n")
    assert History(in_the_way).back("") != ""
    history = History(in_the_way / "h.txt")
    history.add("one")
    history.add("two")
    assert history.back("") == "two"
    without = History(None)
    without.add("one")
    assert without.back("") == "one"


def test_the_usual_file_is_the_programs_own() -> None:
    assert "simmer-tui" in default_history_file().parts
