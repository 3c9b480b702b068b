"""The panes around the controls, and how a snapshot is shown in them.

To add a panel of lines: write a function of a `Snapshot` and a `Room`, and list it in `PANELS`.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Protocol

from msgspec import Struct
from textual.events import Click
from textual.strip import Strip
from textual.widget import Widget

from simmer_tui.config.describe_code import describe_code
from simmer_tui.config.loader import Configuration
from simmer_tui.sim.maze import Maze
from simmer_tui.snapshot import LogEntry, Snapshot
from simmer_tui.tui.line_panel import LinePanel, StyledLine, fault_line, heading, text_of, wrapped
from simmer_tui.tui.log_panel import LogPanel
from simmer_tui.tui.maze.scene import Scene, scene_of
from simmer_tui.tui.maze.view import MazeView
from simmer_tui.tui.radar import RadarPanel
from simmer_tui.tui.readouts import FirstSteps, Room, header_line, pose_line, robot_lines, run_lines
from simmer_tui.tui.sensor_readouts import SensorsView, rows_wanted, sensor_lines
from simmer_tui.tui.terminal import GlyphMode, TerminalChoice

# Every number on the screen is sent again when it changes: most bytes of a busy run.
_NUMBERS = 0.5
"""Least time between two pictures of the numbers, seconds: nobody reads faster."""


class SnapshotSource(Protocol):
    """Source of snapshots: a run that is going on, or one from a log."""

    @property
    def configuration(self) -> Configuration: ...

    @property
    def name(self) -> str:
        """Name in a few words: the configuration, or where the run came from."""
        ...

    @property
    def ports(self) -> Mapping[str, int]:
        """Ports that a program may connect to, by purpose; none for a run from a log."""
        ...

    @property
    def pace(self) -> str:
        """Speed of simulated time, in a word or two; empty if there is nothing to say."""
        ...

    def has_news(self, known: int) -> bool:
        """True if a snapshot would differ from one that was taken at event `known`."""
        ...

    async def snapshot(self, since: int, true_values: bool) -> Snapshot:
        """The run as it stands, with the events after number `since`."""
        ...


class PanelKind(Struct, frozen=True):
    """A panel of lines beside the maze: its name, its rows, and its lines for a snapshot."""

    name: str
    rows: int
    lines: Callable[[Snapshot, Room], Sequence[StyledLine]]


PANELS = (PanelKind("robot", 6, robot_lines), PanelKind("run", 6, run_lines))
"""Panels beside the maze, in the order in which there is room for them."""
_BARS = (
    PanelKind("header", 1, lambda snapshot, room: [header_line(snapshot, room)]),
    PanelKind("pose", 1, lambda snapshot, room: [pose_line(snapshot, room)]),
)


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


class Legend(Widget):
    """Legend of the maze's picture."""

    ALLOW_SELECT = False

    def __init__(self, maze: MazeView) -> None:
        super().__init__(id="legend")
        self._maze = maze
        self._strip = Strip([])

    def bring_up_to_date(self) -> None:
        strip = self._maze.legend(max(self.size.width - 1, 1)) if self.size.width else Strip([])
        if strip != self._strip:
            self._strip = strip
            self.refresh()

    def on_resize(self) -> None:
        self.bring_up_to_date()

    def render_line(self, y: int) -> Strip:
        line = Strip.join((Strip.blank(1, self.rich_style), self._strip))
        return line.adjust_cell_length(self.size.width, self.rich_style)


