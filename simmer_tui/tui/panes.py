"""The panes around the controls, and their update from a snapshot.

To add a panel of lines: write a function of a `Snapshot` and a `Room`, and list it in `PANELS`.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

from msgspec import Struct
from textual.events import Click
from textual.widget import Widget

from simmer_tui.config.loader import Configuration
from simmer_tui.live.operating.switches import SWITCHES
from simmer_tui.live.snapshot import LogEntry, Snapshot
from simmer_tui.run.events import ActionDone
from simmer_tui.sim.command import PEOPLE, counted
from simmer_tui.sim.maze import Maze
from simmer_tui.sim.wheels import WheelKinematics
from simmer_tui.tui.answers import AnswerCard, end_answer, now_answer, scan_answer
from simmer_tui.tui.frame_pace import Lags
from simmer_tui.tui.headline import RunPhase, header_line, phase_of
from simmer_tui.tui.line_panel import LinePanel, StyledLine, fault_line, text_of
from simmer_tui.tui.log_panel import LogPanel
from simmer_tui.tui.maze.palette import Role
from simmer_tui.tui.maze.scene import Scene, scene_of
from simmer_tui.tui.maze.view import Legend, MazeView
from simmer_tui.tui.radar import RadarPanel
from simmer_tui.tui.readouts import Room, board_lines, pose_line, program_lines, robot_lines, run_lines
from simmer_tui.tui.sensor_facts import sensor_facts
from simmer_tui.tui.sensor_readouts import SensorsView, rows_wanted, sensor_lines
from simmer_tui.tui.sizes import BRIEF_ANSWER
from simmer_tui.tui.terminal import GlyphMode, TerminalChoice


class SnapshotSource(Protocol):
    """Source of snapshots: a live run, or one from a log."""

    @property
    def configuration(self) -> Configuration: ...

    @property
    def name(self) -> str:
        """Name in a few words: the configuration, or the log."""
        ...

    @property
    def ports(self) -> Mapping[str, int]:
        """Ports that a program may connect to, by purpose; none for a run from a log."""
        ...

    def has_news(self, known: int) -> bool:
        """True if a snapshot would differ from one that was taken at event `known`."""
        ...

    async def snapshot(self, since: int, true_values: bool) -> Snapshot:
        """The run as it stands, with the events after number `since`."""
        ...


_Lines = Callable[[Snapshot, Room], Sequence[StyledLine]]


class PanelKind(Struct, frozen=True):
    """A panel of lines beside the maze: its name, its rows, and its lines for a snapshot."""

    name: str
    rows: int
    lines: _Lines


# Rows of the panel with boards: a heading, and two lines a board and the rows of its displays, which are as
# many as there are.
PANELS = (
    PanelKind("robot", 6, robot_lines),
    PanelKind("run", 4, run_lines),
    PanelKind("boards", 0, board_lines),
)
"""Panels beside the maze, in the order in which they get room."""
# A heading, the time, and the time spent in two lines.
_MISSION_ROWS = 4
"""Rows of a mission's panel beside those of its goals."""
# Heading, pose and state; beside a radar there is room for the belief as well.
_BRIEF_ROBOT, _TALL_ROBOT, _TALL = 3, 4, 45
"""Rows of the robot's panel beside that of a mission: usually, and on a screen of at least so many rows."""
_FRAMES = {RunPhase.SUCCESS: Role.FRAME_SUCCESS, RunPhase.FAILURE: Role.FRAME_FAILURE}
"""Colour of the maze's frame at a verdict."""
_BARS = (
    PanelKind("header", 1, lambda snapshot, room: [header_line(snapshot, room)]),
    PanelKind("pose", 1, lambda snapshot, room: [pose_line(snapshot, room)]),
)


