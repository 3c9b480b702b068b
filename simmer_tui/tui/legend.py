"""The legend below the maze."""

from textual.strip import Strip

from simmer_tui.tui.direct_lines import DirectLines
from simmer_tui.tui.maze.view import MazeView


class Legend(DirectLines):
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
