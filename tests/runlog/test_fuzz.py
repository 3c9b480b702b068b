"""A thousand damaged logs: whatever stands in a log, it is read, shown, reported and run again, or
refused with a message, and nothing of it reaches a terminal or a page unescaped."""

from __future__ import annotations

import io
import json
import random
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from rich.console import Console

from simmer_tui.document.as_terminal import print_document
from simmer_tui.errors import SimmerError
from simmer_tui.live.snapshot import LogEntry
from simmer_tui.report.content import report_document, svg_picture
from simmer_tui.report.page import report_page
from simmer_tui.report.run_statistics import CommandTable, RunStatistics
from simmer_tui.runlog import playback, reader
from simmer_tui.runlog.header import Header, rebuild
from simmer_tui.runlog.index import EntryFlag, RunLogIndex
from simmer_tui.runlog.playback import Playback
from simmer_tui.runlog.reader import Logged, LogReader
from simmer_tui.runlog.rerun import Rerun
from simmer_tui.tui.event_text import entry_line
from simmer_tui.tui.line_panel import text_of

ALL_OF_IT = 25
"""Every so many-th case is printed and drawn as well."""
CORPUS = sorted((Path(__file__).parent / "corpus").glob("*.jsonl"))
"""Logs that once did harm."""
VALUES: tuple[object, ...] = (
    "\x1b]52;c;Zm9v\x07", "\ud800", "\x9b31m", "<b>&'\"", "[red]", "inf", "nan", "", "u1", "d1-3", "xx",
    "done", "stopped", "header", 0, -1, 1, 7, 10**30, 1e308, -1e308, 5e-324, 1e13, 0.5, None, True, [], {},
    [1.0, 2.0, 3.0], [[0.0, 0.0]], {"t": 0.0, "at": [99, 0.5, 0.5], "point": [1.0, 2.0]},
)  # fmt: skip
RAW = (
    b"1e999",
    b"Infinity",
    b"NaN",
    b"-1e400",
    b'"\\ud800"',
    b"9" * 400,
    b'"\\u001b[2J"',
    b"{",
    b"]",
    b"\x00",
)
UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")


@pytest.fixture(autouse=True)
def quick_rebuild(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hardly any case changes the configuration: it is read once."""

    made: dict[str, Any] = {}

    def cached(header: Header) -> Any:
        key = repr((header.files, header.settings, header.configuration))
        if key not in made:
            made[key] = rebuild(header)
        return made[key]

    for module in (reader, playback):
        monkeypatch.setattr(module, "rebuild", cached)


def damaged(lines: list[bytes], chance: random.Random) -> bytes:
    """A log with something wrong in it."""
    lines = list(lines)
    for _ in range(chance.choice((1, 1, 2, 5))):
        place = chance.randrange(1, len(lines)) if chance.random() < 0.93 else 0
        line = lines[place]
        match chance.randrange(8):
            case 0:
                lines[place] = line[: chance.randrange(len(line))] + b"\n"
            case 1:
                spot = chance.randrange(len(line))
                lines[place] = line[:spot] + bytes((chance.randrange(256),)) + line[spot + 1 :]
            case 2:
                del lines[place]
                lines = lines or [b"\n"]
            case 3:
                lines.insert(place, chance.choice(lines))
            case 4:
                numbers = list(re.finditer(rb"(?<=[:\[,])-?\d[\d.e+-]*", line))
                if numbers:
                    found = chance.choice(numbers)
                    lines[place] = line[: found.start()] + chance.choice(RAW) + line[found.end() :]
            case _:
                lines[place] = with_other_field(line, chance)
        if len(lines) < 2:
            break
    return b"".join(lines)


def with_other_field(line: bytes, chance: random.Random) -> bytes:
    try:
        fields = json.loads(line)
    except ValueError:
        return line
    if not isinstance(fields, dict) or not fields:
        return line
    inner, name = fields, chance.choice(list(fields))
    while isinstance(inner[name], dict) and inner[name] and chance.random() < 0.7:
        inner, name = inner[name], chance.choice(list(inner[name]))
    if chance.random() < 0.1:
        del inner[name]
    else:
        inner[name] = chance.choice(VALUES)
    return json.dumps(fields, separators=(",", ":")).encode() + b"\n"


def go_through(path: Path, *, all_of_it: bool) -> None:
    """Do all that is done with logs. Raises nothing but what the command line shows in one line."""
    for work in (index_and_play, lambda path: report(path, all_of_it), run_again):
        try:
            shown = work(path)
        except SimmerError as error:
            shown = [str(error)]
        for text in shown:
            assert not UNSAFE.search(text), text


def index_and_play(path: Path) -> list[str]:
    with RunLogIndex(path) as log:
        run = Playback(log)
        chance = random.Random(1)
        for _ in range(6):
            elapsed = chance.uniform(0.0, log.duration)
            run.state_at(log.find_time(elapsed), elapsed)
        run.state_at(log.count - 1)
        for flags in (EntryFlag.CONTACT, EntryFlag.FAULTY, EntryFlag.COMMAND):
            log.find_next(-1, flags)
        told = (each for each in run.events(0, log.count) if isinstance(each, Logged))
        return [
            log.note,
            *(text_of(entry_line(LogEntry(each.line, each.real_time, each.event))) for each in told),
        ]


def report(path: Path, all_of_it: bool) -> list[str]:
    table = io.StringIO()
    with LogReader(path) as log:
        run = RunStatistics(log.header, log.configuration)
        commands = CommandTable(table)
        for each in log:
            run.add((each,))
            if isinstance(each, Logged):
                commands.add(each, run.history.elapsed)
    run.finish(log.note)
    shown = [table.getvalue()]
    if all_of_it:
        terminal = io.StringIO()
        print_document(report_document(run, "x"), Console(file=terminal, width=100))
        page, picture = report_page(run, "x"), svg_picture(run, "x")
        ElementTree.fromstring(picture)
        assert not re.search(r"[ '](?:nan|-?inf)[ ',]", picture)
        shown += [terminal.getvalue(), page, picture]
    return shown


def run_again(path: Path) -> list[str]:
    with Rerun(path) as run:
        for _ in run.steps():
            pass
    return [*run.notes, str(run.difference)]


@pytest.mark.parametrize("cases", [12, pytest.param(1000, marks=pytest.mark.slow)])
def test_damaged_logs(cases: int, random_run: Callable[..., Any], varied_log: Path, tmp_path: Path) -> None:
    lines = [path.read_bytes().splitlines(keepends=True) for path in real_logs(random_run, varied_log)]
    path = tmp_path / "damaged.jsonl"
    for case in range(cases):
        chance = random.Random(case)
        path.write_bytes(damaged(chance.choice(lines), chance))
        try:
            go_through(path, all_of_it=case % ALL_OF_IT == 0)
        except Exception as error:
            error.add_note(f"case {case}: {path.read_bytes()[-2000:]!r}")
            raise


def real_logs(random_run: Callable[..., Any], varied_log: Path) -> Iterator[Path]:
    yield varied_log
    for timed in (True, False):
        yield random_run(5, timed=timed, answer_at_end=not timed, steps=15).path


@pytest.mark.parametrize("name", [path.name for path in CORPUS])
def test_logs_that_once_did_harm(name: str) -> None:
    go_through(Path(__file__).parent / "corpus" / name, all_of_it=True)
