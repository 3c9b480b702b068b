"""A folder of runs with results: a plan of the runs, and a line for each that has ended.

Trials and gradings are such folders, with these guarantees:

- The plan is written last, so a folder with a plan is complete. A folder whose creation was interrupted is
  made again.
- A result is on the disk when `append` returns. A last line that a crash cut off is no result; its run is
  done again.
- Other files appear whole or not at all.
- Plan and results are typed: a value that does not fit is one error with its place.
- One process at a time adds results or changes the plan.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from itertools import count, takewhile
from pathlib import Path
from typing import Generic, TypeVar

import msgspec

from simmer_tui import platform_has
from simmer_tui.errors import SimmerError, reason_of
from simmer_tui.runlog.typed_json import TypedJson
from simmer_tui.version import __version__
from simmer_tui.whole_file import PARTIAL, write_whole

RESULTS = "results.jsonl"

Plan = TypeVar("Plan")
Line = TypeVar("Line", bound=msgspec.Struct)
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class StoreKind(Generic[Plan, Line]):
    """A kind of folder: noun for people, plan file and its format, folders in it, types, error raised.

    `private` keeps other users of the machine out.
    """

    noun: str
    plan_file: str
    folders: tuple[str, ...]
    format: int
    plan: type[Plan]
    line: type[Line]
    error: type[SimmerError]
    private: bool = False


class _Head(msgspec.Struct):
    format: int | None = None


_HEAD: TypedJson[_Head] = TypedJson(_Head)


class ResultLines(Generic[Line]):
    """The results in a folder, a line of JSON each. Methods raise `error` if the file cannot be used."""

    def __init__(self, path: Path, line: type[Line], error: type[SimmerError]) -> None:
        self.path = path
        self._line: TypedJson[Line] = TypedJson(line)
        self._error = error

    @property
    def results(self) -> Path:
        """The file with the results."""
        return self.path / RESULTS

    def lines(self) -> Iterator[tuple[str, Line]]:
        """All results in the order in which they came, each with its place for messages."""
        shown = str(self.results)
        with self.reported("read"):
            data = self.results.read_bytes() if self.results.exists() else b""
        for number, line in enumerate(_whole(data).splitlines(), 1):
            where = f"{shown}:{number}"
            try:
                yield where, self._line.decode(line)
            except ValueError as error:
                raise self._error(f"{where}: {error}; delete the line to run it again") from None

    def recover(self) -> None:
        """Remove a last line that was cut off, so that the next one does not continue it."""
        with self.reported("written"):
            if self.results.exists():
                data = self.results.read_bytes()
                if len(_whole(data)) < len(data):
                    os.truncate(self.results, len(_whole(data)))

    def append(self, line: Line) -> None:
        """Add a result: on the disk when this returns."""
        with self.reported("written"), self.results.open("ab", buffering=0) as file:
            text = json.dumps(msgspec.to_builtins(line), separators=(",", ":"), allow_nan=False)
            file.write(f"{text}\n".encode())
            os.fsync(file.fileno())

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Prevent other processes from adding results meanwhile: two would do the same runs, or runs of two
        plans. The system releases the lock of a process that is killed. On Windows there is none. A line that
        was cut off is removed: under the lock no other process is writing it."""
        with self.reported("written"):
            file = self.results.open("ab")
        with file:
            try:
                platform_has.lock_alone(file.fileno())
            except BlockingIOError:
                shown = str(self.path)
                raise self._error(
                    f"{shown}: another simmer-tui is adding results: wait until it has ended"
                ) from None
            self.recover()
            yield

    @contextlib.contextmanager
    def reported(self, what: str) -> Iterator[None]:
        """Raise the folder's error for an OSError: that a file cannot be `what` (read, written)."""
        try:
            yield
        except OSError as error:
            where = str(error.filename or self.path)
            raise self._error(f"{where} cannot be {what}: {reason_of(error)}") from None


class RunStore(ResultLines[Line], Generic[Plan, Line]):
    """The files of one folder. Every method raises the error of its kind if a file cannot be used."""

    def __init__(self, path: Path, kind: StoreKind[Plan, Line]) -> None:
        super().__init__(path, kind.line, kind.error)
        self._kind = kind
        self._plan: TypedJson[Plan] = TypedJson(kind.plan)

    @contextlib.contextmanager
    def made(self) -> Iterator[None]:
        """Make the folder, which must be new or empty. The body fills it and ends with `write_plan`; if it
        raises, the folder is empty again."""
        with self.reported("written"):
            self.path.mkdir(mode=0o700 if self._kind.private else 0o777, parents=True, exist_ok=True)
            if self._kind.private:
                self.path.chmod(0o700)
            self._check_free()
            self._unfinished.touch()
            try:
                yield
            except BaseException:
                self._clear()
                raise
            self._unfinished.unlink()

    def write_plan(self, plan: Plan) -> None:
        """Write the plan, with the version of this package."""
        head = {
            "format": self._kind.format,
            "program": __version__,
            "written": datetime.now().astimezone().isoformat(timespec="seconds"),
        }
        fields = msgspec.to_builtins(plan, enc_hook=os.fspath)
        self.write(self._kind.plan_file, json.dumps(head | fields, indent=1, allow_nan=False) + "\n")

    def read_plan(self) -> Plan:
        kind, file = self._kind, self.path / self._kind.plan_file
        shown = str(self.path)
        try:
            data = file.read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            noun = kind.noun.removeprefix("a ")
            raise kind.error(f"{shown} holds no {noun}: there is no {kind.plan_file}") from None
        except OSError as error:
            raise kind.error(f"{shown} cannot be read: {reason_of(error)}") from None
        try:
            if _HEAD.decode(data).format != kind.format:
                raise ValueError(f"the format is not {kind.format}")
            return self._plan.decode(data)
        except ValueError as error:
            raise kind.error(
                f"{file}: {error}; simmer-tui {__version__} cannot continue with it: begin in another folder"
            ) from None

    def write(self, name: str, text: str) -> Path:
        """Write a file, whole or not at all; returns its path."""
        path = self.path / name
        with self.reported("written"):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, text, 0o600 if self._kind.private and name == self._kind.plan_file else 0o666)
        return path

    def write_files(self, folder: str, files: Mapping[str, str]) -> None:
        """Write the files of a configuration set, as they are, while the folder is `made`. Raises OSError."""
        (self.path / folder).mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            (self.path / folder / name).parent.mkdir(exist_ok=True)
            write_whole(self.path / folder / name, text)

    @property
    def _unfinished(self) -> Path:
        """A file that is there during `made`."""
        return self.path / f"{self._kind.plan_file}{PARTIAL}"

    def _check_free(self) -> None:
        shown = str(self.path)
        if (self.path / self._kind.plan_file).exists():
            raise self._kind.error(f"{shown} holds {self._kind.noun} already: add --resume to continue")
        if self._unfinished.exists():  # ours, by a process that was killed
            self._clear()
        if any(self.path.iterdir()):
            raise self._kind.error(f"{shown} is not empty: name a new folder with --out")

    def _clear(self) -> None:
        """Remove only the files of `made`."""
        for name in self._kind.folders:
            shutil.rmtree(self.path / name, ignore_errors=True)
        for path in self.path.glob(f"*{PARTIAL}"):  # the mark, and what was being written
            path.unlink(missing_ok=True)


def unbroken(results: Mapping[int, _Result]) -> list[_Result]:
    """The results from run 1 up to the first that is missing."""
    return [results[number] for number in takewhile(results.__contains__, count(1))]


def _whole(data: bytes) -> bytes:
    """The lines that have an end."""
    return data[: data.rfind(b"\n") + 1]
