"""The panes beside the console, and how a snapshot is shown in them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

from textual.containers import VerticalScroll

from simmer_tui.config.loader import Configuration
from simmer_tui.sim.maze import Maze
from simmer_tui.snapshot import LogEntry, Snapshot
from simmer_tui.tui.line_panel import Line, LinePanel, fault_line, text_of
from simmer_tui.tui.log_panel import LogPanel
from simmer_tui.tui.maze_pane import MazePane
from simmer_tui.tui.readouts import link_lines, robot_lines, sensor_lines
from simmer_tui.tui.scenes import scene_of
from simmer_tui.tui.terminal import GlyphMode, TerminalChoice

_LOG_INTERVAL = 0.25
"""Least time between two additions to the log panel, seconds."""


class Panes:
    """Maze, log and panels. A fault in one is told in its place and keeps nothing else from going on."""

    def __init__(
        self, configuration: Configuration, choice: TerminalChoice, ports: Mapping[str, int]
    ) -> None:
        """`ports` are those a program may come by, by purpose; none for a run from a log."""
        settings = configuration.settings
        self._ports = ports
        self._spec = configuration.simulation
        self._world = Maze(self._spec.maze)
        self._plain = choice.glyphs is GlyphMode.ASCII
        self._unlogged: list[LogEntry] = []
        self._logged = 0.0
        self.maze = MazePane(choice.glyphs, choice.color, id="maze")
        self.log = LogPanel(id="log")
        self.side = VerticalScroll(id="side")
        self.panels = {name: LinePanel(id=name) for name in ("robot", "sensors", "link")}
        for panel in (*self.panels.values(), self.log):
            panel.border_title = str(panel.id).capitalize()
        self.shown = {
            "plot_robot": settings.plot_robot,
            "plot_sense": settings.plot_sense,
            "trail": True,
            "truth": False,
        }
        """What is to be seen; see `switch`."""

    def switch(self, name: str, word: str = "") -> None:
        """Show something or not, `on` or `off`; without a word, change over."""
        self.shown[name] = not self.shown[name] if not word else word == "on"
        if name == "truth":
            title = "Sensors: reading, true value" if self.shown["truth"] else "Sensors"
            self.panels["sensors"].border_title = title

    def show(self, snapshot: Snapshot) -> None:
        """Bring all panes up to date."""
        self._add_to_log(snapshot.entries)
        self._show_maze(snapshot)
        self._show_lines("robot", lambda: robot_lines(snapshot))
        self._show_lines("sensors", lambda: self._sensor_lines(snapshot))
        self._show_lines("link", lambda: link_lines(snapshot, self._ports))

    @property
    def has_unlogged(self) -> bool:
        """Whether entries wait for the log panel's next turn."""
        return bool(self._unlogged)

    @property
    def whole_log(self) -> str:
        """The text of the log panel, with all there is."""
        self._log_all()
        return self.log.text

    def _add_to_log(self, entries: Sequence[LogEntry]) -> None:
        """Pass entries on to the log panel, not as often as pictures: nobody reads that fast, and
        moving all its rows costs as much as the rest of a picture."""
        self._unlogged += entries
        if time.monotonic() - self._logged >= _LOG_INTERVAL:
            self._log_all()

    def _log_all(self) -> None:
        self.log.add(self._unlogged)
        self._unlogged = []
        self._logged = time.monotonic()

    def _show_lines(self, name: str, lines: Callable[[], Sequence[Line]]) -> None:
        panel = self.panels[name]
        try:
            panel.show(lines())
        except Exception as error:  # noqa: BLE001 - a fault in a panel must not end the app
            panel.show([fault_line(error)])

    def _sensor_lines(self, snapshot: Snapshot) -> list[Line]:
        width = self.panels["sensors"].content_size.width
        truth = self.shown["truth"]
        return sensor_lines(self._spec.sensors, snapshot, width, truth=truth, plain=self._plain)

    def _show_maze(self, snapshot: Snapshot) -> None:
        if not self.shown["plot_robot"]:
            self.maze.show_instead("The maze is not drawn (:plot_robot on draws it).")
            return
        try:
            scene = scene_of(
                self._spec,
                self._world,
                snapshot,
                show_rays=self.shown["plot_sense"],
                show_trail=self.shown["trail"],
            )
        except Exception as error:  # noqa: BLE001 - a fault in a view must not end the app
            self.maze.show_instead(text_of(fault_line(error)))
        else:
            self.maze.show(scene)
