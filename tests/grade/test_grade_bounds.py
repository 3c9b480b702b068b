"""Limits of a grading, its sandboxes by kind, and its control groups."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec import structs

from simmer_tui.errors import ConfigurationError
from simmer_tui.grade import cgroup, grade_folder
from simmer_tui.grade.bubblewrap import Bubblewrap
from simmer_tui.grade.cgroup import ControlGroup, made_group
from simmer_tui.grade.container import Container
from simmer_tui.grade.course import Team, read_course
from simmer_tui.grade.grade_folder import GradeFolder, number_in_team
from simmer_tui.grade.grade_run import GradeRun, OpenCopy, sandbox_of
from simmer_tui.grade.sandbox import Isolation
from simmer_tui.grade.submission_reader import SubmissionReader
from simmer_tui.links.ports import take_port
from simmer_tui.trials.run import TrialRun, fault_result

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no sandboxes")
LIMITS = "[limits]\ntime = 7.0\nmemory = 3.0\noutput = 2.5\n"


@pytest.fixture
def folder(make_course: Callable[..., Path], tmp_path: Path) -> GradeFolder:
    course = read_course(
        make_course({"a": "go", "b": ""}, f'read_only = ["/opt"]\nimage = "an image"\n{LIMITS}')
    )
    return GradeFolder.create(tmp_path / "out", course, 3, Isolation.NONE)


def test_a_submission_has_64_megabytes(
    make_course: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []

    def copy(source: Path, goal: Path, most: int) -> dict[str, str]:
        asked.append(most)
        goal.mkdir()
        return {}

    monkeypatch.setattr(grade_folder, "copy_submission", copy)
    GradeFolder.create(tmp_path / "out", read_course(make_course({"a": ""})), 3, Isolation.NONE)
    assert asked == [64_000_000]


def test_a_trial_is_the_courses(folder: GradeFolder) -> None:
    entry = folder.entries[1]
    trial = folder.trial(entry, 12)
    program = folder.path.resolve() / "teams" / "b" / "program"
    assert (trial.number, trial.repetition, trial.name) == (100_012, 12, "b/0012")
    assert (trial.slug, trial.files, trial.command, trial.maze) == ("b", program, "python -S main.py", "")
    assert (trial.read_only, trial.image, trial.isolation) == (("/opt",), "an image", Isolation.NONE)
    assert (trial.time_limit, trial.limits, trial.fixed_ports) == (7.0, folder.course.limits, False)
    assert number_in_team(fault_result(trial, "")) == 12
    folder.plan = structs.replace(folder.plan, isolation=Isolation.PODMAN)
    assert folder.trial(entry, 1).fixed_ports
    assert folder.log(entry, 12) == folder.path / "runs" / "b" / "0012.jsonl.gz"
    assert folder.output(entry, 12) == folder.path / "runs" / "b" / "0012.txt"


def test_a_run_has_a_log_of_30_megabytes_and_a_sandbox_of_its_own(
    folder: GradeFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: dict[str, Any] = {}

    def init(self: TrialRun, *args: object, **options: Any) -> None:
        given.update(options)

    monkeypatch.setattr(TrialRun, "__init__", init)
    trial = folder.trial(folder.entries[0], 1)
    GradeRun(trial, folder.runs)
    GradeRun(trial, folder.runs)  # the folder of its team is there already
    assert given["most_log"] == 30_000_000
    copy = given["sandbox"]()
    assert isinstance(copy, OpenCopy)
    assert copy.take is take_port
    home = copy.start.keywords["folder"]  # type: ignore[attr-defined]
    assert (home / "main.py").read_text() == "go"
    assert home != trial.files
    copy.close()
    assert not home.exists()


@pytest.mark.skipif(sys.platform != "linux", reason="there are sandboxes on Linux alone")
def test_kinds_of_sandboxes(folder: GradeFolder) -> None:
    trial = replace(folder.trial(folder.entries[0], 1), isolation=Isolation.BWRAP, time_limit=99.5)
    assert isinstance(sandbox_of(trial), Bubblewrap)
    for engine in (Isolation.DOCKER, Isolation.PODMAN):
        made = sandbox_of(replace(trial, isolation=engine))
        assert isinstance(made, Container)
        words = made.words()
        assert words[:2] == [engine.value, "run"]
        assert {"an image", f"{trial.files}:/program:ro", "/opt:/opt:ro", "3000000"} <= {*words}
        assert words[words.index("KILL") + 1] == "120"  # the time of the run, and 20 s
        made.close()


def test_a_course_has_the_simulated_robot_and_room_for_the_largest(
    make_course: Callable[..., Path], tmp_path: Path
) -> None:
    file = make_course({"a": ""}, "[rules]\nsize = 40\n")
    settings = tmp_path / "set" / "settings.toml"
    text = settings.read_text().replace("sim = true", "sim = false")
    _, head, serial = text.partition("\n[serial]\n")
    settings.write_text(text.replace(head + serial, head + serial.replace('port = ""', 'port = "/dev/x"', 1)))
    with pytest.raises(ConfigurationError) as caught:
        GradeFolder.create(tmp_path / "out", read_course(file), 3, Isolation.NONE)
    found = [*map(str, caught.value.problems)]
    assert found[0] == "sim: grading is for the simulated robot"
    assert found[1:]
    assert all(each.startswith("rules.size: with a robot as large as allowed: ") for each in found[1:])
    assert not (tmp_path / "out" / "grade.json").exists()


# -- control groups ----------------------------------------------------------------------------------


def kernel(path: Path) -> Path:
    """A folder in which new groups have the files that the kernel makes."""
    path.mkdir(parents=True, exist_ok=True)
    (path / "cgroup.subtree_control").touch()
    return path


def test_a_group_is_made_where_all_controllers_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = kernel(tmp_path / "a"), kernel(tmp_path / "b")
    make = Path.mkdir

    def made(self: Path, *given: Any, **more: Any) -> None:
        make(self, *given, **more)
        for name in ("memory", "pids", *(["cpu"] if self.parent == second else [])):
            (self / f"{name}.max").touch()

    def remove(self: Path) -> None:
        for each in self.iterdir():
            each.unlink()
        remove_folder(self)

    remove_folder = Path.rmdir
    monkeypatch.setattr(Path, "mkdir", made)
    monkeypatch.setattr(Path, "rmdir", remove)
    group = made_group([tmp_path / "missing", first, second])
    assert group is not None
    assert group.path.parent == second
    assert group.path.name.startswith("simmer-")
    assert len(group.path.name.rpartition("-")[2]) == 8
    assert [each for each in first.iterdir() if each.is_dir()] == []
    assert (first / "cgroup.subtree_control").read_text() == "+memory +pids +cpu"
    group.limit(5, 6)
    assert {each.name: each.read_text() for each in group.path.iterdir()} == {
        "memory.max": "5", "pids.max": "6", "cpu.max": "100000 100000",
    }  # fmt: skip
    (group.path / "cgroup.kill").touch()
    group.remove()
    assert not group.path.exists()


def test_a_limit_that_cannot_be_set_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "memory.max").touch()
    with pytest.raises(FileNotFoundError, match=r"pids\.max"):
        ControlGroup(tmp_path).limit(1, 2)
    assert ControlGroup(tmp_path).processor_time() == 0.0
    (tmp_path / "cpu.stat").write_text("user_usec 5\nusage_usec 1500000\n")
    assert ControlGroup(tmp_path).processor_time() == 1.5
    (tmp_path / "cpu.stat").write_text("user_usec 5\n")
    assert ControlGroup(tmp_path).processor_time() == 0.0


def test_a_group_becomes_empty_within_two_seconds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its processes are killed; it is tried again every hundredth of a second."""
    now = [100.0]
    paused: list[float] = []

    def pause(seconds: float) -> None:
        paused.append(seconds)
        now[0] += 0.5

    monkeypatch.setattr(cgroup, "time", SimpleNamespace(monotonic=lambda: now[0], sleep=pause))
    group = tmp_path / "group"
    group.mkdir()
    (group / "cgroup.kill").touch()
    ControlGroup(group).remove()
    assert (group / "cgroup.kill").read_text() == "1"
    assert paused == [0.01] * 4
    paused.clear()
    ControlGroup(tmp_path / "none").remove()
    assert paused == []


