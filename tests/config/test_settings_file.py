from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simmer_tui.config.loader import load
from simmer_tui.config.reply_formats import NUMBER_LETTERS
from simmer_tui.config.set_warnings import set_warnings
from simmer_tui.config.sets import bundled_folder, bundled_sets, init_set
from simmer_tui.config.settings import MotionSettings, ServerSettings, Settings, all_settings
from simmer_tui.config.settings_file import Override, load_settings
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.noise import SEEDS
from simmer_tui.sim.rules import ChoiceRule, IntegerRule, describe

Edit = Callable[[str, str, str], None]
Problems = Callable[..., list[str]]


def read(folder: Path, text: str, **overrides: Override) -> tuple[Settings, list[str]]:
    """The settings and the problems of a file, without the rest of its set."""
    (folder / "settings.toml").write_bytes(text.encode())
    found: list[Problem] = []
    loaded = load_settings(folder, {name.replace("__", "."): item for name, item in overrides.items()}, found)
    return loaded.settings, [str(problem) for problem in found]


def test_settings_left_out_have_their_defaults(tmp_path: Path) -> None:
    assert read(tmp_path, "") == (Settings(), [])
    settings, found = read(tmp_path, "bot_rot = 90\n[server]\nport = 0\n")
    assert settings == Settings(bot_rot=90.0, server=ServerSettings(port=0))
    assert isinstance(settings.bot_rot, float)
    assert not found


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffbot_rot = 90\r\n[server]\r\nreply_port = 5\r\n[motion]\r\nblock_solid = true\r\n",
        "bot_rot = 9e1\nserver.reply_port = 5\nmotion = {block_solid = true}\n",
        "'bot_rot' = 90\n [ server ]\n\"reply_port\" = 0x5 # five\n[motion]\nblock_solid=true",
    ],
)
def test_all_ways_toml_writes_the_same_settings_mean_the_same(tmp_path: Path, text: str) -> None:
    settings = Settings(
        bot_rot=90.0, server=ServerSettings(reply_port=5), motion=MotionSettings(block_solid=True)
    )
    assert read(tmp_path, text) == (settings, [])


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("bot_center = 5", "must be two numbers, such as [6, 42], not 5 (unit: in)"),
        ("bot_center = [1, 2, 3]", "must be two numbers, such as [6, 42], not [1, 2, 3] (unit: in)"),
        ('bot_center = [1, "2"]', 'must be two numbers, not [1, "2"] (unit: in)'),
        ("bot_center = [1, nan]", "must be two numbers, not [1, nan] (unit: in)"),
        ("bot_rot = inf", "must be a number, not inf (unit: deg)"),
        ("bot_rot = true", "must be a number, not true (unit: deg)"),
        ("bot_rot = 1979-05-27", "must be a number, not 1979-05-27 (unit: deg)"),
        ("bot_rot = {a = 1}", "must be a number, not a table (unit: deg)"),
        ("bot_rot = [[1]]", "must be a number, not a list of 1 value (unit: deg)"),
        ("blocksize = -1", "must be a number, 0 or more, not -1 (unit: in)"),
        ("num_segments = 0", "must be a whole number from 1 to 10000, not 0"),
        ("num_segments = 10001", "must be a whole number from 1 to 10000, not 10001"),
        ("num_segments = 10.0", "must be a whole number from 1 to 10000, not 10.0"),
        ("strength = [0.1, -1]", "must be two numbers, 0 or more, not [0.1, -1]"),
        ("step_time = -0.1", "must be a number from 0 to 3600, not -0.1 (unit: s)"),
        ("randerror = 1", "must be true or false, not 1"),
        ('randbias = "false"', 'must be true or false, not "false"'),
        ("seed = -1", f"must be {SEEDS.allowed}, not -1"),
        (f"seed = {2**128}", f"must be {SEEDS.allowed}, not a far larger whole number"),
        ("seed = 1.5", f"must be {SEEDS.allowed}, not 1.5"),
        (
            "sim = false",
            "means the real robot, which needs its serial port: --serial PORT, or port in [serial] "
            "(simmer-tui ports lists them)",
        ),
        ("server.host = ''", 'must be a line of text, not ""'),
        ("server.port = 65536", "must be a whole number from 0 to 65535, not 65536"),
        ("server.reply_port = -1", "must be a whole number from 0 to 65535, not -1"),
        (
            "server.reply_format = 'float46'",
            f'must be {ChoiceRule(tuple(NUMBER_LETTERS)).allowed}, not "float46"; did you mean "float64"?',
        ),
        ("server.byte_order = 3", 'must be "big" or "little", not 3'),
        ("server.grace = 11", "must be a number from 0 to 10, not 11 (unit: s)"),
        ("motion.block_solid = 'yes'", 'must be true or false, not "yes"'),
    ],
)
def test_wrong_value_names_its_line_and_what_is_allowed(tmp_path: Path, line: str, what: str) -> None:
    name = line.partition(" ")[0]
    _, found = read(tmp_path, f"# a comment\n\n{line}\n")
    assert found == [f"settings.toml:3:{name}: {what}"]


