"""A dialect is a codec, a link and a row: this file adds one, and nothing else knows of it beforehand."""

from __future__ import annotations

import signal
import socket
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from simmer_tui.cli.main import main
from simmer_tui.config.dialects import DIALECTS, Dialect, DialectPort
from simmer_tui.config.loader import load
from simmer_tui.config.reply_formats import ReplyForm, ReplyFormat
from simmer_tui.config.sets import bundled_folder
from simmer_tui.config.settings import ServerSettings, Settings, settings_from
from simmer_tui.config.settings_file import Override
from simmer_tui.links.backend import Message
from simmer_tui.links.link import LinkContext
from simmer_tui.links.peer import PIECE, Peer, ReadBudget
from simmer_tui.live.server import Server
from simmer_tui.sim import CommandResult, parse_command

FORM = ReplyForm(ReplyFormat.TEXT)
PORT = DialectPort("shouts", "shout_port", 9100, "port that takes shouted commands")


def shouted(text: bytes, settings: ServerSettings) -> tuple[bytes, ReplyForm]:
    """The codec: commands in capitals, ended by an exclamation mark."""
    return text.upper() + b"!", FORM


class ShoutLink:
    """The link: any number of connections, each answered on itself."""

    def __init__(self, context: LinkContext) -> None:
        self.context = context
        self.budget = ReadBudget(PIECE)
        self.peers: set[Peer] = set()
        self.acceptor = context.accept(PORT, self.welcome)

    def welcome(self, sock: socket.socket, peer: str) -> None:
        self.peers.add(Shouter(sock, peer, self))

    @property
    def has_clients(self) -> bool:
        return bool(self.peers)

    def close(self) -> None:
        self.acceptor.close()
        for peer in tuple(self.peers):
            peer.abort()


class Shouter(Peer):
    """A connection."""

    def __init__(self, sock: socket.socket, peer: str, link: ShoutLink) -> None:
        super().__init__(sock, peer, link.budget)
        self.link = link
        self.session = link.context.engine.session(lane="shouts")

    def data_received(self, data: bytes) -> None:
        for word in data.removesuffix(b"!").split(b"!"):
            commands = (parse_command(word.decode().lower()),)
            message = Message(word + b"!", commands, FORM)
            self.link.context.backend.submit(message, self.session, self.answer)

    def answer(self, outcomes: Sequence[CommandResult], data: bytes | None) -> None:
        self.write(data or f"{outcomes[0].reply!r}\n".encode())

    def connection_lost(self, error: OSError | None) -> None:
        self.session.close()
        self.link.peers.discard(self)
        self.link.context.client_left()


@pytest.fixture(autouse=True)
def row(monkeypatch: pytest.MonkeyPatch) -> None:
    """The row."""
    here = "tests.test_made_up_dialect" if "tests.test_made_up_dialect" in sys.modules else __name__
    shout = Dialect((PORT,), f"{here}:ShoutLink", "Shouting: port {shout_port}.", f"{here}:shouted")
    monkeypatch.setitem(DIALECTS, "shouting", shout)


def test_its_port_at_its_default_makes_no_other_settings() -> None:
    assert settings_from({"server.shout_port": PORT.default}) == Settings()
    changed = settings_from({"server.shout_port": 5})
    assert settings_from({"server.port": 0}, changed).server.added_ports == (("shout_port", 5),)


PROGRAM = """
import os, socket
with socket.create_connection(("127.0.0.1", int(os.environ["SIMMER_SHOUT_PORT"]))) as robot:
    for _ in range(5):
        for command in (b"D1-2!", b"U1!", b"U2!", b"R1-7!"):
            robot.sendall(command)
            robot.recv(100)
"""


def test_its_port_is_a_setting_that_check_and_doctor_know(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["init", str(tmp_path / "config")]) == 0
    settings = tmp_path / "config" / "settings.toml"
    text = settings.read_text().replace('listeners = ["binary"]', 'listeners = ["shouting"]')
    settings.write_text(text.replace("shout_port = 9100", "shout_port = 0"))
    capsys.readouterr()
    assert main(["check", str(tmp_path / "config")]) == 0
    assert "Shouting: port 0." in capsys.readouterr().out
    assert main(["check", str(tmp_path / "config"), "--shout-port", "70000"]) == 2
    assert "--shout-port" in capsys.readouterr().err
    monkeypatch.chdir(tmp_path)
    assert main(["doctor"]) == 0
    assert "ports     0, 0 are free" in capsys.readouterr().out, "its own, and that for beliefs"


@pytest.mark.slow
def test_a_program_that_speaks_it_is_served_logged_reported_and_calibrated_from(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)  # those of the tests stay
    program, log = tmp_path / "program.py", tmp_path / "run.jsonl"
    program.write_text(PROGRAM)
    options = ["--no-ui", "--listeners", "shouting", "--shout-port", "0", "--seed", "3", "--log", str(log)]
    assert main([*options, "--run", f'"{sys.executable}" "{program}"']) == 0
    told = capsys.readouterr().err
    assert "shouts on port" in told
    assert "commands on port" not in told
    assert main(["report", str(log)]) == 0
    assert "20" in capsys.readouterr().out
    assert main(["rerun", str(log)]) == 0
    assert "20 commands and 0 actions repeated, every reply the same" in capsys.readouterr().out
    assert main(["calibrate", str(log), "--out", str(tmp_path / "learned")]) == 0
    assert (tmp_path / "learned" / "drive.csv").is_file()


def test_its_programs_live_by_the_programs_clock(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)  # those of the tests stay
    program = tmp_path / "program.py"
    program.write_text(
        "import os, socket\n"
        "with socket.create_connection(('127.0.0.1', int(os.environ['SIMMER_SHOUT_PORT'])), 5) as robot:\n"
        "    robot.sendall(b'D1-2!')\n"
        "    print(robot.recv(100))\n"
    )
    options = ["--no-ui", "--listeners", "shouting", "--shout-port", "0", "--clock", "program"]
    assert main([*options, "--run", f'"{sys.executable}" "{program}"']) == 0
    assert "b'inf\\n'" in capfd.readouterr().out


def test_what_is_typed_is_written_as_its_programs_do() -> None:
    overrides = {
        "server.listeners": Override("--listeners", "shouting"),
        "server.shout_port": Override("--shout-port", 0),
    }
    server = Server(load(bundled_folder(), overrides))
    message = server.message(parse_command("d1-3"))
    server.stop()
    assert (message.data, message.form) == (b"D1-3!", FORM)
