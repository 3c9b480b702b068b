"""The page that shows a live run: one document, which needs nothing but its own connection."""

from __future__ import annotations

import base64
import hashlib
import re
from email.utils import formatdate
from http import HTTPStatus
from importlib.resources import files

from websockets.datastructures import Headers
from websockets.http11 import Response

from simmer_tui.config.loader import Configuration
from simmer_tui.document import as_html
from simmer_tui.document.model import Bullets, Document, Paragraph, SideBySide
from simmer_tui.report.figure import live_figure
from simmer_tui.report.player import player_code, player_style
from simmer_tui.run.attempt import Task

_SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)


def live_html(configuration: Configuration, task: Task | None, seed: int) -> str:
    """The page of a run."""
    name = configuration.name
    kind = "Mission" if task is not None else "Run"
    document = Document(
        f"{kind}, live",
        [
            Paragraph(f"set {name} · seed {seed}", kind="run"),
            SideBySide(
                (live_figure(configuration.simulation.maze, task),),
                (Bullets("Events", ["None so far."], kind="card"),),
            ),
        ],
    )
    script = f"<script>{player_code()}</script><script>{_asset('live.js')}</script>"
    return as_html.html_page(document, style=player_style() + _asset("live.css"), script=script)


class PageResponses:
    """Answers to requests that are not from viewers."""

    def __init__(self, page: str) -> None:
        self._page = page.encode()
        # The browser may run these scripts and no other, even if a text of the run contains one.
        hashes = (hashlib.sha256(script.encode()).digest() for script in _SCRIPT.findall(page))
        self._scripts = " ".join(f"'sha256-{base64.b64encode(each).decode()}'" for each in hashes)

    def page(self, host: str) -> Response:
        """The page, for a browser that requested it at `host`."""
        # 'self' is that host too, but not every browser accepts it for connections.
        policy = (
            f"default-src 'none'; script-src {self._scripts}; style-src 'unsafe-inline'; "
            f"connect-src 'self' ws://{host} wss://{host}; "
            "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        headers = {"Content-Security-Policy": policy, "X-Frame-Options": "DENY"}
        return _response(HTTPStatus.OK, "text/html; charset=utf-8", self._page, headers)

    @staticmethod
    def refused(status: HTTPStatus, why: str) -> Response:
        """A refusal, with a reason."""
        return _response(status, "text/plain; charset=utf-8", f"{why}\n".encode(), {})


def _response(status: HTTPStatus, kind: str, body: bytes, more: dict[str, str]) -> Response:
    headers = Headers(
        {
            "Date": formatdate(usegmt=True),
            "Connection": "close",
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            **more,
        }
    )
    return Response(status.value, status.phrase, headers, body)


def _asset(name: str) -> str:
    return files("simmer_tui.web").joinpath(name).read_text(encoding="utf-8")
