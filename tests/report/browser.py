"""A headless Chromium that opens a page and gives back what it made of it."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import pytest

_OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--hide-scrollbars"),
    *("--virtual-time-budget=10000", "--run-all-compositor-stages-before-draw"),
)


def browser() -> str:
    """The program; the test is left out where there is none, but fails in CI, which installs it."""
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if found is None:
        assert not os.environ.get("CI"), "CI has no chromium"
        pytest.skip("no chromium to open the page with")
    return found


SIZES = {"desk": (1280, 800), "phone": (390, 844)}
"""Windows that pages are made for, width and height in CSS pixels."""
# What a reader has in a window: what of the first screenful lies where, how wide the page is, and which
# words short enough for a line were broken, with everything unfolded.
_MEASURE = r"""<script>
  const edge = (name) => document.querySelector(name)?.getBoundingClientRect().bottom ?? null;
  const names = [".verdict", ".figures", ".maze svg", ".timeline", ".bar", "table"];
  const made = { edges: Object.fromEntries(names.map((name) => [name, edge(name)])) };
  for (const each of document.querySelectorAll("details")) each.open = true;
  made.width = document.documentElement.scrollWidth;
  made.broken = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walk.nextNode(); node; node = walk.nextNode()) {
    if (node.parentElement.closest("script, style, svg")) continue;
    for (const word of node.data.matchAll(/[^\s]+/g)) {
      const range = document.createRange();
      range.setStart(node, word.index);
      range.setEnd(node, word.index + word[0].length);
      const lines = new Set([...range.getClientRects()].map((each) => Math.round(each.top)));
      if (lines.size > 1 && !/[-\/]/.test(word[0])) made.broken.push(word[0]);
    }
  }
  const answer = document.createElement("pre");
  answer.id = "measured";
  answer.textContent = JSON.stringify(made);
  parent.document.body.append(answer);
</script></body>"""


def measured(page: Path, size: str) -> dict[str, Any]:
    """Measures of a page in a window of one of `SIZES`: `edges`, the lower edge of each part of its first
    screenful (CSS pixels), its `width`, and the words that were `broken`."""
    text = html.escape(page.read_text("utf-8").replace("</body>", _MEASURE))
    width, height = SIZES[size]
    # A frame may be narrower than any window of the browser.
    frame = page.with_name(f"{page.stem}-{size}.html")
    frame.write_text(f'<iframe width="{width}" height="{height}" srcdoc="{text}"></iframe>', "utf-8")
    found = re.search(r'<pre id="measured">(.*?)</pre>', opened(frame), re.DOTALL)
    assert found is not None
    made: dict[str, Any] = json.loads(html.unescape(found[1]))
    return made


_SLIDE = """<script>
  const slider = document.querySelector(".timeline input"), seen = [];
  for (const t of TIMES) {
    slider.value = t;
    slider.dispatchEvent(new Event("input"));
    seen.push(EACH);
  }
  const made = document.createElement("pre");
  made.id = "seen";
  made.textContent = JSON.stringify([seen, LAST]);
  document.body.append(made);
</script></body>"""


def slid(text: str, folder: Path, times: list[float], each: str, last: str = "null") -> tuple[list[Any], Any]:
    """The values of an expression of JavaScript while a player's slider stands at each of these times, as a
    person would move it, and that of a last one.

    Args:
        text: The page.
        folder: The folder for its file.
        times: Seconds.
        each: The expression at each time.
        last: The one after them.
    """
    script = _SLIDE.replace("TIMES", str(times)).replace("EACH", each).replace("LAST", last)
    page = folder / "run.html"
    page.write_text(text.replace("</body>", script), "utf-8")
    document = opened(page)
    found = re.search(r'<pre id="seen">(.*?)</pre>', document, re.DOTALL)
    assert found is not None, document[-2000:]
    seen, final = json.loads(html.unescape(found[1]))
    return seen, final


def opened(page: Path) -> str:
    """The document as it stands after its scripts have run."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        done = subprocess.run(
            [browser(), *_OPTIONS, f"--user-data-dir={folder}", "--dump-dom", page.as_uri()],
            capture_output=True,
            text=True,
            timeout=600,
            check=True,
        )
    return done.stdout
