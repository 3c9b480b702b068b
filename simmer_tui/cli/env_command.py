"""`simmer-tui env`: the variables for programs that an IDE starts."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import socket
import sys
from collections.abc import Callable, Mapping

from simmer_tui import platform_has
from simmer_tui.cli.command_line import (
    ExitCode,
    OneLineParser,
    add_config_option,
    add_setting_options,
    overrides_from,
    print_lines,
    say,
    subcommand,
)
from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.config.dialects import SERIAL, TEAM
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.sets import find_set
from simmer_tui.config.variables import HOST, SERIAL_NAMES
from simmer_tui.document.as_data import json_text
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.program.program_command import with_hook

# Loopback answers in less than a millisecond, another machine of the same network in a few.
_LOOK = 0.5
"""Seconds within which a running simulator must answer."""


# Paths have at most 4,096 bytes, and there are fewer than 20 variables.
_LONGEST_ANSWER = 128 * 1024
"""Longest answer of a simulator, bytes."""


_FORMS: dict[str, Callable[[str, str], str]] = {
    "sh": lambda name, value: f"export {name}={shlex.quote(value)}",
    "powershell": lambda name, value: "$env:{} = '{}'".format(name, value.replace("'", "''")),
    "cmd": lambda name, value: f'set "{name}={value}"',
}


_JSON = "json"


def _env_options(parser: OneLineParser) -> None:
    add_config_option(parser)
    parser.add_argument(
        "--form",
        choices=(*_FORMS, _JSON),
        default="sh" if platform_has.POSIX else "powershell",
        help="as lines of a shell, or as an object for an IDE (default: powershell on Windows, else sh)",
    )
    names = ("host", "belief_port", "dialect_port", "serial_names")
    add_setting_options(parser, names=[f"server.{name}" for name in names])


@subcommand("env", _env_options)
def run_env(options: argparse.Namespace) -> int:
    """Print the variables with which an IDE or another terminal must start a program: those of the run that
    is live, with the facts of its mission. In a set with a dialect they make a Python program's serial.Serial
    lead to the simulator; give the same set and options as to it."""
    configuration = load(find_set(options.config), overrides_from(options), devices=DeviceUse.PARSE)
    live = live_variables(configuration, os.environ)
    has_dialect = TEAM in configuration.settings.server.listeners
    variables = variables_of(configuration, os.environ) if has_dialect or not live else {}
    # The options of this command count, where both have a variable.
    variables = _hooked(live | variables, os.environ)
    if options.form == _JSON:
        sys.stdout.write(json_text(variables))
    else:
        print_lines(*(_FORMS[options.form](*each) for each in variables.items()))
    if has_dialect:
        host, port = variables[HOST], int(variables[SERIAL.variable])
        if not _answers(host, port):
            say(f"no simulator answers at {host}, port {port}: start simmer-tui with this set")
    return ExitCode.DONE


def live_variables(configuration: Configuration, environment: Mapping[str, str]) -> dict[str, str]:
    """The variables of a program, by name, as the run that is live tells them on its port for beliefs.
    Empty if nobody answers there, or another program than this simulator.

    Args:
        configuration: The set, with the host and the port.
        environment: What is set here: its token counts.
    """
    from simmer_tui.links.belief_link import VARIABLES_QUESTION
    from simmer_tui.live.server import TOKEN, reachable_host

    server = configuration.settings.server
    host, token = reachable_host(server.host), server.token or environment.get(TOKEN, "").strip()
    try:
        with socket.create_connection((host, server.belief_port), _LOOK) as connection:
            first = f"{token}\n" if token else ""
            connection.sendall(f"{first}{json.dumps(VARIABLES_QUESTION)}\n".encode())
            with connection.makefile("rb") as lines:
                told = json.loads(lines.readline(_LONGEST_ANSWER))["variables"]
    except (OSError, ValueError, LookupError, TypeError):
        return {}
    if not isinstance(told, dict) or not all(isinstance(each, str) for each in told.values()):
        return {}
    return told | {HOST: host} | ({TOKEN: token} if token else {})


def _hooked(variables: dict[str, str], environment: Mapping[str, str]) -> dict[str, str]:
    """With the module path that leads a Python program's serial port to the simulator, if there is one."""
    if SERIAL.variable not in variables or "PYTHONPATH" in variables:
        return variables
    before = {"PYTHONPATH": environment["PYTHONPATH"]} if environment.get("PYTHONPATH") else {}
    return with_hook(variables | before)


def variables_of(configuration: Configuration, environment: Mapping[str, str]) -> dict[str, str]:
    """The variables of a program, by name.

    Args:
        configuration: The set that the simulator runs.
        environment: What is set here: its path of Python modules stays, and its token counts.

    Raises:
        ConfigurationError: The set has no serial port, or one of any number.
    """
    from simmer_tui.live.server import TOKEN, reachable_host

    server = configuration.settings.server
    if TEAM not in server.listeners:
        what = (
            "it has no dialect.toml: its programs connect over TCP, and need no variables. A live run tells "
            f"more, and none answers on {reachable_host(server.host)} port {server.belief_port} (beliefs): "
            "start simmer-tui --mission"
        )
        raise ConfigurationError([Problem(f"the set {configuration.name}", what)])
    if not server.dialect_port:
        what = "is any free one: name one, for the simulator as well"
        raise ConfigurationError([Problem("--dialect-port", what)])
    variables = {HOST: reachable_host(server.host), SERIAL.variable: str(server.dialect_port)}
    if server.serial_names:
        variables[SERIAL_NAMES] = ",".join(server.serial_names)
    token = server.token or environment.get(TOKEN, "").strip()
    if token:
        variables[TOKEN] = token
    return _hooked(variables, environment)


def _answers(host: str, port: int) -> bool:
    try:
        socket.create_connection((host, port), _LOOK).close()
    except OSError:
        return False
    return True
