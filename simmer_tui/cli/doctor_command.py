"""`simmer-tui doctor`: a check of this terminal and machine."""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import sys
from collections.abc import Mapping
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from simmer_tui import platform_has
from simmer_tui.cli.command_line import (
    ExitCode,
    add_json_option,
    print_json,
    print_lines,
    subcommand,
    window_of,
)
from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.config.loader import Configuration, load
from simmer_tui.config.sets import find_set
from simmer_tui.config.settings import ServerSettings
from simmer_tui.document.model import DataColumn, Document, data_table
from simmer_tui.errors import ConfigurationError, PortError
from simmer_tui.links import port_list
from simmer_tui.links.link import port_requests
from simmer_tui.links.ports import take_port
from simmer_tui.runlog.saved_runs import BEFORE, saved_runs, saved_runs_folder
from simmer_tui.sim.command import WORD, counted, cut
from simmer_tui.tui.sizes import SMALLEST_COLUMNS, SMALLEST_ROWS
from simmer_tui.tui.terminal import GlyphMode, choose
from simmer_tui.version import __version__, requirement

# Packages whose version affects the picture or the results, for bug reports.
_LIBRARIES = ("textual", "rich", "numpy", "shapely", "pyserial", "msgspec")


_EXTRAS = {"calibrate": "scipy", "dask": "distributed", "export": "PIL", "web": "websockets"}
"""A module of each extra of the package that users may need (pyproject.toml)."""


_SAMPLES = {
    GlyphMode.ASCII: "#o->",
    GlyphMode.HALF: "\N{UPPER HALF BLOCK}\N{LOWER HALF BLOCK}\N{FULL BLOCK}",
}


_SAMPLE = "\N{QUADRANT UPPER LEFT}\N{QUADRANT LOWER RIGHT}\N{FULL BLOCK}\N{BRAILLE PATTERN DOTS-1245}"
"""Characters that the maze is drawn with: people see at once if they are displayed."""


# The size of a VT100's screen, which most terminal programs still have at their start.
_USUAL = (80, 24)


CHECKS = data_table("checks", "Checks", DataColumn("about"), DataColumn("ok"), DataColumn("text"))


Check = tuple[bool, str]
"""True if all is well, and the text."""


@subcommand("doctor", add_json_option)
def run_doctor(options: argparse.Namespace) -> int:
    """Say what this terminal can show, whether the ports are free, which versions are here and what is
    missing for which feature. Exits with 1 if simmer-tui could not start as it is."""
    configuration, set_check = _set()
    server = configuration.settings.server if configuration is not None else ServerSettings()
    ports, ports_needed = _ports(server)
    checks = {
        "version": (True, _program()),
        "libraries": (True, ", ".join(f"{name} {metadata.version(name)}" for name in _LIBRARIES)),
        "terminal": _terminal(os.environ),
        "drawing": (True, _drawing(os.environ)),
        "set": set_check,
        "ports": ports,
        "serial": (True, _serial()),
        "runs": _runs(),
        "grading": _grading(),
        "sketches": (True, _sketches()),
        "extras": (True, _extras()),
    }
    if options.json:
        print_json(Document("Doctor", [CHECKS.filled([(about, *each) for about, each in checks.items()])]))
    else:
        for about, (fine, text) in checks.items():
            print_lines(f"{'ok' if fine else '!!'}  {about:<9} {text}")
    # Any other lack affects only one feature.
    return ExitCode.NO if ports_needed or not set_check[0] else ExitCode.DONE


def _sketches() -> str:
    """The C++ compiler of sketches."""
    from simmer_tui.sketch.compiler import NO_COMPILER, find_compiler

    compiler = find_compiler()
    if compiler is None:
        return NO_COMPILER
    return f"compiled by {compiler.name}: {compiler.version or 'it does not run'}"


def _program() -> str:
    where = Path(__file__).resolve().parents[1]
    system = f"{platform.system()} {platform.machine()}"
    return f"simmer-tui {__version__}, Python {platform.python_version()}, {system}, in {where}"


