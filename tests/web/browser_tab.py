"""A tab of a headless Chromium, driven by its DevTools protocol, with real time and real sockets."""

from __future__ import annotations

import base64
import contextlib
import itertools
import json
import re
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

from tests.report.browser import browser

_OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--disable-dev-shm-usage", "--remote-debugging-port=0", "about:blank"),
)
SECONDS = 60.0
_NAVIGATED = "Inspected target navigated or closed"
"""The answer to an expression whose page has gone meanwhile."""


class NavigatedError(AssertionError):
    """The page that was asked has given way to another."""


class Tab:
    """One page of a browser."""

    def __init__(self, socket: ClientConnection, session: str) -> None:
        self._socket = socket
        self._session = session
        self._numbers = itertools.count(1)
        self.requests: list[str] = []
        """Addresses that the page has asked for, or tried to."""
        self.told: list[str] = []
        """Errors and messages of its console."""

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The browser's answer to a call of its protocol."""
        answer = self._answer(method, parameters)
        if _NAVIGATED in str(answer.get("error")):
            raise NavigatedError(answer)
        assert "error" not in answer, answer
        result: dict[str, Any] = answer["result"]
        return result

    def _answer(self, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        self._socket.send(json.dumps(message))
        while True:
            answer: dict[str, Any] = json.loads(self._socket.recv(timeout=SECONDS))
            if answer.get("id") == number:
                return answer
            self._note(answer)

    def _note(self, event: dict[str, Any]) -> None:
        parameters = event.get("params", {})
        match event.get("method"):
            case "Network.requestWillBeSent":
                self.requests.append(parameters["request"]["url"])
            case "Network.webSocketCreated":
                self.requests.append(parameters["url"])
            case "Runtime.exceptionThrown":
                self.told.append(str(parameters["exceptionDetails"]))
            case "Runtime.consoleAPICalled":
                self.told.append(str([each.get("value") for each in parameters["args"]]))
            case "Log.entryAdded":
                self.told.append(parameters["entry"]["text"])

    def open(self, address: str, *, size: tuple[int, int] = (1280, 800), dark: bool = False) -> None:
        """Go to a page in a window of that size."""
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        width, height = size
        phone = width < 700
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=2 if phone else 1, mobile=phone,
        )  # fmt: skip
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.call("Page.navigate", url=address)

    def run(self, script: str) -> Any:
        """The value of an expression on the page; a promise is waited for."""
        done = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in done, done
        return done["result"].get("value")

    def wait(self, script: str) -> Any:
        """Wait until an expression is true, and give its value."""
        until = time.monotonic() + SECONDS
        while True:
            with contextlib.suppress(NavigatedError):
                if value := self.run(script):
                    return value
            assert time.monotonic() < until, (script, self.told, self.run("document.body?.innerText"))

    def picture(self, path: Path) -> None:
        """Write what the window shows."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot")["data"]))

    def key(self, name: str, text: str = "") -> None:
        """Press a key, by its name in browsers."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=name, text=text if kind == "keyDown" else "")


@contextlib.contextmanager
def tab() -> Iterator[Tab]:
    """A browser with one page."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        process = subprocess.Popen(
            [browser(), *_OPTIONS, f"--user-data-dir={folder}"], stderr=subprocess.PIPE, text=True
        )
        try:
            assert process.stderr is not None
            for line in process.stderr:
                if found := re.search(r"DevTools listening on (\S+)", line):
                    break
            with connect(found[1], max_size=None, proxy=None) as socket:
                whole = Tab(socket, "")
                # A page of our own: among those the browser begins with may be some without a window.
                target = whole.call("Target.createTarget", url="about:blank")["targetId"]
                session = whole.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
                yield Tab(socket, session)
        finally:
            process.kill()
            process.wait()
            process.stderr.close()
