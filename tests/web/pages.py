"""Runs with a page, and viewers of it, for tests."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

from simmer_tui.config.loader import Configuration, Override, load
from simmer_tui.config.sets import bundled_folder
from simmer_tui.errors import PortError
from simmer_tui.live.server import Server
from simmer_tui.run.events import Event
from simmer_tui.sim.command import parse_command
from simmer_tui.web.page_server import PageServer

SECONDS = 60.0


class PageRun:
    """A server with a page, and what it told."""

    def __init__(
        self,
        configuration: Configuration,
        log: Path | None = None,
        first: Callable[[Event], None] | None = None,
    ) -> None:
        """`first` is told of events before the page is."""
        self.server = Server(configuration)
        if first is not None:
            self.server.engine.watch(first)
        if log is not None:
            self.server.start_log(str(log))
        try:
            self.page = PageServer(self.server)
        except PortError:
            self.server.stop()
            raise
        self.told: list[Event] = []
        self._changed = threading.Condition()
        self.page.prepare()
        self.server.start(self._watch)
        self.page.start()
        self.operator = self.server.open_session()

    def _watch(self, event: Event) -> None:
        with self._changed:
            self.told.append(event)
            self._changed.notify_all()

    def wait(self, is_there: Callable[[Event], bool]) -> Event:
        """The first event that is so."""
        with self._changed:
            assert self._changed.wait_for(lambda: any(map(is_there, self.told)), SECONDS), self.told
            return next(filter(is_there, self.told))

    def operate(self, text: str) -> None:
        """Give a command as a person would."""
        command = self.server.message(parse_command(text, "console"))
        self.server.call(self.server.submit, command, self.operator, lambda *_: None)

    def send(self, *texts: str) -> None:
        """Give commands as a person would, and wait until they are answered."""
        for text in texts:
            answered = threading.Event()
            self.server.call(
                self.server.submit,
                self.server.message(parse_command(text, "console")),
                self.operator,
                lambda *_, answered=answered: answered.set(),
            )
            assert answered.wait(SECONDS)

    @property
    def address(self) -> str:
        """The place of the page, without a word."""
        return self.page.links[0].address.partition("#")[0]

    @property
    def host(self) -> str:
        return self.address.removeprefix("http://").removesuffix("/")

    @property
    def port(self) -> int:
        return int(self.host.rpartition(":")[2])

    def word(self, role: str) -> str:
        """The word of a role's link."""
        return next(link.address.partition("#")[2] for link in self.page.links if link.role == role)

    def stop(self) -> None:
        self.page.stop()
        self.server.stop()


@contextlib.contextmanager
def page_run(
    log: Path | None = None,
    folder: Path | None = None,
    first: Callable[[Event], None] | None = None,
    **settings: object,
) -> Iterator[PageRun]:
    """A run in instant motion with a page on any free port; settings with `__` for the dot."""
    given = {"server.port": 0, "web.port": "0", "seed": 5, "randerror": False}
    given |= {name.replace("__", "."): value for name, value in settings.items()}
    overrides = {name: Override("--it", value) for name, value in given.items()}
    configuration = load(folder or bundled_folder(), overrides)
    run = PageRun(configuration, log, first)
    try:
        yield run
    finally:
        run.stop()


class PageViewer:
    """A browser, as far as the page's protocol goes."""

    def __init__(self, run: PageRun, word: str = "", **options: Any) -> None:
        options = {"origin": f"http://{run.host}", "proxy": None, "max_size": None} | options
        self._open = contextlib.ExitStack()
        self.socket: ClientConnection = self._open.enter_context(connect(f"ws://{run.host}/live", **options))
        self.socket.send(json.dumps({"word": word}))
        self.messages: list[dict[str, Any]] = []

    def next(self) -> dict[str, Any]:
        message: dict[str, Any] = json.loads(self.socket.recv(timeout=SECONDS))
        self.messages.append(message)
        return message

    def wait(self, is_there: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        """The first message from here on that is so."""
        while not is_there(message := self.next()):
            pass
        return message

    def say(self, **message: object) -> None:
        self.socket.send(json.dumps(message))

    def __enter__(self) -> PageViewer:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()


class Recorded:
    """The recording that a player makes of the messages it gets, by the same rules."""

    def __init__(self) -> None:
        self.frames: list[tuple[int, int, int, int]] = []
        self.rows: dict[str, list[Any]] = {}
        self.end = 0

    def take(self, message: dict[str, Any]) -> None:
        if "news" not in message:
            return
        news = message["news"]
        if "run" in message:
            self.frames, self.rows = [], {}
        if news["drop"]:
            del self.frames[-news["drop"] :]
        columns = [_sums(news["frames"][name]) for name in ("t", "x", "y", "h")]
        self.frames += zip(*columns, strict=True)
        read = news["readings"]
        times = _sums(read["t"])
        rows = {
            "readings": list(
                zip(read["sensor"], times, read["took"], read["value"], read["true"], strict=True)
            )
        }
        rows |= {name: news[name] for name in ("beliefs", "blocks", "marks", "commands")}
        for name, more in rows.items():
            self.rows.setdefault(name, []).extend(more)
        self.end = news["end"]

    def has(self, command: str, readings: int = 0) -> bool:
        """True if this command is the newest, and there are so many readings."""
        newest = self.rows.get("commands", [])[-1:]
        return bool(newest) and newest[0][1] == command and len(self.rows["readings"]) >= readings


def _sums(differences: list[int]) -> list[int]:
    total, made = 0, []
    for each in differences:
        total += each
        made.append(total)
    return made
