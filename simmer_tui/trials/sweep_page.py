"""A sweep as a document: a table and a curve for all that is varied."""

from __future__ import annotations

from simmer_tui.document import svg
from simmer_tui.document.model import Document, DocumentPart, Figure, Paragraph
from simmer_tui.report.maze_frame import WIDTH
from simmer_tui.sim.command import escape
from simmer_tui.trials.folder import TrialFolder
from simmer_tui.trials.sweep_summary import Curve, curves, sweep_tables
from simmer_tui.trials.trials_summary import runs_table

_LEFT, _RIGHT, _TOP, _HEIGHT, _BELOW = 60.0, 40.0, 16.0, 240.0, 44.0
_CAP = 5.0
"""Half the width of an interval's ends, points."""
_LABEL = 30.0
"""Room for the label of a value; one that finds none is left out, and stands in the table."""
_CURVE = "#1f69c8"


def sweep_document(folder: TrialFolder, wanted: float) -> Document:
    """The runs of a sweep that are done; there must be one."""
    plan = folder.plan
    about = f"configuration {plan.configuration}, seed {plan.seed}, {len(folder.done)} of {plan.total} runs"
    parts: list[DocumentPart] = [Paragraph(escape(about, 400), kind="run")]
    for curve, table in zip(curves(folder), sweep_tables(folder, wanted), strict=True):
        parts += [table, curve_figure(curve, wanted, table.title)]
    note = (
        "In brackets, and as bars: the 95 % Wilson interval. Each name is varied alone, the others are as "
        "the set has them; all values have runs with the same seeds."
    )
    parts += [Paragraph(note, kind="note"), runs_table(folder)]
    return Document(f"Sweep of {escape(plan.command, 120)}", parts)


def curve_figure(curve: Curve, wanted: float, title: str) -> Figure:
    """The success rate with its interval against the value, numbers to scale, others side by side."""
    bottom = _TOP + _HEIGHT
    across = _positions(curve)

    def up(fraction: float) -> float:
        return bottom - _HEIGHT * fraction

    parts = [_scale(up(k / 5), f"{k / 5:.1f}") for k in range(6)]
    parts.append(
        svg.element(
            "line", x1=_LEFT, x2=WIDTH - _RIGHT, y1=up(wanted), y2=up(wanted), stroke=svg.CONTACT,
            stroke_dasharray="6 4",
        )
    )  # fmt: skip
    parts.append(svg.text(WIDTH - _RIGHT + 4, up(wanted) + 4, f"{wanted:g}", fill=svg.CONTACT))
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
            parts.append(svg.text(x, bottom + 16, escape(value.value, 20), text_anchor="middle"))
            free = x + _LABEL
    name = escape(curve.name, 60)
    parts.append(svg.text((_LEFT + WIDTH - _RIGHT) / 2, bottom + 36, name, 12.0, text_anchor="middle"))
    return Figure(title, WIDTH, bottom + _BELOW, "".join(parts))


def _positions(curve: Curve) -> list[float]:
    """Positions of the values, points from the left."""
    numbers = [value.number for value in curve.values]
    if not curve.is_of_numbers:
        numbers = [float(index) for index in range(len(numbers))]
    low, span = min(numbers), max(numbers) - min(numbers)
    room = WIDTH - _LEFT - _RIGHT - 40
    return [_LEFT + 20 + (room * (number - low) / span if span else room / 2) for number in numbers]


def _scale(y: float, label: str) -> str:
    line = svg.element("line", x1=_LEFT, x2=WIDTH - _RIGHT, y1=y, y2=y, stroke="#dddddd")
    return line + svg.text(_LEFT - 8, y + 4, label, text_anchor="end", fill=svg.FAINT)
