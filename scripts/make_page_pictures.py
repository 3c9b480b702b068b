"""Make the pictures of docs/browser.md from a real run, as a real browser shows it: docs/pictures/page-*.png.

    python scripts/make_page_pictures.py

It needs Chromium, and a clone: the browser is driven as the tests do it.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # a clone's root
from tests.web.browser_tab import Tab, tab

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "docs" / "pictures"
RUN = ("--mission", "--web", "0", "--port", "0", "--belief-port", "0", "--seed", "5")
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
    program = f'"{sys.executable}" "{ROOT / "scripts" / "solve.py"}"'
    command = [
        sys.executable,
        "-m",
        "simmer_tui",
        "--no-ui",
        *RUN,
        *options,
        "--time-scale",
        "4",
        "--run",
        program,
    ]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as run:
        try:
            assert run.stderr is not None
            link = next(line.split()[-1] for line in run.stderr if line.startswith("page to"))
            page.open(link, size=size, dark=dark)
            page.wait(f"Number(document.querySelector('.live .robot')?.dataset.time) > {MOMENT}")
            page.picture(PICTURES / f"page-{name}.png")
        finally:
            run.terminate()


def main() -> None:
    """Make all pictures."""
    with tab() as page:
        for name in PAGES:
            take(page, name)
            print(PICTURES / f"page-{name}.png")


if __name__ == "__main__":
    main()
