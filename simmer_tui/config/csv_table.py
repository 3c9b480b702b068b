"""CSV files as spreadsheets write them, read into rows with their line numbers; their IDs and codes."""

import csv
import io
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from msgspec import Struct

from simmer_tui import platform_has
from simmer_tui.config.given_path import other_case, similar_name
from simmer_tui.errors import Problem, reason_of
from simmer_tui.sim.columns import CsvColumn
from simmer_tui.sim.command import NUMBER, WORD, counted, cut, typed_path
from simmer_tui.sim.rules import CodeRule, IntegerRule, Rule, did_you_mean

T = TypeVar("T")

# A number with a decimal comma, as spreadsheets of some countries write it (0,5); never with a thousands
# separator.
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]+)?")
# A row added at the end: it is read back unchanged only if every quote before it is closed.
_END = "end of the file"
_NOTES = "a column of notes has a blank header"
# Excel reads this line and does not show it; other programs keep it as a first row.
_SEPARATOR = re.compile(r'"?sep=(?P<delimiter>[,;\t|:])"?(?P=delimiter)*[ \t]*(?=[\r\n]|$)', re.IGNORECASE)
# Python's csv ends rows with \r\n, and on Windows a file opened without newline='' makes \r\r\n of it.
_WINDOWS_END = re.compile("\r+\n")
# Excel's way to keep a code such as 01 a text.
_FORMULA_TEXT = re.compile(r'="([^"]*)"')
# The minus sign of Excel in Sweden, Norway and others, where a program expects a hyphen.
_MINUS = re.compile("\u2212(?=[0-9.,])")
# Zero-width spaces and marks, which spreadsheets and web pages leave inside cells.
_INVISIBLE = re.compile("[\u200b\u200e\u200f\u2060\ufeff]")
_DOS_END = "\x1a"
"""The last character of a file by older Windows programs."""
COMMENT = "#"
"""The first character of a row that is a comment."""


def read_text(path: Path, problems: list[Problem]) -> str | None:
    """The text of a UTF-8 file, without its byte-order mark; None, and a problem, if it cannot be read."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        folder = str(path.parent)
        what = f"is missing from {folder}; simmer-tui init DIR writes a complete set to start from"
        if other := _instead(path):
            what = f"is missing from {folder}, which has {other}"
        problems.append(Problem(path.name, what))
        return None
    except OSError as error:
        problems.append(Problem(path.name, f"cannot be read: {reason_of(error)}"))
        return None
    remedy = 'save it as "CSV UTF-8"' if path.suffix.lower() == ".csv" else "save it as UTF-8"
    # UTF-16, which spreadsheets save as "Unicode text", and workbooks with the wrong ending.
    if data.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in data:
        problems.append(Problem(path.name, f"is not UTF-8 text but UTF-16 or binary; {remedy}"))
        return None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        what = f"holds the byte 0x{data[error.start]:02x}, which is not UTF-8; {remedy}"
        problems.append(Problem(f"{path.name}:{line}", what))
        return None


# Files of spreadsheets, which they save as CSV.
_WORKBOOKS = (".xlsx", ".xls", ".xlsm", ".ods", ".numbers", ".gsheet")


def _instead(path: Path) -> str:
    """The file that is there in place of a missing one, and what to do; empty if there is none."""
    if other := other_case(path):
        return f"{cut(other)}: rename that, in small letters"
    other = similar_name(path)
    if not other:
        return ""
    if other.lower().endswith(_WORKBOOKS):
        return f'{cut(other)}: open that, and save it as "CSV UTF-8" with the name {path.name}'
    rename = "mv" if platform_has.POSIX else "ren"
    new = path if platform_has.POSIX else path.name
    return f"{cut(other)}: {rename} {typed_path(path.with_name(other))} {typed_path(new)}"


class CsvRow(Struct, frozen=True):
    """One row: the line it begins on and its cells, without spaces around or blank ones at the end."""

    line: int
    cells: tuple[str, ...]
    width: int = 0
    """Number of cells in the file, blank ones included."""

    def cell(self, index: int) -> str:
        """The cell's text, empty beyond the last."""
        return self.cells[index] if index < len(self.cells) else ""


