"""Documents are right: blocks run, links lead somewhere, nothing is left out.

A block of `sh`, `python`, `matlab`, `c` or `toml` is run, unless a comment before it says why not. Commands
run as they stand but for what a test cannot have: no screen, free ports, a seed, and few runs of trials.
"""

from __future__ import annotations

import base64
import functools
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from simmer_tui.cli import main as command_line
from simmer_tui.cli.completion_command import whole_parser
from simmer_tui.config import dialects, drive_csv, sensors_csv
from simmer_tui.config.maze_csv import CELLS
from simmer_tui.config.profiles import DRIVE, LINK, SENSOR, profile_names
from simmer_tui.config.settings import KeySettings, all_settings
from simmer_tui.grade import course
from simmer_tui.live.operating.orders import CONSOLE_COMMANDS
from simmer_tui.program import keeper
from simmer_tui.report.causes import Kind
from simmer_tui.report.verdict import Outcome
from simmer_tui.sim.sensors import KINDS
from simmer_tui.sketch.compiler import find_compiler
from simmer_tui.tui.key_table import shortest_key
from simmer_tui.version import REPOSITORY, requirement
from tests.web.browser_tab import tab

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
WRITTEN = [ROOT / "README.md", *sorted(path for path in DOCS.glob("*.md"))]
PAGES = [*WRITTEN, *sorted((DOCS / "reference").glob("*.md")), *sorted((DOCS / "developing").glob("*.md"))]
STEPS = sorted((ROOT / "scripts" / "course").glob("step*.py"))
BLOCK = re.compile(
    r"(?:<!-- not run: (?P<why>.*?) -->\n)?^```(?P<language>\w*)\n(?P<text>.*?)^```$", re.M | re.S
)
RUN = ("sh", "python", "matlab", "c", "toml")
MOST_RUNS = 6

SHIM = f"""#!{sys.executable}
import os, sys
arguments = sys.argv[1:]
options = [argument for argument in arguments if argument.startswith("--")]
is_run = not arguments or arguments[0].startswith("-")
if is_run and "--no-ui" not in options:
    arguments.append("--no-ui")
if is_run and "--run" not in options:
    sys.exit("this would serve for ever: say why it is not run")
if is_run:
    for port in ("--port", "--reply-port", "--packet-port", "--packet-reply-port", "--belief-port"):
        arguments += [] if port in options else [port, "0"]
if (is_run or arguments[0] == "trials") and "--seed" not in options:
    arguments += ["--seed", "1"]
if "--runs" in arguments:
    at = arguments.index("--runs") + 1
    arguments[at] = str(min(int(arguments[at]), {MOST_RUNS}))
os.execv(sys.executable, [sys.executable, "-m", "simmer_tui", *arguments])
"""


def blocks(path: Path) -> Iterator[tuple[str, str, str]]:
    """Language, text and the reason not to run it, of each block of code."""
    for found in BLOCK.finditer(path.read_text("utf-8")):
        yield found["language"], found["text"], found["why"] or ""


