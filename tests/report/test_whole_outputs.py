"""Pages, pictures and tables are written whole or not at all."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import pytest

from simmer_tui.cli import log_reports
from simmer_tui.cli.main import main

pytestmark = pytest.mark.posix


def limited(monkeypatch: pytest.MonkeyPatch, before: bool, *words: str | Path) -> int:
    """The exit code of `simmer-tui` with a limit of 200 bytes a file: set before or after a log is opened,
    which unpacks its set."""
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)

    class Limited(log_reports.LogReader):
        def __init__(self, path: Path) -> None:
            if before:
                limit()
            super().__init__(path)
            limit()

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (200, usual[1]))

    monkeypatch.setattr(log_reports, "LogReader", Limited)
    try:
        return main([str(word) for word in words])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ("command", "option"),
    [
        ("report", "--html"),
        ("report", "--csv"),
        ("report", "--svg"),
        ("export", "--svg"),
        ("export", "--gif"),
    ],
)
def test_no_half_of_an_output_stays_behind(
    eventful_log: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: str,
    option: str,
) -> None:
    """A limit of the size of files is as good as a full disk."""
    out = tmp_path / "out" / "file"
    out.parent.mkdir()
    out.write_text("of the last time")
    assert limited(monkeypatch, False, command, eventful_log, option, out) == 2
    assert capsys.readouterr().err == f"simmer-tui {command}: {out} cannot be written: File too large\n"
    assert [(each.name, each.read_text()) for each in out.parent.iterdir()] == [("file", "of the last time")]


@pytest.mark.slow
@pytest.mark.parametrize("option", ["--html", "--csv", "--svg"])
def test_standard_output_takes_a_page(eventful_log: Path, tmp_path: Path, option: str) -> None:
    arguments = [sys.executable, "-m", "simmer_tui", "report", eventful_log, option, "/dev/stdout"]
    piped = subprocess.run(arguments, capture_output=True, check=True).stdout
    out = tmp_path / "out" / "file"
    out.parent.mkdir()
    with out.open("wb") as file:
        subprocess.run(arguments, stdout=file, check=True)
    assert b"Wrote /dev/stdout" in out.read_bytes()
    assert len(piped) > 600
    assert [*out.parent.iterdir()] == [out]


def test_a_log_whose_set_cannot_be_unpacked_is_one_line(
    eventful_log: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert limited(monkeypatch, True, "report", eventful_log) == 2
    what = "the set of the log cannot be unpacked into a temporary folder"
    assert capsys.readouterr().err == f"simmer-tui report: {what}: File too large\n"