class Panes:
    """Maze, events and panels. A fault in one is told in its place and keeps nothing else from going on."""

    def __init__(self, source: SnapshotSource, choice: TerminalChoice, maze: MazeView) -> None:
        configuration = source.configuration
        settings = configuration.settings
        self._source = source
        self._spec = configuration.simulation
        self._name = source.name
        self._world = Maze(self._spec.maze)
        self._glyphs = choice.glyphs
        self._plain = choice.glyphs is GlyphMode.ASCII
        self.sensor_rows = rows_wanted(self._spec.sensors)
        self.maze = maze
        self.legend = Legend(maze)
        self.log = LogPanel(plain=self._plain, id="events")
        self.sensors = SensorsPanel()
        self.radar = RadarPanel(self._world, choice.glyphs, choice.color, id="radar")
        self.panels = {kind.name: LinePanel(id=kind.name) for kind in (*PANELS, *_BARS)}
        self.facts = LinePanel(id="facts")
        self.first_steps: Callable[[], FirstSteps | None] = lambda: None
        """Advice to show as long as no command has come."""
        self.pointer = ""
        """Orders that give the reasons of a failure."""
        self.chosen = ""
        """Code of the sensor that is looked at more closely; empty for none."""
        self.shown = {
            "plot_robot": settings.plot_robot,
            "plot_sense": settings.plot_sense,
            "trail": True,
            "truth": False,
        }
        """Parts of the picture that are shown; see `switch`."""
        self._waiting: list[LogEntry] = []
        self._anew = False
        self._snapshot: Snapshot | None = None
        self._numbered = 0.0
        self.has_unshown = False
        """True while numbers wait for their next turn."""

    @property
    def widgets(self) -> Iterator[Widget]:
        """All panes, in the order in which Tab goes through those that take keys."""
        yield from (self.maze, self.legend, self.sensors, self.radar)
        yield from self.panels.values()
        yield from (self.log, self.facts)

    def switch(self, name: str, word: str = "") -> None:
        """Show something or not, `on` or `off`; without a word, change over."""
        self.shown[name] = not self.shown[name] if not word else word == "on"
        self._numbered = 0.0

    def choose(self, code: str) -> None:
        """Look at a sensor more closely; at the same one again, no longer."""
        self.chosen = "" if code == self.chosen else code
        self._numbered = 0.0

    def show(self, snapshot: Snapshot) -> None:
        """Bring the maze up to date, and the numbers if it is their turn."""
        self._snapshot = snapshot
        self._take_entries(snapshot)
        scene = self._show_maze(snapshot)
        if time.monotonic() - self._numbered >= _NUMBERS:
            self._show_numbers(snapshot, scene)
        else:
            self.has_unshown = True

    def show_again(self) -> None:
        """Bring everything up to date after a change of sizes."""
        self._numbered = 0.0
        if self._snapshot is not None:
            self.show(replace(self._snapshot, entries=(), anew=False))

    @property
    def whole_log(self) -> str:
        """Text of the list of events, with all there is."""
        self._show_events()
        return self.log.text

    # -- within ----------------------------------------------------------------------------------

    def _take_entries(self, snapshot: Snapshot) -> None:
        # A replay that has jumped: what waits is of another moment.
        if snapshot.anew:
            self._waiting, self._anew = [], True
        entries = snapshot.entries
        if entries and self._waiting and self._waiting[-1].first == entries[0].first != 0:
            self._waiting.pop()  # it has grown
        self._waiting += entries

    def _show_events(self) -> None:
        told = self._snapshot.told if self._snapshot is not None else 0
        self.log.add(self._waiting, told=told, anew=self._anew)
        self._waiting, self._anew = [], False

    def _show_numbers(self, snapshot: Snapshot, scene: Scene | None) -> None:
        self._numbered = time.monotonic()
        self.has_unshown = False
        self._show_events()
        # Advice for a beginner goes with the first command, or with a program that connects.
        idle = not snapshot.state.commands and not snapshot.state.client
        steps = self.first_steps() if idle else None
        room = max(self.log.size.width - 2, 1)
        self.log.guide([part for line in (steps.lines if steps else ()) for part in wrapped(line, room, 4)])
        for kind in (*PANELS, *_BARS):
            _show(self.panels[kind.name], partial(self._lines_of, kind, snapshot))
        _show(self.facts, lambda width, rows: self._facts(snapshot, width))
        _show(self.sensors, partial(self._sensor_lines, snapshot, steps))
        self.legend.bring_up_to_date()
        if scene is not None and self.radar.display:
            self.radar.show(scene, self.maze.painter.look)

    def _lines_of(self, kind: PanelKind, snapshot: Snapshot, width: int, rows: int) -> Sequence[StyledLine]:
        source = self._source
        room = Room(width, rows, self._plain, self._name, source.pace, source.ports, self.pointer)
        return kind.lines(snapshot, room)

    def _sensor_lines(
        self, snapshot: Snapshot, steps: FirstSteps | None, width: int, rows: int
    ) -> list[StyledLine]:
        view = SensorsView(self._glyphs, self.shown["truth"], self.chosen)
        lines = sensor_lines(self._spec.sensors, snapshot, width, rows, view)
        self.sensors.codes = [line.code for line in lines]
        shown = [line.line for line in lines]
        if steps is not None and not self.log.display:
            # Keys and help, where there are no events to have them below.
            shown += [line for each in ((), *steps.narrow) for line in wrapped(each, width, 0)]
        return shown

    def _facts(self, snapshot: Snapshot, width: int) -> list[StyledLine]:
        """One sensor looked at closely: the one picked, or the one read last."""
        rows = sorted(snapshot.state.sensors.values(), key=lambda row: row.number)
        code = self.chosen or (rows[-1].reading.sensor.code if rows else "")
        if not code:
            return [heading("sensor", "", width, plain=self._plain), (("none read yet", "dim"),)]
        note = "click on another" if self.chosen else f"read last; :help {code}"
        said = describe_code(self._spec, code)
        lines = [heading(f"sensor {code}", note, width, plain=self._plain)]
        return lines + [((line[:7], "label"), (line[7:], "value")) for line in said[1:]]

    def _show_maze(self, snapshot: Snapshot) -> Scene | None:
        if not self.shown["plot_robot"]:
            self.maze.show_instead("The maze is not drawn (:plot_robot on draws it).")
            return None
        try:
            scene = scene_of(
                self._spec,
                self._world,
                snapshot,
                show_rays=self.shown["plot_sense"],
                show_trail=self.shown["trail"],
                chosen=self.chosen,
            )
        except Exception as error:  # noqa: BLE001 - a fault in a view must not end the app
            self.maze.show_instead(text_of(fault_line(error)))
            return None
        if self.maze.region.area:
            self.maze.show(scene)
        return scene


def _show(panel: LinePanel, lines: Callable[[int, int], Sequence[StyledLine]]) -> None:
    """Show lines made for a panel's size, or why they cannot be made."""
    size = panel.size
    if not size.width:
        return
    try:
        panel.show(lines(size.width, size.height))
    except Exception as error:  # noqa: BLE001 - a fault in a panel must not end the app
        panel.show([fault_line(error)])