def script(name: str) -> ModuleType:
    """One of the programs that make documents, as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# -- what stands in them ---------------------------------------------------------------------------


def test_the_readme_stays_short() -> None:
    assert len((ROOT / "README.md").read_text("utf-8").splitlines()) < 150


def test_the_readme_begins_with_three_lines_a_picture_that_moves_and_two_commands() -> None:
    first = (ROOT / "README.md").read_text("utf-8").partition("\n## ")[0]
    lines = first.partition("\n\n")[2].partition("\n\n")[0].splitlines()
    assert len(lines) == 3
    assert max(map(len, lines)) < 100, "or it wraps beside the picture"
    shown = re.findall(r'(?:srcset|src)="(.*?)"', first)
    assert len(shown) == 2, "for dark and for light pages"
    for name in shown:
        assert b"<animate" in (ROOT / name).read_bytes()
        assert (ROOT / name).stat().st_size < 1_000_000
    ((_, commands, _),) = ((each["language"], each["text"], each["why"]) for each in BLOCK.finditer(first))
    assert len(commands.splitlines()) == 2


@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: path.name)
def test_every_block_is_run_or_says_why_not(path: Path) -> None:
    text = path.read_text("utf-8")
    assert text.count("\n```") % 2 == 0
    for language, code, why in blocks(path):
        assert language in (*RUN, "text", "json"), f"{path.name}: {language or 'no language'}: {code[:60]}"
        assert not why or len(why.split()) > 2
    assert text.count("<!-- not run") == sum(bool(why) for _, _, why in blocks(path))


def anchors(path: Path) -> set[str]:
    """The anchors of a page, as code hosts and MkDocs make them of headings."""
    headings = re.findall(r"^#+ (.*)$", path.read_text("utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("path", [*PAGES, ROOT / "CONTRIBUTING.md"], ids=lambda path: path.name)
def test_no_link_is_dead(path: Path) -> None:
    text = BLOCK.sub("", path.read_text("utf-8"))
    for target in re.findall(r"\]\(([^)]+)\)", text):
        if target.startswith(("https://", "http://")):
            continue
        name, _, anchor = target.partition("#")
        found = (path.parent / name).resolve() if name else path
        assert found.exists(), f"{path.name}: {target}"
        assert not anchor or anchor in anchors(found), f"{path.name}: {target}"


def test_every_page_of_the_site_can_be_reached() -> None:
    text = (ROOT / "mkdocs.yml").read_text("utf-8")
    listed = set(re.findall(r"[\w/-]+\.md", text))
    assert {name for name in listed if not (DOCS / name).exists()} == set()
    assert {path.relative_to(DOCS).as_posix() for path in PAGES[1:]} - listed == set()


@pytest.fixture(scope="module")
def made_reference() -> dict[str, str]:
    """The pages of the reference, from the code."""
    pages: dict[str, str] = script("make_reference").pages()
    return pages


def test_the_picture_of_the_frames_is_of_the_default_set() -> None:
    made = script("make_frame_picture")
    assert made.PICTURE.read_text("utf-8") == made.picture(), "run python scripts/make_frame_picture.py"


MOST_WORDS = {"messages.md": 2500, "answers.md": 1500}
"""Words of a page of the reference; other pages outside of it have at most 1500."""


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_a_page_is_short_enough_to_be_read(path: Path) -> None:
    """A page without limit is of `reference/` or `developing/`."""
    limit = MOST_WORDS.get(path.name, 1500 if path in WRITTEN else None)
    words = re.findall(r"\S*\w\S*", re.sub(r"<!--.*?-->", "", path.read_text("utf-8")))
    assert limit is None or len(words) <= limit


def test_messages_of_the_reference_have_the_constants_and_words_of_the_code(
    made_reference: dict[str, str],
) -> None:
    messages = "".join(text for name, text in made_reference.items() if name.startswith("messages"))
    for message in (
        "has no Main.m and no config.py: name the file to import",
        "name the config.py of simmer-python",
        "... is a folder: name a file to write to",  # either of two words
        "it must be x0, y0, x1, y1 with x0 &lt; x1 and y0 &lt; y1",  # MkDocs would show a backslash
    ):
        assert message in messages, message


def test_the_reference_is_as_the_code_has_it(made_reference: dict[str, str]) -> None:
    there = {path.name: path.read_text("utf-8") for path in (DOCS / "reference").glob("*.md")}
    assert there == made_reference, "run python scripts/make_reference.py"


def test_pages_state_the_numbers_of_the_code() -> None:
    pages = script("page_numbers")
    for path, text in pages.numbered_pages():
        assert path.read_text("utf-8") == text, f"{path.name}: run python scripts/make_reference.py"
    old = "Two<!--=run.facts.COVERED!w-->, 7<!--=4*run.facts.SLIGHT:.2f-->, `x y`<!--=trials.folder.TABLE-->"
    new = pages.with_numbers(old, "a page")
    assert re.sub("<!--.*?-->", "", new) == "Three, 4.00, `trials.csv`"
    for marker in ("run.facts.NOSUCH", "run.nowhere.X", "settings.nosuch", "run.facts.SLIGHT:q"):
        with pytest.raises(ValueError, match=r"a page: 7<!--="):
            pages.with_numbers(f"7<!--={marker}-->", "a page")


@pytest.mark.parametrize(
    ("name", "heading"),
    [
        ("README.md", "## On the screen"),
        ("docs/screen.md", "## What is what"),
        ("docs/cheat-sheet.md", "Keys, after Esc: "),
    ],
)
def test_a_page_takes_each_key_that_it_names_from_the_settings(name: str, heading: str) -> None:
    """From the heading to the next one: elsewhere codes of sensors are letters as well."""
    keys = {shortest_key(KeySettings(), action) for action in KeySettings.__struct_fields__}
    text = (ROOT / name).read_text("utf-8").partition(heading)[2].partition("\n## ")[0]
    marked = re.findall(r"`([^`\s]+)`(<!--=key\.)?", text)
    assert any(mark for _, mark in marked)
    assert [key for key, mark in marked if key in keys and not mark] == []


def test_a_column_that_kinds_of_sensors_allow_differently_says_so() -> None:
    rows = (DOCS / "reference" / "files.md").read_text("utf-8").splitlines()
    (rays,) = [row for row in rows if row.startswith("| `Rays` |")]
    assert "from 1 to 1000; lidar: a whole number from 1 to 2000" in rays
    (view,) = [row for row in rows if row.startswith("| `Field of View (deg)` |")]
    assert "from 0 to 360; ir: a number from 0 to below 180" in view


@functools.cache
def known_options() -> set[str]:
    whole = whole_parser()
    commands = next(each.choices for each in whole._actions if isinstance(each.choices, dict) and each.nargs)
    parsers = [whole, *commands.values()]
    return {name for parser in parsers for action in parser._actions for name in action.option_strings}


def test_no_option_setting_column_order_or_variable_is_undocumented() -> None:
    reference = {path.name: path.read_text("utf-8") for path in (DOCS / "reference").glob("*.md")}
    both = reference["commands.md"] + reference["settings.md"]
    for option in known_options() - {"-h", "--help"}:
        plain = option.replace("--no-", "--[no-]") if option.startswith("--no-") else option
        assert any(
            f"{each}{end}" in both
            for each in (option, plain, option.replace("--", "--[no-]", 1))
            for end in ("`", " ", ",")
        ), option
    for item in all_settings():
        assert f"`{item.name}`" in reference["settings.md"], item.name
    columns = (*sensors_csv.meanings(), *(column.name for column in drive_csv.COLUMNS))
    for column in columns:
        assert f"`{column}`" in reference["files.md"], column
    for value, kind in CELLS.items():
        assert f"| {value} | {kind.name} |" in reference["files.md"]
    for order in CONSOLE_COMMANDS.values():
        assert f"`{order.usage}`".replace("|", "\\|") in reference["screen.md"], order.usage


@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: path.name)
def test_pages_name_only_commands_and_options_there_are(path: Path) -> None:
    known = known_options() | {"--help", "--practice"}
    text = path.read_text("utf-8")
    code = [block for language, block, _ in blocks(path) if language in ("sh", "text")]
    code += re.findall(r"`(simmer-tui[^`]*)`", BLOCK.sub("", text))
    for line in "\n".join(code).splitlines():
        for command in re.findall(r"simmer-tui (.*)", line.partition("#")[0]):
            outside = re.sub(r'"[^"]*"', "", command)
            for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", outside):
                assert option in known, f"{path.name}: {line}"


def test_the_course_of_the_page_and_of_init_have_the_defaults_of_the_reference(tmp_path: Path) -> None:
    """But for the number and the size of sensors: a course without them has no such rule."""
    examples = [text for language, text, _ in blocks(DOCS / "grading.md") if language == "toml"]
    term = ROOT / "config" / "term" / course.COURSE_FILE
    for text in (*examples, term.read_text("utf-8")):
        given = tomllib.loads(text)
        for name in ("decide", "limits"):
            defaults = {value.name: value.default for value in course.KEYS[name]}
            assert given[name] == {key: defaults[key] for key in given[name]}, name
        assert given["command"] == "python main.py"
    assert set(tomllib.loads(examples[0])["limits"]) == {value.name for value in course.KEYS["limits"]}


def test_pages_list_every_profile_port_kind_of_sensor_and_answer() -> None:
    pages = {path.name: path.read_text("utf-8") for path in WRITTEN}
    for sort in (DRIVE, SENSOR, LINK):
        assert [name for name in profile_names(sort) if f"`{name}`" not in pages["mission.md"]] == []
    explained = pages["sensors.md"] + pages["lidar.md"] + pages["mission.md"]
    assert [name for name in KINDS if f"`{name}`" not in explained] == []
    with_json = {
        name
        for name in command_line.SUBCOMMANDS
        if "--json" in command_line.command_named(name).parser().format_help()
    }
    assert {name.split()[0] for name in script("make_reference").ANSWERS} == with_json


def test_the_page_of_reports_has_every_key_of_the_player() -> None:
    player = (ROOT / "simmer_tui" / "report" / "player.js").read_text("utf-8")
    table = re.search(r"const KEYS = \{(.*?)\n  \};", player, re.DOTALL)
    assert table is not None
    keys = set(re.findall(r'(?:^|[ ,])"?(\w+|[][ ])"?: (?:\(|\w+,)', table[1], re.MULTILINE))
    names = {" ": "space", "ArrowLeft": "left", "ArrowRight": "right", "Home": "home", "End": "end"}
    text = (DOCS / "report.md").read_text("utf-8").partition("| key | |")[2].partition("\n\n")[0]
    shown = set(
        re.findall(r"(?<=[|`, ;])([][]|\w|space|left|right|home|end)(?=[`, ])", text.replace(" a ", " "))
    )
    assert {names.get(key, key) for key in keys} - {"l"} == shown, "l is for the live page"
    speeds = re.search(r"const PLAYBACK_RATES = \[([\d.]+), .* (\d+)\];", player)
    assert speeds is not None
    assert f"slower, faster: {speeds[1]} to {speeds[2]} times real speed" in text
    assert "or `l`," in (DOCS / "browser.md").read_text("utf-8")


def test_one_page_has_every_variable_of_programs() -> None:
    variables = {port.variable for port in dialects.all_ports()}
    for path in (ROOT / "simmer_tui").rglob("*.py"):
        variables |= set(re.findall(r"\"(SIMMER_[A-Z_]+)\"", path.read_text("utf-8")))
    table = (DOCS / "trials.md").read_text("utf-8").partition("## Variables that the program gets")[2]
    assert set(re.findall(r"`(SIMMER_[A-Z_]+)`", table)) == variables - {keeper.MARK}
    parsers = {
        name: command_line.command_named(name).parser().format_help() for name in command_line.SUBCOMMANDS
    }
    for name, text in {**parsers, "": command_line.build_parser().format_help()}.items():
        assert len(set(re.findall(r"SIMMER_[A-Z_]+", text))) <= 1, f"{name}: the list is on the page"


def test_pages_list_the_outcomes_and_all_causes() -> None:
    report, causes = ((DOCS / name).read_text("utf-8") for name in ("report.md", "causes.md"))
    listed = re.search(r"^- `outcome`: (.*);$", report, re.MULTILINE)
    assert listed is not None
    assert re.findall(r"`([^`]+)`", listed[1]) == [outcome.value for outcome in Outcome]
    assert causes == script("make_reference").causes(), "run python scripts/make_reference.py"
    assert re.findall(r"^\| \d* ?\| `([^`]+)` \|", causes, re.MULTILINE) == [kind.value for kind in Kind]
    assert len(re.sub(r"<!--.*?-->", "", causes).split()) <= 1000


def test_each_step_of_the_course_is_short_and_has_a_picture() -> None:
    text = "".join((DOCS / name).read_text("utf-8") for name in ("course.md", "course-extras.md"))
    assert len(STEPS) == 9
    for step in STEPS:
        name = step.name.partition("_")[0]
        assert len(step.read_text("utf-8").splitlines()) <= 120, step.name
        assert f"](../scripts/course/{step.name})" in text
        assert f"](pictures/{name}.svg)" in text
        assert (
            f'trials --config default --runs 20 --run "python samples/course/{step.name}"' in text
            or name > "step3b"
        )
        assert (DOCS / "pictures" / f"{name}.svg").stat().st_size < 60_000


def test_nothing_is_installed_by_a_name_that_the_index_does_not_have_yet() -> None:
    """Until the first release the name on the index could be anyone's."""
    others = [ROOT / "CONTRIBUTING.md", *(DOCS / "grading").iterdir(), *(ROOT / "config").rglob("*")]
    code = sorted((ROOT / "simmer_tui").rglob("*.py"))
    for path in (each for each in (*PAGES, *others, *code) if each.is_file()):
        for line in path.read_text("utf-8").splitlines():
            named = re.findall(r"(?:pipx? install|uv tool install|uvx)[^`&|;]*?(?<!/)simmer-tui\b(.*)", line)
            assert all(" @ git+https://" in rest for rest in named), f"{path}: {line}"
    assert requirement() == f"simmer-tui @ git+{REPOSITORY}"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert project["urls"]["Source"] == REPOSITORY


