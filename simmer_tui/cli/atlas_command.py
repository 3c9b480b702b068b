"""The command `atlas`: expected readings at every pose of a grid, as a file."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from rich.progress import TaskProgressColumn, TimeRemainingColumn

from simmer_tui.atlas.array_files import csv_bytes, mat_bytes, npz_bytes
from simmer_tui.atlas.c_header import MEGA_FLASH, header_bytes, table_bytes
from simmer_tui.atlas.expected_readings import HEADINGS, STEP, Atlas, PoseGrid, atlas_codes, compute_atlas
from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    add_config_option,
    add_flag,
    add_setting_options,
    add_trust_option,
    add_value,
    overrides_from,
    print_lines,
    say,
    subcommand,
    writing,
)
from simmer_tui.cli.progress_bar import progress_bar
from simmer_tui.config.loader import load
from simmer_tui.config.sets import find_set
from simmer_tui.errors import AtlasError
from simmer_tui.sim import Simulator
from simmer_tui.sim.command import counted
from simmer_tui.whole_file import write_whole

_FORMATS: dict[str, Callable[[Atlas], bytes]] = {
    "npz": npz_bytes,
    "mat": mat_bytes,
    "csv": csv_bytes,
    "h": header_bytes,
}
MANY_POSES = 2_000_000
"""Poses computed without a question: for six sensors they take 10 s of processor time and 0.2 GB."""


def _options(parser: OneLineParser) -> None:
    parser.add_argument("out", metavar="OUT", type=Path, help="the file to write: .npz, .mat, .csv or .h")
    add_config_option(parser)
    text = "side of a cell, inches (default %(default)g)"
    add_value(parser, "--step", STEP, text, metavar="IN", default=1.0)
    add_value(
        parser, "--headings", HEADINGS, "directions, evenly spaced from 0 (default %(default)s)", default=8
    )
    parser.add_argument(
        "--sensors", metavar="CODES", help="which, as u1,u2 (default: every enabled range sensor)"
    )
    parser.add_argument(
        "--format", choices=_FORMATS, help="npz: numpy, mat: MATLAB, h: C (default: by OUT's ending)"
    )
    add_flag(parser, "--yes", f"compute more than {MANY_POSES:,} poses")
    add_trust_option(parser)
    add_setting_options(parser)


@subcommand("atlas", _options, usage="simmer-tui atlas OUT [options]")
def run_atlas(options: argparse.Namespace) -> int:
    """Compute the readings expected of every range sensor at every pose of a grid, for histogram filters
    (docs/atlas.md). Poses where the robot does not fit are marked."""
    out: Path = options.out
    form = _format_for(out, options.format)
    simulator = Simulator(load(find_set(options.config), overrides_from(options)).simulation)
    codes = atlas_codes(simulator, options.sensors.split(",") if options.sensors is not None else ())
    grid = PoseGrid.over(simulator.maze, options.step, options.headings)
    if grid.poses > MANY_POSES and not options.yes:
        what = f"the grid has {grid.poses:,} poses, more than {MANY_POSES:,}"
        raise AtlasError(f"{what}: take a larger --step, fewer --headings, or add --yes")
    atlas = _computed(simulator, grid, codes)
    data = _FORMATS[form](atlas)
    with writing(AtlasError, out):
        write_whole(out, data)
    print_lines(f"Wrote {out}, {len(data) / 1e6:.2f} MB: {', '.join(codes)}")
    _describe(atlas, simulator)
    if form == "h" and table_bytes(atlas) > MEGA_FLASH:
        say(
            f"note: its tables take {table_bytes(atlas) / 1024:.0f} kB; an Arduino Mega has "
            f"{MEGA_FLASH // 1024} kB: take a larger --step, fewer --headings or fewer --sensors"
        )
    return ExitCode.DONE


def _format_for(out: Path, named: str | None) -> str:
    """The format that was named, or that of the file's ending.

    Raises AtlasError if there is none, or if the file cannot be written. This is checked before the work,
    whose result would be lost.
    """
    form = named or out.suffix.removeprefix(".").lower()
    if form not in _FORMATS:
        raise AtlasError(f"{out} does not end in .{', .'.join(_FORMATS)}: add --format")
    if out.is_dir() or not out.parent.is_dir():
        what = "is a folder" if out.is_dir() else "is in a folder that does not exist"
        raise AtlasError(f"{out} {what}: name a file to write to")
    return form


def _describe(atlas: Atlas, simulator: Simulator) -> None:
    """Print the size of an atlas, and remarks on its sensors."""
    grid, codes = atlas.grid, atlas.codes
    places = f"{grid.poses:,} poses: {grid.rows} x {grid.columns} places, {counted(grid.headings, 'heading')}"
    print_lines(f"{places}; the robot fits at {int(atlas.free.sum()):,}")
    scanning = [each.code for each in simulator.spec.sensors if each.code in codes and each.kind.is_scan]
    if scanning:
        print_lines(f"{', '.join(scanning)}: the first ray of a revolution, along its Rotation")


def _computed(simulator: Simulator, grid: PoseGrid, codes: tuple[str, ...]) -> Atlas:
    """The atlas. A terminal (standard error) shows a progress bar meanwhile."""
    with progress_bar("atlas", TaskProgressColumn(), TimeRemainingColumn()) as progress:
        task = progress.add_task("atlas", total=grid.rows)
        return compute_atlas(simulator, grid, codes, lambda rows: progress.update(task, completed=rows))
