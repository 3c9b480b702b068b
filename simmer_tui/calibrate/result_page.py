"""The result of a calibration, as a document and as a page: parameters, residuals, predictions, the path."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise, zip_longest

import numpy as np
from msgspec.structs import replace

from simmer_tui.calibrate.change_detection import FALSE_ALARMS, PartVerdict
from simmer_tui.calibrate.effects import BLIND_SPOT, EFFECT_KINDS, FEWEST_MOVEMENTS, SHORTFALL, TURNING
from simmer_tui.calibrate.estimates import ParameterEstimate, unidentified_labels
from simmer_tui.calibrate.fit import Fit, fit_path
from simmer_tui.calibrate.model_check import FALSE_MISFIT_RATE, POWER, EffectTest, Misfit
from simmer_tui.calibrate.parameters import AXES
from simmer_tui.calibrate.posterior import COUNTER, OBSERVATION, PROCESS, RANGE, Rows
from simmer_tui.calibrate.prediction import HeldBack
from simmer_tui.document import svg
from simmer_tui.document.formats import COUNT, WORDS, Format, estimate, number
from simmer_tui.document.model import (
    DataColumn,
    DataTable,
    Document,
    DocumentPart,
    Figure,
    Folded,
    KeyFigures,
    Paragraph,
    SideBySide,
    Tone,
    VerdictBox,
    data_table,
)
from simmer_tui.document.svg import PICTURE_WIDTH
from simmer_tui.report.figure import WALLS
from simmer_tui.run.phrases import capitalized
from simmer_tui.sim.arrays import FloatArray
from simmer_tui.sim.command import counted, plural
from simmer_tui.sim.specs import CELL_SIZE, WALL, SimulationSpec

_READ_FAMILIES: tuple[int, ...] = (COUNTER, RANGE, OBSERVATION)
_NUMBER = number(".3g")
_FIGURE = replace(WORDS, numeric=True)
_ESTIMATE = tuple(DataColumn(key, hidden=True) for key in ("value", "value_low", "value_high"))
_BEFORE_AFTER = (DataColumn("before", _NUMBER), DataColumn("after", _NUMBER))
MISFITS = data_table(
    "misfits",
    "Misfits of the model",
    DataColumn("part"),
    DataColumn("kind"),
    *_ESTIMATE,
    DataColumn("unit", hidden=True),
    DataColumn("p", number(".1g")),
    DataColumn("text", heading="observation", wraps=True),
)
TESTS = data_table(
    "tests",
    "Tests of the model",
    DataColumn("part"),
    DataColumn("kind", heading="effect"),
    DataColumn("devices", Format(", ".join), wraps=True),
    DataColumn("value", hidden=True),
    DataColumn("unit", hidden=True),
    DataColumn("text", heading=f"seen with {POWER:.0%}", wraps=True),
)
PARAMETERS = data_table(
    "parameters",
    "Estimated parameters",
    DataColumn("part"),
    DataColumn("parameter", heading="parameter"),
    DataColumn("unit", hidden=True),
    DataColumn("was", number(".4g")),
    *_ESTIMATE,
    DataColumn("is", _FIGURE),
    DataColumn("interval", _FIGURE, "95 % interval"),
    DataColumn("changed", Format(lambda changed: "changed" if changed else ""), ""),
)
UNIDENTIFIED = data_table(
    "unidentified",
    "Parameters left unchanged",
    DataColumn("part"),
    DataColumn("parameters", Format(", ".join), "parameters", wraps=True),
    DataColumn("text", heading="why", wraps=True),
)
RESIDUALS = data_table("residuals", "Residuals", DataColumn("part"), DataColumn("unit"), *_BEFORE_AFTER)
_HELD_BACK = data_table(
    "held_back",
    "Predictions of held-back readings",
    DataColumn("readings_of"),
    DataColumn("ahead", COUNT),
    *_BEFORE_AFTER,
    DataColumn("unit"),
    DataColumn("times_better", number(".1f")),
    DataColumn("readings", COUNT),
)
_CHECK = data_table(
    "parts",
    "Has the robot changed?",
    *(DataColumn(key, hidden=True) for key in ("part", "changed", "p")),
    DataColumn("owner", WORDS, "part"),
    DataColumn("parameter", heading="parameter"),
    DataColumn("set", number(".4g")),
    DataColumn("log", number(".4g")),
    DataColumn("error", number(".2g")),
    DataColumn("unit", hidden=True),
    DataColumn("verdict", WORDS, ""),
)
STRENGTHS = data_table(
    "strengths",
    "How the biases of the robots differ",
    DataColumn("movements"),
    DataColumn("strength", estimate(".3g")),
)
TABLES = (MISFITS, TESTS, PARAMETERS, UNIDENTIFIED, _HELD_BACK, RESIDUALS, _CHECK, STRENGTHS)
"""All tables of a calibration, of a check, and of the strength of biases."""
_PATH = "#3066e4"
_NAMED = (SHORTFALL, TURNING, BLIND_SPOT)
"""Effects that the verdict names: a person can check them with a ruler and a protractor."""
_MOST_CHANGED = 10
"""Most changed parameters that the page shows first: as many as fit beside the picture."""


def fit_verdict(fit: Fit) -> VerdictBox:
    """The verdict on the model of a robot, the first part of a page: it does not fit, or what was tested."""
    if fit.misfits:
        headline, tone = "The model does not fit this robot", Tone.BAD
        why = (
            "no set can describe everything it does, so the intervals are wider. The interval of a drive "
            "that changed covers its bias at the beginning and at the end of the log."
        )
    elif fit.tests:
        headline, tone = "The model fits this robot as far as it was tested", Tone.GOOD
        named = [[each for each in fit.tests if each.kind == kind.name] for kind in _NAMED]
        largest = [max(each, key=lambda test: test.size) for each in named if each]
        shown = "; ".join(each.text for each in largest or fit.tests[: len(_NAMED)])
        why = f"with {POWER:.0%} it would have shown {shown}. Only effects in the table were tested."
    else:
        headline, tone = "The log is too short to test the model", Tone.PLAIN
        why = f"a test needs {FEWEST_MOVEMENTS} movements of one drive."
    text, sentence = f"{headline}: {why}", (capitalized(why),)
    return VerdictBox(key="fit", text=text, headline=headline, tone=tone, sentence=sentence)


def tests_table(tests: Sequence[EffectTest]) -> DataTable:
    """Effects that were tested for, each with the size that would have been seen."""
    rows = [(each.owner, each.kind, each.devices, each.size, each.unit, each.text) for each in tests]
    names = {each.kind for each in tests}
    untested = [each.name for each in EFFECT_KINDS if each.name not in names]
    lacking = f" This log has too few data for: {', '.join(untested)}." if untested else ""
    note = (
        "The size that a test would have found in each of the devices, with a probability of "
        f"{POWER:.0%}.{lacking} Other effects are not tested."
    )
    return TESTS.filled(rows, note)


def misfits_table(misfits: Sequence[Misfit]) -> DataTable:
    """Departures of the robot from the model, which no set can describe; no rows if there are none."""
    rows = [
        (each.owner, each.kind, each.value, each.low, each.high, each.unit, each.probability, each.text)
        for each in misfits
    ]
    share = f"{FALSE_MISFIT_RATE:.0%}"
    note = (
        f"False alarms: of robots that the model fits, {share} fail a test of an effect, and {share} a test "
        "of held-back readings. An effect that is not tested may look like one that is."
    )
    return MISFITS.filled(rows, note)


def figures_table(estimates: Sequence[ParameterEstimate]) -> DataTable:
    """Identified parameters: the set's values, their estimates and intervals."""
    rows = []
    for each in estimates:
        if each.identified:
            value, low, high = each.shown
            shown = (f"{value} {each.unit}".rstrip(), f"{low} to {high}")
            numbers = (each.present, each.value, each.low, each.high)
            rows.append((each.owner, each.label, each.unit, *numbers, *shown, each.changed))
    note = "changed: the set's value is outside the interval. For all other parameters it is inside."
    return PARAMETERS.filled(rows, note)


