"""The tables in short: rows of commands, devices and beliefs."""

from __future__ import annotations

from msgspec.structs import replace

from simmer_tui.report.belief_facts import BeliefFacts
from simmer_tui.report.fact_tables import NO_TRUTH, fact_tables
from simmer_tui.report.run_evidence import RunEvidence
from tests.report.test_belief_facts import look_along
from tests.report.test_causes import begin


def test_the_tables_have_the_same_rows_with_and_without_a_truth() -> None:
    mission = begin(noise=True)
    look_along(mission, 3.0)
    tables = fact_tables(mission.evidence(1))
    mission.history.is_twin = True
    real = fact_tables(mission.evidence(1))
    assert not BeliefFacts(mission.attempt).steps
    for table, other in zip(tables, real, strict=True):
        assert [row[0] for row in table.rows] == [row[0] for row in other.rows]
    _, devices, beliefs = real
    assert all(row[-1] == NO_TRUTH for row in (*devices.rows, *beliefs.rows[1:]))


def test_the_table_of_commands_names_what_was_never_read_and_repeated() -> None:
    mission = begin((42.0, 42.0, 180.0))
    mission.give("u1", "d1-1", "d1-1", "d1-x")
    rows = {row[0]: row[1:] for row in fact_tables(mission.evidence(1))[0].rows}
    assert rows["sent"] == (4, "d1 3, u1 1")
    assert rows["refused"] == (1, "d1 1")
    assert "u5" in str(rows["sensors never read"][1])
    assert rows["repeated movements"] == (1, "of 2, such as d1-1")


def test_the_command_that_ended_a_mission_counts_as_sent() -> None:
    mission = begin((30.0, 42.0, 90.0))
    mission.give("u1", "d1-20")
    rows = {row[0]: row[1:] for row in fact_tables(mission.evidence(1))[0].rows}
    assert rows["sent"] == (2, "u1 1, d1 1")
    mission = begin((30.0, 42.0, 90.0))
    mission.give("d1-20")
    assert fact_tables(mission.evidence(1))[0].rows[0] == ("sent", 1, "d1 1")


def test_the_longest_silence_includes_the_one_until_the_end() -> None:
    mission = begin()
    mission.give("u1", "u2")
    mission.referee.check(400.0)
    commands = {row["fact"]: row["text"] for row in fact_tables(RunEvidence(mission.attempt))[0].objects()}
    assert str(commands["longest silence"]) == "249.9 simulated s after 50.1 s"


def test_what_a_sensor_has_otherwise_is_in_the_table_without_an_effect_too() -> None:
    mission = begin(change=lambda sensor: replace(sensor, z=9.0) if sensor.code == "u1" else sensor)
    mission.give("u1", "u5")
    rows = {row["code"]: row["text"] for row in fact_tables(mission.evidence(1))[1].objects()}
    assert rows["u1"] == "as its set says; its Z Position (in) is 9, in mission 6"
    assert rows["u5"] == "as its set says"
