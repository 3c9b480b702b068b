# ruff: noqa: E501 - a phrase is one line
"""Numbers, and names of files, that pages state are those of the code.

A phrase stands here as on its page, with the name of a constant of the package, or of a default below, in
place of each number: `{run.facts.UNSURE:g}`. A number may be multiplied or divided, and `!w` writes it as a
word. To change a number, change the code; this test then says which phrases of which pages are wrong.
"""

from __future__ import annotations

import string
import tomllib
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pytest

from simmer_tui.cli.command_line import ExitCode
from simmer_tui.config.mission_toml import MissionSpec
from simmer_tui.config.settings import Settings
from simmer_tui.sim.sensors import KINDS, LidarSpec
from simmer_tui.sim.specs import GripperSpec
from simmer_tui.trials.sequential import REQUIRED_RATE, sequential_test

ROOT = Path(__file__).parents[1]
TEST = sequential_test(REQUIRED_RATE)
DEFAULTS: dict[str, Any] = {
    "settings": Settings(),
    "mission": MissionSpec(),
    "grip": GripperSpec(code="p1"),
    "lidar": LidarSpec(kind=KINDS["lidar"], number=1, code="sc"),
    "test": TEST,
    "runs": {f"at_{true}": round(TEST.expected_runs(true / 1000)) for true in (0, 750, 825, 900, 1000)},
    "exit": ExitCode,
    "prior": {prior.label.replace(" ", "_"): prior.spread for prior in KINDS["ultra"].parameters},
    **{
        path.stem.replace("-", "_"): tomllib.loads(path.read_text("utf-8"))
        for path in (ROOT / "config" / "profiles").rglob("*.toml")
    },
}
WORDS = ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"]
SHARES = {0.25: "quarter", 0.5: "half", 1 / 3: "third"}

