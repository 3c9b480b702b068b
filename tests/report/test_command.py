"""`simmer-tui report`: on the terminal, as a page, a picture and a table."""

from __future__ import annotations

import csv
import io
import re
import shlex
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from msgspec import structs
from rich.console import Console

from simmer_tui.cli.log_reports import build_report
from simmer_tui.cli.report_command import run_report
from simmer_tui.document.as_terminal import print_document
from simmer_tui.document.svg import PICTURE_WIDTH, shade
from simmer_tui.report.content import report_document, report_tables, svg_picture
from simmer_tui.report.page import report_page
from simmer_tui.robot.link_delay import LinkDelay
from simmer_tui.run.events import ActionName, Belief, CommandResult, MissionEvent, Notice, NoticeKind, Result
from simmer_tui.runlog.reader import Logged, LogReader
from simmer_tui.sim import Pose

SVG = "{http://www.w3.org/2000/svg}"


def test_the_terminal_shows_what_happened(eventful_log: Path, capsys: Any) -> None:
    assert run_report([str(eventful_log)]) == 0
    out, err = capsys.readouterr()
    for words in (
        "the robot touched the maze's outer wall at",
        "Commands",
        "Contacts",
        "Refused commands",
        "Belief",
        "Time by cell",
    ):
        assert words in out
    assert "[bold]</b>" in out
    assert "[red]is[/red]" in out
    assert err == ""


