"""The folder of runs with results, as trials and gradings have it: complete, recovered, typed, locked."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from msgspec import Struct

from simmer_tui.errors import TrialsError
from simmer_tui.trials.store import RunStore, StoreKind, unbroken


class Plan(Struct, frozen=True):
    names: tuple[str, ...]
    home: Path
    limit: float = 1.0


class Line(Struct, frozen=True):
    number: int
    time: float


KIND = StoreKind("runs", "plan.json", ("runs",), 7, Plan, Line, TrialsError)
PLAN = Plan(("a", "\udcff"), Path("/there"), 2.5)
"""With the name of a file that is no UTF-8."""


@pytest.fixture
def store(tmp_path: Path) -> RunStore[Plan, Line]:
    made = RunStore(tmp_path / "out", KIND)
    with made.made():
        made.write_files("runs", {"a.txt": "one\r\ntwo\n"})
        made.write_plan(PLAN)
    return made


def test_plan_and_results_come_back(store: RunStore[Plan, Line]) -> None:
    lines = [Line(2, 0.5), Line(1, 3.0)]
    for line in lines:
        store.append(line)
    again = RunStore(store.path, KIND)
    assert again.read_plan() == PLAN
    assert [line for _, line in again.lines()] == lines
    assert [where for where, _ in again.lines()] == [f"{store.results}:1", f"{store.results}:2"]
    assert (store.path / "runs" / "a.txt").read_bytes() == b"one\r\ntwo\n"
    assert sorted(path.name for path in store.path.iterdir()) == ["plan.json", "results.jsonl", "runs"]


@pytest.mark.parametrize("rest", [b'{"number":2,"ti', b'{"number":2,"time":1.0}'])
def test_line_that_was_cut_off_is_no_result_and_does_not_begin_the_next(
    store: RunStore[Plan, Line], rest: bytes
) -> None:
    store.append(Line(1, 3.0))
    whole = store.results.read_bytes()
    store.results.write_bytes(whole + rest)
    assert [line for _, line in store.lines()] == [Line(1, 3.0)]
    store.recover()
    assert store.results.read_bytes() == whole
    store.append(Line(2, 4.0))
    assert [line for _, line in store.lines()] == [Line(1, 3.0), Line(2, 4.0)]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "Input data was truncated"),
        ("[]", "Expected `object`, got `array`"),
        ('{"names": []}', "the format is not 7"),
        ('{"format": "7"}', "Expected `int | null`, got `str`"),
        ('{"format": 7}', "missing required field `names`"),
        ('{"format": 7, "names": [1], "home": "/"}', r"Expected `str`, got `int` - at `\$\.names\[0\]`"),
        ('{"format": 7, "names": [], "home": 1}', r"expected Path - at `\$\.home`"),
        ('{"format": 7, "names": [], "home": "/", "limit": NaN}', "JSON is malformed"),
        ('{"format": 7, "names": [], "home": "/", "limit": 1e999}', "Number out of range"),
        ('{"x": ' + "[" * 100_000, "recursion"),
    ],
)
def test_plan_that_does_not_fit_is_one_error_with_its_place(
    store: RunStore[Plan, Line], text: str, why: str
) -> None:
    (store.path / "plan.json").write_text(text)
    with pytest.raises(TrialsError, match=rf"plan\.json: .*{why}.*: begin in another folder"):
        store.read_plan()


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("nonsense", "JSON is malformed"),
        ("[]", "Expected `object`, got `array`"),
        ('{"number": "1", "time": 1.0}', "Expected `int`, got `str`"),
        ('{"number": 1, "time": true}', "Expected `float`, got `bool`"),
        ('{"number": 1}', "missing required field `time`"),
        ("\xff", "JSON is malformed"),
    ],
)
def test_result_that_does_not_fit_is_one_error_with_its_line(
    store: RunStore[Plan, Line], line: str, why: str
) -> None:
    store.append(Line(1, 3.0))
    with store.results.open("ab") as file:
        file.write(f"{line}\n".encode("latin-1"))
    with pytest.raises(TrialsError, match=rf"results\.jsonl:2: .*{why}.*; delete the line to run it again"):
        list(store.lines())


def test_folder_that_holds_anything_is_not_taken(store: RunStore[Plan, Line], tmp_path: Path) -> None:
    for path, why in ((store.path, "holds runs already: add --resume"), (tmp_path, "is not empty: name")):
        with pytest.raises(TrialsError, match=why), RunStore(path, KIND).made():
            pass
    (tmp_path / "file").touch()
    with (
        pytest.raises(TrialsError, match="cannot be written: File exists"),
        RunStore(tmp_path / "file", KIND).made(),
    ):
        pass
    assert store.read_plan() == PLAN


def test_folder_whose_making_was_cut_short_is_made_again(tmp_path: Path) -> None:
    path = tmp_path / "out"
    store = RunStore(path, KIND)

    def fail() -> None:
        with store.made():
            store.write_files("runs", {"a.txt": "1"})
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert list(path.iterdir()) == []
    script = (
        "import os, sys\n"
        "from tests.trials.test_store import KIND, RunStore, Path\n"
        "store = RunStore(Path(sys.argv[1]), KIND)\n"
        "with store.made():\n"
        "    store.write_files('runs', {'a.txt': '1'})\n"
        "    os._exit(0)\n"
    )
    subprocess.run([sys.executable, "-c", script, str(path)], check=True)
    assert list(path.iterdir()) != []
    with store.made():
        assert not (path / "runs").exists()
        store.write_plan(PLAN)
    assert [each.name for each in path.iterdir()] == ["plan.json"]


@pytest.mark.skipif(sys.platform == "win32", reason="there is no lock on Windows")
def test_one_process_at_a_time_adds_results(store: RunStore[Plan, Line]) -> None:
    with store.locked():
        store.append(Line(1, 3.0))
        with pytest.raises(TrialsError, match="another simmer-tui is adding results"), store.locked():
            pass
    with store.locked():
        store.append(Line(2, 3.0))
    assert len(list(store.lines())) == 2


def test_a_line_without_an_end_is_cut_off_under_the_lock(store: RunStore[Plan, Line]) -> None:
    """Without it, another process may be writing that line now."""
    store.append(Line(1, 3.0))
    whole = store.results.read_bytes()
    store.results.write_bytes(whole + b'{"number":2,"ti')
    with store.locked():
        assert store.results.read_bytes() == whole


@pytest.mark.skipif(sys.platform == "win32", reason="modes of files are those of POSIX")
def test_plan_of_an_open_folder_has_the_mode_of_any_new_file(store: RunStore[Plan, Line]) -> None:
    usual = store.path / "usual"
    usual.touch()
    assert (store.path / "plan.json").stat().st_mode == usual.stat().st_mode


@pytest.mark.skipif(sys.platform == "win32", reason="modes of files are those of POSIX")
def test_private_folder_is_for_its_owner_alone(tmp_path: Path) -> None:
    kind = StoreKind("runs", "plan.json", ("runs",), 7, Plan, Line, TrialsError, private=True)
    store = RunStore(tmp_path, kind)
    with store.made():
        store.write_plan(PLAN)
    assert (tmp_path.stat().st_mode & 0o777, (tmp_path / "plan.json").stat().st_mode & 0o777) == (
        0o700,
        0o600,
    )
    assert json.loads((tmp_path / "plan.json").read_text())["format"] == 7


def test_results_count_up_to_the_first_that_is_missing() -> None:
    assert unbroken({1: "a", 2: "b", 4: "d"}) == ["a", "b"]
    assert unbroken({2: "b"}) == []
