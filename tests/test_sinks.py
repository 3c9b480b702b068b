"""Text from outside where it is shown: control characters and direction marks are escaped in each place."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Mapping
from html import unescape
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from simmer_tui.cli.command_line import print_lines, report, say
from simmer_tui.cli.main import main
from simmer_tui.config.importer.simmer_python import read_simmer_python
from simmer_tui.config.sets import bundled_folder, init_set
from simmer_tui.document.as_data import json_text, table_csv
from simmer_tui.document.as_html import html_page
from simmer_tui.document.as_terminal import print_document
from simmer_tui.document.formats import TEXT
from simmer_tui.document.model import Bullets, DataColumn, DataTable, Document, Paragraph, Tone, VerdictBox
from simmer_tui.document.svg import text as svg_text
from simmer_tui.errors import ConfigurationError, Problem, RunLogError, SimmerError
from simmer_tui.runlog.header import parse_header
from simmer_tui.tui.help import folded
from simmer_tui.tui.line_panel import text_of
from simmer_tui.tui.maze.glyphs import blank_cells
from simmer_tui.tui.textual_internals import as_plain

NAME = "\x1b]0;X\x07\u202e\x9b2J\r\x00\udcff"
"""A name that sets a terminal's title, turns its text round, clears it, and is no UTF-8."""


def on_terminal(text: str) -> str:
    file = io.StringIO()
    print_document(documented(text), Console(file=file, width=200))
    return file.getvalue()


def documented(text: str) -> Document:
    table = DataTable("t", text, (DataColumn(text, TEXT),), ((text,),), note=text)
    parts = (
        Paragraph(text, "p"),
        VerdictBox(headline=text, text=text, key="v", tone=Tone.BAD),
        Bullets(text, (text,), "b"),
        table,
    )
    return Document(text, parts)


def in_stream(text: str) -> str:
    file = io.StringIO()
    say(text, file)
    return file.getvalue()


def in_cells(text: str) -> str:
    cells = blank_cells(1, 200)
    cells.write(0, 0, text)
    return "".join(map(chr, cells.characters[0]))


SINKS: Mapping[str, Callable[[str], str]] = {
    "a line": in_stream,
    "an error": lambda text: str(SimmerError(text)),
    "a problem": lambda text: str(ConfigurationError([Problem(text, text)])),
    "a terminal": on_terminal,
    "a page": lambda text: unescape(html_page(documented(text))).replace("\N{NO-BREAK SPACE}", " "),
    "a picture": lambda text: svg_text(0, 0, text),
    "JSON": lambda text: json_text(documented(text)),
    "CSV": lambda text: table_csv(DataTable("t", "", (DataColumn("t", TEXT),), ((text,),))),
    "a panel": lambda text: text_of(((text, "plain"),)),
    "help": lambda text: folded(text, 60),
    "a title": lambda text: str(as_plain(text)),
    "the maze": in_cells,
}


def is_safe(shown: str) -> bool:
    return all(each.isprintable() for each in shown.split("\n"))


@pytest.mark.parametrize("sink", SINKS)
@given(text=st.text(max_size=20) | st.just(NAME))
def test_no_sink_lets_a_control_character_through(sink: str, text: str) -> None:
    assert is_safe(SINKS[sink](text))


def messages(tmp_path: Path) -> list[SimmerError | Problem]:
    """Messages of sets, of a dialect, of an import and of a log, all about this name."""
    name = NAME.replace("\udcff", "")
    told: list[SimmerError | Problem] = []
    sets = {
        "sensors.csv": f"{name},b\n{name},u1\n",
        "drive.csv": f"Direction,{name}\n{name},d1\n",
        "maze.csv": f"1,{name}\n2,1\n",
        "settings.toml": f"{json.dumps(name)} = 3\nserver.host = {json.dumps(name)}\n",
        "keys.toml": f"x = {json.dumps(name)}\n",
        "dialect.toml": f"[[command]]\nmatch = {json.dumps(name)}\ndo = {json.dumps(name)}\n",
    }
    for number, (file, text) in enumerate(sets.items()):
        folder = tmp_path / str(number)
        init_set(folder, bundled_folder())
        (folder / file).write_text(text)
        try:
            main(["check", str(folder)])
        except ConfigurationError as error:
            told.append(error)
    told += read_simmer_python(f"sensors = {{{name!r}: Thing({{}})}}").left_out
    header = {"kind": "header", "format": name, "program": name}
    with pytest.raises(RunLogError) as caught:
        parse_header(json.dumps(header).encode(), name)
    return [*told, caught.value]


def test_messages_about_hostile_names_are_safe_in_every_sink(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = messages(tmp_path)
    assert len(told) >= 2
    for message in told:
        raw = f"{message.where}: {message.what}" if isinstance(message, Problem) else str(message.args[0])
        for sink, shown in SINKS.items():
            assert is_safe(shown(raw)), (sink, raw)
            assert is_safe(shown(str(message))), (sink, raw)
    printed = capsys.readouterr()
    assert re.search(r"\\x1b\]0;X", printed.err + printed.out)
    assert is_safe(printed.err + printed.out)


def test_what_check_prints_of_a_dialect_cannot_control_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    init_set(tmp_path / "set", bundled_folder())
    reply = json.dumps("\x1b]0;X\x07")
    text = f'[[command]]\nmatch = "a"\ndo = "u1"\nreply = {reply}\n'
    (tmp_path / "set" / "dialect.toml").write_text(text)
    main(["check", str(tmp_path / "set")])
    printed = capsys.readouterr()
    assert is_safe(printed.out + printed.err)


def test_lines_are_printed_whole(capsys: pytest.CaptureFixture[str]) -> None:
    print_lines("one\x1b", "two\nthree")
    report(RunLogError("four\x07"))
    printed = capsys.readouterr()
    assert (printed.out, printed.err) == ("one\\x1b\ntwo\\nthree\n", "simmer-tui: four\\x07\n")
