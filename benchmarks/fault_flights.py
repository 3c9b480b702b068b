"""Single runs with a fault: logged by the simulator as users run it, and read by `report --json`.

A run is a pair of files in the folder of its kind: NAME.jsonl, the log, and NAME.flight.json, its outcome by
the referee, not by the report under test. Both are kept, so that a table can be continued, and a newer report
can read the same logs again.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import os
import random
import re
import shlex
import shutil
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fault_answers import PLAIN, SOLVE, STEP6, STEP7, Case, Expected, Hand
from fault_independent import INDEPENDENT
from fault_kinds import KINDS, TOLD
from fault_third import THIRD

from simmer_tui.cli.headless import Headless
from simmer_tui.cli.main import main as simmer_tui
from simmer_tui.cli.run_life import RunLife
from simmer_tui.config.loader import Override, load
from simmer_tui.config.maze_csv import read_cells
from simmer_tui.config.sets import MISSION_SET, bundled_sets
from simmer_tui.live.operating.robot_operator import Operator
from simmer_tui.live.server import Server
from simmer_tui.run.events import Action, ActionName, Event, Goal, Result
from simmer_tui.run.mission import plan_run
from simmer_tui.sim.command import parse_command

HERE = Path(__file__).resolve().parent
SCRIPTS = {
    SOLVE: HERE.parent / "scripts" / "solve.py",
    STEP7: HERE.parent / "scripts" / "course" / "step7_mission.py",
    STEP6: HERE.parent / "scripts" / "course" / "step6_block.py",
    PLAIN: HERE / "plain_mission.py",
}
_CENTRE = re.compile(r"(bot|block)_center *= *\[([\d.]+), *([\d.]+)\]")
CLEAN = "clean"
CELL = 12.0  # in
LOADING = 3  # the value of the loading zone's cells in maze.csv
# With packets a run takes four times the CPU time: one of so many runs is enough to test that they are passed
# on.
PACKETS_EVERY = 4
# The arrays of the programs are small: threads would only wait for each other.
_CALM = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}


@dataclass(frozen=True)
class Flight:
    """Result of a run, by the referee and by the program's exit code. `time` in seconds (simulated)."""

    success: bool
    taken: bool
    exit_code: int
    time: float
    struck: bool
    """True if the person's action was possible, or there was none."""

    def failed(self, program: str) -> bool:
        """True if the program has not completed its task: step 6 only takes the block."""
        return not (self.taken if program == STEP6 else self.success)


def case_of(kind: str, seed: int) -> Case:
    """The fault of a kind in the run with a seed; a clean run has none."""
    fault = {**KINDS, **TOLD, **INDEPENDENT, **THIRD}.get(kind)
    return Case(Expected()) if fault is None else fault.draw(random.Random(f"{kind} {seed}"))


def flown(folder: Path, kind: str, program: str, seed: int, *, again: bool = False) -> Flight:
    """Result of a run, which is done unless its files exist."""
    name = folder / kind.replace(":", "").replace(" ", "-") / f"{program}-{seed}"
    told = name.with_suffix(".flight.json")
    if not again and told.exists() and log_of(folder, kind, program, seed).exists():
        return Flight(**json.loads(told.read_text()))
    name.parent.mkdir(parents=True, exist_ok=True)
    flight = _fly(name, case_of(kind, seed), program, seed)
    told.write_text(json.dumps(asdict(flight)))
    return flight


def log_of(folder: Path, kind: str, program: str, seed: int) -> Path:
    """The log of a run."""
    return folder / kind.replace(":", "").replace(" ", "-") / f"{program}-{seed}.jsonl"


