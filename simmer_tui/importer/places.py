"""Start pose and block of an import, moved to a free cell if they overlap a wall.

The other simulators let both overlap a wall; here nothing starts so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from simmer_tui.config.settings import settings_from
from simmer_tui.errors import Problem
from simmer_tui.importer.imported import Imported
from simmer_tui.sim.placement import placement_problems
from simmer_tui.sim.specs import BLOCK, CELL_SIZE, EMPTY, START, MazeSpec, SimulationSpec

MAX_TRIES = 200
"""Most cells tried for a place: each try builds a maze, and a course has 32 cells."""

POSITIONS = ("block_center", "bot_center")
"""The settings that are places. The block comes first: a solid one can be where the robot starts."""
_CELLS = {"block_center": (BLOCK, EMPTY, START), "bot_center": (START, EMPTY, BLOCK)}
"""The cells to try, those meant for it first."""


def settled(imported: Imported, origins: Mapping[str, str]) -> Imported:
    """The import with robot and block in the middle of a free cell where they overlapped a wall.

    `origins` maps the settings `bot_center` and `block_center` to their place in the team's file.
    What has no free cell stays where it is.
    """
    problems = _problems(imported)
    for name in POSITIONS:
        what = problems.get(name)
        if what is None:
            continue
        for x, y in _middles(imported.maze, _CELLS[name]):
            moved = replace(imported, settings={**imported.settings, name: (x, y)})
            found = _problems(moved)
            if name not in found:
                problems = found
                note = Problem(origins.get(name, name), f"{what.partition(';')[0]}; moved to ({x:g}, {y:g})")
                imported = replace(moved, left_out=(*moved.left_out, note))
                break
    return imported


def _problems(imported: Imported) -> dict[str, str]:
    settings = settings_from(imported.settings)
    return dict(
        placement_problems(
            SimulationSpec(
                maze=imported.maze,
                robot=imported.robot,
                sensors=(),
                drives=(),
                bot_center=settings.bot_center,
                bot_rot=settings.bot_rot,
                block_center=settings.block_center,
                block_size=settings.blocksize,
                block_solid=settings.motion.block_solid,
            )
        )
    )


def _middles(maze: MazeSpec, kinds: tuple[int, ...]) -> Iterator[tuple[float, float]]:
    places = [
        ((column + 0.5) * CELL_SIZE, (maze.rows - row - 0.5) * CELL_SIZE)
        for kind in kinds
        for row, cells in enumerate(maze.cells)
        for column, cell in enumerate(cells)
        if cell == kind
    ]
    yield from places[:MAX_TRIES]