class AnswerSlot:
    """The one place for answers: a requested one, the end of the run, first steps, or the present
    movement."""

    def __init__(self) -> None:
        self.first_steps: Callable[[], AnswerCard | None] = lambda: None
        """Advice for a beginning, if there is any."""
        self.has_orders = False
        """True if orders can be typed, which an answer may name."""
        self.tries = False
        """True if the run's program can be run again with one change at a time."""
        self.asked_at = 0
        """Number of the newest event when an answer was last requested."""
        self._asked: AnswerCard | None = None
        self._moved = 0
        self._stays = False
        self._closed = False
        self._commands = -1
        self._has_end = False
        self._begun = 0
        """Number of the event that restarted the run last."""

    def ask(self, answer: AnswerCard, snapshot: Snapshot, *, stays: bool = False) -> None:
        """Show an answer until it is closed, or until the robot moves again. One that `stays` is not ended by
        a program's movement: many of them come in a second."""
        self._stays = stays
        self._asked, self._moved, self.asked_at = answer, snapshot.state.moved, snapshot.number

    def close(self) -> bool:
        """Close the answer, if it can be closed. Returns True if it could."""
        had = self._asked is not None or (self._has_end and not self._closed)
        self._closed = self._closed or (self._asked is None and self._has_end)
        self._asked = None
        return had

    def answer(self, snapshot: Snapshot, phase: RunPhase, *, plain: bool) -> AnswerCard:
        """The answer to show now."""
        state = snapshot.state
        if self._asked is not None and state.moved != self._moved:
            if self._stays and state.moved_by and state.moved_by not in PEOPLE:
                self._moved = state.moved
            else:
                self._asked = None
        end = end_answer(snapshot, orders=self.has_orders, tries=self.tries)
        # A run may begin and end between two frames.
        begun = 0
        for each in snapshot.entries:
            if isinstance(each.event, ActionDone) and each.event.restarts:
                begun = each.number
        if end is None or begun > self._begun:
            self._closed, self._commands = False, -1
        self._begun = max(begun, self._begun)
        if end is not None and (snapshot.mission is None or not snapshot.mission.over):
            # A person who drives on has seen it.
            self._commands = state.commands if self._commands < 0 else self._commands
            self._closed = self._closed or state.commands != self._commands
        self._has_end = end is not None
        if self._asked is not None:
            return self._asked
        if end is not None and not self._closed:
            return end
        steps = self.first_steps() if phase is RunPhase.WAITING else None
        if steps is not None:
            return steps
        return scan_answer(snapshot, plain=plain) or now_answer(snapshot, plain=plain)


class SensorsPanel(LinePanel):
    """Panel of the sensors; a click on one picks it."""

    def __init__(self) -> None:
        super().__init__(id="sensors")
        self.picked: Callable[[str], None] = lambda code: None
        """Called with the code of a sensor that was clicked on."""
        self.codes: list[str] = []
        """Code of the sensor on each row; empty where there is none."""

    def on_click(self, event: Click) -> None:
        if 0 <= event.y < len(self.codes) and self.codes[event.y]:
            self.picked(self.codes[event.y])