def report_of(log: Path) -> dict[str, Any]:
    """Answer of `simmer-tui report LOG --json`, with defaults for the keys that are graded."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        code = simmer_tui(["report", str(log), "--json"])
    if code:
        raise RuntimeError(f"no report of {log}: {said.getvalue()[:500]}")
    report: dict[str, Any] = json.loads(said.getvalue())
    return {"findings": [], "episodes": [], **report}


# -- flying -----------------------------------------------------------------------------------


def _fly(name: Path, case: Case, program: str, seed: int) -> Flight:
    log = name.with_suffix(".jsonl")
    log.unlink(missing_ok=True)
    directory = _set_of(name, case, program, seed)
    packets = program == PLAIN and seed % PACKETS_EVERY == 0
    settings: dict[str, object] = {"server.port": 0, **case.settings}
    if packets:
        settings |= {"server.listeners": ["binary", "packets"], "server.packet_port": 0}
    overrides = {key: Override(key, value) for key, value in settings.items()}
    configuration, plan = plan_run(load(directory, overrides), seed)
    server = Server(configuration, plan=plan)
    hand = _HandOf(server, case.hand, random.Random(seed))
    server.engine.watch(hand.watch)
    # The programs know the robot as it should be, not as it is.
    known = _known_set(name, case)
    scripts = _edited(name.with_suffix(".scripts"), case.edits)
    environment = _CALM | {"SIMMER_CONFIG": str(known)} | dict(case.environment)
    environment |= {"SIMMER_PROTOCOL": "packets"} if packets else {}
    front = Headless(server, quiet=True, has_program=True)
    with _as_surroundings(environment):
        life = RunLife(
            server,
            front,
            command=_command(case, scripts[program], environment | _map(name, case)),
            log=str(log),
        )
        code = life.run()
    assert server.referee is not None, "the set has a mission"
    state = server.referee.state()
    name.with_suffix(".maze.csv").unlink(missing_ok=True)
    for made in (directory, known, name.with_suffix(".scripts")):
        if made.parent == name.parent:
            shutil.rmtree(made, ignore_errors=True)
    return Flight(
        success=state.result is Result.SUCCESS,
        taken=state.goals[Goal.TAKEN] is not None,
        exit_code=code,
        time=state.time,
        struck=hand.struck,
    )


def _edited(folder: Path, edits: Sequence[tuple[str, str, str]]) -> dict[str, Path]:
    """The programs' scripts; with edits they are copies in a folder.

    Raises AssertionError: a file does not have the text that is to be changed, or has it twice.
    """
    if not edits:
        return SCRIPTS
    shutil.rmtree(folder, ignore_errors=True)
    copies = {}
    for program, script in SCRIPTS.items():
        shutil.copytree(script.parent, folder / program, ignore=shutil.ignore_patterns("__pycache__"))
        copies[program] = folder / program / script.name
        for file, old, new in edits:
            path = folder / program / file
            if path.exists():
                text = path.read_text("utf-8")
                assert text.count(old) == 1, f"{file} has {text.count(old)} times: {old}"
                path.write_text(text.replace(old, new), "utf-8")
    return copies


def _map(name: Path, case: Case) -> dict[str, str]:
    """Variable with the program's own map of the maze, if it lacks a wall."""
    if case.opened is None:
        return {}
    row, column = case.opened
    lines = (bundled_sets()[MISSION_SET] / "maze.csv").read_text("utf-8").splitlines()
    cells = [line.split(",") for line in lines if line and not line.startswith("#")]
    assert cells[row][column] == "0", "the map lacks a wall that there is"
    cells[row][column] = "1"
    path = name.with_suffix(".maze.csv").resolve()
    path.write_text("\n".join(map(",".join, cells)) + "\n", "utf-8")
    return {"SIMMER_MAZE": str(path)}


def _command(case: Case, path: Path, environment: dict[str, str]) -> str:
    """Command for `--run`: the proxy, which starts the program."""
    if case.script:
        script = shlex.split(case.script)
    elif case.program:
        script = [str(HERE / "fault_program.py"), json.dumps(dict(case.program)), str(path)]
    else:
        script = [str(path)]
    fault = {"rules": case.rules, "environment": environment}
    proxy = [sys.executable, "-S", "-E", str(HERE / "fault_proxy.py"), json.dumps(fault)]
    return shlex.join([*proxy, sys.executable, *script])


@contextlib.contextmanager
def _as_surroundings(environment: dict[str, str]) -> Iterator[None]:
    """Context with the environment that the program inherits, without variables of other runs."""
    before = dict(os.environ)
    os.environ.update(environment)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def _set_of(name: Path, case: Case, program: str, seed: int) -> Path:
    """The folder of the robot's set: the bundled one, or a changed copy of it."""
    if not case.cells and program != PLAIN:
        return bundled_sets()[MISSION_SET]
    folder = _made(name.with_suffix(".set"), case.cells)
    if program == PLAIN:
        _give_start(folder, random.Random(seed))
    return folder


def _known_set(name: Path, case: Case) -> Path:
    """The folder of the set that the program knows: the bundled one, or a wrong one."""
    if not case.known and not case.mirrored:
        return bundled_sets()[MISSION_SET]
    folder = _made(name.with_suffix(".known"), case.known)
    if case.mirrored:
        maze = folder / "maze.csv"
        lines = maze.read_text("utf-8").splitlines()
        turned = [line if line.startswith("#") else ",".join(line.split(",")[::-1]) for line in lines]
        maze.write_text("\n".join(turned) + "\n", "utf-8")
        # Robot and block are moved too, or the set would be refused.
        settings = folder / "settings.toml"
        settings.write_text(_CENTRE.sub(_mirrored_centre, settings.read_text("utf-8")), "utf-8")
    return folder


def _mirrored_centre(line: re.Match[str]) -> str:
    """The line of settings.toml with the robot's or the block's place in the mirrored maze."""
    return f"{line[1]}_center = [{8 * CELL - float(line[2])}, {line[3]}]"


def _made(folder: Path, changed: Sequence[tuple[str, str, str, str]]) -> Path:
    """A folder with the bundled set and other values in some cells."""
    shutil.rmtree(folder, ignore_errors=True)
    with contextlib.redirect_stdout(io.StringIO()):
        simmer_tui(["init", str(folder), "--from", MISSION_SET])
    for file in ("sensors.csv", "drive.csv"):
        cells = [cell[1:] for cell in changed if cell[0] == file]
        if cells:
            path = folder / file
            path.write_text(_with_cells(path.read_text("utf-8"), cells), "utf-8")
    return folder


