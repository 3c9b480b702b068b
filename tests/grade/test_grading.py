"""A course graded from the command line: decided, written, gone on with, graded again."""

from __future__ import annotations

import contextlib
import gzip
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest

from simmer_tui.cli.grade_command import run_grade
from simmer_tui.grade.container import what_is_missing
from simmer_tui.grade.grade_folder import GradeFolder
from simmer_tui.grade.grading import Grading
from tests.grade.conftest import HIT, SOLVE, chance, read_grades

TEAMS = {"good": SOLVE, "lazy": "pass", "wall": HIT, "odd <b>=1": chance(0.5, "odd")}
QUICK = "[decide]\nrequire = 0.9\nmargin = 0.5\n[limits]\ntime = 5.0\n"
"""Few runs: the two rates are far apart."""


def _results(out: Path) -> Counter[tuple[str, int, int]]:
    lines = [json.loads(line) for line in (out / "results.jsonl").read_text().splitlines()]
    return Counter((line["team"], line["attempt"], line["result"]["number"]) for line in lines)


@pytest.mark.slow
def test_course_is_graded_and_all_of_the_answer_is_there(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    file = make_course(TEAMS, QUICK)
    assert run_grade([str(file), "--out", str(out), "--jobs", "2"]) == 1
    rows = read_grades(out)
    assert {name: row["status"] for name, row in rows.items()} == {
        "good": "passed", "lazy": "failed", "wall": "failed", "odd <b>=1": "failed",
    }  # fmt: skip
    assert rows["lazy"]["main_cause"] == "nothing was sent"
    assert rows["wall"]["main_cause"] == "1 contact with a wall, 0 allowed"
    assert float(rows["good"]["success_rate_low"]) < 0.9 < float(rows["good"]["success_rate_high"]) == 1.0
    said = capsys.readouterr()
    assert "Wald's sequential test" in said.err
    assert "in a sandbox of bwrap" in said.err
    assert "1 of 4 teams passed" in said.out
    assert (out.stat().st_mode & 0o77, (out / "grade.json").stat().st_mode & 0o77) == (0, 0)

    suite = ElementTree.fromstring((out / "junit.xml").read_text())
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("4", "3", "0")
    results = json.loads((out / "gradescope" / "good" / "results.json").read_text())
    assert (results["score"], results["tests"][0]["status"]) == (100.0, "passed")
    assert [each["name"] for each in results["leaderboard"]] == ["success rate", "time, s"]
    lazy = json.loads((out / "gradescope" / "lazy" / "results.json").read_text())
    assert lazy["leaderboard"] == [{"name": "success rate", "value": 0.0}]  # a time of 0 would be the best
    index = (out / "site" / "index.html").read_text()
    assert "odd &lt;b&gt;=1" in index
    assert "<b>=1" not in index
    assert ">1 of 4 teams passed</h1>" in index
    assert "✓ passed" in index
    assert "Never started: " in index
    assert "class='verdict mixed'" in index
    for name in re.findall(r"href='([^']+)'", index):
        assert (out / "site" / name).exists()
    assert "run 1" in (out / "site" / "wall.html").read_text()
    kept = sorted(path.name for path in (out / "runs").rglob("*.gz"))
    failures = sum(int(row["runs"]) - int(row["successes"]) for row in rows.values())
    results_of = (json.loads(line)["result"] for line in (out / "results.jsonl").read_text().splitlines())
    first = sum(each["success"] and each["number"] % 100_000 == 1 for each in results_of)
    assert len(kept) == failures + first, "and those of first runs"
    headers = [
        json.loads(gzip.decompress(path.read_bytes()).splitlines()[0])
        for path in (out / "runs").rglob("*.gz")
    ]
    assert not any("run" in header for header in headers), "a team's command is nobody else's to run"
    page = (out / "site" / "good.html").read_text()
    assert "✓ succeeded" in page
    (played,) = re.findall(r"href='(good-run-[^']+)'", page)
    assert ">Mission succeeded</h1>" in (out / "site" / played).read_text()
    # All runs with a number had the same seed and mission, those of another none.
    drawn: dict[int, set[int]] = {}
    for line in (out / "results.jsonl").read_text().splitlines():
        result = json.loads(line)["result"]
        drawn.setdefault(result["number"] % 100_000, set()).add(result["seed"])
    assert all(len(seeds) == 1 for seeds in drawn.values())
    assert len(set.union(*drawn.values())) == len(drawn)


@pytest.mark.slow
def test_graded_twice_the_same_table_and_with_another_seed_another_grading(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path
) -> None:
    file = make_course({"odd": chance(0.6, "odd"), "good": SOLVE}, QUICK)
    tables = []
    for name, seed in (("one", ["--seed", "7"]), ("two", ["--seed", "7", "--jobs", "1"]), ("three", [])):
        run_grade([str(file), "--out", str(tmp_path / name), *seed])
        tables.append((tmp_path / name / "grades.csv").read_text())
    assert tables[0] == tables[1]
    assert GradeFolder.read(tmp_path / "three").plan.seed > 2**64  # but for once in 10^19


@pytest.mark.slow
def test_grading_that_was_killed_goes_on_with_nothing_lost_or_done_twice(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path
) -> None:
    file = make_course({"a": chance(0.8, "a"), "b": SOLVE, "c": chance(0.7, "c")}, QUICK)
    whole, out = tmp_path / "whole", tmp_path / "out"
    run_grade([str(file), "--out", str(whole), "--seed", "5"])
    command = [sys.executable, "-m", "simmer_tui", "grade", str(file), "--out", str(out), "--seed", "5"]
    with subprocess.Popen(
        command, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}, stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        while not (out / "results.jsonl").exists() or len(_results(out)) < 3:
            assert process.poll() is None
            signal.sigtimedwait([signal.SIGUSR1], 0.02)
        os.kill(process.pid, signal.SIGKILL)
    before = (out / "results.jsonl").read_bytes()
    with (out / "results.jsonl").open("ab") as file_of_results:
        file_of_results.write(b'{"team":"a","attem')  # as if it had been cut off
    run_grade(["--resume", "--out", str(out)])
    assert (out / "results.jsonl").read_bytes().startswith(before)
    assert max(_results(out).values()) == 1
    assert (out / "grades.csv").read_text() == (whole / "grades.csv").read_text()
    done = (out / "results.jsonl").read_bytes()
    run_grade(["--resume", "--out", str(out)])
    assert (out / "results.jsonl").read_bytes() == done


@pytest.mark.slow
def test_one_team_again_with_what_it_has_handed_in_now(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path
) -> None:
    file, out = make_course({"a": "pass", "b": SOLVE}, QUICK), tmp_path / "out"
    assert run_grade([str(file), "--out", str(out)]) == 1
    before = _results(out)
    (tmp_path / "teams" / "a" / "main.py").write_text(SOLVE)
    assert run_grade(["--regrade", "a", "--out", str(out)]) == 0
    after = _results(out)
    assert before <= after
    assert {team for team, attempt, _ in after if attempt == 2} == {"a"}
    assert run_grade(["--regrade", "nobody", "--out", str(out)]) == 2


@pytest.mark.slow
def test_names_can_be_hidden(isolation: str, make_course: Callable[..., Path], tmp_path: Path) -> None:
    file, out = make_course({"secretive": HIT}, QUICK), tmp_path / "out"
    run_grade([str(file), "--out", str(out), "--hide-names"])
    code = read_grades(out)["secretive"]["code"]
    for page in (out / "site").iterdir():
        assert "secretive" not in page.name + page.read_text()
    assert code in (out / "site" / "index.html").read_text()


@pytest.mark.slow
def test_student_practises_at_home(
    make_course: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = make_course({"mine": SOLVE}, QUICK)
    file.rename(tmp_path / "course.toml")
    mine, out = tmp_path / "teams" / "mine", tmp_path / "out"
    options = ["--practice", "--course", str(tmp_path / "course.toml"), "--isolation", "none"]
    assert run_grade([str(mine), *options, "--out", str(out)]) == 0
    assert list(read_grades(out)) == ["mine"]
    assert "without a sandbox" in (out / "site" / "index.html").read_text()
    assert run_grade([str(mine), *options, "--out", str(mine / "out")]) == 2
    assert "name another --out" in capsys.readouterr().err


@pytest.mark.slow
def test_program_or_robot_that_cannot_be_is_the_teams_own_failure(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path
) -> None:
    file = make_course({"none": SOLVE, "ports": SOLVE, "robot": SOLVE, "good": SOLVE}, QUICK)
    teams = tmp_path / "teams"
    (teams / "none" / "team.toml").write_text('command = "./no-such-program"\n')
    for name in ("ports", "robot"):
        (teams / name / "config").mkdir()
    (teams / "ports" / "config" / "settings.toml").write_text("[server]\nport = 9000\nreply_port = 9000\n")
    (teams / "ports" / "config" / "robot.csv").write_bytes((tmp_path / "set" / "robot.csv").read_bytes())
    (teams / "robot" / "config" / "robot.csv").write_text("Shape,7\n")
    out = tmp_path / "out"
    assert run_grade([str(file), "--out", str(out)]) == 1
    rows = read_grades(out)
    assert "the sandbox has no ./no-such-program" in rows["none"]["main_cause"]
    assert rows["good"]["status"] == "passed"
    assert rows["ports"]["status"] in ("failed", "refused")
    assert rows["robot"]["status"] == "refused"
    assert "robot.csv" in rows["robot"]["problem"]


def test_without_a_sandbox_it_says_what_is_missing(
    make_course: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = make_course({"a": SOLVE}, QUICK)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert run_grade([str(file), "--out", str(tmp_path / "out")]) == 2
    assert "apt-get install bubblewrap" in capsys.readouterr().err
    assert run_grade([str(file), "--out", str(tmp_path / "two"), "--isolation", "docker"]) == 2
    assert "docker is not installed" in capsys.readouterr().err
    # The same command with another sandbox finds a free folder.
    assert [each.name for each in tmp_path.iterdir() if each.name in ("out", "two")] == []


@pytest.mark.slow
def test_logs_take_no_more_than_their_room(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path
) -> None:
    file, out = make_course({"a": HIT, "b": HIT}, QUICK + "logs = 0.005\n"), tmp_path / "out"
    run_grade([str(file), "--out", str(out)])
    sizes = [path.stat().st_size for path in (out / "runs").rglob("*") if path.is_file()]
    assert sum(sizes) <= 5000
    assert (out / "site" / "index.html").exists()


def test_teams_take_turns_and_nothing_is_done_in_vain(
    make_course: Callable[..., Path], tmp_path: Path
) -> None:
    from simmer_tui.grade.course import read_course
    from simmer_tui.grade.sandbox import Isolation

    file = make_course({"a": "", "b": "", "c": ""}, QUICK)
    folder = GradeFolder.create(tmp_path / "out", read_course(file), 3, Isolation.NONE)
    trials = Grading(folder).trials()
    first = [next(trials) for _ in range(6)]
    assert [(trial.slug, trial.repetition) for trial in first] == [
        ("a", 1), ("b", 1), ("c", 1), ("a", 2), ("b", 2), ("c", 2),
    ]  # fmt: skip


@pytest.mark.slow
def test_sixty_teams_of_known_success(
    isolation: str, make_course: Callable[..., Path], tmp_path: Path
) -> None:
    """At both margins and at 0, 0.5 and 1. Of twelve teams at a margin three wrongly decided happen once
    in fifty gradings; the program's luck is fixed, so here it is always the same."""
    rates = (0.0, 0.5, 0.75, 0.9, 1.0)
    programs = {
        f"team-{rate:g}-{number}": chance(rate, f"{rate}/{number}") for rate in rates for number in range(12)
    }
    file, out = make_course(programs), tmp_path / "out"
    assert run_grade([str(file), "--out", str(out), "--seed", "16", "--hide-names"]) == 1
    rows = read_grades(out)
    passed = {
        rate: sum(rows[f"team-{rate:g}-{n}"]["status"] == "passed" for n in range(12)) for rate in rates
    }
    size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    assert (passed[0.0], passed[0.5], passed[1.0]) == (0, 0, 12)
    assert passed[0.75] <= 2
    assert passed[0.9] >= 10
    assert len(_results(out)) < 60 * 50
    assert size < 500e6


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() != 0, reason="the other tests are done by a user who is not root already")
def test_grader_need_not_be_root(isolation: str, make_course: Callable[..., Path], tmp_path: Path) -> None:
    """The program is then the grader's own user, in namespaces."""
    make_course({"good": SOLVE, "who": "import os; print(os.getuid(), os.listdir('/proc/1/task'))"}, QUICK)
    nobody = {"user": 65534, "group": 65534, "extra_groups": list[int]()}
    paths = os.pathsep.join(path for path in sys.path if path.endswith("site-packages") or not path)
    root = str(Path(__file__).resolve().parents[2])
    variables = {"PATH": os.environ["PATH"], "PYTHONPATH": os.pathsep.join((root, paths)), "HOME": "/nowhere",
                 "PYTHONDONTWRITEBYTECODE": "1"}  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        shutil.copytree(tmp_path, place, dirs_exist_ok=True)
        for path in (place, *place.rglob("*")):
            os.chown(path, 65534, 65534)

        def run(python: str, *words: str) -> subprocess.CompletedProcess[str]:
            command = [python, *words]
            return subprocess.run(
                command, capture_output=True, text=True, check=False, env=variables, cwd=place, **nobody
            )

        for python in (sys.executable, "/usr/bin/python3"):
            with contextlib.suppress(OSError):
                if run(python, "-c", "import simmer_tui.cli.grade_command").returncode == 0:
                    break
        else:
            pytest.skip("there is no Python here that others than root can start")
        done = run(python, "-m", "simmer_tui", "grade", "teams.toml", "--out", "out")
        assert done.returncode == 1, done.stderr
        assert "in a sandbox of bwrap" in done.stderr
        assert {team: row["status"] for team, row in read_grades(place / "out").items()} == {
            "good": "passed", "who": "failed",
        }  # fmt: skip
        assert (place / "out" / "runs" / "who" / "0001.txt").read_text() == "65534 ['1']\n"


@pytest.mark.skipif(sys.platform == "win32", reason="a script stands in for the engine")
def test_what_an_engine_says_last_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    engine = tmp_path / "docker"
    engine.write_text(f"#!/bin/sh\necho {'a' * 300}{'b' * 200} >&2\nexit 1\n")
    engine.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert what_is_missing("docker", "") == f"docker does not answer: {'b' * 200}"
    engine.write_text("#!/bin/sh\nexit 0\n")
    assert what_is_missing("docker", "") == ""
    # An image that has to be fetched first would come too late for the runs.
    engine.write_text('#!/bin/sh\n[ "$1" = info ] || { echo "no image $3" >&2; exit 1; }\n')
    assert (
        what_is_missing("docker", "ours")
        == "docker has no image ours (docker pull ours fetches it): no image ours"
    )
    assert what_is_missing("docker", "").startswith("docker has no image python:3.12-slim (")
