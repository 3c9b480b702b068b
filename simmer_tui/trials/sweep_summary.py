"""A sweep as a document: success against each value, and the largest with which a program keeps a rate."""

from __future__ import annotations

from msgspec.structs import replace

from simmer_tui.document import svg
from simmer_tui.document.as_data import table_csv
from simmer_tui.document.formats import COUNT, ESTIMATE, LENGTH
from simmer_tui.document.model import (
    DataColumn,
    DataTable,
    Document,
    DocumentPart,
    Figure,
    Paragraph,
    Tone,
    VerdictBox,
    data_table,
)
from simmer_tui.document.svg import PICTURE_WIDTH
from simmer_tui.sim.command import WORD, cut
from simmer_tui.trials.curves import Curve, SweepValue, curves
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.intervals import median
from simmer_tui.trials.sweep import SWEPT
from simmer_tui.trials.trials_page import run_line
from simmer_tui.trials.trials_summary import runs_table

CURVES = "sweep.csv"
SWEEP = data_table(
    "sweep",
    "Sweep",
    DataColumn("setting", hidden=True),
    DataColumn("value", SWEPT),
    DataColumn("runs", COUNT),
    DataColumn("successes", COUNT),
    DataColumn("success_rate", ESTIMATE),
    DataColumn("median_time_s", LENGTH),
    DataColumn("contacts", COUNT),
)


def sweep_tables(folder: TrialFolder, wanted: float) -> list[DataTable]:
    """A table for all that is varied, with the answer below it."""
    return [
        replace(
            SWEEP.filled([_row(curve, each) for each in curve.values], answer(curve, wanted)),
            title=f"Success against {cut(curve.name)}",
        )
        for curve in curves(folder)
    ]


def _row(curve: Curve, point: SweepValue) -> tuple[object, ...]:
    results = point.results
    times = [result.time for result in results if result.success]
    contacts = sum(result.contacts for result in results)
    return curve.name, point.value, len(results), len(times), point.rate, median(times), contacts


def answer(curve: Curve, wanted: float) -> str:
    """Sentence about the largest value with which the program keeps a success rate."""
    name, places, kept = cut(curve.name), curve.values, curve.kept(wanted)
    if not curve.is_of_numbers:
        good = ", ".join(cut(place.value) for place in kept) or "none of the values"
        return f"The program keeps a success rate of {wanted:g} with {good} of {name}."
    if not kept:
        first = places[0]
        return (
            f"The program does not keep a success rate of {wanted:g} even with {name} at "
            f"{cut(first.value)}, where it is {ESTIMATE.text(first.rate)}."
        )
    last = kept[-1]
    said = (
        f"The program keeps a success rate of {wanted:g} with {name} up to {cut(last.value)}, where "
        f"it is {ESTIMATE.text(last.rate)}"
    )
    if len(kept) < len(places):
        beyond = places[len(kept)]
        said += f"; at {cut(beyond.value)} it is {ESTIMATE.text(beyond.rate)}."
    else:
        said += ", and no greater value was tried."
    if last.rate.low < wanted:
        said += f" {len(last.results)} runs of {cut(last.value)} do not rule out less than {wanted:g}."
    return said


def curves_csv(folder: TrialFolder) -> str:
    """All curves, a row a value: sweep.csv."""
    rows = [_row(curve, each) for curve in curves(folder) for each in curve.values]
    return table_csv(SWEEP.filled(rows))


# Points: room around the curve, and its height.
_LEFT, _RIGHT, _TOP, _HEIGHT, _BELOW = 60.0, 40.0, 16.0, 240.0, 44.0
_CAP = 5.0
"""Half the width of an interval's ends, points."""
_LABEL = 30.0
"""Room for the label of a value, points; a label without room is left out, and is in the table."""
_CURVE = "#3066e4"  # of a robot's path, which the page has in a lighter blue where it is dark


def sweep_document(folder: TrialFolder, wanted: float) -> Document:
    """The runs of a sweep that are done, for terminals and programs; there must be one."""
    tables = sweep_tables(folder, wanted)
    return Document(_title(folder), (*tables, _INTERVALS, runs_table(folder)))


