"""Sentences that answer why a run went as it did: what went wrong first, and how it ended."""

from __future__ import annotations

from collections.abc import Iterator

from simmer_tui.document.formats import COUNT, PASSAGE, QUOTED, number
from simmer_tui.document.model import DataColumn, DataTable, data_table
from simmer_tui.report.run_statistics import RunStatistics
from simmer_tui.run.episodes import Episode, EpisodeKind
from simmer_tui.run.events import ActionName
from simmer_tui.run.history_rows import ContactRow
from simmer_tui.run.phrases import WEDGED_TEXT, contact_ending, obstacles_text, pose_text, times_text
from simmer_tui.run.run_history import RunHistory
from simmer_tui.sim.command import WORD, counted, cut, first_of

# Readings named in a sentence; it says how many more there are.
_READINGS = 6
# Episodes named in sentences; the table has all.
_NAMED = 6
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


def findings(run: RunStatistics) -> list[str]:
    """Sentences that a person should read first, the most telling first."""
    return list(_sentences(run))


def _sentences(run: RunStatistics) -> Iterator[str]:
    history, totals, origin = run.history, run.totals, run.header.taken_over
    wedged = history.wedged.first
    if origin is not None:
        yield f"Taken over {origin}: until then the two runs are the same."
    yield from _end(run)
    if totals.contacts:
        yield _contacts(run)
    if wedged.given:
        since, place = wedged.items[0].elapsed, pose_text(wedged.items[0].pose)
        yield f"From {since:.1f} s on it was {WEDGED_TEXT}. It stood at {place}."
    yield from belief_sentences(history, ended_badly=run.cause is not None)
    if totals.actions:
        listed = ", ".join(f"{name} {count}x" for name, count in totals.actions.most_common(8))
        yield f"Actions by a person: {listed}."
    yield from _other_seed(run)


def _other_seed(run: RunStatistics) -> Iterator[str]:
    """The seed since the last restart, if a person chose another than that of the log's header."""
    done = (row for row in run.history.actions.items if row.done.action.name is ActionName.SEED)
    changed = [row for row in done if not row.done.refused]
    if changed and changed[-1].done.action.arguments[0] != run.header.seed:
        seed = int(changed[-1].done.action.arguments[0])
        yield f"From {changed[-1].elapsed:.1f} s on the seed was {seed}."


def _end(run: RunStatistics) -> Iterator[str]:
    """The end at a wall, if it was there."""
    contacts = run.history.contacts.items
    stuck = run.attempt.stuck
    if stuck is not None:
        where = pose_text(run.pose)
        yield f"Stuck at the end: {stuck.text}. The robot stayed at {where}."
    elif contacts and contacts[-1].contact.ended and contacts[-1].line == run.totals.last_command_line:
        last = contacts[-1]
        touched = obstacles_text((last.contact,))
        yield f"The run ends at {touched}: {last.shown} (line {last.line}) was its last command."


def _contacts(run: RunStatistics) -> str:
    first = run.history.repeated.first.items[0].first
    touched = obstacles_text(row.contact for row in run.history.contacts.items)
    if run.totals.legs:
        text = f"The robot touched {touched} {times_text(run.totals.contacts)}"
        unread = "No sensor was read shortly before it."
    else:
        share = f"{run.totals.contacts} of {counted(run.totals.movements, 'movement')}"
        went_on = run.totals.contacts - run.totals.contacts_that_ended
        text = (
            f"{share} touched {touched}, and {went_on} went on" if went_on else f"{share} ended at {touched}"
        )
        unread = "No sensor was read since the movement before it."
    return f"{text}. The first: {_contact_text(first)} {_before(first) or unread}"


def _contact_text(row: ContactRow) -> str:
    turned = f" and {abs(row.turned):.0f} deg of turning" if abs(row.turned) >= 2 else ""
    ending = contact_ending(row.contact, row.pose, f"after {row.went:.1f} in{turned} ")
    return f"{row.shown} (line {row.line}, at {row.elapsed:.1f} s) {ending}."


def _before(row: ContactRow) -> str:
    """The program's readings when it gave the command; empty if there were none."""
    if not row.seen:
        return ""
    shown = [f"{cut(each.text.strip(), WORD)} {each.reading.value:.1f}" for each in row.seen]
    return f"Readings before it: {first_of(shown, _READINGS)}."


# -- episodes of beliefs: localized, lost, frozen or moved ---------------------------------------------


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
    end = f"At the end the belief was off by {last.error_text} (on average {beliefs.mean:.1f} in)."
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