def test_every_page_is_in_the_index_of_tasks() -> None:
    """By itself, or by the page that it belongs to."""
    text = (DOCS / "index.md").read_text("utf-8").partition("## I want to")[2]
    linked = {target.partition("#")[0] for target in re.findall(r"\]\(([^)]+\.md[^)]*)\)", text)}
    assert {path.relative_to(DOCS).as_posix() for path in PAGES[1:]} - linked == {"index.md"}


# -- what they do ----------------------------------------------------------------------------------


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder like a clone, with the commands on PATH."""
    commands = tmp_path / "bin"
    commands.mkdir()
    for name, text in (("simmer-tui", SHIM), ("python", f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')):
        (commands / name).write_text(text)
        (commands / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{commands}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    folder = tmp_path / "clone"
    folder.mkdir()
    return folder


def done(command: list[str], folder: Path) -> str:
    ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=600)
    assert ended.returncode == 0, f"{' '.join(command)[:300]}\n{ended.stdout[-2000:]}\n{ended.stderr[-2000:]}"
    return ended.stdout


def in_reading_order() -> list[Path]:
    """The README, then the pages in the order of the site."""
    named = re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text("utf-8"))
    pages = [DOCS / name for name in named if DOCS / name in WRITTEN]
    return [WRITTEN[0], *pages]


@pytest.mark.slow
def test_the_blocks_of_all_pages_run_in_order_in_one_folder(place: Path) -> None:
    """In one folder, as a reader has it: no page needs what none before it made, or stumbles over it."""
    assert sorted(in_reading_order()) == sorted(WRITTEN)
    octave = shutil.which("octave-cli")
    for path in in_reading_order():
        for language, text, why in blocks(path):
            if "--sketch" in text and "init" not in text and find_compiler() is None:
                continue  # boards are compiled
            if not why and (language != "matlab" or octave is not None):
                run_block(language, text, place)


def run_block(language: str, text: str, place: Path) -> None:
    """Run a block of a page. A program is named by its first line, if that is a comment with a name."""
    if language == "toml":
        tomllib.loads(text)
    elif language == "sh":
        done(["bash", "-euo", "pipefail", "-c", text], place)
    elif language == "python":
        named = re.match(r"# (\w+\.py)\n", text)
        name = named[1] if named else "block.py"
        (place / name).write_text(f"import numpy as np\n\n{text}" if "np." in text else text)
        is_client = "Robot()" in text
        done(["simmer-tui", "--no-ui", "--run", f"python {name}"] if is_client else ["python", name], place)
    elif language == "c":
        (place / "block.c").write_text(text)
        done(["cc", "-Wall", "-Werror", "-I", "samples/c", "-o", "block", "block.c", "-lm"], place)
        done(["simmer-tui", "--no-ui", "--run", "./block"], place)
    elif language == "matlab":
        (place / "block.m").write_text(text)
        program = f"{shutil.which('octave-cli')} --norc --path samples/matlab block.m"
        done(["simmer-tui", "--no-ui", "--run", program], place)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built without a warning."""
    built = tmp_path_factory.mktemp("site")
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    ended = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-d", str(built)],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return built