def sweep_page(folder: TrialFolder, wanted: float) -> Document:
    """The page of a sweep: the number of values that keep the rate, and a curve for each name."""
    found = curves(folder)
    tried = sum(len(curve.values) for curve in found)
    kept = sum(len(curve.kept(wanted)) for curve in found)
    text = " ".join(answer(curve, wanted) for curve in found)
    verdict = VerdictBox(
        key="answer",
        text=text,
        headline=f"{kept} of {tried} values keep a success rate of {wanted:g}",
        tone=Tone.GOOD if kept == tried else Tone.MIXED if kept else Tone.BAD,
    )
    parts: list[DocumentPart] = [run_line(folder), verdict]
    for curve, table in zip(found, sweep_tables(folder, wanted), strict=True):
        parts += [replace(table, note=""), curve_figure(curve, wanted, table.title)]
    return Document(_title(folder), (*parts, _INTERVALS))


_INTERVALS = Paragraph(
    "In brackets, and as bars: the 95 % Wilson interval. Each name is varied alone; the others keep the "
    "set's values. All values have runs with the same seeds.",
    kind="note",
)


def _title(folder: TrialFolder) -> str:
    return f"Sweep of {cut(folder.plan.program)}"


def curve_figure(curve: Curve, wanted: float, title: str) -> Figure:
    """The success rate with its interval against the value, numbers to scale, others side by side."""
    bottom = _TOP + _HEIGHT
    across = _positions(curve)

    def up(fraction: float) -> float:
        return bottom - _HEIGHT * fraction

    parts = [_scale(up(k / 5), f"{k / 5:.1f}") for k in range(6)]
    parts.append(
        svg.element(
            "line", x1=_LEFT, x2=PICTURE_WIDTH - _RIGHT, y1=up(wanted), y2=up(wanted), stroke=svg.CONTACT,
            stroke_dasharray="6 4",
        )
    )  # fmt: skip
    parts.append(svg.text(PICTURE_WIDTH - _RIGHT + 4, up(wanted) + 4, f"{wanted:g}", fill=svg.CONTACT))
    estimates = [value.rate for value in curve.values]
    if curve.is_of_numbers:
        line = svg.points((x, up(each.value)) for x, each in zip(across, estimates, strict=True))
        parts.append(svg.element("polyline", points=line, fill="none", stroke=_CURVE, stroke_width=1.5))
    free = 0.0
    for x, value, each in zip(across, curve.values, estimates, strict=True):
        low, high = up(each.low), up(each.high)
        bar = f"M{x - _CAP:.1f} {low:.1f}h{2 * _CAP:g}m-{_CAP:g} 0V{high:.1f}m-{_CAP:g} 0h{2 * _CAP:g}"
        parts.append(svg.element("path", d=bar, fill="none", stroke=_CURVE))
        parts.append(svg.element("circle", cx=x, cy=up(each.value), r=4.0, fill=_CURVE))
        if x >= free:
            parts.append(svg.text(x, bottom + 16, cut(value.value, WORD), text_anchor="middle"))
            free = x + _LABEL
    name = cut(curve.name)
    parts.append(
        svg.text((_LEFT + PICTURE_WIDTH - _RIGHT) / 2, bottom + 36, name, 12.0, text_anchor="middle")
    )
    return Figure(title, PICTURE_WIDTH, bottom + _BELOW, "".join(parts), "graph")


def _positions(curve: Curve) -> list[float]:
    """Positions of the values, points from the left."""
    numbers = [value.number for value in curve.values]
    if not curve.is_of_numbers:
        numbers = [float(index) for index in range(len(numbers))]
    low, span = min(numbers), max(numbers) - min(numbers)
    room = PICTURE_WIDTH - _LEFT - _RIGHT - 40
    return [_LEFT + 20 + (room * (number - low) / span if span else room / 2) for number in numbers]


def _scale(y: float, label: str) -> str:
    line = svg.element("line", x1=_LEFT, x2=PICTURE_WIDTH - _RIGHT, y1=y, y2=y, stroke="#dddddd")
    return line + svg.text(_LEFT - 8, y + 4, label, text_anchor="end", fill=svg.FAINT)
