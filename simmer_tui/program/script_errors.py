"""Errors of interpreted programs beside the usual traceback of Python, as they are printed last.

These are Python with the tracebacks of rich or IPython, or with a hook of its own, and Perl, Ruby, shells and
others.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from simmer_tui.program.crash_parts import Crash, PrintedFrame, file_name, last_own

# -- Python in other formats -----------------------------------------------------------------------------

_RICH_HEAD = re.compile(r"^[╭┌+][─-].* Traceback \(most recent call last\) .*[╮┐+]$")
_RICH_EDGE = re.compile(r"^[╰└+╭┌].*[╯┘+╮┐]$")
_RICH_ROW = re.compile(r"^[│|] (.*) [│|]$")
_RICH_CODE = re.compile(r"^(?: {2}|[❱>] |[╭│╰+|])")
"""The begin of a row with code, or with the frame of local variables; other rows are places."""
_RICH_PLACE = re.compile(r"^(.*):(\d+)(?: in\b.*)?$")
_RAISED = re.compile(r"^[\w.]+(?:: |$)")
"""The last line of an exception: `KeyError: 'u9'`."""


def _rich(lines: Sequence[str]) -> Crash | None:
    """The exception below the last frame that rich has drawn around a traceback."""
    heads = [place for place, line in enumerate(lines) if _RICH_HEAD.match(line)]
    if not heads:
        return None
    frames: list[PrintedFrame] = []
    path = ""
    for line in lines[heads[-1] + 1 :]:
        row = _RICH_ROW.match(line)
        if row is None:
            if not _RICH_EDGE.match(line) and _RAISED.match(line):
                return Crash(line, last_own(frames, line))
            path = ""
            continue
        if _RICH_CODE.match(row[1]) or not row[1].strip():
            path = ""
            continue
        # A long place is folded at the edge, or at a blank before it.
        path += row[1] if len(row[1].rstrip()) == len(row[1]) else f"{row[1].rstrip()} "
        if found := _RICH_PLACE.match(path.rstrip()):
            frames.append((found[1], found[2]))
            path = ""
    return Crash("Traceback", last_own(frames)) if frames else None


_IPYTHON_HEAD = re.compile(r"^([\w.]+) +Traceback \(most recent call last\)$")
_IPYTHON_FRAME = re.compile(r"^File (.+?):(\d+)(?:, in .*|$)")
_IPYTHON_OLD = re.compile(r"^(\S.*\.py) in .+$")
_ARROW = re.compile(r"^-+> *(\d+)\b")


def _ipython(lines: Sequence[str]) -> Crash | None:
    heads = [place for place, line in enumerate(lines) if _IPYTHON_HEAD.match(line)]
    if not heads:
        return None
    frames: list[PrintedFrame] = []
    file, error = "", ""
    for line in lines[heads[-1] + 1 :]:
        if found := _IPYTHON_FRAME.match(line):
            frames.append((found[1], found[2]))
            file = ""
        elif found := _IPYTHON_OLD.match(line):
            file = found[1]
        elif file and (found := _ARROW.match(line)):
            frames.append((file, found[1]))
            file = ""
        elif _RAISED.match(line):
            error = line
            break
    return Crash(error, last_own(frames, error)) if error else None


# -- other interpreters ----------------------------------------------------------------------------------

_RUBY = re.compile(r"^(.+\.rb):(\d+):in .*?['`’]?: (.+)$")
_PHP = re.compile(r"^(?:PHP )?Fatal error: +(?:Uncaught )?(.+) in (.+\.php)(?::| on line )(\d+)$")
_DOTNET = re.compile(r"^Unhandled [Ee]xception(?:\.|:) (.+)$")
_DOTNET_FRAME = re.compile(r"^\s+at .* in (.+):line (\d+)$")
_JULIA = re.compile(r"^ERROR: (?:LoadError: )?(.+)$")
_JULIA_PLACE = re.compile(r"^in expression starting at (.+):(\d+)$")
_R = re.compile(r"^Error(?: in .+? :|:) ?(.*)$")
_TCL_PLACE = re.compile(r'^ +\(file "(.+)" line (\d+)\)$')
_MATLAB_FILE = re.compile(r"^(?:\{?(?:\[.)?)?Error: File: (.+) Line: (\d+)(?: Column: \d+)?$")


def _ruby(lines: Sequence[str]) -> Crash | None:
    # A line of the program's own may look alike, but has no calls below it.
    found = [row for row in map(_RUBY.match, lines) if row]
    return Crash(found[-1][3], _place(found[-1][1], found[-1][2])) if found else None


def _php(lines: Sequence[str]) -> Crash | None:
    found = [row for row in map(_PHP.match, lines) if row]
    return Crash(found[-1][1], _place(found[-1][2], found[-1][3])) if found else None


def _dotnet(lines: Sequence[str]) -> Crash | None:
    return _headed(lines, _DOTNET, _DOTNET_FRAME)


def _julia(lines: Sequence[str]) -> Crash | None:
    return _headed(lines, _JULIA, _JULIA_PLACE) if any(map(_JULIA_PLACE.match, lines)) else None


def _r(lines: Sequence[str]) -> Crash | None:
    if "Execution halted" not in lines[-2:]:
        return None
    for place in range(len(lines) - 1, -1, -1):
        if found := _R.match(lines[place]):
            below = next((line.strip() for line in lines[place + 1 :] if line.strip()), "")
            return Crash(found[1].strip() or below)
    return None


def _tcl(lines: Sequence[str]) -> Crash | None:
    places = [row for row in map(_TCL_PLACE.match, lines) if row]
    begins = [place for place, line in enumerate(lines) if line == "    while executing"]
    if not places or not begins or not begins[-1]:
        return None
    return Crash(lines[begins[-1] - 1], _place(places[-1][1], places[-1][2]))


def _matlab_file(lines: Sequence[str]) -> Crash | None:
    """A mistake in the text of a MATLAB file."""
    for place in range(len(lines) - 1, -1, -1):
        if found := _MATLAB_FILE.match(lines[place]):
            below = next((line.strip("{} ") for line in lines[place + 1 :] if line.strip("{} ")), "")
            return Crash(below or "syntax error", _place(found[1], found[2]))
    return None


def _headed(lines: Sequence[str], head: re.Pattern[str], frame: re.Pattern[str]) -> Crash | None:
    """The last error in a line by `head`, with the first place below it in one by `frame`."""
    for place in range(len(lines) - 1, -1, -1):
        if found := head.match(lines[place]):
            frames = [row for row in map(frame.match, lines[place + 1 :]) if row]
            return Crash(found[1], _place(frames[0][1], frames[0][2]) if frames else "")
    return None


def _place(file: str, line: str) -> str:
    return f"{file_name(file)}:{line}"


ERROR_FORMATS: tuple[Callable[[Sequence[str]], Crash | None], ...] = (
    *(_rich, _ipython, _php, _dotnet, _julia, _r, _tcl, _matlab_file, _ruby),
)
"""Functions that find an error in printed lines, by the format of one language each."""


# -- errors without a format of their own -----------------------------------------------------------------

_DIED = re.compile(r"^(.+?) at (-e|\S.*?\.\w+) line (\d+)(?:\.$|, .*$)")
"""Perl: `no wall at robot.pl line 3.`"""
_PERL_REST = re.compile(r"^\t.* called at .* line \d+$|^BEGIN failed--|^Execution of .* aborted ")
_NUMBERED = re.compile(r"^(?:\S*[/\\])?(?:\S+: )?(\S[^:]*?)(?:: (?:line )?|\[|:)(\d+)(?:\]|:\d+)?: (.*\S)$")
"""A shell, Lua or a compiler's check: `robot.sh: line 3: u9: unbound variable`."""
_SCRIPT_FILES = re.compile(r"\.(?:sh|bash|zsh|ksh|lua|awk|c|cc|cpp|cxx|h|hpp|rs|swift)$|^-?(?:ba|da|z|k)?sh$")
_NAMED = re.compile(
    r"(?:^|[\s:(])((?:[A-Za-z_]\w*\.)*[A-Z]\w*(?:Error|Exception|Interrupt)(?:: .*|\(.*\))?)$"
)
"""An exception by its name at the end of a line, as hooks of programs print it."""
_ANY_PLACE = re.compile(r'File "?([^"]+?)"?,? line (\d+)|([^\s:"\'()\[\]]+\.py):(\d+)')


def last_line_error(lines: Sequence[str]) -> Crash | None:
    """The error in the last line of a program that failed; None if the line is a sentence of its own."""
    printed = [line for line in lines if line.strip()]
    while printed and _PERL_REST.match(printed[-1]):
        printed.pop()
    if not printed:
        return None
    last = printed[-1]
    if found := _DIED.match(last):
        return Crash(found[1], _place(found[2], found[3]))
    if (found := _NUMBERED.match(last)) and _SCRIPT_FILES.search(found[1]):
        # bash prints a syntax error and, in a line of its own, the text.
        before = [_NUMBERED.match(line) for line in printed[-2:-1]]
        if before and before[0] and before[0].group(1, 2) == found.group(1, 2):
            found = before[0]
        return Crash(found[3], _place(found[1], found[2]))
    if found := _NAMED.search(last):
        places = [row for line in printed for row in _ANY_PLACE.finditer(line)]
        return Crash(found[1], last_own([(row[1] or row[3], row[2] or row[4]) for row in places], found[1]))
    return None
