"""Events of a run, as frozen records: the one stream that every reader of a run follows.

An event tells what has happened, never what is only expected. A movement gives two events: its plan when it
begins, and its true path when it has ended. The engine tells events in the order in which they happen.
Screen, run log, referee and report follow the same stream, live or from a file.

The records are msgspec structs, since a log has millions of them: a changed copy is made by
`msgspec.structs.replace`.

A command that moves gives `MovementPlanned`, `MovementEnded` and a `CommandResult` with its answer. The
answer comes at the end (`DONE`), or at once (`ACCEPTED`, then before the end). All other commands give a
`CommandResult`. A velocity continues after its answer: its motion is reported leg by leg.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, KeysView
from enum import StrEnum
from typing import Annotated, Generic, Self, TypeVar, get_type_hints

from msgspec import Meta, Struct, field

from simmer_tui.run.belief_grid import GridBelief
from simmer_tui.sim.command import Command
from simmer_tui.sim.legs import Leg
from simmer_tui.sim.path import Contact
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.records import CommandResult as CommandResult  # the event of every command
from simmer_tui.sim.records import Grip
from simmer_tui.sim.trajectory import Trajectory

# Beyond this, adding 0.01 to a float loses digits: no maze and no run comes near it.
LARGEST_NUMBER = 1e12
"""Limit of all times (seconds), places (inches) and headings (degrees)."""
Real = Annotated[float, Meta(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
"""A number within it, as a log may have."""


class NoticeKind(StrEnum):
    """Subject of a notice."""

    CONNECTED = "connected"
    LEFT = "left"
    TURNED_AWAY = "turned away"
    FAULT = "fault"
    PROGRAM = "program"
    ROBOT = "robot"
    """The port of a real robot."""
    BOARD = "board"
    """A fact of a board: a late byte, a lost edge, a wait at a contact."""
    VERDICT = "verdict"
    """Outcome of the run, and its cause."""
    HINT = "hint"
    """A hint to the person at the screen: it is shown and not logged."""
    TAKEN_OVER = "taken over"
    """The events before it are the replayed prefix of another run; this run continues from there."""


class Notice(Struct, frozen=True):
    """Something that happened beside the commands: who came, who left, what went wrong.

    Without a `moment`, simulated seconds, reports take that of the event before it: only boards tell one, and
    the log of a fault. Any other fact with a time is an event of its own.
    `subject` is the client's address where the notice is about one; a board's is its line in the sketch,
    after the kind of a mistake: a report shows the newest of each.
    `advice` is true if it tells what a new program does wrong with its connection.
    """

    kind: NoticeKind
    text: str
    subject: str = ""
    advice: bool = False
    moment: float | None = None


BOARDS_ENDED = "the boards have ended: "
"""Beginning of the notice that a board has died or hangs: the run is over."""
NOT_CONNECTED = "the program was not connected to the robot's serial port"
"""Beginning of the notice that says so."""
NOT_STARTED = "could not start: "
"""Beginning of an error that kept a program from starting."""


class OutputLine(Struct, frozen=True):
    """A line that a program printed, as it came, and the simulated time then (key `t` in a log). Escape it to
    show it."""

    time: Real = field(name="t")
    text: str


class ProgramEnded(Struct, frozen=True):
    """The program that drives the robot has ended, at a simulated time.

    `exit_code` is 128 and the signal's number for one that a signal ended; `signal` is then its name.
    `stopped` is true if the simulator ended it, not the program itself. `error` is the error of a crash,
    `place` the last line of its own code that led there (`robot.py:12`), or of a Python program that was
    stopped the line at which it was; both may be empty.
    `stderr` and `stdout` hold the last lines of its output.
    """

    time: float
    exit_code: int
    signal: str = ""
    stopped: bool = False
    error: str = ""
    place: str = ""
    stderr: tuple[OutputLine, ...] = ()
    stdout: tuple[OutputLine, ...] = ()

    @property
    def crashed(self) -> bool:
        """True if an error ended it."""
        return bool(self.error)

    @property
    def started(self) -> bool:
        """True if the program itself began: its command and its file were found."""
        return not self.error.startswith(NOT_STARTED)


class Goal(StrEnum):
    """Goals of a mission, in this order. Taking the block counts as having reached it."""

    aim: str
    """Words for it before it is met; `{x}, {y}` is the drop zone."""
    done: str
    """Words for it once it is met."""
    short: str
    """The same in a line with other goals."""
    asked_by: str
    """The field of `MissionSpec` and `MissionPlan` that is true if a mission asks for it; empty if every one
    does."""

    def __new__(cls, value: str, aim: str = "", done: str = "", short: str = "", asked_by: str = "") -> Self:
        """A member with its row of the table below."""
        goal = str.__new__(cls, value)
        goal._value_, goal.aim, goal.done, goal.short, goal.asked_by = value, aim, done, short, asked_by
        return goal

    REACHED = "loading zone reached", "reach the loading zone", "reached the loading zone", "loading zone"
    TAKEN = "block taken", "pick the block up", "picked the block up", "picked up"
    DELIVERED = "block delivered", "set it down at {x:g}, {y:g}", "set it down at {x:g}, {y:g}", "delivered"

    @property
    def key(self) -> str:
        """Its name in files and tables."""
        return self.name.lower()


def goals_of(mission: Struct) -> tuple[Goal, ...]:
    """The goals that a mission, its spec or its plan, asks for, in their order. With the last it ends."""
    return tuple(goal for goal in Goal if not goal.asked_by or getattr(mission, goal.asked_by))


class Result(StrEnum):
    """State of a mission."""

    UNDER_WAY = "under way"
    SUCCESS = "success"
    FAILED = "failed"


class MissionEvent(Struct, frozen=True):
    """A mission has begun (`UNDER_WAY`), a goal has been met, or the mission is over.

    `time` is the simulated time of it. `reason` says why a mission failed.
    """

    time: float
    subject: Goal | Result
    text: str
    reason: str = ""

    @property
    def over(self) -> bool:
        """True if the mission has ended by this."""
        return self.subject in (Result.SUCCESS, Result.FAILED)


class ActionName(StrEnum):
    """Actions of people beside commands. A run log names actions so."""

    RESET = "reset"
    TELEPORT = "teleport"
    BLOCK = "block"
    SEED = "seed"
    NOISE = "noise"
    BIAS = "bias"
    STOP = "stop"
    PAUSE = "pause"
    RESUME = "resume"
    TIME_SCALE = "speed"
    """Simulated seconds a second: `:speed` on the console, and so in logs."""

    @property
    def restarts(self) -> bool:
        """True if it restarts the run, with simulated time 0."""
        return self in (ActionName.RESET, ActionName.SEED)

    @property
    def places(self) -> bool:
        """True if it puts the robot elsewhere."""
        return self.restarts or self is ActionName.TELEPORT

    @property
    def helps(self) -> bool:
        """True if it makes a mission easier: robot or block put elsewhere, errors taken away."""
        return self in (ActionName.TELEPORT, ActionName.BLOCK, ActionName.BIAS)

    @property
    def switches(self) -> bool:
        """True if its argument is 1 or 0 for on and off."""
        return self in (ActionName.NOISE, ActionName.BIAS)


class Action(Struct, frozen=True):
    """One action: `teleport` takes x, y and heading, `block` x and y, `seed` a whole number, `speed`
    simulated seconds a second, `noise` and `bias` 1 or 0 for on and off."""

    name: ActionName
    arguments: tuple[float, ...] = ()
    source: str = "console"


class ActionDone(Struct, frozen=True):
    """An action of a person, when it was done (simulated time), what it did, and the pose then.

    `refused` actions changed nothing; `text` says why.
    """

    time: float
    action: Action
    text: str
    pose: Pose
    refused: bool = False

    @property
    def restarts(self) -> bool:
        """True if it restarted the run, with simulated time 0."""
        return self.action.name.restarts and not self.refused

    @property
    def places(self) -> bool:
        """True if it put the robot elsewhere."""
        return self.action.name.places and not self.refused


class Belief(Struct, frozen=True):
    """A pose that a program believes the robot to have, and the true one at that moment.

    `spread` is in inches, `particles` are (x, y) pairs or (x, y, heading) triples. With a `grid`, pose and
    spread may have been computed from it. `again` is true where the previous belief is repeated, with the
    cells that the log had left out of it.
    """

    time: float
    pose: Pose
    true: Pose
    spread: float | None = None
    particles: tuple[tuple[float, ...], ...] = ()
    note: str = ""
    grid: GridBelief | None = None
    again: bool = False


class TwinReading(Struct, frozen=True):
    """A reading of the same sensor on the real robot and on its twin, taken at the same moment.

    `robot` and `simulated` are in the sensor's unit, `time` is simulated time. `robot` is NaN if the robot's
    answer is not a number.
    """

    time: float
    command: Command
    code: str
    robot: float
    simulated: float


class DisplayChanged(Struct, frozen=True, omit_defaults=True):
    """A board shows something else from a simulated time on (key `t` in a log).

    Attributes:
        board: its name.
        led: true if its own LED is on.
        led_pin: the pin of that LED.
        displays: the rows of text on each of its displays.
        busy: the share of its last second in which its sketch did not wait; None in its first one.
    """

    time: Real = field(name="t")
    board: str
    led: bool = False
    led_pin: str = "13"
    displays: tuple[tuple[str, ...], ...] = ()
    busy: Real | None = None


# Without garbage collection (gc=False): both events of a movement hold no cycles, and thousands are kept.
class MovementPlanned(Struct, frozen=True, gc=False):
    """A movement begins, or its rest is planned again because the block was moved.

    `number` is that of its command, `time` the simulated time from which the plan holds. `trajectory` is the
    robot's path as long as nothing intervenes. `grip` is what the gripper has done, if the command was for
    it: the jaws act at once, then the robot stands still.
    """

    number: int
    time: float
    command: Command
    trajectory: Trajectory
    grip: Grip | None = None


class MovementEnded(Struct, frozen=True, gc=False):
    """A movement is over, and this is how it really went.

    `time` is the simulated time of its end, and `pose` the pose then. `stopped_by` says who ended it early,
    and is empty if nobody did: a movement that a wall holds takes its full time too. `answers` is true if
    this event is also the command's answer: the `CommandResult` that follows adds nothing.
    """

    number: int
    time: float
    command: Command
    trajectory: Trajectory
    pose: Pose
    stopped_by: str = ""
    answers: bool = False
    grip: Grip | None = None

    @property
    def before(self) -> Pose:
        """Pose at the beginning of the movement."""
        return self.trajectory.before

    @property
    def contact(self) -> Contact | None:
        """The first contact during the movement, None if there was none."""
        return self.trajectory.contact


class LegBegun(Struct, frozen=True):
    """A leg of a continuous motion begins: where the robot will be as long as nothing intervenes.

    `number` and `command` are those of the velocity that moves it. Another leg may replace it before any time
    has passed.
    """

    number: int
    command: Command
    leg: Leg

    @property
    def time(self) -> float:
        """Simulated time of its beginning."""
        return self.leg.start_time


class LegEnded(Struct, frozen=True):
    """A leg of a continuous motion is over, and this is how it went."""

    number: int
    command: Command
    leg: Leg

    @property
    def time(self) -> float:
        """Simulated time of its end."""
        return self.leg.end_time

    @property
    def contact(self) -> Contact | None:
        """The contact at its end, or at its beginning."""
        return self.leg.contact

    def as_movement(self) -> MovementEnded:
        """The same as the end of a movement of one segment."""
        movement = self.leg.as_movement()
        return MovementEnded(self.number, self.time, self.command, movement, movement.pose_at(self.time))


class VelocityEnd(StrEnum):
    """Reason for which a velocity ended without a command that set another."""

    TIME = "its time was over"
    TIMEOUT = "it was not sent again"
    LEFT = "its program left"
    STOP = "the robot was stopped"
    MOVEMENT = "a movement began"
    PLACED = "the robot was put elsewhere"


class VelocityEnded(Struct, frozen=True):
    """A velocity has ended without a command that set another, at a simulated time. `source` is who did it,
    empty if nobody did."""

    time: float
    reason: VelocityEnd
    source: str = ""


class PortLine(Struct, frozen=True, omit_defaults=True):
    """The last line that a board has sent at one of its ports; the one to the program has no name."""

    board: str
    port: str = ""
    text: str = ""


class WireMessage(Struct, frozen=True):
    """Bytes on the line between a program and a robot with a dialect, at a simulated time.

    Attributes:
        data: the bytes, one character each.
        reply: true if the robot sent them.
        meaning: what a message does; empty for a reply.
        board: the board that has sent a reply.
        port: its port, if that is not the one to the program: text for people, no reply.
    """

    time: float
    data: str
    reply: bool = False
    meaning: str = ""
    board: str = ""
    port: str = ""


Event = (
    CommandResult
    | MovementPlanned
    | MovementEnded
    | LegBegun
    | LegEnded
    | VelocityEnded
    | ActionDone
    | Belief
    | TwinReading
    | Notice
    | MissionEvent
    | ProgramEnded
    | WireMessage
    | DisplayChanged
)
Watcher = Callable[[Event], None]
Made = TypeVar("Made")


class EventHandler(Generic[Made]):
    """Base class of handlers for some kinds of events: a subclass overrides their methods, and `other` for
    the rest.

    Handlers keep no state of a run: the reducer does.
    """

    def handle(self, event: Event) -> Made:
        """The result of the method for this kind of event."""
        made: Made = getattr(self, _METHODS[type(event)])(event)
        return made

    def other(self, event: Event) -> Made:
        """Called with each event whose method is not overridden; returns None."""
        return None  # type: ignore[return-value]

    def on_result(self, event: CommandResult) -> Made:
        return self.other(event)

    def on_planned(self, event: MovementPlanned) -> Made:
        return self.other(event)

    def on_ended(self, event: MovementEnded) -> Made:
        return self.other(event)

    def on_leg_begun(self, event: LegBegun) -> Made:
        return self.other(event)

    def on_leg_ended(self, event: LegEnded) -> Made:
        return self.other(event)

    def on_velocity_ended(self, event: VelocityEnded) -> Made:
        return self.other(event)

    def on_action(self, event: ActionDone) -> Made:
        return self.other(event)

    def on_belief(self, event: Belief) -> Made:
        return self.other(event)

    def on_twin(self, event: TwinReading) -> Made:
        return self.other(event)

    def on_notice(self, event: Notice) -> Made:
        return self.other(event)

    def on_mission(self, event: MissionEvent) -> Made:
        return self.other(event)

    def on_program_ended(self, event: ProgramEnded) -> Made:
        return self.other(event)

    def on_wire(self, event: WireMessage) -> Made:
        return self.other(event)

    def on_display(self, event: DisplayChanged) -> Made:
        return self.other(event)


# A table by type in place of a match: events come by the million, and a dict costs the same for all kinds.
_METHODS = {
    get_type_hints(method)["event"]: name
    for name, method in vars(EventHandler).items()
    if name.startswith("on_")
}
"""The method of `EventHandler` for each kind of event."""


class MissionEnd(EventHandler[None]):
    """A watcher that calls a function when a mission is over."""

    def __init__(self, call: Callable[[], None]) -> None:
        self._call = call

    def on_mission(self, event: MissionEvent) -> None:
        if event.over:
            self._call()


class Watchers:
    """The receivers of events: all receive the same events, in the same order."""

    def __init__(self, fault: Callable[[str], None] = lambda text: None) -> None:
        """`fault` is called with a sentence about a watcher that failed."""
        self._watchers: list[Watcher] = []
        self._calls: dict[type, tuple[tuple[Watcher, Watcher], ...]] = {}
        """For each kind of event that has come, the function to be called of each watcher that takes it, and
        the watcher."""
        self._undelivered: deque[Event] = deque()
        self._telling = False
        self._fault = fault

    def add(self, watcher: Watcher) -> None:
        """Pass every event from now on to `watcher`. The `handle` of an `EventHandler` costs nothing for
        events whose method is not overridden."""
        self._watchers.append(watcher)
        self._sort()

    def remove(self, watcher: Watcher) -> None:
        """Pass no more events to `watcher`."""
        if watcher in self._watchers:
            self._watchers.remove(watcher)
            self._sort()

    def _sort(self) -> None:
        self._calls = {kind: self._calls_for(kind) for kind in self._calls}

    @property
    def told(self) -> KeysView[type]:
        """The kinds of events that have come."""
        return self._calls.keys()

    def tell(self, event: Event) -> None:
        """Pass an event to all watchers. A watcher that fails is removed; the robot continues. An event that
        a watcher tells comes after the event it reacts to, for every watcher."""
        # A queue, not a recursion: all watchers get an event before those that one of them tells about it.
        self._undelivered.append(event)
        if self._telling:
            return
        self._telling = True
        try:
            while self._undelivered:
                event = self._undelivered.popleft()
                # A tuple of its own: a watcher may be removed while it handles the event.
                kind = type(event)
                if kind not in self._calls:
                    self._calls[kind] = self._calls_for(kind)
                for call, watcher in self._calls[kind]:
                    try:
                        call(event)
                    except Exception as error:  # noqa: BLE001 - whatever a watcher does, the robot must continue
                        self.remove(watcher)
                        self._fault(f"a watcher failed and was dropped: {type(error).__name__}: {error}")
        finally:
            self._telling = False

    def _calls_for(self, kind: type) -> tuple[tuple[Watcher, Watcher], ...]:
        """The functions to be called with events of a kind, each with its watcher."""
        found = ((_method_of(watcher, kind), watcher) for watcher in self._watchers)
        return tuple((call, watcher) for call, watcher in found if call is not None)


def _method_of(watcher: Watcher, kind: type) -> Watcher | None:
    """The method of a handler for a kind of event, or another watcher itself; None if it does nothing."""
    handler = getattr(watcher, "__self__", None)
    if not isinstance(handler, EventHandler) or getattr(watcher, "__func__", None) is not EventHandler.handle:
        return watcher
    for name in (_METHODS[kind], "other"):
        if getattr(type(handler), name) is not getattr(EventHandler, name):
            method: Watcher = getattr(handler, name)
            return method
    return None
