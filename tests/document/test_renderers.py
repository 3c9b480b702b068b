"""One document, four renderers: values stay numbers, and text from outside stays data in each of them."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from simmer_tui.document.as_data import json_text, table_csv
from simmer_tui.document.as_html import embedded, html_page
from simmer_tui.document.as_terminal import print_document, print_table
from simmer_tui.document.formats import (
    COUNT_OR_BLANK,
    DURATION,
    ESTIMATE,
    HISTOGRAM,
    NUMBERS,
    PASSAGE,
    PLACE,
    POSE,
    QUOTED,
    SHARE,
    TEXT,
    WORDS,
    TextLink,
    estimate,
    number,
)
from simmer_tui.document.model import (
    Bullets,
    Code,
    DataColumn,
    DataTable,
    Document,
    Figure,
    Folded,
    KeyFigures,
    Paragraph,
    SectionHeading,
    ShareBar,
    SideBySide,
    Tone,
    VerdictBox,
)
from simmer_tui.report.content import REFUSED_COMMANDS
from simmer_tui.sim import Pose
from tests.report.browser import opened

RATE = SimpleNamespace(value=0.94, low=0.838, high=0.979)
COLUMNS = (
    DataColumn("time_s", number(".1f")),
    DataColumn("text", PASSAGE, "what", wraps=True),
    DataColumn("success_rate", ESTIMATE),
    DataColumn("end", POSE, "ended at"),
    DataColumn("code", hidden=True),
    DataColumn("shown", WORDS, "for people"),
)
TABLE = DataTable(
    "runs", "Runs", COLUMNS, [(1.25, "=1+1", RATE, Pose(1.0, 2.0, 3.0), "x", "hello"), (None,) * 6]
)
RECORD = DataTable("run", "Run", COLUMNS, [TABLE.rows[0]], "a note", record=True)


def terminal(document: Document, *, width: int = 200, encoding: str = "utf-8") -> str:
    raw = io.BytesIO()
    file = io.TextIOWrapper(raw, encoding=encoding)
    print_document(document, Console(file=file, width=width))
    file.flush()
    return raw.getvalue().decode(encoding)


def shown(*parts: object) -> Document:
    return Document("A title", parts)  # type: ignore[arg-type]


def test_numbers_stay_numbers_under_keys_with_units() -> None:
    answer = json.loads(
        json_text(shown(TABLE, RECORD, Paragraph("Done.", "answer"), Bullets("H", ["a"], "all")))
    )
    row = {
        "time_s": 1.25,
        "text": "=1+1",
        "success_rate": 0.94,
        "success_rate_low": 0.838,
        "success_rate_high": 0.979,
        "end_x_in": 1.0,
        "end_y_in": 2.0,
        "end_heading_deg": 3.0,
        "code": "x",
    }
    assert answer == {
        "text": {"run": "a note", "answer": "Done.", "all": ["a"]},
        "runs": [row, dict.fromkeys(row)],
        "run": row,
    }


def test_tables_of_one_key_are_one_to_programs() -> None:
    table = DataTable("runs", "Others", COLUMNS, [TABLE.rows[1]], "b")
    answer = json.loads(json_text(shown(DataTable("runs", "", COLUMNS, TABLE.rows, "a"), table)))
    assert (len(answer["runs"]), answer["text"]["runs"]) == (3, "a b")


def test_csv_has_a_header_of_keys_and_no_formula() -> None:
    rows = list(csv.DictReader(io.StringIO(table_csv(TABLE))))
    assert rows[0]["text"] == "'=1+1"
    assert (rows[0]["success_rate_low"], rows[0]["end_heading_deg"], rows[0]["code"]) == ("0.838", "3.0", "x")
    assert set(rows[1].values()) == {""}
    assert "shown" not in rows[0]


def test_people_see_headings_and_text() -> None:
    out = terminal(
        shown(TABLE, RECORD, Bullets("Found", [("See ", Code("it"), TextLink("there", "#a"))], "found"))
    )
    for words in (
        "time s",
        "what",
        "0.940 (0.838 to 0.979)",
        "(1.00, 2.00) heading 3.0 deg",
        "- See itthere",
    ):
        assert words in out
    assert "code" not in out
    page = html_page(shown(TABLE, RECORD, Paragraph((TextLink("there", "a.html"), Code("b")))))
    assert "<td class='n' data-label='time s'>1.2</td>" in page
    assert "<a href='a.html'>there</a><code>b</code>" in page


def test_hidden_tables_are_for_programs_only() -> None:
    document = shown(DataTable("runs", "Hidden", COLUMNS, TABLE.rows, hidden=True))
    assert "Hidden" not in terminal(document) + html_page(document)
    assert len(json.loads(json_text(document))["runs"]) == 2


def test_a_value_with_a_line_of_its_own_can_be_copied_from_a_terminal() -> None:
    columns = (DataColumn("text", wraps=True), DataColumn("replay", line=True))
    document = shown(DataTable("a", "A", columns, [("failed", "simmer-tui replay a/b.jsonl")]))
    assert "simmer-tui replay a/b.jsonl" in [line.strip() for line in terminal(document).splitlines()]


@pytest.mark.parametrize(
    ("form", "value", "text", "plain"),
    [
        (TEXT, "", "", [None]),
        (QUOTED, "", "", [None]),
        (COUNT_OR_BLANK, 0, "", [0]),
        (SHARE, 0.34, "34%", [0.34]),
        (DURATION, 12.345, "12.35 s", [12.345]),
        (DURATION, 200.0, "200 s (3 min 20 s)", [200.0]),
        (NUMBERS, list(range(10)), "0, 1, 2, 3, 4, 5, 6, 7 and 2 more", [list(range(10))]),
        (PLACE, (1.0, 2.5), "1.00, 2.50", [1.0, 2.5]),
        (ESTIMATE, SimpleNamespace(value=1.0, low=math.nan, high=math.nan), "1.000", None),
        (HISTOGRAM, [0, 1, 8], " ▁█", [[0, 1, 8]]),
        (number(".1f", " in"), 2.25, "2.2 in", [2.25]),
    ],
)
def test_formats_give_text_and_plain_values(
    form: object, value: object, text: str, plain: list[object]
) -> None:
    assert form.text(value) == text  # type: ignore[attr-defined]
    if plain is not None:
        assert list(form.plain(value)) == plain  # type: ignore[attr-defined]
    assert form.text(None) == ""  # type: ignore[attr-defined]


def test_histograms_are_ascii_where_there_is_nothing_else() -> None:
    table = DataTable("a", "A", (DataColumn("bars", HISTOGRAM),), [([0, 1, 8],)])
    assert " .@" in terminal(shown(table), encoding="ascii")


class Tags(HTMLParser):
    """Collects the tags of a page, and what its attributes are."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag != "wbr":  # a long word may be broken there: the only tag that depends on text
            self.tags.append(tag + ",".join(name for name, _ in attrs))


