"""`--web` and its like on the command line: links, logs, what is missing, and the end of a run."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from websockets.sync.client import connect

from simmer_tui.cli.main import main
from simmer_tui.client import Robot
from simmer_tui.errors import PortError
from simmer_tui.web import page_server
from tests.web.pages import page_run

SECONDS = 60.0
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals are those of POSIX")


def started(*options: str) -> tuple[subprocess.Popen[str], list[str], list[int]]:
    """A run without a screen, and the links and the port of commands that it printed."""
    arguments = ["--no-ui", "--port", "0", "--belief-port", "0", "--web", "0", *options]
    process = subprocess.Popen(
        [sys.executable, "-m", "simmer_tui", *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    links: list[str] = []
    ports: list[int] = []
    for line in process.stdout:
        ports += map(int, re.findall(r"commands on port (\d+)", line))
        links += re.findall(r"page to (?:look|drive): (\S+)", line)
        if len(links) == (2 if "--web-host" in options and "--web-control" in options else 1):
            break
    return process, links, ports


@pytest.mark.slow
@posix
def test_links_are_printed_and_not_logged_and_the_end_comes_soon(tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    process, links, _ = started("--web-host", "127.0.0.1", "--web-control", "--log", str(log))
    with process:
        words = [link.partition("#")[2] for link in links]
        assert len({*words}) == 2
        # A viewer that says nothing does not hold up the end.
        place = re.findall(r"http://(.*):(\d+)/", links[0])[0]
        with socket.create_connection((place[0], int(place[1])), SECONDS):
            begun = time.monotonic()
            process.send_signal(signal.SIGINT)
            try:
                process.communicate(timeout=SECONDS)
            finally:
                process.kill()
        assert time.monotonic() - begun < 30  # of a busy machine; it takes 2 s at most by its own clock
    text = log.read_text("utf-8")
    assert not any(word in text for word in words)


WITHOUT = """
import sys

class Gone:
    def find_spec(self, name, *_):
        if name == "websockets":
            raise ModuleNotFoundError(name, name=name)

sys.meta_path.insert(0, Gone())
from simmer_tui.cli.main import main
sys.exit(main(["--no-ui", "--port", "0", "--belief-port", "0", "--web", "0"]))
"""


@pytest.mark.slow
def test_without_the_package_one_line_says_how_to_get_it() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT], capture_output=True, text=True, timeout=SECONDS)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("--web: needs the package websockets: pip install 'simmer-tui[web] @ ")


@pytest.mark.parametrize("port", ["65536", "-1", "no", "1.5"])
def test_a_port_that_is_none_is_refused(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--no-ui", f"--web={port}"]) == 2
    assert "--web" in capsys.readouterr().err


def test_a_port_in_use_is_an_error_unless_it_is_the_usual_one(monkeypatch: pytest.MonkeyPatch) -> None:
    with page_run() as first:
        taken = str(first.port)
        with pytest.raises(PortError, match="choose another with --web N"), page_run(web__port=taken):
            pass
        monkeypatch.setattr(page_server, "WEB_PORT", taken)
        with page_run(web__port=taken) as second:
            assert second.port != first.port
            assert any(f"port {taken} (page) is in use" in each for each in second.server.warnings)


@pytest.mark.slow
@posix
def test_the_verdict_is_shown_when_the_client_has_left_and_the_run_goes_on() -> None:
    process, links, (commands,) = started("--seed", "3")
    with process:
        try:
            assert process.stdout is not None
            page = links[0].removeprefix("http://").partition("/")[0]
            with connect(f"ws://{page}/live", origin=f"http://{page}", proxy=None, max_size=None) as viewer:
                viewer.send('{"word": ""}')
                with Robot(port=commands) as robot:
                    robot.drive("d1", 3)
                while not (told := json.loads(viewer.recv(timeout=SECONDS))).get("verdict"):
                    pass
            process.send_signal(signal.SIGINT)
            said = process.communicate(timeout=SECONDS)[0]
        finally:
            process.kill()
    headline = told["verdict"]["lines"][0]
    assert said.count(headline) == 1