def test_line_is_found_inside_tables_and_inline_tables(tmp_path: Path) -> None:
    _, found = read(
        tmp_path, "server = {\nport = -1}\n".replace("\n", "", 1) + "[motion]\n\nblock_solid = 3\n"
    )
    assert [line.partition(": ")[0] for line in found] == [
        "settings.toml:1:server.port",
        "settings.toml:4:motion.block_solid",
    ]


def test_port_and_reply_port_must_differ_unless_both_are_free(tmp_path: Path) -> None:
    assert read(tmp_path, "[server]\nport = 0\nreply_port = 0\n")[1] == []
    assert read(tmp_path, "[server]\nport = 9001\n")[1] == [
        "settings.toml:1:server.reply_port: must differ from server.port, which is 9001 too"
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("bot_centre = [1, 2]", '1:bot_centre: is not a setting; did you mean "bot_center"?'),
        ("port = 9", '1:port: is not a setting; did you mean "server.port"?'),
        (
            "[server]\nseed = 3",
            '2:server.seed: is not a setting; did you mean "seed"? It belongs above the first [table].',
        ),
        ("[server]\nprot = 3", '2:server.prot: is not a setting; did you mean "server.port"?'),
        ("[sever]\nport = 3", '1:sever: is not a setting; did you mean "server"?'),
        ("server = 3", "1:server: is a table of settings, written [server] on a line of its own"),
        ("qqqqqqqq = 3", "1:qqqqqqqq: is not a setting"),
        ('"a\\u001b[31m" = 3', "a\\x1b[31m: is not a setting"),
    ],
)
def test_unknown_setting_is_a_problem_with_a_suggestion(tmp_path: Path, text: str, expected: str) -> None:
    _, found = read(tmp_path, text)
    assert found == [f"settings.toml:{expected}"]


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("bot_rot = 1\nbot_rot = 2\n", "settings.toml:2: is not TOML here: "),
        ("bot_rot = \n", "settings.toml:1: is not TOML here: "),
        ("bot_center = [1,\n", "settings.toml:2: is not TOML here: "),
        ("seed = " + "9" * 5000, "settings.toml: is not TOML that can be read: "),
        ("seed = " + "[" * 20000, "settings.toml: is not TOML that can be read: "),
        ("seed." * 1000 + "a = 1", "settings.toml:1:seed: must be a whole number"),
    ],
)
def test_text_that_is_not_toml_is_one_problem_with_its_line(tmp_path: Path, text: str, place: str) -> None:
    _, found = read(tmp_path, text)
    (line,) = found
    assert line.startswith(place)


def test_options_win_over_the_file_and_text_is_parsed(tmp_path: Path) -> None:
    settings, found = read(
        tmp_path,
        "bot_center = [1, 2]\n[server]\nport = 5\n",
        bot_center=Override("--bot-center", "-6,42.5"),
        server__port=Override("--port", 7),
    )
    assert not found
    assert settings.bot_center == (-6, 42.5)
    assert settings.server.port == 7


def test_wrong_option_is_named_by_the_option_beside_the_files_mistakes(tmp_path: Path) -> None:
    _, found = read(
        tmp_path,
        "num_segments = 0\n",
        bot_center=Override("--bot-center", "6"),
        blocksize=Override("--blocksize", "-1e999"),
        server__byte_order=Override("--byte-order", "bug"),
        sim=Override("--no-sim", False),
    )
    assert found == [
        "settings.toml:1:num_segments: must be a whole number from 1 to 10000, not 0",
        '--bot-center: must be two numbers, such as 6,42, not "6" (unit: in)',
        '--blocksize: must be a number, 0 or more, not "-1e999" (unit: in)',
        '--byte-order: must be "big" or "little", not "bug"; did you mean "big"?',
        "--no-sim: means the real robot, which needs its serial port: --serial PORT, or port in [serial] "
        "(simmer-tui ports lists them)",
    ]


@pytest.mark.parametrize("number", [7, SEEDS.high])
def test_seed_option_turns_repeatable_errors_on(tmp_path: Path, number: int) -> None:
    seed = Override("--seed", str(number))
    settings, found = read(tmp_path, "randerror = true\n", seed=seed)
    assert (settings.seed, settings.randerror, found) == (number, False, [])
    assert read(tmp_path, "seed = 7\n")[0].randerror
    assert read(tmp_path, "", seed=seed, randerror=Override("--no-randerror", False))[1] == []
    assert read(tmp_path, "", seed=seed, randerror=Override("--randerror", True))[1] == [
        "--seed: asks for repeatable errors and --randerror for different ones; give one of the two"
    ]


