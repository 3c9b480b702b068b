"""`simmer-tui compare`: two sets of trials, run by run."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from simmer_tui.cli.compare_command import run_compare
from simmer_tui.config.loader import load
from simmer_tui.config.sets import bundled_sets
from simmer_tui.errors import TrialsError
from simmer_tui.trials.compare import count_pairs, paired, verdict
from simmer_tui.trials.folder import TrialFolder, TrialPlan
from simmer_tui.trials.intervals import PairCounts, mcnemar
from simmer_tui.trials.trial import TrialResult, run_seed

Make = Callable[[str, int, list[bool]], TrialFolder]


@pytest.fixture
def make(tmp_path: Path, made_result: Callable[..., TrialResult]) -> Make:
    """Makes trials of a name and seed with these successes."""
    files = load(bundled_sets()["mission"]).files

    def made(name: str, seed: int, successes: list[bool]) -> TrialFolder:
        plan = TrialPlan(
            command=f"python {name}.py",
            runs=len(successes),
            seed=seed,
            configuration="mission",
            settings={},
            mazes=(),
            random_mazes=False,
            fixed_ports=False,
            time_limit=60.0,
        )
        folder = TrialFolder.create(tmp_path / name, plan, files, {})
        for number, success in enumerate(successes, 1):
            time = 100.0 + number + (10.0 if name == "b" else 0.0)
            folder.append(made_result(number, run_seed(seed, number), success=success, time=time))
        return folder

    return made


def test_pairs_are_the_runs_that_both_have(make: Make) -> None:
    a = make("a", 1, [True, True, False, False, True])
    b = make("b", 1, [True, False, True, False])
    pairs = paired(a, b)
    assert [(one.number, other.number) for one, other in pairs] == [(1, 1), (2, 2), (3, 3), (4, 4)]
    assert count_pairs(pairs) == PairCounts(1, 1, 1, 1)


def test_compare_prints_difference_interval_and_what_can_be_said(
    make: Make, capsys: pytest.CaptureFixture[str]
) -> None:
    a, b = make("a", 1, [False] * 12 + [True] * 8), make("b", 1, [True] * 18 + [False] * 2)
    assert run_compare([str(a.path), str(b.path)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "both succeed 6" in out
    assert "only A succeeds 2 19, 20" in out
    assert "only B succeeds 12 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12" in out
    assert "B - A, success rate +0.500 (" in out
    assert out.count("McNemar's exact test: p = 0.013, below 0.05") == 2
    assert "time, both succeed s 6 115.5 125.5 +10 (+10 to +10)" in out
    assert "B succeeds more often than A" in out


def test_compare_as_json_has_the_counts_and_the_interval(
    make: Make, capsys: pytest.CaptureFixture[str]
) -> None:
    a, b = make("a", 1, [True, False, False, False]), make("b", 1, [True, True, True, False])
    assert run_compare([str(a.path), str(b.path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert [(row["runs"], row["which"]) for row in answer["pairs"]] == [
        (1, None),
        (0, []),
        (2, [2, 3]),
        (1, None),
    ]
    assert answer["difference"]["success_rate"] == answer["difference"]["p"] == 0.5
    assert [(row["set"], row["success_rate"]) for row in answer["sets"]] == [("A", 0.25), ("B", 0.75)]
    assert answer["text"]["verdict"] == verdict(paired(a, b))


def test_verdict_changes_sides_with_the_sets_and_says_when_nothing_can_be_told(make: Make) -> None:
    poor, good = make("a", 1, [False] * 12 + [True] * 8), make("b", 1, [True] * 20)
    assert verdict(paired(poor, good)).startswith("B succeeds more often")
    assert verdict(paired(good, poor)).startswith("A succeeds more often")
    assert "do not show which" in verdict(paired(poor, poor))


def test_trials_on_other_seeds_are_not_compared(make: Make, capsys: pytest.CaptureFixture[str]) -> None:
    a, b = make("a", 1, [True]), make("b", 2, [True])
    assert run_compare([str(a.path), str(b.path)]) == 2
    assert (
        "A and B have no run with the same seed and maze (their seeds are 1 and 2)" in capsys.readouterr().err
    )


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.builds(PairCounts, *[st.integers(0, 40)] * 4).filter(lambda each: each.count > 0))
def test_verdict_and_p_value_never_disagree(
    made_result: Callable[..., TrialResult], counts: PairCounts
) -> None:
    outcomes = [(True, True)] * counts.both + [(True, False)] * counts.first_only
    outcomes += [(False, True)] * counts.second_only + [(False, False)] * counts.neither
    pairs = [tuple(made_result(k, k, success=each) for each in both) for k, both in enumerate(outcomes)]
    said = verdict(pairs)  # type: ignore[arg-type]
    p = mcnemar(counts)
    assert ("do not show which" in said) == (p >= 0.05) == ("not below 0.05" in said)
    if p < 0.05:
        better = "B succeeds" if counts.second_only > counts.first_only else "A succeeds"
        assert said.startswith(better)
    shown = float(said.partition("p = ")[2].partition(",")[0])
    assert (shown < 0.05) == (p < 0.05)


def test_two_runs_give_a_mean_but_no_interval(make: Make, capsys: pytest.CaptureFixture[str]) -> None:
    a, b = make("a", 1, [True, True]), make("b", 1, [True, True])
    assert run_compare([str(a.path), str(b.path)]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith(" time, both")]
    assert line.split()[-4:] == ["2", "101.5", "111.5", "+10"]


def alter(folder: TrialFolder, name: str, old: str, new: str) -> TrialFolder:
    """The folder with another text in a file of its set."""
    path = folder.path / "set" / name
    text = path.read_bytes().decode()
    assert old in text
    path.write_bytes(text.replace(old, new).encode())
    return TrialFolder.read(folder.path)


@pytest.mark.parametrize(
    ("name", "old", "new", "named"),
    [
        ("mission.toml", "time_limit = 300", "time_limit = 200", "mission.toml"),
        ("maze.csv", "3,3,1,1,0,2,0,2", "3,3,1,1,2,2,0,2", "maze.csv"),
        ("settings.toml", "blocksize = 3.0", "blocksize = 2.5", "the setting blocksize (3.0 and 2.5)"),
    ],
)
@pytest.mark.parametrize("options", [[], ["--other-robot"]])
def test_other_tasks_are_never_compared(
    make: Make,
    capsys: pytest.CaptureFixture[str],
    name: str,
    old: str,
    new: str,
    named: str,
    options: list[str],
) -> None:
    a, b = make("a", 1, [True]), alter(make("b", 1, [True]), name, old, new)
    assert run_compare([str(a.path), str(b.path), *options]) == 2
    assert capsys.readouterr().err == (
        f"simmer-tui compare: A and B had different tasks: they differ in {named}; run both with the same "
        "maze, mission and block\n"
    )


@pytest.mark.parametrize(
    ("name", "old", "new", "named"),
    [
        ("sensors.csv", "ultra1,u1,1", "ultra1,u1,0", "sensors.csv"),
        ("settings.toml", "num_segments = 10", "num_segments = 20", "the setting num_segments (10 and 20)"),
    ],
)
def test_other_robots_are_compared_only_when_that_is_wanted(
    make: Make, capsys: pytest.CaptureFixture[str], name: str, old: str, new: str, named: str
) -> None:
    a, b = make("a", 1, [True]), alter(make("b", 1, [True]), name, old, new)
    both = [str(a.path), str(b.path)]
    assert run_compare(both) == 2
    assert capsys.readouterr().err == (
        f"simmer-tui compare: A and B had different robots: they differ in {named}; add --other-robot "
        "to compare them anyway\n"
    )
    assert run_compare([*both, "--other-robot"]) == 0
    assert f"They differ in {named}." in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("mission.toml", "time_limit = 300", "time_limit = 300.0  # five minutes"),
        ("maze.csv", "\n", "\r\n"),
        ("settings.toml", "fps = 16", "fps = 5"),
        ("settings.toml", "port = 9000", "port = 9010"),
    ],
)
def test_what_changes_no_run_is_not_asked_about(make: Make, name: str, old: str, new: str) -> None:
    a, b = make("a", 1, [True]), alter(make("b", 1, [True]), name, old, new)
    assert len(paired(a, b)) == 1


def test_mazes_of_one_name_must_be_one_maze(make: Make) -> None:
    a, b = make("a", 1, [True]), make("b", 1, [True])
    made = []
    for folder, cells in ((a, "2,1,3\n"), (b, "2,0,3\n")):
        (folder.path / "mazes").mkdir()
        (folder.path / "mazes" / "m.csv").write_text(cells)
        folder.write_plan(replace(folder.plan, mazes=("m.csv",)))
        result = replace(folder.results[1], maze="m.csv")
        (folder.path / "results.jsonl").write_bytes(msgspec.json.encode(result) + b"\n")
        made.append(TrialFolder.read(folder.path))
    with pytest.raises(TrialsError, match=r"they differ in the maze m\.csv;"):
        paired(*made)
    assert len(paired(made[0], made[0])) == 1


def test_folder_without_trials_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_compare([str(tmp_path), str(tmp_path)]) == 2
    assert "holds no trials" in capsys.readouterr().err
