"""The result of a calibration as a document: parameters, residuals, predictions and the path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from simmer_tui.calibrate.change_detection import FALSE_ALARMS, PartVerdict
from simmer_tui.calibrate.estimates import ParameterEstimate
from simmer_tui.calibrate.fit import Fit, fit_path
from simmer_tui.calibrate.model_check import FALSE_MISFIT_RATE, Misfit
from simmer_tui.calibrate.posterior import COUNTER, OBSERVATION, PROCESS, RANGE, Rows
from simmer_tui.calibrate.prediction import HeldBack
from simmer_tui.document import svg
from simmer_tui.document.formats import COUNT, WORDS, Format, number
from simmer_tui.document.model import (
    DataColumn,
    DataTable,
    Document,
    DocumentPart,
    Figure,
    Paragraph,
    SectionHeading,
)
from simmer_tui.report.figure import WIDTH
from simmer_tui.sim.command import escape
from simmer_tui.sim.specs import CELL_SIZE, WALL

_READ_FAMILIES = (COUNTER, RANGE, OBSERVATION)
_NUMBER = number(".3g")
_FIGURE = replace(WORDS, numeric=True)
MISFITS = DataTable(
    "misfits",
    "What does not fit",
    (
        DataColumn("part"),
        DataColumn("kind"),
        *(DataColumn(key, hidden=True) for key in ("value", "value_low", "value_high")),
        DataColumn("unit", hidden=True),
        DataColumn("probability", number(".1g"), "p"),
        DataColumn("text", heading="what was seen", wraps=True),
    ),
)
PARAMETERS = DataTable(
    "parameters",
    "What was learned",
    (
        DataColumn("part"),
        DataColumn("parameter", heading="figure"),
        DataColumn("unit", hidden=True),
        DataColumn("was", number(".4g")),
        *(DataColumn(key, hidden=True) for key in ("value", "value_low", "value_high")),
        DataColumn("is", _FIGURE),
        DataColumn("interval", _FIGURE, "95 % interval"),
        DataColumn("changed", Format(lambda changed: "changed" if changed else ""), ""),
    ),
)
UNIDENTIFIED = DataTable(
    "unidentified",
    "Not told, and left as it was",
    (
        DataColumn("part"),
        DataColumn("parameters", Format(", ".join), "figures", wraps=True),
        DataColumn("text", heading="why", wraps=True),
    ),
)
RESIDUALS = DataTable(
    "residuals",
    "Residuals",
    (
        DataColumn("part"),
        DataColumn("unit"),
        DataColumn("before", _NUMBER),
        DataColumn("after", _NUMBER),
    ),
)
HELD_BACK = DataTable(
    "held_back",
    "Readings held back, predicted",
    (
        DataColumn("readings_of"),
        DataColumn("ahead", COUNT),
        DataColumn("before", _NUMBER),
        DataColumn("after", _NUMBER),
        DataColumn("unit"),
        DataColumn("times_better", number(".1f")),
        DataColumn("readings", COUNT),
    ),
)
CHECK = DataTable(
    "parts",
    "Is it still so?",
    (
        *(DataColumn(key, hidden=True) for key in ("part", "changed", "probability")),
        DataColumn("owner", WORDS, "part"),
        DataColumn("parameter", heading="figure"),
        DataColumn("set", number(".4g")),
        DataColumn("log", number(".4g")),
        DataColumn("error", number(".2g")),
        DataColumn("verdict", WORDS, ""),
    ),
)
TABLES = (MISFITS, PARAMETERS, UNIDENTIFIED, HELD_BACK, RESIDUALS, CHECK)
"""All tables of a calibration, and of a check."""
_WALL_FILL, _PATH, _TOUCH = "#3c3c3c", "#1f69c8", svg.CONTACT


def fit_parts(misfits: Sequence[Misfit]) -> list[DocumentPart]:
    """The answer to the question whether the model fits the robot, which stands first."""
    if not misfits:
        return [Paragraph("The model fits this robot: no test of it failed.", "fit")]
    rows = [
        (each.owner, each.kind.value, each.value, each.low, each.high, each.unit, each.probability, each.text)
        for each in misfits
    ]
    share = f"{FALSE_MISFIT_RATE:.0%}"
    note = (
        f"Even of robots that the model fits, {share} fail a test of drives, and {share} a test of held-back "
        "readings."
    )
    said = (
        "The model does not fit this robot: no set can describe all that it does. The intervals are wider "
        "because of that. If a drive changes, they hold its bias at the beginning and at the end of the log."
    )
    return [Paragraph(said, "fit", "warning"), MISFITS.filled(rows, note)]


def figures_table(estimates: Sequence[ParameterEstimate]) -> DataTable:
    """All identified parameters: as the set had them, as they are, and their intervals."""
    rows = []
    for each in estimates:
        if each.identified:
            value, low, high = each.shown
            unit = f" {each.unit}" if each.unit else ""
            shown = (f"{value}{unit}", f"{low} to {high}")
            numbers = (each.present, each.value, each.low, each.high)
            rows.append((each.owner, each.label, each.unit, *numbers, *shown, each.changed))
    note = "changed: what the set had is outside the interval. For all other figures it is inside."
    return PARAMETERS.filled(rows, note)


def unidentified_table(estimates: Sequence[ParameterEstimate]) -> DataTable:
    """Parameters that the data do not identify, and why, a row a part and reason."""
    reasons: dict[tuple[str, str], list[str]] = {}
    for each in estimates:
        if not each.identified:
            reasons.setdefault((each.owner, each.why_not), []).append(each.label)
    rows = [(owner, labels, why) for (owner, why), labels in reasons.items()]
    return UNIDENTIFIED.filled(rows)


def residual_table(fit: Fit) -> DataTable:
    """Median residuals of movements and readings, with the set as it was and as it is."""
    before_state = fit_path(fit.run, fit.space, *fit.space.of(fit.run.spec), fit.state)
    before, after = fit.model.rows(before_state), fit.rows
    rows = []
    spec = fit.run.spec
    for index, drive in enumerate(spec.drives):
        was, now = (_middle(each, (PROCESS,), index) for each in (before, after))
        if now is not None and was is not None:
            rows.append((drive.kind.value, "in and deg", was, now))
    for index, sensor in enumerate(spec.sensors):
        was, now = (_middle(each, _READ_FAMILIES, index) for each in (before, after))
        if now is not None and was is not None:
            rows.append((sensor.id, sensor.unit, was, now))
    note = (
        "Medians of what is left of each movement and reading along the path that fits best: with the set "
        "as it was, and as it is."
    )
    return RESIDUALS.filled(rows, note)


def _middle(rows: Rows, families: tuple[int, ...], source: int) -> float | None:
    mine = np.isin(rows.family, families) & (rows.source == source)
    return float(np.median(np.abs(rows.residuals[mine]))) if mine.any() else None


def held_back_table(held: HeldBack) -> DataTable:
    """Errors of predictions of readings that were held back."""
    rows = []
    for each in held.errors:
        times = each.before / each.after if each.after else None
        numbers = (each.ahead, each.before, each.after)
        rows.append((each.kind.meaning, *numbers, each.kind.unit, times, each.count))
    note = (
        f"Median errors over the last {held.movements} movements, predicted 0, 1 and 5 movements ahead, with "
        "the set as it was, and with what the movements before them tell."
    )
    return HELD_BACK.filled(rows, note)


def held_back_picture(held: HeldBack) -> Figure:
    """Errors of predictions after (blue) as parts of those before (grey)."""
    parts, y = [], 8.0
    left, room = 240.0, WIDTH - 240.0 - 90.0
    for each in held.errors:
        share = each.after / each.before if each.before else 1.0
        words = f"{each.kind.meaning}, {f'{each.ahead} ahead' if each.ahead else 'at once'}"
        parts.append(svg.text(left - 10, y + 12, words, text_anchor="end"))
        parts.append(svg.element("rect", x=left, y=y, width=room, height=16.0, fill="#dddddd"))
        wide = room * min(share, 1.0)
        parts.append(svg.element("rect", x=left, y=y + 3, width=wide, height=10.0, fill=_PATH))
        parts.append(svg.text(left + room + 8, y + 12, f"{share:.0%}"))
        y += 22.0
    return Figure("Errors of predictions: after, as parts of those before", WIDTH, y, "".join(parts))


def check_document(parts: Sequence[PartVerdict]) -> Document:
    """Each part, what the set and the log tell of it, and whether it has changed."""
    rows = []
    for part in parts:
        verdict = f"{'changed' if part.changed else 'as it was'} (p = {part.probability:.2g})"
        about = (part.owner, part.changed, part.probability)
        for place, (label, *figures) in enumerate(part.figures):
            owner, shown = (None, None) if place else (part.owner, verdict)  # once a part
            rows.append((*about, owner, label, *figures, shown))
    note = (
        f"Each part is tested. Of robots that have not changed, at most {FALSE_ALARMS:.0%} get a verdict "
        '"changed" for any part.'
    )
    changed = [part.owner for part in parts if part.changed]
    answer = f"Changed: {', '.join(changed)}" if changed else "The robot behaves as the set says."
    table = CHECK.filled(rows, note)
    return Document("Is it still so?", (table, Paragraph(answer, "answer")))


def result_document(fit: Fit, estimates: Sequence[ParameterEstimate], held: HeldBack | None) -> Document:
    """All that was learned, and how well it predicts."""
    run = fit.run
    told = sum(each.identified for each in estimates)
    changed = sum(each.changed for each in estimates)
    readings = sum(len(each.values) for each in run.readings.values())
    about = (
        f"{len(run.movements)} movements, {readings} readings; {told} parameters estimated, {changed} differ "
        f'from the set "{run.configuration.name}"'
    )
    unidentified = unidentified_table(estimates)
    parts: list[DocumentPart] = [
        *fit_parts(fit.misfits),
        Paragraph(escape(about, 400), "about", "run"),
        SectionHeading("The path as estimated"),
        *path_pictures(fit),
        figures_table(estimates),
        *([unidentified] if unidentified.rows else []),
    ]
    if held is not None:
        parts += [held_back_table(held), held_back_picture(held)]
        parts.append(Paragraph("Blue: the error after, as part of the error before (grey).", kind="note"))
    else:
        parts.append(Paragraph("No chain of movements is long enough to hold readings back.", "held_back"))
    parts.append(residual_table(fit))
    return Document(f"Calibration from {escape(', '.join(run.names), 200)}", parts)


def path_pictures(fit: Fit) -> list[DocumentPart]:
    """Each chain's path, from dark to light, and where a wall was met."""
    pictures: list[DocumentPart] = []
    maze = fit.run.spec.maze
    scale = WIDTH / maze.width
    height = maze.height * scale
    for first, chain in zip(fit.run.first_stops(), fit.run.chains, strict=True):
        count = len(chain.movements) + 1
        poses = fit.poses[first : first + count]
        parts = []
        for row, cells in enumerate(maze.cells):
            for column, cell in enumerate(cells):
                if cell == WALL:
                    side = CELL_SIZE * scale
                    parts.append(
                        svg.element(
                            "rect", x=column * side, y=row * side, width=side, height=side, fill=_WALL_FILL
                        )
                    )
        places = [(float(x) * scale, height - float(y) * scale) for x, y in poses[:, :2]]
        for k, (begin, end) in enumerate(pairwise(places)):
            parts.append(
                svg.element(
                    "line", x1=begin[0], y1=begin[1], x2=end[0], y2=end[1],
                    stroke=svg.shade(k / count), stroke_width=1.5,
                )
            )  # fmt: skip
        for k, (x, y) in enumerate(places):
            spread = 2.0 * float(fit.pose_spread[first + k, :2].max()) * scale
            met = k and fit.state.contacts[fit.model.movement_at[first + k - 1]]
            fill = _TOUCH if met else svg.shade(k / count)
            parts.append(svg.element("circle", cx=x, cy=y, r=max(spread, 2.0), fill=fill, fill_opacity=0.6))
        frame = svg.element("rect", x=0.0, y=0.0, width=WIDTH, height=height, fill="none", stroke=_WALL_FILL)
        title = "The path as estimated, dark at its beginning; red: a wall was met on the way"
        about = f"{title}. Discs are as wide as the place is unsure (95 %)."
        pictures += [Figure(title, WIDTH, height, "".join(parts) + frame), Paragraph(about, kind="note")]
    return pictures
