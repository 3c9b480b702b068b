"""Sketches of a team, compiled in a sandbox: its compiler sees the team's files and the runtime, and no more.

A few lines make a compiler work without end, or read what it can: `#include "/dev/zero"`. So all of it runs
in a sandbox with limits, and the compiled sketch comes out through a pipe.
"""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from msgspec import Struct

from simmer_tui import platform_has
from simmer_tui.errors import ConfigurationError, GradeError, Problem, ProgramError, reason_of
from simmer_tui.grade.bubblewrap import Bubblewrap, seen_folders
from simmer_tui.grade.limits import Limits
from simmer_tui.grade.sandbox import SANDBOXED_FILES
from simmer_tui.sim.command import cut
from simmer_tui.sketch.boards import BoardKind
from simmer_tui.sketch.build import BOARD_PROGRAM, BuiltSketch, runtime_object
from simmer_tui.sketch.build_order import BuildAnswer, BuildOrder
from simmer_tui.sketch.compiler import Compiler, find_compiler
from simmer_tui.sketch.compiler_messages import MOST_ERRORS
from simmer_tui.whole_file import write_whole

# A sketch of 3,800 lines took g++ 3.3 s and 155 MB, and 24 s of real time on a busy machine.
COMPILE_LIMITS = Limits(time=120.0, cpu=60.0, memory=1500.0, disk=64.0, processes=32)
"""Limits for the compiler of one sketch."""
_LARGEST_ANSWER = 32_000_000
"""Bytes of a compiled sketch, with all that is told; usual are 100 kB."""
_LONGEST_TEXT, _MOST_WARNINGS = 300, 10
"""Characters of a message of the compiler, and number of warnings that are kept."""
_ANSWER_FILE = "built.json"
NEEDS_COMPILER = "teams hand in sketches, which need g++ or clang++ on this machine: apt install g++"
_EXCEEDED = (
    *("signal terminated program", "out of memory", "memory exhausted", "cannot allocate memory"),
    *("std::bad_alloc", "No space left", "File too large", "File size limit"),
)
"""Words of a compiler, or of the system, about a limit that it has exceeded."""


@dataclass(frozen=True, slots=True)
class BoardSketch:
    """A sketch to compile. `sketch` is its path in the folder of the team's files, `place` that in
    wiring.toml."""

    sketch: str
    kind: BoardKind
    place: str


@dataclass(frozen=True, slots=True)
class BoardBuild:
    """Compiled sketches by board, or the problems for which there are none."""

    built: Mapping[str, BuiltSketch] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()


class _Kept(Struct, frozen=True):
    """The result of a build as it is kept: of each board its hash and warnings; or problems."""

    boards: dict[str, tuple[str, tuple[str, ...]]]
    problems: tuple[tuple[str, str], ...]


class BoardCompiler:
    """Compiles the sketches of teams in sandboxes."""

    def __init__(self, read_only: Sequence[str] = (), limits: Limits = COMPILE_LIMITS) -> None:
        """`read_only` are the course's folders that programs may read. Raises GradeError without a compiler
        here."""
        found = find_compiler()
        # The cache of ziglang fills for minutes at first, and a sandbox begins without it.
        if found is None or len(found.command) > 1:
            raise GradeError(NEEDS_COMPILER)
        self._compiler: Compiler = found
        self._limits = limits
        # A compiler elsewhere than in the system's folders is visible if the course says so.
        place = Path(found.command[0]).resolve()
        self._extra = [each for each in read_only if place.is_relative_to(Path(each).resolve())]
        if not any(place.is_relative_to(each.resolve()) for each in seen_folders(self._extra)):
            raise GradeError(
                f"no sandbox sees the compiler {place}: name its folder in the course's read_only"
            )

    def build_all(
        self, asked: Sequence[tuple[Path, Path, Mapping[str, BoardSketch]]], jobs: int | None = None
    ) -> list[BoardBuild]:
        """The builds of several teams: for each the folder of its files, that for the result, and its
        sketches by board. Raises GradeError if they cannot be sandboxed."""
        kinds = {each.kind.name: each.kind for _, _, sketches in asked for each in sketches.values()}
        for kind in kinds.values():
            self._runtime(kind)  # once, before the threads need it
        with ThreadPoolExecutor(jobs or os.cpu_count() or 1) as pool:
            return list(pool.map(lambda each: self.build(*each), asked))

    def _runtime(self, kind: BoardKind) -> Path:
        try:
            return runtime_object(self._compiler, kind)
        except (ConfigurationError, OSError) as error:
            raise GradeError(f"the runtime of boards cannot be compiled: {error}") from None

    def build(self, files: Path, goal: Path, sketches: Mapping[str, BoardSketch]) -> BoardBuild:
        """Compile a team's sketches, unless `goal` has the result already. It is kept there, unless the
        compiler ran out of real time: that may be this machine's fault. Raises GradeError."""
        kept = kept_build(goal)
        if kept is not None:
            return kept
        boards: dict[str, tuple[str, tuple[str, ...]]] = {}
        problems: list[tuple[str, str]] = []
        try:
            for name, sketch in sketches.items():
                answer, is_late = self._answer(files, sketch)
                if is_late:
                    return BoardBuild(problems=tuple(Problem(*each) for each in answer.problems))
                if answer.problems or not answer.program:
                    problems += [_cut_pair(each) for each in answer.problems[:MOST_ERRORS]]
                    continue
                folder = goal / name
                folder.mkdir(parents=True, exist_ok=True)
                folder.chmod(0o755)  # the board reads it with a user ID that nobody has
                (folder / BOARD_PROGRAM).write_bytes(answer.program)
                (folder / BOARD_PROGRAM).chmod(0o755)
                warnings = tuple(cut(each, _LONGEST_TEXT) for each in answer.warnings[:_MOST_WARNINGS])
                boards[name] = cut(answer.digest, 16), warnings
            goal.mkdir(exist_ok=True)
            write_whole(goal / _ANSWER_FILE, msgspec.json.encode(_Kept(boards, tuple(problems))))
        except OSError as error:
            raise GradeError(f"{error.filename or goal}: {reason_of(error)}") from None
        return kept_build(goal) or BoardBuild()

    def _answer(self, files: Path, sketch: BoardSketch) -> tuple[BuildAnswer, bool]:
        """The answer of a compiler in a sandbox; True if it ran out of real time."""
        runtime = self._runtime(sketch.kind)
        order = BuildOrder(
            compiler=self._compiler.command,
            sketch=f"{SANDBOXED_FILES}/{sketch.sketch}",
            kind=sketch.kind.name,
            place=sketch.place,
            runtime=str(runtime),
        )
        words = [sys.executable, "-m", "simmer_tui.sketch.build_order", msgspec.json.encode(order).decode()]
        limits: list[str] = []
        # The one package that a build imports may be elsewhere than Python itself.
        package = Path(msgspec.__file__).parent
        sandbox = Bubblewrap(files, self._limits, [*self._extra, str(runtime), str(package)])
        try:
            process = sandbox.start_piped(words, limits.append, [str(package.parent)])
            data, said, is_late = _output(process, self._limits.time)
            process.kill()
            process.wait()
        except ProgramError as error:
            raise GradeError(f"the compiler cannot be started in a sandbox: {error}") from None
        finally:
            sandbox.close()
        limit = limits[0] if limits else ""
        if is_late:
            limit = f"ended: it took more than {self._limits.time:g} s; grade again when this machine is idle"
        return _answer_of(data, said, limit, sketch, self._limits), is_late


