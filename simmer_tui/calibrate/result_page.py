"""What was learned, as tables for the terminal and as one page that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from simmer_tui.calibrate.change_detection import FALSE_ALARMS, PartVerdict
from simmer_tui.calibrate.estimates import ParameterEstimate
from simmer_tui.calibrate.fit import Fit, fit_path
from simmer_tui.calibrate.prediction import HeldBack
from simmer_tui.calibrate.row_stack import COUNTER, OBSERVATION, PROCESS, RANGE, Rows
from simmer_tui.report import svg
from simmer_tui.report.content import Column, Table
from simmer_tui.report.maze_frame import WIDTH
from simmer_tui.report.page import heading, html_tables, page, paragraph
from simmer_tui.sim.command import escape
from simmer_tui.sim.specs import CELL_SIZE, WALL

_READ_FAMILIES = (COUNTER, RANGE, OBSERVATION)
_WALL_FILL, _PATH, _TOUCH = "#3c3c3c", "#1f69c8", svg.CONTACT


def figures_table(estimates: Sequence[ParameterEstimate]) -> Table:
    """Every figure that was told: as it was, as it is, and its interval."""
    rows = []
    for each in estimates:
        if not each.identified:
            continue
        value, low, high = each.shown
        unit = f" {each.unit}" if each.unit else ""
        mark = "changed" if each.changed else ""
        was = f"{each.present:.4g}"
        rows.append((each.owner, each.label, was, f"{value}{unit}", f"{low} to {high}", mark))
    columns = (
        Column("part"),
        Column("figure"),
        Column("was", numeric=True),
        Column("is", numeric=True),
        Column("95 % interval", numeric=True),
        Column(""),
    )
    note = "changed: what the set had is outside the interval. Of all other figures the interval holds it."
    return Table("What was learned", columns, tuple(rows), note)


def unidentified_table(estimates: Sequence[ParameterEstimate]) -> Table:
    """What the data do not tell, and why, a row a part and reason."""
    reasons: dict[tuple[str, str], list[str]] = {}
    for each in estimates:
        if not each.identified:
            reasons.setdefault((each.owner, each.why_not), []).append(each.label)
    rows = tuple((owner, ", ".join(labels), why) for (owner, why), labels in reasons.items())
    columns = (Column("part"), Column("figures", wraps=True), Column("why", wraps=True))
    return Table("Not told, and left as it was", columns, rows)


def residual_table(fit: Fit) -> Table:
    """How far movements and readings are off what the sets say of them: half of all are within that."""
    before_state = fit_path(fit.run, fit.space, *fit.space.of(fit.run.spec), fit.state)
    before, after = fit.model.rows(before_state), fit.rows
    rows = []
    spec = fit.run.spec
    for index, drive in enumerate(spec.drives):
        was, now = (_middle(each, (PROCESS,), index) for each in (before, after))
        if now is not None and was is not None:
            rows.append((drive.kind.value, "in and deg", f"{was:.3g}", f"{now:.3g}"))
    for index, sensor in enumerate(spec.sensors):
        was, now = (_middle(each, _READ_FAMILIES, index) for each in (before, after))
        if now is not None and was is not None:
            rows.append((sensor.id, sensor.unit, f"{was:.3g}", f"{now:.3g}"))
    columns = (Column("part"), Column("unit"), Column("before", numeric=True), Column("after", numeric=True))
    note = (
        "Medians of what is left of each movement and reading along the path that fits best: with the set "
        "as it was, and as it is."
    )
    return Table("Residuals", columns, tuple(rows), note)


def _middle(rows: Rows, families: tuple[int, ...], source: int) -> float | None:
    mine = np.isin(rows.family, families) & (rows.source == source)
    return float(np.median(np.abs(rows.residuals[mine]))) if mine.any() else None


def held_back_table(held: HeldBack) -> Table:
    """How well readings that were held back are predicted."""
    rows = []
    for each in held.errors:
        unit = each.kind.unit
        times = f"{each.before / each.after:.1f}" if each.after else ""
        cells = (f"{each.before:.3g} {unit}", f"{each.after:.3g} {unit}", times, str(each.count))
        rows.append((each.kind.meaning, str(each.ahead), *cells))
    columns = (
        Column("readings of"),
        Column("ahead", numeric=True),
        Column("before", numeric=True),
        Column("after", numeric=True),
        Column("times better", numeric=True),
        Column("readings", numeric=True),
    )
    note = (
        f"Median errors over the last {held.movements} movements, predicted 0, 1 and 5 movements ahead, with "
        "the set as it was, and with what the movements before them tell."
    )
    return Table("Readings held back, predicted", columns, tuple(rows), note)


def held_back_picture(held: HeldBack) -> str:
    """PredictionErrors of predictions after (blue) as parts of those before (grey)."""
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
    return svg.picture(WIDTH, y, "".join(parts), "Errors of predictions: after, as parts of those before")


def check_table(parts: Sequence[PartVerdict]) -> Table:
    """Each part, what the set and the log say of it, and whether it has changed."""
    rows = []
    for part in parts:
        for number, (label, known, now, error) in enumerate(part.figures):
            verdict = f"{'changed' if part.changed else 'as it was'} (p = {part.probability:.2g})"
            rows.append(
                (
                    part.owner if not number else "",
                    label,
                    f"{known:.4g}",
                    f"{now:.4g}",
                    f"{error:.2g}",
                    verdict if not number else "",
                )
            )
    columns = (
        Column("part"),
        Column("figure"),
        Column("set", numeric=True),
        Column("log", numeric=True),
        Column("error", numeric=True),
        Column(""),
    )
    note = (
        f"A test a part; of robots that have not changed at most {FALSE_ALARMS:.0%} are said to have a part "
        "that has."
    )
    return Table("Is it still so?", columns, tuple(rows), note)


def result_page(fit: Fit, estimates: Sequence[ParameterEstimate], held: HeldBack | None) -> str:
    """The page."""
    run = fit.run
    told = sum(each.identified for each in estimates)
    changed = sum(each.changed for each in estimates)
    readings = sum(len(each.values) for each in run.readings.values())
    about = (
        f"{len(run.movements)} movements, {readings} readings; "
        f"{told} figures told, {changed} of them other than the set {run.configuration.name} had"
    )
    tables = [figures_table(estimates), unidentified_table(estimates)]
    parts = [paragraph(escape(about, 400), "run"), heading("The path as estimated"), *path_pictures(fit)]
    if held is not None:
        parts.append(html_tables([held_back_table(held)]))
        parts.append(held_back_picture(held))
        parts.append(paragraph("Blue: the error after, as part of the error before (grey).", "note"))
    parts += [html_tables([residual_table(fit)]), html_tables([t for t in tables if t.rows])]
    return page(f"Calibration from {escape(', '.join(run.names), 200)}", *parts)


def path_pictures(fit: Fit) -> list[str]:
    """Each chain's path, from dark to light, and where a wall was met."""
    pictures = []
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
        pictures.append(svg.picture(WIDTH, height, "".join(parts) + frame, title))
        pictures.append(paragraph(f"{title}. Discs are as wide as the place is unsure (95 %).", "note"))
    return pictures
