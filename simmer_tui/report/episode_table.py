"""The episodes of a run's beliefs as a table: localized, lost, frozen or moved by a person."""

from __future__ import annotations

from simmer_tui.document.formats import COUNT, PASSAGE, QUOTED, number
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.run.episodes import Episode, EpisodeKind
from simmer_tui.run.run_history import RunHistory

_PERSON = "a person moved the robot"
EPISODES = data_table(
    "episodes",
    "What the program believed",
    DataColumn("kind"),
    DataColumn("time_s", number(".1f")),
    DataColumn("line", COUNT),
    DataColumn("off_in", number(".1f")),
    DataColumn("off_deg", number(".0f")),
    DataColumn("after", QUOTED),
    DataColumn("text", PASSAGE, "what", wraps=True),
)


def episodes_table(history: RunHistory, *, ended_badly: bool) -> DataTable:
    """The episodes of a run; no rows where no belief was sent and nobody moved anything."""
    rows = [
        (each.kind.value, each.elapsed, each.line, each.distance, each.turn, _after(each), episode_text(each))
        for each in history.episodes.so_far(ended_badly=ended_badly)
    ]
    return EPISODES.filled(rows)


def episode_text(episode: Episode) -> str:
    """An episode in words: `lost at 64.8 s, 2.0 s after a person moved the robot, by 65.0 in`."""
    when = f"at {episode.elapsed:.1f} s"
    by = f"by {_size(episode)}"
    match episode.kind:
        case EpisodeKind.LOCALIZED:
            return f"localized {'again ' if episode.again else ''}{when}"
        case EpisodeKind.LOST:
            return f"lost {when}{_since(episode)}, {by}"
        case EpisodeKind.FROZEN:
            return f"frozen {when}: the pose sent stayed the same while the robot moved by {_size(episode)}"
        case EpisodeKind.MOVED:
            return f"{_PERSON} {when}, {by}"
        case EpisodeKind.BLOCK_MOVED:
            return f"a person moved the block {when}"
        case EpisodeKind.RESTARTED:
            return f"a person restarted the run {when}"


def _size(episode: Episode) -> str:
    turn = f" and {abs(episode.turn):.0f} deg" if abs(episode.turn) >= 1.0 else ""
    return f"{episode.distance:.1f} in{turn}"


def _after(episode: Episode) -> str | None:
    if episode.moved is not None:
        return _PERSON
    return None if episode.touched is None else f"the contact of line {episode.touched.line}"


def _since(episode: Episode) -> str:
    """Time since the event that may explain it, and that event."""
    if episode.moved is not None:
        return f", {episode.elapsed - episode.moved.elapsed:.1f} s after {_PERSON}"
    after = _after(episode)
    return "" if after is None else f", after {after}"
