"""The team's boards as the robot: their sketches drive its wheels and read its sensors.

Only for the robot's thread. Nobody else drives: console and programs over TCP may read sensors and stop it.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from heapq import heappop, heappush
from operator import itemgetter
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from simmer_tui.config.dialects import TEAM
from simmer_tui.config.loader import Configuration
from simmer_tui.config.set_sketches import WIRING_FILE
from simmer_tui.config.settings import BITS_OF_A_BYTE
from simmer_tui.errors import BoardError
from simmer_tui.links.backend import Message
from simmer_tui.robot.engine import Engine
from simmer_tui.robot.sessions import Answered, Session
from simmer_tui.run.events import (
    BOARDS_ENDED,
    ActionDone,
    ActionName,
    DisplayChanged,
    Event,
    LegEnded,
    MissionEvent,
    Notice,
    NoticeKind,
    ProgramEnded,
    WireMessage,
)
from simmer_tui.sim.command import Command
from simmer_tui.sim.records import CommandResult, Status
from simmer_tui.sketch.board_facts import BoardFacts, in_task
from simmer_tui.sketch.board_mistakes import BoardMistakes
from simmer_tui.sketch.board_process import (
    BYTE,
    EDGE,
    NEVER,
    BoardEvent,
    BoardProcess,
    BoardRecord,
    Query,
    Told,
    Watchdog,
)
from simmer_tui.sketch.board_view import BoardView, PinView, PortView
from simmer_tui.sketch.build import BuiltSketch, build_sketch, fastest_baud
from simmer_tui.sketch.display_changes import DisplayChanges
from simmer_tui.sketch.line_check import dead_wires
from simmer_tui.sketch.lockstep import BOARD_SLICE, Board, Lockstep, LockstepWorld, PinState
from simmer_tui.sketch.motion_check import wrong_functions
from simmer_tui.sketch.parts import (
    ECHO_DELAY,
    SECOND,
    SERVO_STOP,
    EncoderState,
    analog_counts,
    bus_option,
    echo_length,
    rim_speed,
)
from simmer_tui.sketch.robot_world import RobotWorld
from simmer_tui.sketch.shared_processor import SharedProcessor
from simmer_tui.sketch.sketch_check import facts_of
from simmer_tui.sketch.sketch_scan import SketchFacts
from simmer_tui.sketch.steppers import StepperState
from simmer_tui.sketch.wiring import (
    WiredAnalog,
    WiredEncoder,
    WiredGyro,
    WiredI2c,
    WiredLineSensor,
    WiredRanger,
    WiredServo,
    WiredSonar,
    Wiring,
    WiringParts,
    read_wiring,
)

_TYPED = "binary"
"""The dialect of typed commands."""
# Two byte times of silence: a sketch that prints without line ends pauses for much longer.
_GAP, _LINE_END = 2, 10
# A few lines of the screen; a sketch that never ends a line would have a message of any length.
_LONGEST_MESSAGE = 200
"""Bytes of a message that has no end."""
NOT_DRIVEN = "boards drive the robot; send their program a line with :send TEXT"
"""The reason of a drive of anybody else that is refused."""
# A frame of the screen is 67 ms, a byte at 9600 baud 1 ms.
TICK = 0.005
"""Real seconds between two times at which boards are brought to the present."""
# A servo's angle by the pulses of Servo.h: 544 us is 0 degrees, 2400 us 180.
_SHORTEST_PULSE, _LONGEST_PULSE, _HALF_TURN = 544, 2400, 180.0
BEHIND = (
    "the boards cannot keep pace with the real clock on this machine: simulated time falls behind. Run the "
    "program by its own clock: --no-ui --clock program --run CMD"
)
# A person notices half a second, and a start or a busy moment costs less.
_MOST_LATE = 0.5


StartBoard = Callable[[str, Path, Sequence[str]], BoardProcess]
"""A function that starts a board by its name, its compiled sketch and the sketch's options."""


