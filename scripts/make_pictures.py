"""Make the pictures of the course from real runs of its programs: docs/pictures/stepN.svg.

    python scripts/make_pictures.py

Each program is run once, without a screen, with the same seed; the picture is the one of `simmer-tui report`:
the path from dark to light, the believed path in purple, red where the robot met something.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from msgspec.structs import replace

sys.path.append(str(Path(__file__).resolve().parent.parent))  # a clone's root; an installed one is first
from simmer_tui.cli.log_reports import build_report
from simmer_tui.document import svg
from simmer_tui.report.figure import maze_figure

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "docs" / "pictures"
STEPS = sorted((ROOT / "scripts" / "course").glob("step*.py"))
SEED = 5
OPTIONS = {"6": ["--config", "mission"], "7": ["--mission"]}
"""Further options of some steps; the others run in the default set."""


def step_of(program: Path) -> str:
    """The step's number, as in its file's name: 3, 3b."""
    return program.name.partition("_")[0].removeprefix("step")


def picture(program: Path, folder: Path) -> str:
    """Run a step and draw its path. Raises CalledProcessError if it failed."""
    number = step_of(program)
    log = folder / f"step{number}.jsonl"
    ports = ["--port", "0", "--reply-port", "0", "--belief-port", "0"]
    command = [sys.executable, "-m", "simmer_tui", "--no-ui", "--quiet", *ports, "--seed", str(SEED)]
    command += [*OPTIONS.get(number, []), "--log", str(log), "--run", f'"{sys.executable}" "{program}"']
    subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    figure = replace(maze_figure(build_report(log)), title=f"Step {number}")
    return svg.figure_svg(svg.whole_figure(figure)) + "\n"


def main() -> int:
    """Write all of them; returns the exit code."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        for program in STEPS:
            target = PICTURES / f"step{step_of(program)}.svg"
            target.write_text(picture(program, Path(name)), encoding="utf-8", newline="\n")
            print(f"Wrote {target.relative_to(ROOT)}, {target.stat().st_size / 1000:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