def unidentified_table(estimates: Sequence[ParameterEstimate]) -> DataTable:
    """Parameters that the data do not identify, a row for each part and reason."""
    labels_by_reason = unidentified_labels(estimates)
    return UNIDENTIFIED.filled([(owner, labels, why) for (owner, why), labels in labels_by_reason.items()])


def residual_table(fit: Fit) -> DataTable:
    """Median residuals of movements and readings, with the old set and with the new one."""
    before_state = fit_path(fit.run, fit.space, *fit.space.of(fit.run.spec), fit.state)
    before, after = (_residuals(fit.run.spec, each) for each in (fit.model.rows(before_state), fit.rows))
    rows = [
        (name, unit, float(np.median(was)), float(np.median(now)))
        for (name, unit, was), (_, _, now) in zip(before, after, strict=True)
        if was.size and now.size
    ]
    note = (
        "Median residuals of movements and readings along the path that fits best: with the old set (before) "
        "and with the new one (after)."
    )
    return RESIDUALS.filled(rows, note)


def _residuals(spec: SimulationSpec, rows: Rows) -> Iterator[tuple[str, str, FloatArray]]:
    """Sizes of residuals by part and unit: of a drive's movements, both axes of translation in inches and the
    heading in degrees, and of a sensor's readings."""
    sizes = np.abs(rows.residuals)
    by_axis = np.flatnonzero(rows.family == PROCESS).reshape(len(AXES), -1)
    for source, drive in enumerate(spec.drives):
        mine = sizes[by_axis[:, rows.source[by_axis[0]] == source]]
        yield drive.kind.value, "in", mine[:-1]
        yield drive.kind.value, "deg", mine[-1]
    read = np.isin(rows.family, _READ_FAMILIES)
    for source, sensor in enumerate(spec.sensors):
        yield sensor.id, sensor.unit, sizes[read & (rows.source == source)]


