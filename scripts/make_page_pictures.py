"""Make the pictures of docs/browser.md and docs/report.md from real runs, as a real browser shows them:
docs/pictures/page-*.png and docs/player.png.

    python scripts/make_page_pictures.py

It needs Chromium, and a clone: the browser is driven as the tests do it.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # a clone's root
from tests.web.browser_tab import Tab, tab

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "docs" / "pictures"
PLAYER = ROOT / "docs" / "player.png"
SIMMER_TUI = (sys.executable, "-m", "simmer_tui")
PROGRAM = f'"{sys.executable}" "{ROOT / "scripts" / "solve.py"}"'
RUN = ("--mission", "--web", "0", "--port", "0", "--belief-port", "0", "--seed", "5", "--motion", "timed")
# The robot looks for its block then: its path, its belief and its rays are there.
MOMENT = 24.0
"""Simulated seconds at which the pictures are taken."""
PAGES = {
    "desk": ((1280, 800), False, ()),
    "phone": ((390, 844), True, ()),
    "drive": ((1280, 800), True, ("--web-control",)),
}
"""Pictures by name: the size of the window, True for the dark theme, and further options."""


def take(page: Tab, name: str) -> None:
    """Run a mission, and take a picture of its page."""
    size, dark, options = PAGES[name]
    command = [*SIMMER_TUI, "--no-ui", *RUN, *options, "--run", PROGRAM]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as run:
        try:
            assert run.stderr is not None
            link = next(line.split()[-1] for line in run.stderr if line.startswith("page to"))
            page.open(link, size=size, dark=dark)
            page.wait(f"Number(document.querySelector('.live .robot')?.dataset.time) > {MOMENT}")
            page.picture(PICTURES / f"page-{name}.png")
        finally:
            run.terminate()


def take_player(page: Tab) -> None:
    """Take a picture of the page of a run that is over, where its program finds out where the robot is."""
    with tempfile.TemporaryDirectory() as folder:
        log, report = Path(folder) / "solve.jsonl", Path(folder) / "solve.html"
        run = ("--no-ui", "--mission", "--seed", "3", "--port", "0", "--belief-port", "0", "--log", str(log))
        for options in ((*run, "--run", PROGRAM), ("report", str(log), "--html", str(report))):
            subprocess.run([*SIMMER_TUI, *options], check=True, capture_output=True)
        page.open(f"{report.as_uri()}#t=12", size=(1160, 800), dark=True)
        page.wait("Number(document.querySelector('.live .robot')?.dataset.time) >= 12")
        page.picture(PLAYER)


def main() -> None:
    """Make all pictures."""
    with tab() as page:
        for name in PAGES:
            take(page, name)
            print(PICTURES / f"page-{name}.png")
        take_player(page)
        print(PLAYER)


if __name__ == "__main__":
    main()
