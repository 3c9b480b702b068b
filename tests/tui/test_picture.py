"""The screen as an SVG: every letter in its place, blocks and dots as shapes."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip

from simmer_tui.tui.picture import screen_picture

SVG = "{http://www.w3.org/2000/svg}"


def drawn(*segments: Segment) -> ElementTree.Element:
    return ElementTree.fromstring(screen_picture([Strip(list(segments))]))


def test_every_word_stands_at_its_cell() -> None:
    tree = drawn(Segment("  one <b> ", Style(color="#ff0000")), Segment("two", Style(bold=True)))
    texts = [(text.get("x"), text.text) for text in tree.iter(f"{SVG}text")]
    assert texts == [("20", "one"), ("60", "<b>"), ("100", "two")]
    assert tree.get("viewBox") == "0 0 130 20"
    assert {group.get("fill") for group in tree.iter(f"{SVG}g")} >= {"#ff0000"}


def test_blocks_dots_and_box_lines_are_shapes() -> None:
    tree = drawn(Segment("▀▄█⠁⢀─┼", Style(color="#00ff00", bgcolor="#0000ff")))
    assert not list(tree.iter(f"{SVG}text"))
    paths = {(path.get("fill") or path.get("stroke")): path for path in tree.iter(f"{SVG}path")}
    assert paths["#0000ff"].get("d") == "M0 0h70v20h-70z"
    shapes = [path.get("d") for path in tree.iter(f"{SVG}path") if "#00ff00" in path.attrib.values()]
    assert shapes[0] == "M0 0h10v10h-10zM10 10h10v10h-10zM20 0h10v20h-10z"
    assert shapes[1] == "M32.5 2.5h0M47.5 17.5h0"
    assert shapes[2].count("M") == 6


def test_quadrants_sextants_and_octants_are_shapes() -> None:
    tree = drawn(Segment("▚\U0001fb00\U0001cd00", Style(color="#00ff00")))
    assert not list(tree.iter(f"{SVG}text"))
    shapes = next(path.get("d") for path in tree.iter(f"{SVG}path") if path.get("fill") == "#00ff00")
    assert shapes == "M0 0h5v10h-5zM5 10h5v10h-5zM10 0h5v6.66667h-5zM20 5h5v5h-5z"


def test_reversed_and_default_colours_are_resolved() -> None:
    tree = drawn(Segment(" ", Style(color="#010203", reverse=True)), Segment("x", None))
    fills = {element.get("fill") for element in tree.iter() if element.get("fill")}
    assert "#010203" in fills
    assert "default" not in fills


def test_nothing_in_it_can_run_or_is_fetched() -> None:
    text = screen_picture([Strip([Segment("<script>&'\"", Style())])])
    assert "<script" not in text
    assert "http" not in text.replace("http://www.w3.org/2000/svg", "")