def _terminal(environment: Mapping[str, str]) -> Check:
    around = [name for name, key in (("tmux", "TMUX"), ("SSH", "SSH_CONNECTION")) if environment.get(key)]
    inside = f", in {' and '.join(around)}" if around else ""
    kind = f"TERM={cut(environment.get('TERM', ''), WORD) or '(not set)'}{inside}"
    if not (sys.stdin.isatty() and sys.stdout.isatty() and sys.stderr.isatty()):
        return True, f"none to draw on here, {kind}: run with --no-ui"
    columns, rows = window_of(sys.stderr) or shutil.get_terminal_size()
    told = {name: environment.get(name) for name in ("COLUMNS", "LINES")}
    wrong = [
        f"{name}={cut(value, WORD)}"
        for (name, value), true in zip(told.items(), (columns, rows), strict=True)
        if value and value != str(true)
    ]
    if wrong:
        names = " ".join(told)
        return False, (
            f"{columns} x {rows}, {kind}; {' and '.join(wrong)} in the environment "
            f"{'is' if len(wrong) == 1 else 'are'} wrong, and not used here: unset {names}"
        )
    if columns < SMALLEST_COLUMNS or rows < SMALLEST_ROWS:
        least = f"{SMALLEST_COLUMNS} x {SMALLEST_ROWS}"
        return False, f"{columns} x {rows}, {kind}: too small, make it {least} at least"
    usual_columns, usual_rows = _USUAL
    is_usual = columns >= usual_columns and rows >= usual_rows
    hint = "" if is_usual else f"; from {usual_columns} x {usual_rows} on all is shown at once"
    return True, f"{columns} x {rows}, {kind}{hint}"


def _drawing(environment: Mapping[str, str]) -> str:
    choice = choose(environment, sys.stdout.encoding, windows=not platform_has.POSIX)
    if choice.glyphs is GlyphMode.ASCII:
        why = "in ASCII: the locale is not UTF-8, or the terminal shows no more; LANG=C.UTF-8 may help"
        return f"colours {choice.color}, {why}"
    sample = _SAMPLES.get(choice.glyphs, _SAMPLE)
    return f"colours {choice.color}, {choice.glyphs} {sample} (looks odd? --glyphs half or ascii)"


def _set() -> tuple[Configuration | None, Check]:
    try:
        configuration = load(find_set(None), devices=DeviceUse.PARSE)
    except ConfigurationError as error:
        mistakes = counted(len(error.problems), "mistake")
        return None, (False, f"{mistakes} in ./config: simmer-tui check lists them")
    return configuration, (True, f"{configuration.name}, {configuration.directory}")


def _ports(server: ServerSettings) -> tuple[Check, bool]:
    """The check of the ports, and True if nothing starts without one that is taken."""
    requests = [(dialect, request) for dialect, each in port_requests(server) for request in each]
    taken, is_needed = [], False
    for dialect, request in requests:
        try:
            # Taking it is the only sure test; it is released at once.
            take_port(server.host, request).close()
        except PortError:
            taken.append(request)
            # Without a dialect that has a warning, as beliefs have, the robot is served all the same.
            is_needed |= not (dialect.warning or request.falls_back)
    shown = ", ".join(str(request.number) for _, request in requests)
    if not taken:
        return (True, f"{shown} are free on {cut(server.host)}"), False
    busy = ", ".join(str(request.number) for request in taken)
    options = " ".join(f"{request.option} 0" for request in taken)
    how = f"end what holds them (another simmer-tui?), or {options} with --run"
    return (False, f"{busy} of {shown} taken: {how}"), is_needed


def _serial() -> str:
    found = port_list.list_ports()
    if not found:
        return "no port: plug a real robot in, or pair it, first (simmer-tui ports)"
    return f"{', '.join(port.device for port in found[:4])} (details: simmer-tui ports)"


def _runs() -> Check:
    if notice := platform_has.home_notice():
        return False, notice
    folder = saved_runs_folder()
    # The first run makes the folder: until then its nearest parent is checked. In a folder of another user
    # it may not even be asked for.
    fine = True
    for path in (folder, *folder.parents):
        try:
            path.lstat()
        except FileNotFoundError:
            continue
        except OSError:
            fine = False
        fine = fine and os.access(path, os.W_OK)
        break
    lack = "" if fine else ", which cannot be written"
    saved = counted(len(saved_runs(folder)), "run")
    return fine, f"{saved} saved in {folder}, of at most {BEFORE + 1}{lack}"


def _grading() -> Check:
    from simmer_tui.grade.bubblewrap import what_is_missing

    missing = what_is_missing()
    return not missing, missing or "programs can be sandboxed with bubblewrap (simmer-tui grade)"


def _extras() -> str:
    """Extras of the package, and programs, that some features need."""
    missing = [name for name, module in _EXTRAS.items() if find_spec(module) is None]
    octave = "apt-get install octave octave-instrument-control"
    programs = (
        ("Octave", _is_there("octave-cli", "octave"), octave),
        ("MATLAB", _is_there("matlab"), "from MathWorks"),
    )
    found = ", ".join(name for name in _EXTRAS if name not in missing) or "none"
    lack = f"; missing: pip install '{requirement(','.join(missing))}'" if missing else ""
    others = ", ".join(name if there else f"no {name} ({how})" for name, there, how in programs)
    return f"{found}{lack}; {others}"


def _is_there(*programs: str) -> bool:
    return any(shutil.which(each) is not None for each in programs)