class SketchSet(Struct, frozen=True):
    """A set's wiring with its compiled sketches, by the board's name."""

    wiring: Wiring
    built: Mapping[str, BuiltSketch]
    bauds: Mapping[str, int]
    """The fastest rate that each sketch names."""
    facts: Mapping[str, SketchFacts] = {}
    """Facts of the text of each sketch."""


def compile_set(wiring: Wiring, directory: Path) -> SketchSet:
    """Compile the sketches of a wiring. Raises ConfigurationError."""
    built, bauds = {}, {}
    for name, board in wiring.boards.items():
        path = directory / board.sketch
        built[name] = build_sketch(path, board.kind, board.place_of("sketch"))
        bauds[name] = fastest_baud(path)
    return SketchSet(wiring, built, bauds, facts_of(wiring, directory, []))


def with_boards(configuration: Configuration) -> Configuration:
    """The configuration of a run with boards: motion is timed, and a velocity lasts as the pins do."""
    listeners = tuple(each for each in configuration.settings.server.listeners if each != TEAM)
    simulation = configuration.simulation
    text = configuration.files.get(WIRING_FILE, "")
    wiring = read_wiring(text, WiringParts(simulation.sensors, simulation.wheels), [])
    if wiring is not None and wiring.steppers:
        # A stepper has the lag and the ramp of its steps.
        drives = (replace(each, start_lag=0.0, acceleration=0.0) for each in simulation.drives)
        configuration = replace(configuration, simulation=replace(simulation, drives=tuple(drives)))
    made = configuration.with_settings(
        {
            "motion.motion": "timed",
            "motion.velocity_timeout": 0.0,
            # A set with a dialect may have no other language.
            "server.listeners": listeners or (_TYPED,),
        }
    )
    return replace(made, simulation=replace(configuration.simulation, velocity_timeout=0.0))


class SentMessages:
    """Bytes of a board put together to messages: lines, or what comes without a gap."""

    def __init__(self) -> None:
        self._text = ""
        self._last = self._byte = 0
        self._times: list[int] = []
        """The times at which the bytes arrive whose messages are not told yet."""
        self._whole: list[tuple[int, str]] = []
        self.next_due = NEVER
        """Time at which the first message is over, unless another byte comes."""

    def add(self, time: int, value: int, byte: int) -> None:
        """Add a byte that arrives at a time; `byte` is its duration."""
        if self._text and time > self._last + _GAP * byte:
            self._end(self._last + _GAP * self._byte)
        self._text += chr(value)
        self._times.append(time)
        self._last, self._byte = time, byte
        if value == _LINE_END or len(self._text) >= _LONGEST_MESSAGE:
            self._end(time)
        self.next_due = self._whole[0][0] if self._whole else time + _GAP * byte

    def due(self, time: int) -> list[tuple[int, str]]:
        """The messages that are over by a time, with their times; each is returned once."""
        if self._text and time >= self._last + _GAP * self._byte:
            self._end(self._last + _GAP * self._byte)
        whole = [each for each in self._whole if each[0] <= time]
        self._whole = self._whole[len(whole) :]
        del self._times[: sum(len(text) for _, text in whole)]
        self._plan()
        return whole

    def cut(self, time: int) -> None:
        """End at a time, and forget the bytes that would arrive later: their port has been reset."""
        del self._times[bisect_right(self._times, time) :]
        left = len(self._times)
        messages = [*self._whole, (time, self._text)]
        self._whole, self._text = [], ""
        for end, text in messages:
            if left:
                self._whole.append((min(end, time), text[:left]))
            left -= min(len(text), left)
        self._plan()

    def _plan(self) -> None:
        if self._whole:
            self.next_due = self._whole[0][0]
        else:
            self.next_due = self._last + _GAP * self._byte if self._text else NEVER

    def _end(self, time: int) -> None:
        self._whole.append((time, self._text))
        self._text = ""