def _answer_of(data: bytes, said: bytes, limit: str, sketch: BoardSketch, limits: Limits) -> BuildAnswer:
    """The answer in the output of a build, in which the sketch's text may have had a hand."""
    try:
        answer = msgspec.msgpack.decode(data, type=BuildAnswer)
    except (msgspec.MsgspecError, ValueError):
        answer = BuildAnswer()
        limit = limit or f"ended without an answer: {_last_line(said)}"
    if not answer.program:
        texts = [what for _, what in answer.problems]
        if any(word in each for each in texts for word in _EXCEEDED):
            given = f"{limits.cpu:g} s, {limits.memory:g} MB of memory or {limits.disk:g} MB of files"
            limit = limit or f"ended: it took more than {given}"
    if limit:
        return BuildAnswer(problems=((sketch.place, f"its compiler was {limit}"),))
    if not answer.program and not answer.problems:
        return BuildAnswer(problems=((sketch.place, "its compiler made nothing"),))
    return answer


def _last_line(said: bytes) -> str:
    lines = said.decode("utf-8", "replace").strip().splitlines()
    return cut(lines[-1], _LONGEST_TEXT) if lines else "it printed nothing"


def _cut_pair(problem: tuple[str, str]) -> tuple[str, str]:
    where, what = problem
    return cut(where, _LONGEST_TEXT), cut(what, _LONGEST_TEXT)


def kept_build(goal: Path) -> BoardBuild | None:
    """The result of an earlier build in a folder; None if there is none."""
    try:
        kept = msgspec.json.decode((goal / _ANSWER_FILE).read_bytes(), type=_Kept)
    except (OSError, msgspec.MsgspecError):
        return None
    built = {
        name: BuiltSketch((goal / name / BOARD_PROGRAM).resolve(), digest, warnings)
        for name, (digest, warnings) in kept.boards.items()
    }
    problems = tuple(Problem(where, what) for where, what in kept.problems)
    return BoardBuild({} if problems else built, problems)


def _output(process: subprocess.Popen[bytes], seconds: float) -> tuple[bytes, bytes, bool]:
    """The output of a process, both streams up to a limit; True if it took longer than so many seconds."""
    if not platform_has.POSIX:
        raise NotImplementedError  # there are no sandboxes here
    assert process.stdout is not None
    assert process.stderr is not None
    out, err = process.stdout.fileno(), process.stderr.fileno()
    found = {out: bytearray(), err: bytearray()}
    waiting, until = {out, err}, time.monotonic() + seconds
    while waiting:
        ready = select.select(list(waiting), [], [], max(until - time.monotonic(), 0.0))[0]
        if not ready:
            return b"", bytes(found[err]), True
        for each in ready:
            data = os.read(each, 1 << 16)
            found[each] += data
            if not data or len(found[each]) > _LARGEST_ANSWER:
                waiting.discard(each)
        if out not in waiting and len(found[out]) > _LARGEST_ANSWER:
            return b"", b"its answer is too large", False
    return bytes(found[out]), bytes(found[err]), False
