"""Numbers in files that import nothing of the package are those of the package."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

from simmer_tui import client
from simmer_tui.config import dialects, reply_formats
from simmer_tui.config.settings import ServerSettings
from simmer_tui.links.protocol import binary, replies
from simmer_tui.live.server import TOKEN
from simmer_tui.program import program_command
from simmer_tui.robot import program_clock
from simmer_tui.run import belief_grid

ROOT = Path(__file__).parents[1]
SCRIPTS, PACKAGE = ROOT / "scripts", ROOT / "simmer_tui"


def constants(path: Path) -> dict[str, Any]:
    """The constants at the top level of a module, which is not imported: the hook would replace the clock."""
    found = {}
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.Assign):
            for target in node.targets:
                names = target.elts if isinstance(target, ast.Tuple) else [target]
                values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
                for name, value in zip(names, values, strict=False):
                    if isinstance(name, ast.Name) and isinstance(value, ast.Constant):
                        found[name.id] = value.value
    return found


def test_the_python_client_has_the_defaults_and_limits_of_the_simulator() -> None:
    found = constants(PACKAGE / "client.py")
    assert found["DEFAULT_HOST"] == ServerSettings().host
    for name, port in {
        "DEFAULT_PORT": dialects.COMMANDS,
        "DEFAULT_REPLY_PORT": dialects.REPLIES,
        "DEFAULT_PACKET_PORT": dialects.PACKETS,
        "DEFAULT_PACKET_REPLY_PORT": dialects.PACKET_REPLIES,
        "DEFAULT_BELIEF_PORT": dialects.BELIEFS,
    }.items():
        assert found[name] == port.default, name
        assert f'"{port.variable}"' in Path(client.__file__).read_text("utf-8")
    assert found["_MOST_RANGES"] == replies.MOST_RANGES
    assert client._NUMBER_LETTERS == reply_formats.NUMBER_LETTERS
    assert client._BYTE_ORDERS == reply_formats.BYTE_ORDERS
    given = get_type_hints(client.Robot.__init__)
    assert get_args(given["reply_format"]) == tuple(reply_formats.NUMBER_LETTERS)
    assert get_args(given["byte_order"]) == tuple(reply_formats.BYTE_ORDERS)
    assert found["_MOST_STATES"] == belief_grid.MOST_STATES
    assert (found["_MOST_ROWS"], found["_MOST_HEADINGS"]) == (
        belief_grid.MOST_ROWS,
        belief_grid.MOST_HEADINGS,
    )
    assert found["_LONGEST_COMMAND"] == binary.LONGEST_COMMAND - 1


@pytest.mark.parametrize(
    ("file", "phrase"),
    [
        ("c/simmer.h", f"SIMMER_LONGEST = {binary.LONGEST_COMMAND - 1} }}"),
        ("c/simmer.h", f"SIMMER_MOST_RANGES = {replies.MOST_RANGES} }}"),
        ("c/simmer.h", f'"{dialects.COMMANDS.variable}", {dialects.COMMANDS.default})'),
        ("c/simmer.h", f'"{dialects.REPLIES.variable}", port == {dialects.COMMANDS.default} ? '),
        ("c/simmer.h", f"? {dialects.REPLIES.default} : 0)"),
        ("c/simmer.h", f'"{dialects.BELIEFS.variable}", {dialects.BELIEFS.default})'),
        ("matlab/simmer_open.m", f"'{dialects.COMMANDS.variable}', {dialects.COMMANDS.default})"),
        ("matlab/simmer_open.m", f"'{dialects.REPLIES.variable}', {dialects.REPLIES.default} * "),
        ("matlab/simmer_open.m", f"(port == {dialects.COMMANDS.default}))"),
        ("matlab/simmer_send.m", f"numel(text) > {binary.LONGEST_COMMAND - 1} "),
        ("matlab/simmer_send.m", f"number <= {replies.MOST_RANGES} "),
        ("matlab/simmer_believe.m", f"numel(p) > {belief_grid.MOST_STATES}\n"),
        ("matlab/simmer_believe.m", f"port = {dialects.BELIEFS.default};"),
    ],
)
def test_the_clients_in_c_and_matlab_have_them_too(file: str, phrase: str) -> None:
    assert phrase in (SCRIPTS / file).read_text("utf-8")


def test_the_hook_in_a_program_has_the_limits_and_variables_of_the_simulator() -> None:
    folder = PACKAGE / "program" / "hook"
    clock, serial = constants(folder / "simmer_clock.py"), constants(folder / "simmer_serial.py")
    assert clock["_IN_FLIGHT"] == program_clock.IN_FLIGHT
    assert (clock["_PORT"], serial["PORT"], program_command.STACK) == program_command.HOOKED
    assert f'"{program_command.STACK}"' in (folder / "sitecustomize.py").read_text("utf-8")
    assert serial["PORT"] == dialects.SERIAL.variable
    for path in (folder / "simmer_clock.py", folder / "simmer_serial.py"):
        assert f'"{TOKEN}"' in path.read_text("utf-8"), path.name
