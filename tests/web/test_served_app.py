"""The app in a terminal in a browser, as `textual serve` runs it: packets over the standard streams."""

from __future__ import annotations

import json
import os
import shlex
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from tests.web.browser_tab import tab

SECONDS = 60.0
posix = pytest.mark.skipif(sys.platform == "win32", reason="quoting is that of POSIX")


def app(log: Path) -> list[str]:
    options = ["--port", "0", "--belief-port", "0", "--pace", "off", "--log", str(log)]
    return [sys.executable, "-m", "simmer_tui", *options]


def packet(kind: bytes, data: bytes) -> bytes:
    return kind + len(data).to_bytes(4, "big") + data


def commands_in(log: Path) -> list[str]:
    """The commands of a log, as far as it is written."""
    lines = log.read_text("utf-8").splitlines() if log.exists() else []
    records = [json.loads(line) for line in lines if line.endswith("}")]
    # A movement has a line when it begins and one when it ends, of the same number.
    return [*{each["n"]: each["cmd"] for each in records if "cmd" in each}.values()]


def wait_for(log: Path, *commands: str) -> None:
    until = time.monotonic() + SECONDS
    while commands_in(log) != list(commands):
        assert time.monotonic() < until, commands_in(log)
        time.sleep(0.05)  # a file tells nobody when it grows


@pytest.mark.slow
def test_a_line_typed_in_one_burst_is_one_command(tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    environment = os.environ | {"TEXTUAL_DRIVER": "textual.drivers.web_driver:WebDriver"}
    with subprocess.Popen(
        app(log), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment
    ) as process:
        try:
            assert process.stdin is not None
            assert process.stdout is not None
            assert process.stdout.readline() == b"__GANGLION__\n"

            def drawn(text: bytes) -> None:
                """Wait until the app has drawn this."""
                seen = b""
                while text not in seen:
                    kind = process.stdout.read(1)
                    assert kind, seen[-500:]
                    seen += process.stdout.read(int.from_bytes(process.stdout.read(4), "big"))

            drawn(b"u1")  # the sensors: it has begun, and nobody has given it the focus
            process.stdin.write(packet(b"D", b"u1\rd1-3\r"))
            process.stdin.flush()
            drawn(b"d1-3")
            process.stdin.write(packet(b"M", b'{"type": "quit"}'))
            process.stdin.flush()
            process.stdout.read()
            assert process.wait(SECONDS) == 0
        finally:
            process.kill()
    assert commands_in(log) == ["u1", "d1-3"]


@posix
@pytest.mark.slow
def test_textual_serve_serves_the_app(tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    serve = f"from textual_serve.server import Server; Server({shlex.join(app(log))!r}, port={port}).serve()"
    with subprocess.Popen([sys.executable, "-c", serve], stdout=subprocess.DEVNULL) as serving:
        try:
            until = time.monotonic() + SECONDS
            while True:
                try:
                    urllib.request.urlopen(f"http://localhost:{port}/", timeout=SECONDS).close()
                    break
                except OSError:
                    assert time.monotonic() < until
                    time.sleep(0.1)  # it does not say when it is ready
            with tab() as page:
                page.open(f"http://localhost:{port}/")
                page.wait("Boolean(document.querySelector('.xterm-helper-textarea'))")
                wait_for(log)  # the app has started
                page.wait("!document.querySelector('body').className.includes('-loading')")
                page.run("document.querySelector('.xterm-helper-textarea').focus()")
                page.call("Input.insertText", text="u1")
                page.key("Enter", "\r")
                wait_for(log, "u1")
        finally:
            serving.terminate()