PHRASES = {
    "README.md": [
        "within {mission.time_limit/60!w} minutes without touching a wall",
    ],
    "atlas.md": [
        "more than {cli.atlas_command._MANY:,} poses needs `--yes`",
        "in steps of {atlas.c_header._UNIT} in",
        "arrays of at most {atlas.c_header._PART:,} bytes",
        "up to {run.belief_grid.MOST_STATES:,} poses",
    ],
    "beliefs.md": [
        "the belief port ({config.dialects.BELIEFS.default}, or `{config.dialects.BELIEFS.variable}`)",
        "at most {links.belief_link.LONGEST_LINE/1048576:g} MB long",
        "1 to {run.belief_grid.MOST_ROWS:,}, and 1 to {run.belief_grid.MOST_HEADINGS} headings; "
        "at most {run.belief_grid.MOST_STATES:,} states in all",
        "more than {100*run.belief_grid.SURELY_ELSEWHERE:g} % of the probability",
        "more than {run.facts.COVERED!w} spreads, {run.facts.SLIGHT:g} in, and half a cell's diagonal",
        "**unsure** with a spread of more than {run.facts.UNSURE:g} in",
        "a text of at most {links.belief_parser.LONGEST_NOTE} characters",
        "the map is drawn every {tui.maze.heat._REDRAWN!w} second",
        "grids above {runlog.encode.LARGE_GRID:,} states",
    ],
    "browser.md": [
        "<http://127.0.0.1:{config.settings.WEB_PORT}/>",
        "a random word of {8*web.page_access._WORD_BYTES} bits",
        "at {web.run_frames._PACE!w} times real speed",
    ],
    "calibrate.md": [
        "`{calibrate.written_set.CALIBRATION_PAGE}` shows each parameter",
        "(70 to {calibrate.guided._MOST} movements)",
        "more than {calibrate.rows.LONGEST_COUNT!w} movements apart",
        "readings on the way, after every {calibrate.stretches.LEAST_DISTANCE:g} in or "
        "{calibrate.stretches.LEAST_TURN:g} degrees",
        "within an inch and {calibrate.measured_run.START_SPREAD[2]:g} degrees",
        "at most {calibrate.parameters.IDENTIFIED!w} of its prior's",
        "would have been seen with {100*calibrate.model_check.POWER:g} %",
        "keeps all tests together at {100*calibrate.model_check.FALSE_MISFIT_RATE:g} %",
        "readings of the last {calibrate.prediction._HELD_BACK!w}, {calibrate.pose_filter.AHEAD[0]}, "
        "{calibrate.pose_filter.AHEAD[1]} and {calibrate.pose_filter.AHEAD[2]} movements ahead",
        "From {calibrate.change_detection._LEAST!w} calibrated sets on",
        "a false alarm in at most {100*calibrate.change_detection.FALSE_ALARMS:g} % of checks",
    ],
    "causes.md": [
        "At most {report.moments.MOST_MOMENTS!w} moments",
        "on the last {report.contact_evidence.BLIND:g} in or {report.contact_evidence.BLIND_TURN:g} deg",
        "{run.progress.HUNDRED} movements, or a {report.cause_order.STAYED!w} of the time",
        "within {run.facts.COVERED!w} standard deviations (and {run.facts.SLIGHT:g} in)",
        "than {run.facts.COVERED!w} of its spreads (and {run.facts.SLIGHT:g} in)",
        "spreads of its headings (and {run.facts.SLIGHT_TURN:g} deg)",
        "{run.facts.DEFAULT_ALLOWED:g} in and {run.facts.DEFAULT_ALLOWED_TURN:g} deg count",
        "(spread up to {run.facts.UNSURE:g} in and {run.facts.UNSURE_TURN:g} deg)",
        "Less than {report.counterfactuals.NARROW} in of room counts as neither",
    ],
    "coming-from.md": [
        "ports {config.dialects.COMMANDS.default} and {config.dialects.REPLIES.default} "
        "({config.dialects.PACKETS.default} and {config.dialects.PACKET_REPLIES.default} for simmer-python)",
        "At most {links.backend.MOST_COMMANDS:,} commands or {links.backend._MOST_BYTES/1024:g} KB",
        "packet waits {links.packet_replies.LONGEST_KEPT/60!w} minutes for its reader",
    ],
    "course.md": [
        "It has {mission.time_limit:g} seconds",
    ],
    "devices.md": [
        "has at most {config.device_file.LARGEST_DEVICE_FILE:,} bytes",
    ],
    "dialects.md": [
        "{config.dialects.SERIAL.default}; with another `{config.dialects.SERIAL.option}`",
        "{dialect.expressions._LONGEST:,} characters, {dialect.expressions.MOST_NODES} parts",
        "one `scan` of {dialect.expressions.MOST_RAYS} rays or {dialect.expressions._MOST_SENSING!w} `ray`",
        "texts that it makes have at most {dialect.expressions.LONGEST_TEXT:,} characters",
        "the replies to a message {dialect.templates.LONGEST_REPLY/1024:g} KB",
        "A {links.dialect_robot.KEY_SILENCE!w} of a second after the last key",
        "{dialect.exchange.LATE} s later or earlier than `takes` says",
        "that come within {1000*links.serial_wire.USB_FRAME:g} ms can be read together",
        "({config.settings.USUAL_BAUD} baud until then)",
    ],
    "driving.md": [
        "`loop_time` ({settings.motion.loop_time} s)",
        "`keys_speed` ({settings.screen.keys_speed:g} in/s) or `keys_turn_speed` "
        "({settings.screen.keys_turn_speed:g} deg/s)",
        "ends {tui.key_velocity._REPEATED} s after the last repeat of the key, or {tui.key_velocity._FIRST} s",
        "Touching again within {sim.continuous.SAME_CONTACT} s is the same contact",
        "Reading a clock costs {program.hook.simmer_clock._LOOK/1000:g} us, polling for a reply that is not there "
        "{1000*program.hook.simmer_clock.EMPTY_POLL:g} ms, and `input()` {program.hook.simmer_clock.INPUT:g} s",
        "Over a cell ({sim.specs.CELL_SIZE:g} in)",
    ],
    "grading.md": [
        "never succeeds takes {runs.at_0} runs, and one that always does takes {runs.at_1000}",
        "{runs.at_900} runs at a true rate of {test.rate}, {runs.at_750} at 0.75, and {runs.at_825} halfway; no team "
        "takes more than {test.cap}",
        "{100*test.false_pass:.1f} % pass at 0.75, {100*test.false_fail:.1f} % fail at {test.rate}",
        "at least {grade.robot_rules.SMALLEST_ROBOT:g} in across at its narrowest, and has at most "
        "{grade.robot_rules.MOST_SENSORS} sensors",
        "at most {grade.submission_copy.LARGEST_SUBMISSION/1000000:g} MB and {grade.submission_copy.MOST_FILES} files",
        "{grade.submission_reader._CPU} s of processor time and {grade.submission_reader._MEMORY/1000000:g} MB",
        "| `{cli.grade_command._GRADES}` | a row for each team",
        "| `{cli.grade_command._SITE}/{grade.site.INDEX}` | how many passed",
        "| `{cli.grade_command._JUNIT}` | a test case",
        "| `{cli.grade_command._GRADESCOPE}/TEAM/results.json` |",
        "The seed is in `{grade.course.PLAN_FILE}`",
        "A supervisor measures every {grade.usage._EVERY} s",
        "of its runs have {sim.noise.SEED_BITS} bits",
        "It is {exit.LOST:d} if the Dask cluster was lost, and {exit.INTERRUPTED:d} after Ctrl-C",
    ],
    "mission.md": [
        "`Reach` inches long (default {grip.reach:g}) and `Width` inches wide (default {grip.width:g})",
        "strokes a second, default {grip.speed:g}",
        "the drive `{config.settings.USUAL_DRIVE}`, a sensor profile for each type in the set, the link "
        "`{config.settings.USUAL_LINK}`",
        "`ultra` {1000*hc_sr04.read_time:g} ms, `tof` {1000*vl53l0x.read_time:g} ms, others "
        "{1000*encoder.read_time:g} ms",
    ],
    "report.md": [
        "the newest {run.paths.MOVEMENTS} movements and {report.recording.READINGS:thousands} readings",
        "at most {trials.figures._MOST}, with some for every cause",
        "at most {report.animation.USUAL_SECONDS:g} s long",
        "The last {program.program_output.LAST_LINES} lines of each stream",
        "the program's last {run.phrases.SHOWN_OUTPUT!w} lines if it crashed",
        "It needs {report.finding.FEWEST[set]} readings or movements",
        "Only rows that differ are tested, from {report.finding.FEWEST[nominal]} readings on",
        "any finding of a run is wrong is at most {100*report.finding._ERROR:g} % (Holm)",
        "from {report.finding.LEAST_INCHES:g} in or {report.finding.LEAST_DEGREES:g} degrees on, a gain from "
        "{100*report.finding.LEAST_SHARE:g} %",
    ],
    "run-log.md": [
        "This is format {runlog.header.FORMAT}.",
        "version of this format, {runlog.header.FORMAT}",
        "about every {runlog.writer.CHECKPOINT_EVERY} lines",
        "the first {links.dialect_link.LOGGED_OF_STREAM:,} messages of streams",
        "more than {runlog.encode.LARGE_GRID:,} states",
        "the last {program.program_output.LAST_LINES} lines of each",
        "{runlog.logged_scans._MISSED} is infinity",
        "-{run.belief_grid._STEPS:g} log2(p/p_best), {run.belief_grid.RULED_OUT} for none",
    ],
    "screen.md": [
        "Blue dots show its last {run.reducer.LEGS} movements",
        "small crosses the {tui.maze.scene.MOST_CONTACTS} before it",
        "with per cents from {100*tui.maze.heat._LEAST_SHARE:g} % on",
        "{settings.screen.fps} times a second, or {tui.frame_pace._SHOWN} times if",
    ],
    "sensors.md": [
        "{lidar.min_range} to {lidar.max_range} in",
        "{lidar.scan_rate} revolutions a second (`Scan Rate (Hz)`) of {lidar.rays} rays",
        "Percent Error is {lidar.error}, the Resolution {lidar.resolution} in, the Dropout {lidar.dropout}",
        "({sim.sensors.range_sensors.USUAL_RANGE} in, 4 m, if there is none)",
        "c = 343 m/s = {sim.sensors.faults.SPEED_OF_SOUND:,.0f} in/s",
        "up to {config.set_warnings._MOST_SAMPLES:,} rays a second",
        "| `hc-sr04` | {1000*hc_sr04.read_time:g} ms | no echo beyond {hc_sr04.incidence_limit:g} degrees, "
        "{100*hc_sr04.dropout:g} % dropouts, {100*hc_sr04.outlier:g} % outliers, cross-talk |",
        "| `vl53l0x` | {1000*vl53l0x.read_time:g} ms | {100*vl53l0x.dropout:g} % dropouts, "
        "{100*vl53l0x.outlier:g} % outliers |",
        "| `qtr` | {1000*qtr.read_time:g} ms | |",
        "| `mpu-6050` | {1000*mpu_6050.read_time:g} ms | random walk of {mpu_6050.random_walk} deg/sqrt(s) |",
        "| `qmc5883l` | {1000*qmc5883l.read_time:g} ms | hard iron {qmc5883l.hard_iron:g} deg, soft iron "
        "{qmc5883l.soft_iron:g} deg |",
        "| `encoder` | {1000*encoder.read_time:g} ms | {encoder.ticks_per_inch:g} ticks an inch |",
        "| `rplidar-a1m8` | up to a revolution, {1000/rplidar_a1m8.scan_rate:.0f} ms | "
        "{100*rplidar_a1m8.dropout:g} % dropouts |",
        "{1000*omni_4.right.start_lag:g} ms and {omni_4.right.acceleration:g} to {diff_dc.right.acceleration:g} in/s2 "
        "with DC motors, {1000*diff_stepper.right.start_lag:g} ms and {diff_stepper.right.acceleration:g} in/s2 with "
        "steppers",
    ],
    "trials.md": [
        "`{trials.store.RESULTS}`, a line for each finished run, and `{trials.folder.TABLE}`, a row for each run",
        "`{trials.folder.REPORT_PAGE}`: distributions",
        "`{trials.sweep_summary.CURVES}` has a row for each value",
        "Results are kept in `{trials.folder.WHY}/{trials.store.RESULTS}`",
        "`--margin` ({test.margin})",
        "up to {trials.cluster.MOST_PROGRAM_BYTES/1000000:g} MB",
        "repeats {trials.explanations.EXPLAINED!w} failed runs",
        "is repeated up to {trials.chance_control.REPEATS!w} times",
        "If p is not below {trials.intervals.SIGNIFICANCE}",
        "McNemar's exact test at {100*trials.intervals.SIGNIFICANCE:g} %",
        "the exit code is {exit.LOST:d}, and finished runs are kept",
        "is at least {trials.sequential.REQUIRED_RATE}, or that of `--require`",
    ],
}


