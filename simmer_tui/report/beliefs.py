"""Episodes of a program's beliefs, in sentences and as a table: localized, lost, frozen or moved."""

from simmer_tui.document.formats import COUNT, PASSAGE, QUOTED, number
from simmer_tui.document.model import DataColumn, DataTable
from simmer_tui.run.episodes import Episode, EpisodeKind
from simmer_tui.run.run_history import RunHistory

EPISODES = DataTable(
    "episodes",
    "What the program believed",
    (
        DataColumn("kind"),
        DataColumn("time_s", number(".1f")),
        DataColumn("line", COUNT),
        DataColumn("off_in", number(".1f")),
        DataColumn("off_deg", number(".0f")),
        DataColumn("after", QUOTED),
        DataColumn("text", PASSAGE, "what", wraps=True),
    ),
)
# Episodes named in sentences; the table has all.
_NAMED = 6
_PERSON = "a person moved the robot"


def episodes_table(history: RunHistory, *, ended_badly: bool) -> DataTable:
    """The episodes of a run; no rows where no belief was sent and nobody moved anything."""
    rows = [
        (each.kind.value, each.elapsed, each.line, each.distance, each.turn, _after(each), episode_text(each))
        for each in history.episodes.so_far(ended_badly=ended_badly)
    ]
    return EPISODES.filled(rows)


def belief_sentences(history: RunHistory, *, ended_badly: bool) -> list[str]:
    """The episodes in one sentence, and the error at the end; none where no belief was sent."""
    if not history.beliefs:
        return []
    last, beliefs = history.beliefs[-1], history.totals.beliefs
    end = (
        f"At the end the belief was off by {last.distance:.1f} in and {abs(last.turn):.0f} deg "
        f"(on average {beliefs.mean:.1f} in)."
    )
    episodes = history.episodes.so_far(ended_badly=ended_badly)
    named = [episode_text(each) for each in episodes[:_NAMED]]
    if len(episodes) > _NAMED:
        named.append(f"and {len(episodes) - _NAMED} more")
    if not any(each.kind is EpisodeKind.LOCALIZED for each in episodes):
        named.insert(0, "never localized")
    return [f"Belief: {', '.join(named)}. {end}"]


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