def test_commands_that_show_the_run_again_find_the_log_from_here(
    eventful_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    elsewhere = tmp_path / "else where"
    elsewhere.mkdir()
    log = elsewhere / eventful_log.name
    log.write_bytes(eventful_log.read_bytes())
    monkeypatch.chdir(elsewhere)
    monkeypatch.setenv("COLUMNS", "300")
    for given in (log.name, f"../else where/{log.name}"):
        assert run_report([given]) == 0
        assert f"simmer-tui replay {shlex.quote(given)}" in capsys.readouterr().out


def test_a_fault_that_ends_in_a_question_has_no_full_stop(
    start_run: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    run = start_run()
    run.send("u1")
    run.engine.tell(Notice(NoticeKind.FAULT, "dialect: 'gett' is no message; did you mean \"get\"?"))
    assert run_report([str(run.path)]) == 0
    assert 'did you mean "get"?' in capsys.readouterr().out


def test_another_seed_since_a_restart_is_named(start_run: Callable[..., Any]) -> None:
    run = start_run()
    run.send("d1-3")
    for seed in (2**128 - 1, run.simulator.seed):
        run.perform(ActionName.SEED, seed)
        told = [note for note in build_report(run.path).notes if "seed was" in note]
        assert told == [f"from 0.5 s on the seed was {2**128 - 1}"][: seed == 2**128 - 1]


def test_the_mission_is_in_the_report(start_run: Callable[..., Any], capsys: Any) -> None:
    run = start_run()
    run.engine.tell(MissionEvent(0.0, Result.UNDER_WAY, "mission: drop zone (30, 18)"))
    run.send("d1-3")
    run.engine.tell(MissionEvent(0.5, Result.FAILED, "mission: failed after 0.5 s: no time", "no time"))
    assert run_report([str(run.path)]) == 0
    out = capsys.readouterr().out
    assert "Mission" in out
    assert "drop zone (30, 18)" in out
    assert "failed after 0.5 s" in out


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize("width", [40, 80, 200])
def test_the_terminal_report_fits_its_width(eventful_log: Path, width: int) -> None:
    file = io.StringIO()
    print_document(report_document(build_report(eventful_log), "x"), Console(file=file, width=width))
    assert max(len(line) for line in file.getvalue().splitlines()) <= width


def test_nothing_but_ascii_where_there_is_nothing_else(eventful_log: Path) -> None:
    raw = io.BytesIO()
    file = io.TextIOWrapper(raw, encoding="ascii")
    print_document(report_document(build_report(eventful_log), "x"), Console(file=file, width=100))
    file.flush()
    assert b"Readings" in raw.getvalue() or b"readings" in raw.getvalue()


class Page(HTMLParser):
    """Collects the tags of a page and whether they pair up."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in ("meta", "wbr"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_is_whole_and_needs_nothing_else(eventful_log: Path, tmp_path: Path, capsys: Any) -> None:
    output = tmp_path / "run.html"
    assert run_report([str(eventful_log), "--html", str(output)]) == 0
    text = output.read_text(encoding="utf-8")
    page = Page()
    page.feed(text)
    assert page.open == []
    assert all(link.startswith("#t=") for link in page.links)
    assert not {"link", "img", "iframe"} & set(page.tags)
    assert text.count("<div class='picture ") == page.tags.count("script") == 2
    assert set(re.findall(r"https?://[^'\"]*", text)) == {"http://www.w3.org/2000/svg"}
    assert "&lt;script&gt;alert(1)" in text
    assert "touched the maze&#x27;s outer wall at (27.0, 48.0)" in text
    assert "@media print" in text


def test_the_picture_holds_path_contacts_belief_and_traces(eventful_log: Path, tmp_path: Path) -> None:
    output = tmp_path / "run.svg"
    assert run_report([str(eventful_log), "--svg", str(output)]) == 0
    root = ElementTree.parse(output).getroot()
    assert root.get("viewBox", "").split()[2] == f"{PICTURE_WIDTH:g}"
    words = ["".join(text.itertext()) for text in root.iter(f"{SVG}text")]
    for word in ("start", "end", "u1 ultra1", "g1 gyro1", "belief error", "contact, numbered in order"):
        assert word in words
    strokes = {group.get("stroke") for group in root.iter(f"{SVG}g")}
    assert len([stroke for stroke in strokes if stroke and stroke.startswith("#")]) > 5
    crosses = [path for path in root.iter(f"{SVG}path") if "l8 8m0 -8l-8 8" in path.get("d", "")]
    report = build_report(eventful_log)
    assert (
        len(crosses) == 2 * len(report.history.repeated.first.items) + 1
    )  # with a halo each, and one in the key


def test_the_drawn_path_lies_where_the_robot_went(start_run: Any) -> None:
    run = start_run()
    run.send("d1-20")
    root = ElementTree.fromstring(svg_picture(build_report(run.path), "x"))
    [line] = [
        element
        for group in root.iter(f"{SVG}g")
        for element in group.findall(f"{SVG}polyline")
        if group.get("stroke-width") == "2.4"
    ]
    first, *_, last = [tuple(map(float, pair.split(","))) for pair in line.get("points", "").split()]
    scale = (PICTURE_WIDTH - 48) / 96
    outcome = run.outcomes[0]
    assert first == pytest.approx((34 + 9.5 * scale, 8 + 6 * scale), abs=0.02)
    assert last == pytest.approx((34 + outcome.pose.x * scale, 8 + (48 - outcome.pose.y) * scale), abs=0.02)


def test_colours_go_from_dark_to_light() -> None:
    def light(fraction: float) -> float:
        red, green, blue = (int(shade(fraction)[i : i + 2], 16) for i in (1, 3, 5))
        return 0.3 * red + 0.6 * green + 0.1 * blue

    steps = [light(step / 10) for step in range(11)]
    assert steps == sorted(steps)


def test_the_table_has_a_row_a_command(eventful_log: Path, tmp_path: Path) -> None:
    output = tmp_path / "run.csv"
    assert run_report([str(eventful_log), "--csv", str(output)]) == 0
    with output.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    with LogReader(eventful_log) as log:
        told = [each for each in log if isinstance(each, Logged) and isinstance(each.event, CommandResult)]
    assert len(rows) == len(told)
    for row, logged in zip(rows, told, strict=True):
        outcome = logged.event
        assert isinstance(outcome, CommandResult)
        assert int(row["line"]) == logged.line
        units = ("x_in", "y_in", "heading_deg")
        assert [float(row[f"after_{unit}"]) for unit in units] == list(structs.astuple(outcome.pose))
        assert [float(row[f"before_{unit}"]) for unit in units] == list(structs.astuple(outcome.before))
        assert (row["status"], row["text"]) == (outcome.status.value, outcome.reason)
        assert float(row["real_time_s"]) == logged.real_time
        assert (row["contact_x_in"] != "") == (outcome.contact is not None)
    assert {row["reply"] for row in rows} >= {"inf", "nan"}
    assert "'=cmd()" in {row["command"] for row in rows}


@pytest.mark.parametrize("answer_at_end", [False, True])
@pytest.mark.parametrize("timed", [False, True])
def test_a_command_over_a_link_with_a_delay_has_one_row(
    start_run: Any, tmp_path: Path, timed: bool, answer_at_end: bool
) -> None:
    """Its answer is later than its end. The row has the contact as well."""
    run = start_run(timed=timed, answer_at_end=answer_at_end, link=LinkDelay(0.01, 0.02, 3))
    for text in ("d1-2", "u1", "d1-90", "u1"):
        run.send(text)
        run.loop.run_until(run.loop.now + 60.0)
    output = tmp_path / "run.csv"
    assert run_report([str(run.path), "--csv", str(output)]) == 0
    with output.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["command"] for row in rows] == ["d1-2", "u1", "d1-90", "u1"]
    assert [row["contact_x_in"] != "" for row in rows] == [False, False, True, False]


def test_instant_readings_alone_are_drawn_by_their_number(start_run: Any) -> None:
    run = start_run()
    run.send(*("u1",) * 30)
    page = report_page(build_report(run.path), "readings")
    assert "readings</text>" in page
    assert len(re.findall(r"M[\d.]+ [\d.]+h0", page)) == 30


def test_readings_in_motion_do_not_leave_time_to_wait(start_run: Any) -> None:
    notes = []
    for drive in ("vv-1;0;0", "d1-1"):
        run = start_run(f"{drive[:2]}.jsonl", link=LinkDelay(0.2, 0.0, 3))
        run.send(drive, "u1", "u1", "wt-1")
        [table] = [each for each in report_tables(build_report(run.path)) if each.key == "time_spent"]
        notes.append((sum(row[2] for row in table.rows) > 1.0, table.note.rpartition(". ")[2]))
    assert notes == [
        (True, "The robot also drove while it read and sent, so the shares add up to more than 100%."),
        (False, "In the remaining time the robot waited."),
    ]


def test_readings_alone_take_all_of_the_time_and_no_more(start_run: Any, configuration: Any) -> None:
    """0.1 s in single precision is more than 0.1 s."""
    sensors = tuple(structs.replace(sensor, read_time=0.1) for sensor in configuration.simulation.sensors)
    header, row, *_ = configuration.files["sensors.csv"].splitlines()
    run = start_run(sensors=sensors, files={"sensors.csv": f"{header},Read Time (s)\n{row},0.1\n"})
    run.send(*("u1",) * 30)
    [table] = [each for each in report_tables(build_report(run.path)) if each.key == "time_spent"]
    assert table.note.endswith(" In the remaining time the robot waited.")


@pytest.mark.parametrize(("gain", "off"), [("1", "true value"), ("1.3", "true value times Gain")])
def test_the_note_says_from_what_errors_of_readings_count(
    start_run: Any, configuration: Any, gain: str, off: str
) -> None:
    header, row, *_ = configuration.files["sensors.csv"].splitlines()
    run = start_run(files={"sensors.csv": f"{header},Gain\n{row},{gain}\n"})
    run.send("u1")
    [table] = [each for each in report_tables(build_report(run.path)) if each.key == "sensor_errors"]
    assert table.note.startswith(f"Reading minus {off}. ")


def test_one_missed_reading_is_one(start_run: Any, configuration: Any) -> None:
    sensors = tuple(structs.replace(sensor, dropout=1.0) for sensor in configuration.simulation.sensors)
    run = start_run(sensors=sensors)
    run.send("u1")
    [table] = [each for each in report_tables(build_report(run.path)) if each.key == "sensor_errors"]
    assert " 1 reading had a value where nothing was in range, or none where" in table.note


def test_infinite_readings_do_not_spoil_the_picture(start_run: Any, configuration: Any) -> None:
    from msgspec.structs import replace

    sensors = tuple(replace(sensor, max_range=10.0) for sensor in configuration.simulation.sensors)
    run = start_run(sensors=sensors)
    run.send("u1", "t1", "d1-2", "u1", "u3")
    text = svg_picture(build_report(run.path), "x")
    ElementTree.fromstring(text)
    assert not re.search(r"\b(nan|inf)\b", text)


@pytest.mark.parametrize("option", ["--svg", "--csv", "--html"])
def test_an_output_that_cannot_be_written_is_named(
    eventful_log: Path, tmp_path: Path, capsys: Any, option: str
) -> None:
    assert run_report([str(eventful_log), option, str(tmp_path / "no" / "out")]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_the_log_itself_is_not_overwritten(eventful_log: Path, tmp_path: Path, capsys: Any) -> None:
    before = eventful_log.read_bytes()
    assert run_report([str(eventful_log), "--csv", str(eventful_log)]) == 2
    assert "is named twice" in capsys.readouterr().err
    twice = str(tmp_path / "a.out")
    assert run_report([str(eventful_log), "--svg", twice, "--html", twice]) == 2
    assert eventful_log.read_bytes() == before


def test_what_is_no_log_is_refused(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("dear diary\n")
    assert run_report([str(path)]) == 2
    assert "is not a run log" in capsys.readouterr().err


def test_progress_shows_on_a_terminal_only(
    eventful_log: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    assert run_report([str(eventful_log)]) == 0
    assert capsys.readouterr().err == ""
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert run_report([str(eventful_log)]) == 0
    assert "report" in capsys.readouterr().err


def test_nothing_of_a_log_steers_the_terminal(start_run: Any, capsys: Any, tmp_path: Path) -> None:
    bad = "\x1b]52;c;Zm9v\x07 \x9b31m \ud800"
    run = start_run()
    run.send(f"u1{bad}", bad, "d1-60")
    run.engine.tell(Notice(NoticeKind.FAULT, bad))
    run.engine.tell(MissionEvent(0.5, Result.FAILED, bad, bad))
    run.engine.tell(Belief(0.5, Pose(1.0, 2.0, 3.0), Pose(1.0, 2.0, 3.0), note=bad))
    outputs = [str(tmp_path / name) for name in ("a.svg", "a.csv", "a.html")]
    options = [word for pair in zip(("--svg", "--csv", "--html"), outputs, strict=True) for word in pair]
    assert run_report([str(run.path), *options]) == 0
    texts = [capsys.readouterr().out, *(Path(name).read_text(encoding="utf-8") for name in outputs)]
    for text in texts:
        assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f]", text)
        assert "Zm9v" in text or "svg" in text