def held_back_table(held: HeldBack) -> DataTable:
    """Errors of predictions of readings that were held back."""
    rows = []
    for each in held.errors:
        kind, times = each.kind, each.before / each.after if each.after else None
        rows.append((kind.meaning, each.ahead, each.before, each.after, kind.unit, times, each.count))
    note = (
        f"Median errors over the last {held.movements} movements, predicted 0, 1 and 5 movements ahead: with "
        "the old set (before), and with parameters estimated from the earlier movements (after)."
    )
    return _HELD_BACK.filled(rows, note)


def held_back_picture(held: HeldBack) -> Figure:
    """Errors of predictions after (blue) as parts of those before (grey)."""
    parts, y = [], 8.0
    # Room for the names of kinds on the left, and for the shares on the right.
    left, room = 240.0, PICTURE_WIDTH - 240.0 - 90.0
    for each in held.errors:
        share = each.after / each.before if each.before else 1.0
        words = f"{each.kind.meaning}, {f'{each.ahead} ahead' if each.ahead else 'at once'}"
        parts.append(svg.text(left - 10, y + 12, words, text_anchor="end"))
        parts.append(svg.element("rect", x=left, y=y, width=room, height=16.0, fill="#dddddd"))
        wide = room * min(share, 1.0)
        parts.append(svg.element("rect", x=left, y=y + 3, width=wide, height=10.0, fill=_PATH))
        parts.append(svg.text(left + room + 8, y + 12, f"{share:.0%}"))
        y += 22.0
    return Figure("Prediction errors: after, as a share of before", PICTURE_WIDTH, y, "".join(parts), "graph")


def check_document(parts: Sequence[PartVerdict]) -> Document:
    """Each part with its values in set and log, and its verdict."""
    rows = []
    for part in parts:
        verdict = f"{'changed' if part.changed else 'unchanged'} (p = {part.probability:.2g})"
        about = (part.owner, part.changed, part.probability)
        for place, ((label, *figures), unit) in enumerate(zip_longest(part.figures, part.units)):
            owner, shown = (None, None) if place else (part.owner, verdict)  # once a part
            rows.append((*about, owner, label, *figures, unit, shown))
    note = (
        f"Each part is tested. Of robots that have not changed, at most {FALSE_ALARMS:.0%} get the verdict "
        '"changed" for any part.'
    )
    changed = [part.owner for part in parts if part.changed]
    answer = f"Changed: {', '.join(changed)}" if changed else "The robot behaves as the set says."
    table = _CHECK.filled(rows, note)
    return Document("Has the robot changed?", (table, Paragraph(answer, "answer")))


def strength_document(found: Sequence[ParameterEstimate]) -> Document:
    """Both numbers of the setting `strength`, and the line for settings.toml."""
    table = STRENGTHS.filled([(each.label, each) for each in found], "In brackets: the 95 % interval.")
    setting = f"strength = [{', '.join(_NUMBER.text(each.value) for each in found)}]"
    return Document("Strength of biases", (table, Paragraph(setting, "setting")))


def result_document(fit: Fit, estimates: Sequence[ParameterEstimate], held: HeldBack | None) -> Document:
    """All estimates, with the accuracy of their predictions, for terminals and programs."""
    tables = (
        *(misfits_table(fit.misfits), tests_table(fit.tests)),
        *(figures_table(estimates), unidentified_table(estimates)),
    )
    misfits, tests, learned, unidentified = ((table,) if table.rows else () for table in tables)
    about = Paragraph(_about(fit, estimates), "about", "run")
    parts = (*misfits, about, *learned, *unidentified, *tests, _held_back(held), residual_table(fit))
    return Document(_title(fit), (fit_verdict(fit), *parts))


