"""Every sort of crash, with its error and its line, wherever a run is told of."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from simmer_tui.cli.report_command import run_report
from simmer_tui.cli.trials_command import run_trials
from tests.in_process import simmer
from tests.program.crash_kinds import KINDS, QUICK, CrashKind
from tests.tui.test_tmux import Pane

SECONDS = 300.0


@pytest.fixture(
    params=[name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in KINDS]
)
def kind(request: pytest.FixtureRequest) -> CrashKind:
    found = KINDS[request.param]
    if not found.is_possible:
        pytest.skip(f"{found.needs} is not installed")
    return found


def read(page: Path) -> str:
    """The text of a page that a reader sees."""
    without = re.sub(r"<(style|script)\b.*?</\1>", "", page.read_text("utf-8"), flags=re.S)
    return html.unescape(re.sub(r"<wbr>|<[^>]*>", lambda tag: "" if "wbr" in tag[0] else " ", without))


def check(kind: CrashKind, text: str) -> None:
    """All that must be said is there, in its order, however the lines are wrapped."""
    words = " ".join(text.split())
    place = 0
    for part in kind.said:
        found = words.lower().find(part.lower(), place)
        assert found >= 0, f"{part!r} is not in {words[:600]}"
        place = found + len(part)


@pytest.mark.parametrize(
    "mission", [("--mission",), pytest.param((), marks=pytest.mark.slow)], ids=["mission", "no mission"]
)
def test_last_line_report_page_and_json_have_a_crash(
    kind: CrashKind, mission: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, page = tmp_path / "run.jsonl", tmp_path / "run.html"
    done = simmer("--no-ui", *mission, "--port", "0", "--log", log, "--run", kind.made(tmp_path))
    last = done.stderr.splitlines()[-1]
    assert last.startswith("verdict: ")
    check(kind, last)
    assert run_report([str(log), "--html", str(page)]) == 0
    assert run_report([str(log)]) == 0
    text = " ".join(capsys.readouterr().out.split())
    check(kind, text)
    check(kind, read(page))
    assert run_report([str(log), "--json"]) == 0
    verdict = json.loads(capsys.readouterr().out)["verdict"]
    assert f"verdict: {verdict['text']}" == last
    # A mission, and a run in which nothing was sent, have failed whatever the program says.
    code = verdict["program"]["exit_code"]
    assert done.returncode == (1 if not code or (mission and "nosuch" not in kind.command) else code)


def test_trials_have_a_crash_on_their_page_in_their_results_and_json(
    kind: CrashKind, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    command, out = kind.made(tmp_path), tmp_path / "out"
    options = ["--config", "mission", "--runs", "1", "--jobs", "1", "--seed", "1", "--json"]
    code = run_trials([*options, "--out", str(out), "--run", command])
    printed, told = capfd.readouterr()
    if "nosuch" in kind.command:
        assert code == 2
        assert "there is no file" in told, "none of the runs can be done"
        return
    [failed] = json.loads(printed)["failed"]
    check(kind, failed["text"])
    [line] = (out / "results.jsonl").read_text().splitlines()
    assert json.loads(line)["verdict"]["text"] == failed["text"]
    check(kind, read(out / "report.html"))


@pytest.fixture
def pane(tmp_path: Path) -> Iterator[Pane]:
    pytest.importorskip("pty")
    made = Pane(tmp_path)
    yield made
    made.close()


@pytest.mark.slow
def test_the_screen_has_a_crash(kind: CrashKind, pane: Pane, tmp_path: Path) -> None:
    pane.start("--mission", "--run", kind.made(tmp_path), size=(200, 60))
    if "nosuch" in kind.command:
        pane.until("nosuch", "there is no file", "EXIT 127")
        return
    first, *_ = kind.said
    # Columns stand side by side: words of a sentence that was wrapped are looked for one by one.
    pane.until("verdict", *first.split())
    pane.type(":why", "Enter")
    pane.until("Esc closes", *(word for part in kind.said for word in part.split()))