class Panes:
    """Maze, events and panels. A fault in one is shown in its place, and the others continue."""

    def __init__(self, source: SnapshotSource, choice: TerminalChoice, maze: MazeView) -> None:
        configuration = source.configuration
        settings = configuration.settings
        self._source = source
        self._spec = configuration.simulation
        self._name = source.name
        wheels = self._spec.wheels
        self._wheels = None if wheels is None else WheelKinematics.of(wheels)
        self._world = Maze(self._spec.maze)
        self.program_name = ""
        """Name of the program that runs beside, if there is one."""
        self._glyphs = choice.glyphs
        self._plain = choice.glyphs is GlyphMode.ASCII
        self.sensor_rows = rows_wanted(self._spec.sensors)
        self.maze = maze
        self.legend = Legend(maze)
        self.log = LogPanel(plain=self._plain)
        self.sensors = SensorsPanel()
        self.radar = RadarPanel(self._world, choice.glyphs, choice.color)
        self._lines: dict[str, _Lines] = {
            "answer": self._answer_lines,
            **{kind.name: kind.lines for kind in (*PANELS, *_BARS)},
            "facts": self._facts,
            "program": lambda snapshot, room: program_lines(snapshot, self.log.entries, room),
        }
        self._panels = {name: LinePanel(id=name) for name in self._lines}
        self.slot = AnswerSlot()
        self.answer: AnswerCard | None = None
        """AnswerCard of the moment."""
        self.phase = RunPhase.GOING
        """Phase of the run that is shown."""
        self.board_rows = 0
        """Rows for the boards of the run, with their displays."""
        self.goals = 0
        """Number of goals that the mission shown asks for; 0 if there is no mission."""
        self.pointer = ""
        """Orders that give the reasons of a failure."""
        self.chosen = ""
        """Code of the sensor that is looked at more closely; empty for none."""
        self.shown = {each.name: getattr(settings, each.name, each.at_start) for each in SWITCHES}
        """Parts of the picture that are shown; see `switch`."""
        self._waiting: list[LogEntry] = []
        self._is_full = False
        self._snapshot: Snapshot | None = None
        self._lags = Lags()
        self._past: Mapping[str, Sequence[float]] = {}
        """Earlier values of each sensor, by code, as they are shown."""

    @property
    def has_unshown(self) -> bool:
        """True while a lagging part waits to be updated."""
        return bool(self._lags.waiting)

    @property
    def widgets(self) -> Iterator[Widget]:
        """All panes, those that take keys in the order of Tab."""
        answer, *bars, facts, program = self._panels.values()
        yield from (self.maze, self.legend, answer, self.sensors, self.radar)
        yield from (*bars, self.log, facts, program)

    def panel_rows(self, height: int, *, page: bool) -> list[tuple[str, int]]:
        """Name and rows of each panel beside the maze, on a screen of so many rows. On a `page` of their own
        they have all rows."""
        rows = {kind.name: kind.rows for kind in PANELS}
        if self.goals:
            rows["run"] = _MISSION_ROWS + self.goals
            if not page:
                rows["robot"] = _BRIEF_ROBOT if height < _TALL else _TALL_ROBOT
        rows["boards"] = 1 + self.board_rows if self.board_rows else 0
        return [(name, count) for name, count in rows.items() if count]

    @property
    def answer_rows(self) -> int:
        """Rows that the answer needs; 0 if it may be left out."""
        answer = self.answer
        if answer is None or not answer.covers:
            return 0
        return answer.rows(self._panels["answer"].size.width or self.sensors.size.width or 1)

    def switch(self, name: str, word: str = "") -> None:
        """Show something or not, `on` or `off`; without a word, switch over."""
        self.shown[name] = not self.shown[name] if not word else word == "on"
        self._lags.make_due()

    def choose(self, code: str) -> None:
        """Choose a sensor for a closer look; the same one again ends the choice."""
        self.chosen = "" if code == self.chosen else code
        self._lags.make_due()

    def show(self, snapshot: Snapshot) -> None:
        """Show a snapshot, the same one in every pane; parts with history only when they are due."""
        before, self._snapshot = self._snapshot, snapshot
        self._lags.take(snapshot, before)
        self._take_entries(snapshot)
        if self._lags.is_due("values"):
            self._past = {code: row.history for code, row in snapshot.state.sensors.items()}
        self._show_phase(snapshot)
        scene = self._show_maze(snapshot)
        self._show_numbers(snapshot)
        if self._lags.is_due("radar") and scene is not None and self.radar.display:
            self.radar.show(scene, self.maze.painter.look)
        if self._lags.is_due("events"):
            self._show_events()

    def show_again(self) -> None:
        """Update everything after a change of sizes."""
        self._lags.make_due()
        if self._snapshot is not None:
            self.show(replace(self._snapshot, entries=(), is_full=False))

    @property
    def whole_log(self) -> str:
        """The full text of the list of events."""
        self._show_events()
        return self.log.text

    # -- within ----------------------------------------------------------------------------------

    def _take_entries(self, snapshot: Snapshot) -> None:
        # After a jump in a replay the waiting entries are of another moment.
        if snapshot.is_full:
            self._waiting, self._is_full = [], True
        entries = snapshot.entries
        if entries and self._waiting and self._waiting[-1].first == entries[0].first != 0:
            self._waiting.pop()  # it has grown
        self._waiting += entries

    def _show_phase(self, snapshot: Snapshot) -> None:
        """Give row 0 and the maze's frame the colour of the run's phase."""
        phase = phase_of(snapshot, self._source.ports)
        self.goals = 0 if snapshot.mission is None else len(snapshot.mission.goals)
        self.board_rows = sum(
            2 + len(board.ports) + sum(map(len, board.displays)) for board in snapshot.boards
        )
        if phase is not self.phase:
            self.phase = phase
            self._panels["header"].set_classes([phase.value])
            self._lags.make_due()
        self.maze.frame_role = _FRAMES.get(phase, Role.EDGE)

    def _show_events(self) -> None:
        total = 0
        if self._snapshot is not None:
            total = self._snapshot.total
            self.log.show_before_events(self._ready_text(self._snapshot.state.seed))
        self.log.add(self._waiting, total=total, is_full=self._is_full)
        self._waiting, self._is_full = [], False

    def _ready_text(self, seed: int) -> str:
        maze, sensors = self._spec.maze, self._spec.sensors
        used = counted(sum(sensor.enabled for sensor in sensors), "sensor")
        return f"ready: {self._name}, maze {maze.columns} x {maze.rows}, {used}, seed {seed}"

    def _show_numbers(self, snapshot: Snapshot) -> None:
        self._choose_answer(snapshot)
        for name, lines in self._lines.items():
            self._show_panel(self._panels[name], lines, snapshot)
        self._show_panel(self.sensors, self._sensor_lines, snapshot)
        self.legend.update_content()

    def _show_panel(self, panel: LinePanel, lines: _Lines, snapshot: Snapshot) -> None:
        """Show lines made for a panel's size, or the fault in making them."""
        width, rows = panel.size
        if not width:
            return
        source = self._source
        words = self._name, source.ports, self.pointer, self.program_name
        try:
            panel.show(lines(snapshot, Room(width, rows, self._plain, *words, self._wheels)))
        except Exception as error:  # noqa: BLE001 - a fault in a panel must not end the app
            panel.show([fault_line(error)])

    def _choose_answer(self, snapshot: Snapshot) -> None:
        try:
            self.answer = self.slot.answer(snapshot, self.phase, plain=self._plain)
        except Exception as error:  # noqa: BLE001 - a fault in an answer must not end the app
            self.answer = AnswerCard("answer", "", (fault_line(error),), covers=False)

    def _answer_lines(self, _snapshot: Snapshot, room: Room) -> Sequence[StyledLine]:
        if self.answer is None:
            return []
        # On a small screen it continues in the line below, which is the console's.
        return self.answer.shown(Room(room.width, max(room.rows, BRIEF_ANSWER), room.plain))[: room.rows]

    def _sensor_lines(self, snapshot: Snapshot, room: Room) -> list[StyledLine]:
        view = SensorsView(self._glyphs, self.shown["truth"], self.chosen, self._past)
        lines = sensor_lines(self._spec.sensors, snapshot, room.width, room.rows, view)
        self.sensors.codes = [line.code for line in lines]
        return [line.line for line in lines]

    def _facts(self, snapshot: Snapshot, room: Room) -> list[StyledLine]:
        sensors = self._spec.sensors
        return sensor_facts(snapshot, room.width, self.chosen, self._past, sensors, plain=room.plain)

    def _show_maze(self, snapshot: Snapshot) -> Scene | None:
        if not self.shown["plot_robot"]:
            self.maze.show_instead("The maze is not drawn (:plot_robot on draws it).")
            return None
        try:
            shown = frozenset(name for name, is_shown in self.shown.items() if is_shown)
            scene = scene_of(self._spec, self._world, snapshot, shown=shown, chosen=self.chosen)
        except Exception as error:  # noqa: BLE001 - a fault in a view must not end the app
            self.maze.show_instead(text_of(fault_line(error)))
            return None
        if self.maze.region.area:
            self.maze.show(scene)
        return scene
