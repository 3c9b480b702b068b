"""Lines that go to the screen as a widget makes them."""

from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget


class DirectLines(Widget):
    """Widget that fills all of its lines, each with its whole style.

    Textual lays border, padding, background and opacity around every line, whether there are any or not: a
    fifth of the time that a picture takes. Where there is neither border nor padding, lines go past that.
    """

    def render_lines(self, crop: Region) -> list[Strip]:
        """Strips of the part of the widget in `crop`."""
        size = self.outer_size
        # Either would make the content smaller than the widget.
        if size != self.size:
            return super().render_lines(crop)
        strips = [self.render_line(y) for y in crop.line_range]
        # Between a change of size and the picture made for it, lines have the old width.
        strips = [
            strip
            if strip.cell_length == size.width
            else strip.adjust_cell_length(size.width, self.rich_style)
            for strip in strips
        ]
        for line_filter in self.get_line_filters():
            background = self.background_colors[1]
            strips = [strip.apply_filter(line_filter, background) for strip in strips]
        if crop.column_span == (0, size.width):
            return strips
        return [strip.crop(*crop.column_span) for strip in strips]