class Phrase(string.Formatter):
    """Fills in numbers by the names of constants."""

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> tuple[Any, str]:
        for sign in "*/":
            left, found, right = field_name.partition(sign)
            if found:
                first, second = self._value(left), self._value(right)
                return first * second if sign == "*" else first / second, field_name
        return self._value(field_name), field_name

    def convert_field(self, value: Any, conversion: str | None) -> Any:
        if conversion == "w":
            return SHARES.get(value) or WORDS[int(value)]
        return super().convert_field(value, conversion)  # type: ignore[arg-type]

    def format_field(self, value: Any, format_spec: str) -> str:
        if format_spec == "thousands":
            return f"{value:,}".replace(",", " ")
        return str(super().format_field(value, format_spec))

    def _value(self, name: str) -> Any:
        if name.isdigit():
            return int(name)
        name, bracket, key = name.removesuffix("]").partition("[")
        first, *rest = name.split(".")
        value = DEFAULTS[first] if first in DEFAULTS else resolve_name(f"simmer_tui.{name}")
        for part in rest if first in DEFAULTS else ():
            value = value[part] if isinstance(value, dict) else getattr(value, part)
        return value[int(key) if key.isdigit() else key] if bracket else value


@pytest.mark.parametrize("name", PHRASES)
def test_a_page_states_the_numbers_of_the_code(name: str) -> None:
    text = (ROOT / name if name == "README.md" else ROOT / "docs" / name).read_text("utf-8")
    page = " ".join(text.split()).casefold()
    phrases = [Phrase().vformat(phrase, (), {}) for phrase in PHRASES[name]]
    assert [phrase for phrase in phrases if phrase.casefold() not in page] == []