def _with_cells(text: str, cells: list[tuple[str, str, str]]) -> str:
    """A table with other values in some cells, given by the code of their row, and their column."""
    header, *rows = csv.reader(io.StringIO(text))
    code_at = header.index("Poll Character")
    rows = [row + [""] * (len(header) - len(row)) for row in rows if any(row)]
    changed = []
    for code, column, value in cells:
        if column not in header:
            header.append(column)
            rows = [[*row, ""] for row in rows]
        # All rows are found before any is changed: codes may be swapped.
        changed.append((next(row for row in rows if row[code_at] == code), header.index(column), value))
    # A later column may have lengthened the rows, which are other lists by then.
    by_id = {row[0]: row for row in rows}
    for row, at, value in changed:
        by_id[row[0]][at] = value
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([header, *rows])
    return out.getvalue()


def _give_start(folder: Path, draw: random.Random) -> None:
    """Write the robot's start into mission.toml, for a program that does not search for it."""
    cells = read_cells((folder / "maze.csv"), [])
    assert cells is not None, "the bundled maze can be read"
    starts = [(x, y) for y, row in enumerate(cells[::-1]) for x, value in enumerate(row) if value == 2]
    x, y = draw.choice(starts)
    path = folder / "mission.toml"
    text = path.read_text("utf-8")
    text = text.replace('start = "any"', f"start = [{(x + 0.5) * CELL}, {(y + 0.5) * CELL}]")
    text = text.replace('heading = "quarter"', f"heading = {90.0 * draw.randrange(4)}")
    path.write_text(text, "utf-8")


class _HandOf:
    """A person who waits for the moment, and then moves robot or block."""

    def __init__(self, server: Server, hand: Hand | None, draw: random.Random) -> None:
        self._server, self._hand, self._draw = server, hand, draw
        self._operator = Operator(server) if hand is not None and hand.action == "keys" else None
        self.struck = hand is None
        self._asked = hand is None

    def watch(self, event: Event) -> None:
        """Check for the moment, in the robot's thread."""
        hand, simulator = self._hand, self._server.simulator
        if self._asked or hand is None or simulator.moving:
            return
        block, pose = simulator.block, simulator.pose
        near = (
            hand.near
            and not simulator.holding
            and math.dist((block.x, block.y), (pose.x, pose.y)) < hand.near
        )
        held = hand.holding and simulator.holding
        if simulator.time >= hand.at or near or held:
            self._asked = True
            self._server.call(self._strike, hand)

    def _strike(self, hand: Hand) -> None:
        if hand.action == "pause":
            self.struck = True
            for name in (ActionName.PAUSE, ActionName.RESUME):
                self._server.engine.perform(Action(name))
            return
        if self._operator is not None:
            self.struck = True
            self._operator.send(parse_command(f"r1-{hand.turn:g}", "keys"))
            return
        for action in self._tries(hand):
            if not self._server.engine.perform(action).refused:
                self.struck = True
                return

    def _tries(self, hand: Hand) -> list[Action]:
        """The possible actions, the best first: a place may be too near a wall."""
        simulator = self._server.simulator
        pose = simulator.pose
        if hand.action == "turn":
            return [Action(ActionName.TELEPORT, (pose.x, pose.y, pose.heading + hand.turn))]
        if hand.action == "reset":
            return [Action(ActionName.RESET)]
        if hand.shift:
            return self._shifts(hand)
        cells = simulator.spec.maze.cells[::-1]
        free = [(x, y, value) for y, row in enumerate(cells) for x, value in enumerate(row) if value]
        # A block in another cell of the loading zone would be found again.
        places = [
            ((x + 0.5) * CELL, (y + 0.5) * CELL)
            for x, y, value in free
            if value != LOADING or hand.action == "teleport"
        ]
        far = [place for place in places if math.dist(place, (pose.x, pose.y)) > 1.5 * CELL]
        self._draw.shuffle(far)
        if hand.action == "block":
            return [Action(ActionName.BLOCK, place) for place in far]
        return [Action(ActionName.TELEPORT, (*place, 90.0 * self._draw.randrange(4))) for place in far]

    def _shifts(self, hand: Hand) -> list[Action]:
        """Pushes of the robot or the block by the same way, in any direction."""
        simulator = self._server.simulator
        moves = [
            (hand.shift * math.cos(math.radians(angle)), hand.shift * math.sin(math.radians(angle)))
            for angle in range(0, 360, 30)
        ]
        self._draw.shuffle(moves)
        if hand.action == "block":
            block = simulator.block
            return [Action(ActionName.BLOCK, (block.x + x, block.y + y)) for x, y in moves]
        pose = simulator.pose
        return [Action(ActionName.TELEPORT, (pose.x + x, pose.y + y, pose.heading)) for x, y in moves]