@pytest.mark.slow
def test_links_of_the_site_to_files_outside_of_it_lead_to_the_repository(site: Path) -> None:
    course = (site / "course" / "index.html").read_text("utf-8")
    assert "/blob/main/scripts/course/step1_first_command.py" in course


# The least contrast of texts to what is behind them (WCAG 2), with the text. A canvas turns colours to bytes.
CONTRAST = """(() => {
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const bytes = (colour) => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = colour;
    canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data];
  };
  const over = (front, back) => [0, 1, 2].map((i) => back[i] + (front[i] - back[i]) * front[3] / 255);
  const linear = (part) => (part <= 10.31 ? part / 3294.6 : ((part / 255 + 0.055) / 1.055) ** 2.4);
  const luminance = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  let least = [99, ""];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walk.nextNode(); node; node = walk.nextNode()) {
    const of = node.parentElement;
    if (!node.data.trim() || of.closest("script, style, svg, noscript")) continue;
    if (!of.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
    const behind = [];
    for (let each = of; each; each = each.parentElement)
      behind.unshift(bytes(getComputedStyle(each).backgroundColor));
    const ground = behind.reduce((back, front) => over(front, back), [255, 255, 255]);
    const both = [luminance(ground), luminance(over(bytes(getComputedStyle(of).color), ground))];
    const ratio = (Math.max(...both) + 0.05) / (Math.min(...both) + 0.05);
    if (ratio < least[0]) least = [ratio, node.data.trim()];
  }
  return least;
})()"""