def test_start_inside_a_wall_names_the_setting_or_the_option(edit: Edit, problems: Problems) -> None:
    edit("settings.toml", "[9.5, 42.0]", "[30, 30]")
    (line,) = problems()
    assert line.startswith("settings.toml:7:bot_center: the robot at (30, 30) heading 0 overlaps a wall")
    block = {"block_center": Override("--block-center", "500,1")}
    lines = problems(block)
    assert len(lines) == 2
    assert any(line.startswith("--block-center: (500, 1) lies outside the maze") for line in lines)
    assert problems({"bot_center": Override("--bot-center", "9.5,42")}) == []


def test_start_on_a_solid_block_is_a_problem_only_if_it_is_solid(problems: Problems) -> None:
    there = {"bot_center": Override("--bot-center", "25,41")}
    assert problems(there) == []
    (line,) = problems(there | {"motion.block_solid": Override("--block-solid", True)})
    assert line.startswith("--bot-center: the robot at (25, 41)")


def test_every_mistake_of_every_file_is_reported_at_once(
    edit: Edit, folder: Path, problems: Problems
) -> None:
    edit("maze.csv", "3,3,1,1,0,2,0,2", "3,3,9,1,0,2,0,2")
    (folder / "floor.csv").write_text("5\n")
    edit("robot.csv", ",6\ny", ",60\ny")
    edit("sensors.csv", "ultra1,u1,1,3", "ultra1,u1,2,x")
    edit("sensors.csv", "comp1,c1", "cmp1,c")
    edit("drive.csv", "up,w1,1,0.05", "up,w1,1,")
    edit("settings.toml", "blocksize = 3.0", "blocksize = -3.0")
    edit("settings.toml", "port = 9000", "port = 9e3")
    lines = problems({"bot_rot": Override("--bot-rot", "north")})
    assert [line.partition(": ")[0] for line in lines] == [
        "maze.csv:1:C",
        "floor.csv:1:A",
        "robot.csv:2:B",
        "sensors.csv:2:Enabled",
        "sensors.csv:2:X Position (in)",
        "sensors.csv:11:ID",
        "sensors.csv:11:Poll Character",
        "drive.csv:2:Y-Axis Error",
        "settings.toml:13:blocksize",
        "settings.toml:55:server.port",
        "--bot-rot",
    ]


def test_missing_folder_is_one_problem(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"none: is not a folder; simmer-tui init DIR"):
        load(tmp_path / "none")


@pytest.mark.parametrize("name", ["maze.csv", "robot.csv", "sensors.csv", "drive.csv", "settings.toml"])
@given(text=st.text(max_size=200) | st.text("01,.\n\r\"'ul-;[]=server.potbi_n \t", max_size=60))
@settings(max_examples=15)
def test_any_text_in_any_file_is_read_or_refused_as_a_configuration(name: str, text: str) -> None:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "set"
        init_set(folder, bundled_folder())
        (folder / name).write_bytes(text.encode("utf-8", "surrogatepass"))
        found: Sequence[Problem] = ()
        try:
            load(folder)
        except ConfigurationError as error:
            found = error.problems
        assert all(str(problem).isprintable() for problem in found)


@given(
    st.dictionaries(
        st.sampled_from([item.name for item in all_settings()]),
        st.text(max_size=20)
        | st.booleans()
        | st.integers()
        | st.floats()
        | st.lists(st.floats(), max_size=3),
        max_size=4,
    )
)
@settings(max_examples=25)
def test_any_values_of_options_are_taken_or_refused_as_a_configuration(values: dict[str, object]) -> None:
    overrides = {name: Override(f"--{name}", value) for name, value in values.items()}
    settings = Settings()
    found: Sequence[Problem] = ()
    try:
        settings = load(bundled_folder(), overrides).settings
    except ConfigurationError as error:
        found = error.problems
    assert all(str(problem).isprintable() for problem in found)
    assert 1 <= settings.num_segments <= 10_000
    assert settings.blocksize > 0


def test_two_whole_numbers_are_named_and_far_larger_ones_are_not_written_out() -> None:
    assert IntegerRule(0, 1).allowed == "0 or 1"
    assert IntegerRule(0, 2).allowed == "a whole number from 0 to 2"
    assert describe(10**30 - 1) == "9" * 30
    assert describe(10**30) == "a far larger whole number"


def test_segments_that_cost_more_than_real_time_have_a_warning() -> None:
    """Continuous motion has as many parts as its stretches of errors."""

    def warnings(segments: str) -> tuple[str, ...]:
        return set_warnings(load(bundled_sets()["default"], {"num_segments": Override("option", segments)}))

    (warning,) = warnings("10000")
    assert warning.startswith("num_segments = 10000 cuts continuous motion into up to 23,333 parts a second")
    most = warning.partition("--num-segments ")[2].split()[0]
    assert warnings(most) == warnings("10") == ()
    assert warnings(str(int(most) + 1))