def hostile(text: str) -> Document:
    """A document with a text from outside wherever one can be."""
    columns = (
        DataColumn("a", heading=text),
        DataColumn("b", QUOTED),
        DataColumn("c", line=True),
        DataColumn("d"),
    )
    row = (text, text, text, TextLink(text, text, text))
    return Document(
        text,
        (
            DataTable("t", text, columns, [row], text),
            DataTable("r", text, columns, [row], record=True),
            Paragraph(text, "p", "note"),
            Paragraph((text, Code(text), TextLink(text, text, text))),
            Bullets(text, [text], "b"),
            SectionHeading(text),
            Figure(text, 10.0, 10.0, ""),
        ),
    )


def test_a_long_command_leaves_room_for_the_reason_why_it_was_refused() -> None:
    file = io.StringIO()
    rows = [(12.5, 3, "x" * 200, "no enabled drive has the code")]
    print_table(REFUSED_COMMANDS.filled(rows), Console(file=file, width=80))
    assert "12.50" in file.getvalue()
    assert "no enabled drive" in file.getvalue()


@settings(max_examples=12)
@given(
    st.text(min_size=1) | st.sampled_from(("<script>'\"&", "\x1b]0;x\x07", "[red]x[/red]", "‮abc", "=a\n+b"))
)
def test_text_from_outside_stays_data_in_every_renderer(text: str) -> None:
    document, harmless = hostile(text), hostile("x")
    page = html_page(document)
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f]", page)
    found, expected = Tags(), Tags()
    found.feed(page)
    expected.feed(html_page(harmless))
    assert found.tags == expected.tags
    assert '"' not in embedded(page).split('srcdoc="')[1].removesuffix('"></iframe>')
    file = io.StringIO()
    print_document(document, Console(file=file, width=60))
    assert not re.search("[\x00-\x09\x0b-\x1f\x7f-\x9f\ud800-\udfff]", file.getvalue())
    answer = json.loads(json_text(document))
    assert answer["text"]["p"] == answer["t"][0]["d"] == text
    table = next(part for part in document.parts if isinstance(part, DataTable))
    rows = list(csv.reader(io.StringIO(table_csv(table))))
    assert len(rows) == 2
    assert not any(cell.startswith(tuple("=+-@＝＋－＠")) for cell in rows[1])


def test_parts_within_others_are_parts_like_all_to_terminals_and_programs() -> None:
    box = VerdictBox(key="answer", text="Two of three.", headline="2 of 3", tone=Tone.MIXED)
    columns = SideBySide((TABLE,), (Folded("More", (RECORD,)),))
    only_on_pages = (KeyFigures((("2", "good"),)), ShareBar(((2, "good", Tone.GOOD),)))
    document = shown(box, *only_on_pages, columns)
    answer = json.loads(json_text(document))
    assert answer["text"] == {"answer": "Two of three.", "run": "a note"}
    assert answer["run"]["time_s"] == 1.25
    out = terminal(document)
    assert out.startswith("Two of three.\n")
    assert "a note" in out
    assert "good" not in out
    page = html_page(document)
    assert "<h1>2 of 3</h1><p>Two of three.</p>" in page
    assert "<details><summary>More</summary>" in page
    assert "✓ 2 good" in page