class CsvTable(Struct, frozen=True):
    """A CSV file without the blank rows at its end. Every mistake is added to `problems`."""

    file: str
    rows: tuple[CsvRow, ...]
    problems: list[Problem]
    delimiter: str = ","

    def add_problem(self, row: CsvRow, column: int, what: str) -> None:
        """Add a problem with a cell; its column is named by letters, as in spreadsheets."""
        self.problems.append(Problem(f"{self.file}:{row.line}:{column_letters(column)}", what))

    def value(self, row: CsvRow, column: int, rule: Rule[T], name: str = "") -> T | None:
        """The value of a cell; None, and a problem, if it is missing or wrong."""
        try:
            return from_cell(rule, row.cell(column))
        except ValueError as error:
            self.add_problem(row, column, f"the {name} {error}" if name else str(error))
            return None


def column_letters(index: int) -> str:
    """The spreadsheet's name of a column: 0 is A, 25 Z, 26 AA."""
    letters = ""
    # The digits are 1 to 26, without a zero.
    index += 1
    while index:
        index, digit = divmod(index - 1, 26)
        letters = chr(ord("A") + digit) + letters
    return letters


def read_csv(path: Path, problems: list[Problem]) -> CsvTable | None:
    """Read a CSV file: UTF-8 with or without mark, any line ends, quotes, spaces around values.

    Semicolons or tabs may replace the commas, as in spreadsheets of many countries. Then a comma inside a
    number is its decimal point. Excel's first line `sep=;` names the character. Rows whose first cell begins
    with # are comments.
    """
    text = read_text(path, problems)
    if text is None:
        return None
    text, delimiter = _as_sheet(text)
    is_doubled = _has_doubled_ends(text)
    # The reader accepts a quote that is never closed, with the rest of the file inside it. The row after the
    # last line is then not read back unchanged.
    lines = [*io.StringIO(text, newline=""), "\n", _END]
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    rows: list[CsvRow] = []
    begin, begin_of_last, last = 1, 1, [_END]
    try:
        for last in reader:
            if not (last and last[0].lstrip().startswith(COMMENT)) and (last or not is_doubled):
                rows.append(CsvRow(begin, _clean(last, delimiter), len(last)))
            begin_of_last, begin = begin, reader.line_num + 1
    except csv.Error as error:
        problems.append(Problem(f"{path.name}:{reader.line_num}", f"is not CSV here: {error}"))
        return None
    if last != [_END]:
        problems.append(Problem(f"{path.name}:{begin_of_last}", 'a quote (") is opened and never closed'))
        return None
    rows.pop()
    while rows and not rows[-1].cells:
        rows.pop()
    if not rows:
        problems.append(Problem(f"{path.name}:1", "the file is empty"))
        return None
    return CsvTable(path.name, tuple(rows), problems, delimiter)


def delimiter_of(text: str) -> str:
    """The character between the cells of a CSV text."""
    return _as_sheet(text)[1]


def first_row(text: str) -> list[str]:
    """The cells of the first row of a CSV text, which may have mistakes further on."""
    text, delimiter = _as_sheet(text)
    line = next((line for line in text.splitlines() if line.strip() and not line.startswith(COMMENT)), "")
    return [cell.strip() for cell in line.split(delimiter)]


def _as_sheet(text: str) -> tuple[str, str]:
    """A CSV text with one line end a row and without what spreadsheets add, and the character between its
    cells. Every row keeps its line."""
    text = _WINDOWS_END.sub("\n", text.lstrip("\ufeff")).rstrip(_DOS_END)
    named = _SEPARATOR.match(text)
    if named is not None:
        # A comment in its place keeps the numbers of the lines.
        return COMMENT + text[named.end() :], named["delimiter"]
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip(' "').startswith(COMMENT)]
    # A comma in every line means that commas separate cells: notes may contain semicolons.
    for other in (";", "\t"):
        if lines and all(other in line for line in lines) and not all("," in line for line in lines):
            return text, other
    return text, ","


def _has_doubled_ends(text: str) -> bool:
    """True if an empty line follows every row, as after a conversion of line ends that were doubled."""
    lines = text.rstrip().splitlines()
    return len(lines) > 1 and all(bool(line) != index % 2 for index, line in enumerate(lines))


