from __future__ import annotations

import gc
import sys
from pathlib import Path

import pytest

from simmer_tui.__main__ import entry
from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    add_setting_options,
    default_text,
    overrides_from,
)
from simmer_tui.cli.log_options import configuration_of
from simmer_tui.cli.main import SUBCOMMANDS, build_parser, main
from simmer_tui.config.loader import load
from simmer_tui.config.settings import Settings, all_settings
from simmer_tui.errors import ConfigurationError, Problem, RunLogError


def parser() -> OneLineParser:
    made = OneLineParser(prog="simmer-tui")
    add_setting_options(made, has_screen=True)
    return made


def settings_of(folder: Path, *argv: str) -> Settings:
    return load(folder, overrides_from(parser().parse_args(list(argv)))).settings


def test_only_options_really_given_override(folder: Path) -> None:
    assert overrides_from(parser().parse_args([])) == {}
    assert set(overrides_from(parser().parse_args(["--port", "1", "--no-randbias"]))) == {
        "server.port",
        "randbias",
    }
    assert settings_of(folder) == Settings()


def test_every_setting_has_an_option_that_takes_its_default(folder: Path) -> None:
    argv: list[str] = []
    for item in all_settings():
        if isinstance(item.default, bool):
            argv.append(item.option if item.default else f"--no-{item.option[2:]}")
        elif item.name != "seed":
            argv += [item.option, default_text(item)]
    overrides = overrides_from(parser().parse_args(argv))
    assert set(overrides) == {item.name for item in all_settings()} - {"seed"}
    assert load(folder, overrides).settings == Settings()


def test_options_set_what_they_name(folder: Path) -> None:
    settings = settings_of(
        folder, "--bot-center", "6,42", "--bot-rot", "90", "--strength", "0.1,2", "--no-randbias",
        "--seed", "7", "--host", "0.0.0.0", "--port", "0", "--reply-port", "0", "--reply-format", "float32",
        "--byte-order", "little", "--block-solid", "--no-plot-sense",
    )  # fmt: skip
    assert (settings.bot_center, settings.bot_rot, settings.strength) == ((6, 42), 90, (0.1, 2))
    assert (settings.randbias, settings.seed, settings.randerror) == (False, 7, False)
    assert (settings.server.host, settings.server.port, settings.server.reply_port) == ("0.0.0.0", 0, 0)
    assert (settings.server.reply_format, settings.server.byte_order) == ("float32", "little")
    assert settings.motion.block_solid
    assert not settings.plot_sense


@pytest.mark.parametrize(
    ("argv", "name", "text"),
    [
        (["--bot-rot", "-90"], "bot_rot", "-90"),
        (["--bot-rot", "-1e3"], "bot_rot", "-1e3"),
        (["--bot-rot", "-.5"], "bot_rot", "-.5"),
        (["--bot-rot=-90"], "bot_rot", "-90"),
        (["--bot-center=-1,2"], "bot_center", "-1,2"),
        (["--bot-center", "-1,2"], "bot_center", "-1,2"),
        (["--bot-center", "-1,-2", "--randbias"], "bot_center", "-1,-2"),
    ],
)
def test_negative_values_need_no_equals_sign(argv: list[str], name: str, text: str) -> None:
    assert overrides_from(parser().parse_args(argv))[name].value == text


def test_negative_value_after_a_double_dash_stays_an_argument() -> None:
    made = parser()
    made.add_argument("program", nargs="*")
    assert made.parse_args(["--seed", "1", "--", "--seed", "-2"]).program == ["--seed", "-2"]


def test_bad_values_are_collected_and_named_by_their_options(folder: Path) -> None:
    with pytest.raises(ConfigurationError) as caught:
        settings_of(folder, "--bot-center", "6;42", "--port", "http", "--byte-order", "litle", "--seed", "-1")
    assert [problem.where for problem in caught.value.problems] == [
        "--bot-center",
        "--seed",
        "--port",
        "--byte-order",
    ]
    assert "did you mean" in caught.value.problems[-1].what


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--bot-centre", "1,2"], 'unknown option "--bot-centre"; did you mean "--bot-center"?'),
        (["--bot-cent", "1,2"], 'unknown option "--bot-cent"; did you mean "--bot-center"?'),
        (["stray\nline"], 'unknown argument "stray\\nline"'),
        (["--port"], "--port needs a value: --port PORT"),
    ],
)
def test_usage_error_is_exactly_one_line(
    argv: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        parser().parse_args(argv)
    assert caught.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err == f"simmer-tui: {message} (see simmer-tui --help)\n"


def test_help_groups_options_and_names_units_and_defaults(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    text = parser().format_settings()
    for title in ("start positions:", "movement and random errors:", "server:", "motion:"):
        assert f"\n{title}\n" in f"\n{text}"
    assert "start of the robot's centre (in, default 9.5,42)" in text
    assert "--bot-rot ANGLE" in text
    assert "(deg, default 0)" in text
    assert "--randbias, --no-randbias" in text
    assert "(s, default 0.005)" in text
    for item in all_settings():
        assert item.option in text


def test_help_begins_with_the_commands_and_fits_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["help"]) == 0
    text = capsys.readouterr().out
    assert text == build_parser().format_help()
    lines = text.splitlines()
    assert len(lines) <= 60
    assert max(map(len, lines)) <= 84
    places = [text.index(f"\n  {name} ") for name in SUBCOMMANDS]
    assert places == sorted(places)
    assert places[-1] < text.index("--config DIR")


@pytest.mark.parametrize("name", SUBCOMMANDS)
def test_help_on_a_command_is_its_own_and_has_nothing_else(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["help", name]) == 0
    text = capsys.readouterr().out
    with pytest.raises(SystemExit):
        main([name, "--help"])
    assert capsys.readouterr().out == text
    assert f"usage: simmer-tui {name}" in text
    assert "--key-" not in text
    assert len(text.splitlines()) <= 100


def test_help_on_settings_has_every_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["help", "settings"]) == 0
    text = capsys.readouterr().out
    assert all(item.option in text for item in all_settings())
    assert "--config" not in text


def test_keys_are_options_of_what_has_a_screen_alone(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["check", "--key-forward", "x"], ["trials", "--theme", "dark"]):
        with pytest.raises(SystemExit):
            main(arguments)
        assert f'unknown option "{arguments[1]}"' in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [(["reprot"], "report"), (["help", "trails"], "trials"), (["help", "setting"], "settings")],
)
def test_a_misspelt_command_gets_its_neighbour(
    arguments: list[str], meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert f'did you mean "{meant}"?' in capsys.readouterr().err


def test_an_interrupt_while_modules_are_loaded_is_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C just after the start: loading takes half a second, and more on a busy machine."""

    class Interrupted:
        def find_spec(self, name: str, *_: object) -> None:
            if name == "simmer_tui.cli.main":
                raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, "simmer_tui.cli.main")
    monkeypatch.setattr(sys, "meta_path", [Interrupted(), *sys.meta_path])
    monkeypatch.setattr(gc, "disable", lambda: None)
    with pytest.raises(SystemExit) as ended:
        entry()
    assert ended.value.code == ExitCode.INTERRUPTED


def test_the_mistakes_in_the_configuration_of_a_log_are_one_line() -> None:
    mistakes = [Problem("maze.csv:1", "is blank"), Problem("robot.csv", "is missing")]
    with pytest.raises(RunLogError) as refused, configuration_of(Path("run.jsonl")):
        raise ConfigurationError(mistakes)
    told = "the configuration in run.jsonl is refused: maze.csv:1: is blank; robot.csv: is missing"
    assert str(refused.value) == told