def test_only_long_words_may_be_broken_and_only_after_signs_and_digits() -> None:
    page = html_page(shown(Paragraph("see /home/somebody/course/run.jsonl and incomprehensibilities")))
    assert "/<wbr>home/<wbr>somebody/<wbr>course/<wbr>run.<wbr>jsonl" in page
    assert "incomprehensibilities" in page
    seed = html_page(shown(Paragraph(f"seed {2**127}")))  # as long as that of a grading
    assert str(2**127) in seed.replace("<wbr>", "")
    assert max(map(len, re.split("<wbr>|[ <>]", seed[seed.index("<body>") :]))) <= 20


def test_headings_are_not_repeated_not_nameless_and_not_parted_from_their_units() -> None:
    columns = (DataColumn("team"), DataColumn("main_cause", heading=""), DataColumn("median_time_s"))
    table = DataTable("grades", "Grades", columns, [("a", "b", "c")])
    page = html_page(shown(Folded("Grades", [table])))
    assert page.count(">Grades<") == 1
    assert "<th>team</th><th aria-label='main cause'></th><th>median time\N{NO-BREAK SPACE}s</th>" in page
    assert html_page(shown(Folded("More", [table]))).count(">Grades<") == 1


@pytest.mark.slow
def test_a_click_or_key_on_a_heading_sorts_the_rows_and_another_turns_them_around(tmp_path: Path) -> None:
    columns = (DataColumn("team"), DataColumn("rate", number(".1f")))
    rows = [("b", 0.25), ("c", 10.0), ("a", None), ("d", 9.0)]
    table = DataTable("grades", "Grades", columns, rows, sortable=True)
    script = """<script>
      const seen = [];
      for (const place of [1, 1, 0]) {
        document.querySelectorAll("th")[place].click();
        seen.push([...document.querySelectorAll("tbody tr")].map((row) => row.cells[0].textContent).join(""));
      }
      document.querySelectorAll("th")[1].dispatchEvent(new KeyboardEvent("keydown", { key: " " }));
      seen.push(document.querySelector("tbody tr").cells[0].textContent);
      document.title = seen.join(" ");
    </script>"""
    page = tmp_path / "page.html"
    page.write_text(html_page(shown(table), script=script), "utf-8")
    assert "<title>bdca cdba abcd b</title>" in opened(page)


def test_a_picture_with_links_keeps_them_for_screen_readers() -> None:
    linked = Figure("Ends", 10.0, 10.0, "<a href='run.html'><circle r='2'/></a>")
    assert " role='group' " in html_page(shown(linked))  # of an image they would be left out
    assert " role='img' " in html_page(shown(Figure("Ends", 10.0, 10.0, "<circle r='2'/>")))


def test_large_numbers_have_no_exponent() -> None:
    shown_mean, shown_difference = number(".4g"), estimate("+.3g")
    assert shown_mean.text(12345.6) == "12346"
    less = SimpleNamespace(value=-1140.4, low=-1330.0, high=-930.0)
    assert shown_difference.text(less) == "-1140 (-1330 to -930)"
    assert number(".1g").text(0.00002) == "2e-05"


def test_a_number_that_rounds_to_0_has_no_minus() -> None:
    assert [number(form).text(-0.04) for form in (".1f", ".0f", "+.1f", ".0%", "")] == (
        ["0.0", "0", "+0.0", "-4%", "-0.04"]
    )
    assert number("d").text(-3) == "-3"


def test_no_number_is_cut_where_a_table_is_wider_than_the_terminal() -> None:
    columns = (DataColumn("first"), DataColumn("second"), DataColumn("third", number()))
    table = DataTable("wide", "Wide", columns, [("a" * 30, "b" * 30, 12345)])
    said = terminal(shown(table), width=40)
    assert max(map(len, said.splitlines())) <= 40
    assert (said.count("a"), said.count("b")) == (30, 30)
    assert "12345" in said


def test_no_number_is_cut_beside_values_with_spaces() -> None:
    columns = (DataColumn("at", heading="robot at"), DataColumn("off"), DataColumn("why", wraps=True))
    values = "87.00, 41.12, 180.0", "-1.47e-06", "a wall"
    table = DataTable("wide", "", columns, [values])
    signs = Counter(filter(str.isalnum, "".join((*(column.title for column in columns), *values))))
    for width in range(15, 60):
        said = terminal(shown(table), width=width)
        assert max(map(len, said.splitlines())) <= width
        assert Counter(filter(str.isalnum, said)) == signs, width