class SketchRobot(LockstepWorld):
    """The boards of a run, and what is wired to them. A `Backend` for the commands of others."""

    def __init__(
        self,
        sketches: SketchSet,
        engine: Engine,
        slice_length: int = BOARD_SLICE,
        start_board: StartBoard | None = None,
    ) -> None:
        """`start_board` starts the boards, by default as processes with the access of this one."""
        self.engine = engine
        self._set = sketches
        self._start_board: StartBoard = start_board or BoardProcess
        self._slice = slice_length
        self._processor = SharedProcessor()
        self._session = engine.session(answer_at_end=False, lane="boards")
        self._running = False
        self._late = 0.0
        """Seconds by which simulated time has fallen behind the real clock so far."""
        self._has_told_late = False
        self._facts = BoardFacts(engine)
        self.failed = ""
        """The sentence about boards that have ended; empty while they run."""
        self.on_end: Callable[[], None] = lambda: None
        """Called when a board has died or hangs."""
        self.on_sent: Callable[[], None] = lambda: None
        """Called when bytes for the laptop may have arrived, after each step."""
        self._encoders = {
            each.label: EncoderState(each)
            for each in sketches.wiring.sensors
            if isinstance(each, WiredEncoder)
        }
        self._steppers = [StepperState(each) for each in sketches.wiring.steppers]
        for stepper in self._steppers:
            stepper.on_missed = self._tell_missed
        self._world = RobotWorld(
            engine,
            self._session,
            list(self._encoders.values()),
            self._steppers,
            self._stepped_at,
            [each.code for each in sketches.wiring.sensors if isinstance(each, WiredGyro)],
        )
        self._asked: dict[tuple[str, int, int], list[_AskedSensor]] = {}
        """Sensors by the question that asks for them: board, query and pin."""
        for number, each in enumerate(sketches.wiring.sensors):
            if not isinstance(each, WiredEncoder):
                for question in _questions(each, number):
                    self._asked.setdefault(question, []).append(each)
        self._start()
        engine.boards = self.catch_up
        engine.watch(self._watch)

    def _start(self) -> None:
        """Start the boards at time 0."""
        self._is_over = False
        self._mistakes = BoardMistakes(self.engine.tell, self._set.facts)
        wheels = self.engine.simulator.spec.wheels
        self._wrong = list(wrong_functions(self._set.wiring, wheels, self._set.facts))
        """Functions that move the robot otherwise than they are named, until that is told."""
        self._messages = SentMessages()
        self._prints: dict[tuple[str, int], SentMessages] = {}
        """Messages of boards on other ports than the laptop's, by board and pin."""
        self._prints_due = NEVER
        self._last_lines: dict[str, dict[str, str]] = {}
        """The last line of each board's ports, by board and port; that to the laptop has no name."""
        self._sonar_until: dict[str, int] = {}
        self._options: dict[str, list[str]] = {}
        self._pulses: dict[tuple[str, int], int] = {}
        """The last pulse of each gripper's servo, microseconds, by board and pin."""
        kinds = {name: board.kind for name, board in self._set.wiring.boards.items()}
        self._known: list[tuple[int, int, Callable[[int], None]]] = []
        """Facts that are not told yet, a heap: their times, numbers, and the calls that tell them."""
        self._facts_known = 0
        self._displays = {
            name: DisplayChanges(name, kind.led, kind.pin_name(kind.led)) for name, kind in kinds.items()
        }
        self._told_due = 0
        """Time of the next fact, or change of what a board shows, that may be told."""
        boards = {name: self._board(name) for name in self._set.wiring.boards}
        for wire in self._set.wiring.wires:
            sender, receiver = boards[wire.from_board], boards[wire.to_board]
            sender.lines.setdefault(wire.tx, []).append((receiver, wire.rx))
            if sender not in receiver.sources:
                receiver.sources.append(sender)
        for text in dead_wires(self._set.wiring, self._set.facts):
            # Nothing else tells it: both pins keep their levels for ever.
            self._tell_fact(0, partial(self._tell_dead_wire, text))
        self._watchdog = Watchdog([each.process for each in boards.values()])
        self.boards: Mapping[str, Board] = boards
        line = self._set.wiring.laptop
        laptop = None if line is None else (boards[line.board], line.tx)
        self.lockstep = Lockstep(list(boards.values()), self, laptop, self._slice, self._processor)

    def _board(self, name: str) -> Board:
        wiring = self._set.wiring
        driving = {pin for each in wiring.motors if each.board == name for pin in each.pins.values()}
        driving |= {each.pin for each in wiring.servos if each.board == name}
        sensors = [each for each in wiring.sensors if each.board == name]
        triggers = {each.trig for each in sensors if isinstance(each, WiredSonar)}
        asked = {each.pin for each in sensors if isinstance(each, WiredLineSensor)}
        steppers: dict[int, list[StepperState]] = {}
        for state in self._steppers:
            for pin in set(state.wired.pins.values()) if state.wired.board == name else ():
                steppers.setdefault(pin, []).append(state)
        steps = {pin for pin, states in steppers.items() if any(pin == each.step_pin for each in states)}
        encoders = [self._encoders[each.label] for each in sensors if isinstance(each, WiredEncoder)]
        # Edges are passed on up to the next change of speed: a step may be one.
        telling = driving | {*steppers} if encoders else driving
        options: list[str] = []
        for option, pins in (
            ("--drives", telling),
            ("--triggers", triggers),
            ("--asked", asked),
            ("--steps", steps),
        ):
            if pins:
                options += [option, ",".join(map(str, sorted(pins)))]
        for number, part in enumerate(wiring.sensors):
            if isinstance(part, WiredI2c) and part.board == name:
                options += bus_option(number, part)
        self._options[name] = options
        process = self._start_board(name, self._set.built[name].program, options)
        board = Board(name, process, BITS_OF_A_BYTE * SECOND // self._set.bauds[name])
        board.driving = frozenset(driving)
        board.led = self._set.wiring.boards[name].kind.led
        board.encoders, board.steppers = encoders, steppers
        self._set_levels(board)
        return board

    def _set_levels(self, board: Board) -> None:
        """The levels at a board's inputs as it begins."""
        now = board.now
        for encoder in board.encoders:
            board.events += encoder.levels_at(now)
        for each in self._set.wiring.sensors:
            if isinstance(each, WiredSonar) and each.board == board.name:
                board.events.append(BoardEvent(now, EDGE, each.echo, 0))
        board.events.sort()

    def reset_by_usb(self) -> None:
        """The laptop's program has opened the port: on a USB line that resets the board."""
        line = self._set.wiring.laptop
        if line is None or self.failed:
            return
        if (line.rx, line.tx) != self._set.wiring.boards[line.board].kind.usb:
            return
        board = self.boards[line.board]
        now = board.now
        # A board that has not begun needs no reset.
        if not now:
            return
        board.process.close()
        options = [*self._options[board.name], "--boot", str(now)]
        process = self._start_board(board.name, self._set.built[board.name].program, options)
        self._watchdog.replace(board.process, process)
        process.now = now
        board.process = process
        self._pulses = {key: width for key, width in self._pulses.items() if key[0] != board.name}
        self._displays[board.name].restart(now)
        self._plan_told()
        board.events.clear()
        for pin, states in board.steppers.items():
            for each in states:
                each.add(BoardRecord(now, Told.LEVEL, pin, 0, 0))
        self._set_levels(board)
        self._messages.cut(now)
        try:
            self.lockstep.reset(board)
        except BoardError as error:
            self._fail(str(error))
        else:
            self.changed(board, board.driving)

    def close(self) -> None:
        """End the boards. By the real clock they may still be asked for the present time."""
        self._is_over = True
        self._processor.release()
        self._watchdog.close()
        for each in self.boards.values():
            each.process.close()

    # -- time ------------------------------------------------------------------------------------------

    def catch_up(self, present: float) -> bool:
        """Bring the boards to a simulated time, seconds. False if that takes too long."""
        reached = self.run_to(present)
        if reached >= present or self.failed:
            return True
        self._late += present - reached
        if self._late > _MOST_LATE and not self._has_told_late:
            self._has_told_late = True
            self._tell(BEHIND)
        return False

    def run_to(self, until: float) -> float:
        """Let the boards run to a simulated time, seconds. Returns the time that they have reached."""
        # A restart has set the simulator back already; the boards follow once it is told.
        if self._running or self._is_over or self.failed or round(until * SECOND) < self._world.time:
            return until
        target = round(until * SECOND)
        if target == self._world.time and target:
            # All boards are there: whoever sends them something asks for the present first.
            self._world.settle()
            return until
        self._running = True
        try:
            reached = self.lockstep.run(target)
        except BoardError as error:
            self._fail(str(error))
            return min(until, self.lockstep.reached / SECOND)
        finally:
            self._running = False
        self.on_sent()
        return until if reached >= target else reached / SECOND

    def run_clock_to(self, time: float) -> float:
        """The same by the time of the loop's clock."""
        engine = self.engine
        until = (time - engine.clock_time(0.0)) * engine.time_scale
        reached = self.run_to(until)
        return time if reached >= until else engine.clock_time(reached)

    def _fail(self, text: str) -> None:
        # What the board did before is done, and its last words have left it.
        self.advance(self.lockstep.reached)
        self._world.settle()
        self._tell_told(self._world.time, at_end=True)
        self.lockstep.laptop_listens = False  # else bytes still on the line would wait for the boards
        self.on_sent()
        self.failed = text
        self._processor.release()
        self._world.set_speeds({})
        time = self.engine.simulator.time
        self.engine.tell(Notice(NoticeKind.FAULT, f"{BOARDS_ENDED}{text}", moment=time))
        self.engine.end_time()
        self.on_end()

    def _watch(self, event: Event) -> None:
        if isinstance(event, LegEnded):
            self._facts.leg_ended(event, self.boards.values())
        elif isinstance(event, ProgramEnded) or (isinstance(event, MissionEvent) and event.over):
            self._facts.tell_totals(self._world.time)
            self._tell_displays()
        if not isinstance(event, ActionDone) or event.refused:
            return
        if event.action.name is ActionName.STOP:
            self._world.cut_power()
        self._world.look_again()
        if event.restarts:
            self.close()
            self._world.restart()
            for each in self._encoders.values():
                each.restart()
            self.failed = ""
            self._facts = BoardFacts(self.engine)
            self._start()
        elif event.action.name is ActionName.TELEPORT:
            self._world.drive_again()

    # -- what boards do --------------------------------------------------------------------------------

    def advance(self, time: int) -> None:
        if time <= self._world.time:
            return
        if time >= self._messages.next_due or time >= self._prints_due or time >= self._told_due:
            self._tell_told(time)
        self._world.advance(time)

    def _tell_told(self, until: int, *, at_end: bool = False) -> None:
        """Tell the messages that are over by a time, the facts by then, and what boards show; at the end of
        the run those messages too that are still on their way."""
        told: list[tuple[int, Callable[[int], None]]] = []
        last = NEVER if at_end else until
        for at, text in self._messages.due(last):
            told.append((min(at, until), partial(self._tell_message, text)))
        # Boards first print in another order if slices are longer.
        for (name, pin), messages in sorted(self._prints.items(), key=itemgetter(0)):
            for at, text in messages.due(last):
                told.append((min(at, until), partial(self._tell_print, name, pin, text)))
        for each in self._displays.values():
            told += [
                (at, partial(self._tell_change, change)) for at, change in each.due(until, at_end=at_end)
            ]
        while self._known and self._known[0][0] <= until:
            at, _, tell = heappop(self._known)
            told.append((at, tell))
        self._plan_told()
        for at, tell in sorted(told, key=itemgetter(0)):
            self._world.advance(at)
            tell(at)

    def _tell_message(self, text: str, time: int) -> None:
        line = self._set.wiring.laptop
        self._tell_text("" if line is None else line.board, "", text, time)

    def _tell_print(self, name: str, pin: int, text: str, time: int) -> None:
        kind = self._set.wiring.boards[name].kind
        named = kind.pin_name(pin)
        port = "USB" if pin == kind.usb[1] else named if pin in (kind.bluetooth or ()) else f"pin {named}"
        self._tell_text(name, port, text, time)

    def _tell_text(self, name: str, port: str, text: str, time: int) -> None:
        if text.strip():
            self._last_lines.setdefault(name, {})[port] = text.strip()
        self.engine.tell(WireMessage(time / SECOND, text, reply=True, board=name, port=port))

    def _tell_change(self, change: DisplayChanged, time: int) -> None:
        self.engine.tell(change)

    def _tell_fact(self, time: int, tell: Callable[[int], None]) -> None:
        """Tell a fact once the world has reached its time, nanoseconds, which `tell` is called with."""
        self._facts_known += 1
        heappush(self._known, (time, self._facts_known, tell))
        self._told_due = min(self._told_due, time)

    def _plan_told(self) -> None:
        due = [each.next_due for each in self._displays.values()]
        self._told_due = min(due) if not self._known else min(*due, self._known[0][0])
        self._plan_prints()

    def _plan_prints(self) -> None:
        self._prints_due = min([each.next_due for each in self._prints.values()], default=NEVER)

    def shows(self, board: Board, record: BoardRecord) -> None:
        display = self._displays[board.name]
        display.add(record)
        self._told_due = min(self._told_due, display.next_due)

    def sent(self, time: int, value: int, byte: int) -> None:
        self._messages.add(time, value, byte)

    def printed(self, board: Board, pin: int, time: int, value: int, byte: int) -> None:
        key = (board.name, pin)
        messages = self._prints.get(key)
        if messages is None:
            messages = self._prints[key] = SentMessages()
        messages.add(time, value, byte)
        self._plan_prints()

    def settle(self) -> None:
        self._world.settle()

    @property
    def next_wheel_change(self) -> int:
        return self._world.next_wheel_change

    def changed(self, board: Board, pins: Iterable[int]) -> None:
        wiring = self._set.wiring
        speeds = {each.wheel_index: rim_speed(each, self.boards[each.board].level) for each in wiring.motors}
        line = ""

        def where() -> str:
            nonlocal line
            line = board.process.line_of(board.process.place)
            return f"{board.name} at {line}{in_task(board, board.process.task)}" if line else ""

        if self._world.set_speeds(speeds, where):
            self._tell_wrong(board, line)
        for servo in wiring.servos:
            if servo.board == board.name and servo.pin in pins:
                self._move_servo(board, servo)

    def _tell_displays(self) -> None:
        """Tell what boards show at the end of a run."""
        for name, display in self._displays.items():
            for _, change in display.due(self._world.time, at_end=True):
                self.engine.tell(change)
            for rows in display.shown(self._world.time).displays:
                text = " / ".join(filter(None, map(str.strip, rows)))
                if text:
                    self._tell(f"board {name}: its display shows {text}")
        self._plan_told()

    def tell_shown(self) -> None:
        """Tell again what boards show, to a log that begins now."""
        for each in self._displays.values():
            self.engine.tell(each.shown(self._world.time))

    def _tell_wrong(self, board: Board, line: str) -> None:
        """Tell a function that moves the robot otherwise than it is named, if a line is one of its writes."""
        for wrong in self._wrong[:]:
            if line in wrong.spots:
                self._wrong.remove(wrong)
                self._tell(f"board {board.name}: {wrong.text}, at {line}", wrong.spot)

    def _tell(self, text: str, line: str = "") -> None:
        """Tell a fact of the present time."""
        self.engine.tell(Notice(NoticeKind.BOARD, text, line, moment=self._world.time / SECOND))

    def _tell_dead_wire(self, text: str, _: int) -> None:
        self._tell(text)

    def _stepped_at(self, stepper: StepperState) -> str:
        """The place of a stepper's last step in its sketch: a step has changed the speed."""
        board = self.boards[stepper.wired.board]
        line = board.process.line_of(stepper.place)
        self._tell_wrong(board, line)
        return f"{board.name} at {line}" if line else ""

    def _tell_missed(self, stepper: StepperState, reason: str) -> None:
        """Tell the first step that moves nothing, the tenth, the hundredth ..."""
        wired = stepper.wired
        line = self.boards[wired.board].process.line_of(stepper.place)
        kind = self._set.wiring.boards[wired.board].kind
        self._facts.missed_step(wired, kind, line, reason, self._world.time)

    def _move_servo(self, board: Board, servo: WiredServo) -> None:
        """The gripper's servo has got another pulse: its jaws are on the side of the nearer angle."""
        width = board.pin(servo.pin).servo
        before = self._pulses.get((board.name, servo.pin), 0)
        self._pulses[board.name, servo.pin] = width
        # The middle is what attach() sends by itself, before the sketch has written anything.
        by_attach = not before and width == SERVO_STOP
        if servo.open is None or servo.closed is None or not width or by_attach:
            return
        angle = (width - _SHORTEST_PULSE) / (_LONGEST_PULSE - _SHORTEST_PULSE) * _HALF_TURN
        self._world.grip(close=abs(angle - servo.closed) < abs(angle - servo.open))

    @property
    def steady_until(self) -> int:
        return self._world.steady_until

    def answer(self, board: Board, query: int, pin: int) -> float:
        made = 0.0
        filter_number = 0
        if query == Query.RATE:
            pin, filter_number = pin & _NUMBER, pin >> _FILTER_SHIFT & _FILTERS
        for each in self._asked.get((board.name, query, pin), ()):
            if isinstance(each, WiredSonar):
                self._ping(board, each)
            elif isinstance(each, WiredAnalog):
                made = analog_counts(
                    each, self._world.read(each.code), self._set.wiring.boards[board.name].kind.most_counts
                )
            elif isinstance(each, WiredI2c):
                is_rate = query == Query.RATE
                made = self._world.rate(each.code, filter_number) if is_rate else self._world.read(each.code)
            else:
                seen = self._world.level(each.code) == 1.0
                made = float(seen == each.active_high)
        return made

    def _ping(self, board: Board, sonar: WiredSonar) -> None:
        """A sonar's trigger has fallen: its echo rises and falls. While it listens it takes no other."""
        now = board.now
        if now < self._sonar_until.get(sonar.label, 0):
            return
        rise = now + ECHO_DELAY
        fall = rise + echo_length(self._world.read(sonar.code))
        self._sonar_until[sonar.label] = fall
        self.lockstep.put(board, BoardEvent(rise, EDGE, sonar.echo, 1))
        self.lockstep.put(board, BoardEvent(fall, EDGE, sonar.echo, 0))

    def was_late(self, board: Board, record: BoardRecord, until: int) -> None:
        self._tell_fact(until, partial(self._facts.was_late, board, record))

    def bus_told(self, board: Board, record: BoardRecord) -> None:
        if record.kind == Told.BUS_STUCK:
            self._tell_fact(record.time, partial(self._facts.bus_stuck, board, record))
        elif record.pin < len(self._set.wiring.sensors):
            part = self._set.wiring.sensors[record.pin]
            name = f"{part.label} {getattr(part, 'code', '')}"
            self._tell_fact(record.time, partial(self._facts.fifo_overflow, board, name, record))

    def mistake(self, board: Board, record: BoardRecord, details: Sequence[BoardRecord]) -> None:
        self._tell_fact(record.time, partial(self._mistakes.add, board, record, details))

    def lost_edge(self, board: Board, record: BoardRecord, edges: int) -> None:
        pin = self._pin_name(board, record)
        self._tell_fact(record.time, partial(self._facts.lost_edge, board, pin, record, edges))

    def lost(self, board: Board, record: BoardRecord) -> None:
        pin = self._pin_name(board, record)
        self._tell_fact(record.time, partial(self._facts.lost_byte, board, pin, record))

    def _pin_name(self, board: Board, record: BoardRecord) -> str:
        return self._set.wiring.boards[board.name].kind.pin_name(record.pin)

    # -- the line to the laptop ------------------------------------------------------------------------

    @property
    def laptop_baud(self) -> int:
        """The rate of the board's port to the laptop; 0 if it is not open yet."""
        line = self._set.wiring.laptop
        return 0 if line is None else self.boards[line.board].baud.get(line.tx, 0)

    def receive(self, time: int, value: int, baud: int) -> None:
        """Add a byte of the laptop that arrives at its board."""
        line = self._set.wiring.laptop
        assert line is not None, "only a wiring with a line to the laptop has its link"
        board = self.boards[line.board]
        at = max(time, board.now)
        self._facts.received(at, value)
        self.lockstep.put(board, BoardEvent(at, BYTE, line.rx, value | baud << 8))

    def tell_line(self, text: str, *, reply: bool) -> None:
        """Tell bytes of the line, at the present time."""
        self.engine.tell(WireMessage(self.engine.simulator.time, text, reply=reply))

    # -- what people see -------------------------------------------------------------------------------

    def views(self) -> tuple[BoardView, ...]:
        """The boards as they are now."""
        return tuple(self._view(each) for each in self.boards.values())

    def _view(self, board: Board) -> BoardView:
        name = board.name
        kind = self._set.wiring.boards[name].kind
        said = self._last_lines.get(name, {})
        pins = tuple(
            PinView(kind.pin_name(number), _pin_text(state)) for number, state in sorted(board.pins.items())
        )
        shown = self._displays[name].shown(self._world.time)
        return BoardView(
            name,
            board.now / SECOND,
            shown.busy,
            shown.led,
            said.get("", ""),
            pins,
            self.failed,
            shown.displays,
            shown.led_pin,
            tuple(PortView(port, text) for port, text in said.items() if port),
        )

    # -- commands of others ----------------------------------------------------------------------------

    def submit(self, message: Message, session: Session, answered: Answered) -> None:
        """Read sensors, stop the robot, and refuse everything else."""
        answered([self._do(command) for command in message.commands], None)

    def _do(self, command: Command) -> CommandResult:
        engine = self.engine
        if command.stops:
            engine.now()
            done = engine.halt(command)
            self._world.cut_power()
            self._world.look_again()
            return done
        simulator = engine.simulator
        refused = simulator.is_drive(command) or simulator.is_velocity(command)
        result = engine.peek(replace(command, problem=NOT_DRIVEN) if refused else command)
        # The command itself has no mistake.
        result = replace(result, command=command)
        if result.status is Status.READING or result.status is not Status.DONE:
            engine.tell(result)
        return result

    def urgent_part(self, message: Message) -> Message | None:
        """The stops of a message."""
        stops = tuple(each for each in message.commands if each.stops)
        return Message(message.data, stops, message.form) if stops else None

    def append_late(self, data: bytes, session: Session) -> None:
        """Nothing is passed on as it is."""

    def forget(self, session: Session) -> None:
        """Every message has its answer at once."""


# Of the question for a gyro's rate: the part's number, and that of its filter.
_NUMBER, _FILTER_SHIFT, _FILTERS = 0xFF, 8, 7
_AskedSensor = WiredSonar | WiredAnalog | WiredLineSensor | WiredI2c


def _questions(sensor: _AskedSensor, number: int) -> list[tuple[str, int, int]]:
    """The boards, queries and pins by which a sketch asks for a sensor; for one on a bus its row's `number`
    stands for the pin."""
    if isinstance(sensor, WiredI2c):
        queries = (Query.RANGE,) if isinstance(sensor, WiredRanger) else (Query.ANGLE, Query.RATE)
        return [(sensor.board, query, number) for query in queries]
    if isinstance(sensor, WiredSonar):
        return [(sensor.board, Query.SONAR, sensor.trig)]
    return [(sensor.board, Query.ANALOG if isinstance(sensor, WiredAnalog) else Query.DIGITAL, sensor.pin)]


_MODES = {0: "input", 1: "output", 2: "input with pull-up"}


def _pin_text(state: PinState) -> str:
    """The use of a pin by its sketch, in words."""
    if state.servo:
        return f"servo, {state.servo} us"
    if state.steps:
        return f"output, {state.steps:,} steps"
    if state.mode != 1:
        return _MODES.get(state.mode, "input")
    return f"output, {'high' if state.level == 1.0 else f'{state.level:.0%}' if state.level else 'low'}"


def logged_sketches(sketches: SketchSet) -> dict[str, str]:
    """The sketches of a run for its log, by board: file and hash."""
    return {
        name: f"{board.sketch} {sketches.built[name].digest}"
        for name, board in sketches.wiring.boards.items()
    }