@pytest.mark.slow
@pytest.mark.parametrize("dark", [True, False])
def test_pages_of_the_site_can_be_read_and_fetch_nothing_from_elsewhere(dark: bool, site: Path) -> None:
    with tab() as browser:
        for name in ("course", "cheat-sheet", "reference/messages"):
            browser.open((site / name / "index.html").as_uri(), dark=dark)
            browser.wait("document.readyState === 'complete'")
            scheme = browser.run("document.body.dataset.mdColorScheme")
            assert scheme == ("slate" if dark else "default")
            ratio, text = browser.run(CONTRAST)
            assert ratio >= 4.5, (name, text)
        assert [each for each in browser.requests if not each.startswith(("file:", "data:"))] == []


@pytest.mark.slow
def test_the_cheat_sheet_fits_a_sheet_of_paper(site: Path) -> None:
    with tab() as browser:
        browser.open((site / "cheat-sheet" / "index.html").as_uri())
        browser.wait("document.readyState === 'complete'")
        paper = browser.call("Page.printToPDF", paperWidth=8.27, paperHeight=11.69, preferCSSPageSize=True)
        assert len(re.findall(rb"/Type\s*/Page\b", base64.b64decode(paper["data"]))) == 1


@pytest.mark.slow
def test_pictures_are_made_of_real_runs(tmp_path: Path) -> None:
    made = script("make_pictures").picture(STEPS[0], tmp_path)
    assert made.startswith("<svg")
    assert "polyline" in made