@pytest.mark.parametrize(
    ("mounts", "own"),
    [
        ("1 0 0:1 / /x rw - ext4 y rw\n", "0::/a\n"),
        ("2 0 0:2 / /x rw - cgroup2 cgroup2 rw\n", "1:name:/a\n"),
        ("2 0 0:2 / /x rw - tmpfs cgroup2 rw\n", "0::/a\n"),
        (None, None),
    ],
)
def test_a_process_without_groups_of_the_second_version_has_none(
    monkeypatch: pytest.MonkeyPatch, mounts: str | None, own: str | None
) -> None:
    made: list[str] = []

    def read(self: Path, *given: object) -> str:
        if mounts is None or own is None:
            raise FileNotFoundError
        return mounts if self.name == "mountinfo" else own

    monkeypatch.setattr(Path, "read_text", read)
    monkeypatch.setattr(Path, "mkdir", lambda self: made.append(str(self)))
    assert made_group() is None
    assert made == []


def test_only_a_team_with_a_robot_of_its_own_is_read_in_a_child(
    make_course: Callable[..., Path], tmp_path: Path, exact_mission: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or one with a team.toml; each is read once when the grading begins."""
    called: list[str] = []

    def call(self: SubmissionReader, function: Callable[..., Any], team: Team, *given: object) -> Any:
        called.append(f"{function.__name__} {team.name}")
        return function(team, *given)

    monkeypatch.setattr(SubmissionReader, "call", call)
    file = make_course({"a": "", "b": "", "c": ""})
    (tmp_path / "teams" / "b" / "config").mkdir()
    shutil.copy(exact_mission / "robot.csv", tmp_path / "teams" / "b" / "config")
    (tmp_path / "teams" / "c" / "team.toml").write_text('command = "./x"\n')
    made = GradeFolder.create(tmp_path / "out", read_course(file), 3, Isolation.NONE)
    assert called == ["submitted_team c", "check_submission b"]
    assert [entry.problems for entry in made.entries] == [(), (), ()]
    assert [entry.check.configuration is None for entry in made.entries] == [False] * 3