def plain_rows(text: str) -> list[list[str]]:
    """The rows of a valid CSV text, without spaces around cells, blank rows and comments."""
    text, delimiter = _as_sheet(text)
    rows = csv.reader(io.StringIO(text), delimiter=delimiter, skipinitialspace=True)
    cells = ([_clean_cell(cell) for cell in row] for row in rows)
    return [row for row in cells if any(row) and not row[0].startswith(COMMENT)]


def rows_by_header(text: str) -> list[dict[str, str]]:
    """The rows under the header of such a text, by column."""
    rows = plain_rows(text)
    return [dict(zip(rows[0], row, strict=False)) for row in rows[1:]]


def csv_text(rows: Iterable[Iterable[object]], delimiter: str = ",") -> str:
    """The text of a CSV file with these rows."""
    text = io.StringIO()
    csv.writer(text, delimiter=delimiter, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _clean(cells: Sequence[str], delimiter: str) -> tuple[str, ...]:
    cleaned = [_clean_cell(cell) for cell in cells]
    # A comma inside a cell is certainly a decimal point only if something else separates cells.
    if delimiter != ",":
        cleaned = [cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in cleaned]
    while cleaned and not cleaned[-1]:
        cleaned.pop()
    return tuple(cleaned)


def _clean_cell(cell: str) -> str:
    cell = _INVISIBLE.sub("", cell).strip()
    kept = _FORMULA_TEXT.fullmatch(cell)
    if kept is not None:
        return kept[1]
    return "-" + cell[1:] if _MINUS.match(cell) else cell


def read_grid(table: CsvTable, rule: IntegerRule) -> tuple[tuple[int, ...], ...] | None:
    """A rectangle of whole numbers; None, and problems, if it is not one."""
    before = len(table.problems)
    # The most frequent width counts as the right one, so that a single mistake is reported as one.
    width = Counter(len(row.cells) for row in table.rows).most_common(1)[0][0]
    grid: list[tuple[int, ...]] = []
    for row in table.rows:
        if len(row.cells) != width:
            has = f"the row has {counted(len(row.cells), 'cell')}, others have {width}"
            table.add_problem(row, min(len(row.cells), width), f"{has}; all rows must be equally long")
        values = [table.value(row, column, rule) for column in range(len(row.cells))]
        grid.append(tuple(value for value in values if value is not None))
    return tuple(grid) if len(table.problems) == before else None


class TableRow(Struct, frozen=True):
    """One row under a header, `FILE:LINE`. `values` has the text of each known column of the file. Every
    mistake is added to `problems`."""

    place: str
    line: int
    values: Mapping[str, str]
    problems: list[Problem]

    def add_problem(self, column: str, what: str) -> None:
        """Add a problem with a cell."""
        self.problems.append(Problem(f"{self.place}:{column}", what))

    def cells(self, columns: Iterable[CsvColumn]) -> dict[str, Any]:
        """The values of the cells that are filled, by field. A wrong cell, or a blank one that is needed, is
        a problem. A column missing in the file is not, because its header is already reported."""
        values: dict[str, Any] = {}
        for column in columns:
            text = self.values.get(column.name)
            if text or (text is not None and column.needed):
                try:
                    values[column.field] = from_cell(column.rule, text)
                except ValueError as error:
                    self.add_problem(column.name, str(error))
        return values

    def has(self, columns: Iterable[CsvColumn]) -> bool:
        """True if the file has all of these columns that are needed."""
        return all(column.name in self.values for column in columns if column.needed)

    def refuse(self, columns: Iterable[str], what: str) -> None:
        """Report cells that must be blank and are not."""
        for name in columns:
            if self.values.get(name):
                self.add_problem(name, what)


def headers_of(table: CsvTable) -> tuple[str, ...]:
    """The cells of the header row that are not blank, each once."""
    header = next((row for row in table.rows if row.cells), None)
    return tuple(dict.fromkeys(cell for cell in header.cells if cell)) if header is not None else ()


def read_table(table: CsvTable, required: Sequence[str], optional: Sequence[str]) -> tuple[TableRow, ...]:
    """The rows under a header row, columns found by name; blank rows are left out.

    Columns without a header are notes for people. Any other unknown, missing or doubled header is a problem.
    """
    begin = next(index for index, row in enumerate(table.rows) if row.cells)
    header = table.rows[begin]
    place = f"{table.file}:{header.line}"
    names = {_fold(name): name for name in (*required, *optional)}
    if not any(_fold(cell) in names for cell in header.cells):
        what = f"the first row must be the header row: {','.join(required)}"
        table.problems.append(Problem(place, what))
        return ()
    titles = TableRow(place, header.line, {}, table.problems)
    columns = _columns_by_name(titles, header.cells, names)
    for name in required:
        if name not in columns:
            titles.add_problem(name, "this column is missing from the header row")
    rows = []
    for row in table.rows[begin + 1 :]:
        # Notes beyond the header are words. Numbers there mean that commas have shifted the cells.
        extra = row.cells[header.width :]
        if extra and table.delimiter == "," and all(map(NUMBER.fullmatch, extra)):
            has = f"the row has {len(row.cells)} cells and the header {header.width}"
            what = f"{has}: a number with a decimal comma (0,05) is two cells; write 0.05 ({_NOTES})"
            table.problems.append(Problem(f"{table.file}:{row.line}", what))
            continue
        values = {name: row.cell(index) for name, index in columns.items()}
        if any(values.values()):
            rows.append(TableRow(f"{table.file}:{row.line}", row.line, values, table.problems))
    return tuple(rows)


def _columns_by_name(titles: TableRow, cells: Iterable[str], names: Mapping[str, str]) -> dict[str, int]:
    """The index of each known column; `names` are the known ones by their folded form."""
    columns: dict[str, int] = {}
    for index, cell in enumerate(cells):
        name = names.get(_fold(cell))
        if not cell:
            continue
        if name is None:
            hint = did_you_mean(cell, names.values()) or f"; known are {', '.join(names.values())}"
            what = f"is not a column that is known{hint} ({_NOTES})"
            titles.add_problem(cut(cell, WORD), what)
        elif name in columns:
            first = column_letters(columns[name])
            what = f"is a column already (column {first}); each column must occur once"
            titles.add_problem(cut(cell, WORD), what)
        else:
            columns[name] = index
    return columns


def from_cell(rule: Rule[T], text: str) -> T:
    """The value of a cell. Raises ValueError if it is blank or not allowed."""
    if not text:
        raise ValueError(f"is blank; must be {rule.allowed}")
    try:
        return rule.from_text(text)
    except ValueError as error:
        if _DECIMAL_COMMA.fullmatch(text):
            raise ValueError(f"{error}; write {text.replace(',', '.')}") from None
        raise


def _fold(header: str) -> str:
    return " ".join(header.casefold().split())


# -- sensors.csv and drive.csv --------------------------------------------------------------------

ID = "ID"
POLL_CHARACTER = "Poll Character"
CODE = CsvColumn(
    CodeRule(),
    "code that a program sends: two characters, in no other row of sensors.csv or drive.csv",
    *("", POLL_CHARACTER, "code"),
    needed=True,
)
ENABLED = CsvColumn(
    IntegerRule(0, 1, "0 (off) or 1 (on)"),
    "1: the robot has it; 0: commands to it are refused",
    *("", "Enabled", "enabled"),
    needed=True,
)
"""The first three columns of sensors.csv and drive.csv are ID, code (unique across both files) and flag."""


def read_flags(row: TableRow, codes: dict[str, str]) -> dict[str, Any]:
    """The code and the flag of a row, by field. The code is added to `codes` (code to place), so that no
    later row can have it."""
    values = row.cells((CODE, ENABLED))
    if "enabled" in values:
        values["enabled"] = values["enabled"] == 1
    code = values.get("code")
    if code is None:
        return values
    if code in codes:
        what = f'"{code}" is the code of {codes[code]} already; codes must be unique over both files'
        row.add_problem(POLL_CHARACTER, what)
    # The first row keeps the code: the messages about later ones name its place.
    codes.setdefault(code, row.place)
    return values


def claim_id(name: str, row: TableRow, seen: dict[str, int]) -> bool:
    """True if no earlier row has the ID `name`; `seen` has the line of each."""
    if name in seen:
        row.add_problem(ID, f'"{name}" is in line {seen[name]} already; every ID must occur once')
        return False
    seen[name] = row.line
    return True