def result_page(fit: Fit, estimates: Sequence[ParameterEstimate], held: HeldBack | None) -> Document:
    """The page: the verdict on the model, parameters that differ from the set, and the path; the rest is
    folded."""
    misfits, unidentified = misfits_table(fit.misfits), unidentified_table(estimates)
    changed = [each for each in estimates if each.changed]
    identified = sum(each.identified for each in estimates)
    figures = (
        (str(len(changed)), f"{plural(len(changed), 'parameter')} other than in the set"),
        (str(identified), f"{plural(identified, 'parameter')} estimated"),
        (str(len(fit.run.movements)), plural(len(fit.run.movements), "movement")),
    )
    differs: DocumentPart = Paragraph("No parameter differs from the set.")
    if changed:
        table = figures_table(changed[:_MOST_CHANGED])
        more = len(changed) - _MOST_CHANGED
        note = f"{more} more, under All parameters." if more > 0 else ""
        differs = replace(table, title="What differs from the set", note=note)
    first_path, about_path, *more_paths = path_pictures(fit)
    predicted: list[DocumentPart] = [] if held is None else [held_back_picture(held), _BLUE]
    return Document(
        _title(fit),
        (
            Paragraph(f"{_title(fit)} · {_about(fit, estimates)}", kind="run"),
            fit_verdict(fit),
            KeyFigures(figures),
            *((misfits,) if misfits.rows else ()),
            SideBySide((differs,), (first_path, about_path), even=True),
            Folded(TESTS.title, (tests_table(fit.tests),) if fit.tests else ()),
            Folded("All parameters", (figures_table(estimates),)),
            Folded(unidentified.title, (unidentified,) if unidentified.rows else ()),
            Folded("Predictions of held-back readings", (_held_back(held), *predicted)),
            Folded("Residuals", (residual_table(fit),)),
            Folded("More of the path", more_paths),
        ),
    )


_BLUE = Paragraph("Blue: the error after, as a share of the error before (grey).", kind="note")


def _title(fit: Fit) -> str:
    return f"Calibration from {', '.join(fit.run.names)}"


def _about(fit: Fit, estimates: Sequence[ParameterEstimate]) -> str:
    run = fit.run
    identified = counted(sum(each.identified for each in estimates), "parameter")
    changed = sum(each.changed for each in estimates)
    readings = sum(len(each.values) for each in run.readings.values())
    log = f"{counted(len(run.movements), 'movement')}, {counted(readings, 'reading')}"
    found = f'{identified} estimated, {changed} differ from the set "{run.configuration.name}"'
    return f"{log}; {found}"


def _held_back(held: HeldBack | None) -> DataTable | Paragraph:
    if held is not None:
        return held_back_table(held)
    return Paragraph("No chain of movements is long enough to hold readings back.", "held_back")


def path_pictures(fit: Fit) -> list[DocumentPart]:
    """Each chain's path, from dark to light, with its contacts."""
    pictures: list[DocumentPart] = []
    maze = fit.run.spec.maze
    scale = PICTURE_WIDTH / maze.width
    height, side = maze.height * scale, CELL_SIZE * scale
    walls = [
        svg.element("rect", x=column * side, y=row * side, width=side, height=side, fill=WALLS)
        for row, cells in enumerate(maze.cells)
        for column, cell in enumerate(cells)
        if cell == WALL
    ]
    size = {"width": PICTURE_WIDTH, "height": height}
    frame = svg.element("rect", x=0.0, y=0.0, **size, fill="none", stroke=WALLS)
    for first, chain in zip(fit.run.first_stops(), fit.run.chains, strict=True):
        count = len(chain.movements) + 1
        poses = fit.poses[first : first + count]
        parts = [*walls]
        places = [(float(x) * scale, height - float(y) * scale) for x, y in poses[:, :2]]
        for k, ((x1, y1), (x2, y2)) in enumerate(pairwise(places)):
            shade = svg.shade(k / count)
            parts.append(svg.element("line", x1=x1, y1=y1, x2=x2, y2=y2, stroke=shade, stroke_width=1.5))
        for k, (x, y) in enumerate(places):
            spread = 2.0 * float(fit.pose_spread[first + k, :2].max()) * scale
            met = k and fit.state.contacts[fit.model.movement_at[first + k - 1]]
            fill = svg.CONTACT if met else svg.shade(k / count)
            parts.append(svg.element("circle", cx=x, cy=y, r=max(spread, 2.0), fill=fill, fill_opacity=0.6))
        title = "The estimated path, dark at its beginning; red: a wall was touched on the way"
        about = f"{title}. A disc shows the uncertainty of its place (95 %)."
        pictures += [
            Figure(title, PICTURE_WIDTH, height, "".join(parts) + frame),
            Paragraph(about, kind="note"),
        ]
    return pictures
