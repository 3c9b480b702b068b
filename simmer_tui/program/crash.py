"""The error that ended a program, found in the last lines of its output: its text, and its place.

Each language prints errors in its own format, with one function here for each. If none fits, a signal is
still a crash. An exit code alone is not: programs give up with exit codes too.
"""

from __future__ import annotations

import re
import signal
from collections.abc import Callable, Sequence
from itertools import pairwise

from msgspec import Struct

from simmer_tui.program.crash_parts import (
    Crash,
    PrintedFrame,
    file_name,
    first_said,
    frames_of,
    from_the_end,
    is_foreign,
    is_own,
    last_own,
    places_of,
    without_escapes,
)
from simmer_tui.program.script_errors import ERROR_FORMATS, last_line_error
from simmer_tui.run.events import NOT_STARTED

# The length of the sentences in reports.
_LONGEST = 200
"""Characters of an error that are kept."""
_SIGNALS = {
    "SIGSEGV": "segmentation fault",
    "SIGABRT": "aborted",
    "SIGFPE": "arithmetic error",
    "SIGILL": "illegal instruction",
    "SIGBUS": "bus error",
    "SIGKILL": "killed",
    "SIGTERM": "terminated",
    "SIGINT": "interrupted",
    "SIGPIPE": "broken pipe",
    "SIGXCPU": "out of CPU time",
}
_WINDOWS = {0xC0000005: "access violation", 0xC00000FD: "stack overflow", 0xC0000409: "aborted"}
"""Exit codes of Windows (NTSTATUS) for programs that the system has ended."""
NOT_FOUND, _NOT_RUN = 127, 126
"""Exit codes of shells for a command that is not found, and for one that cannot be run."""


def crash_of(code: int, stderr: Sequence[str], stdout: Sequence[str]) -> Crash | None:
    """The crash that ended a program; None if it ended normally.

    Args:
        code: Exit code; 128 and the signal's number for a program that a signal ended.
        stderr: Last lines of its standard error.
        stdout: Last lines of its standard output, where errors are looked for if there are none on the other.
    """
    for lines in (stderr, stdout):
        stripped = [without_escapes(line).rstrip() for line in lines]
        for find in _LANGUAGES if code else (_thread,):
            found = find(stripped)
            if found is not None:
                return Crash(found.error[:_LONGEST].strip(), found.place)
    found = _signalled(code) or _shell(code, stderr)
    if found is None and code:
        said = [
            without_escapes(line).rstrip() for line in (stderr if any(map(str.strip, stderr)) else stdout)
        ]
        found = last_line_error(said)
    return found and Crash(found.error[:_LONGEST].strip(), found.place)


def signal_name(code: int) -> str:
    """Name of the signal that ended a program with this exit code; empty if none did."""
    try:
        return signal.Signals(code - 128).name if code > 128 else ""
    except ValueError:
        return ""


def _signalled(code: int) -> Crash | None:
    if code in _WINDOWS:
        return Crash(f"{_WINDOWS[code]} (0x{code:X})")
    name = signal_name(code)
    return Crash(f"{_SIGNALS.get(name, 'ended by a signal')} ({name})") if name else None


def _shell(code: int, stderr: Sequence[str]) -> Crash | None:
    """A command that a shell did not find, or could not run, in the shell's own words."""
    if code not in (NOT_FOUND, _NOT_RUN):
        return None
    printed = [line.strip() for line in map(without_escapes, stderr) if line.strip()]
    default = "command not found" if code == NOT_FOUND else "the command cannot be run"
    return Crash(f"{NOT_STARTED}{printed[-1] if printed else default}"[:_LONGEST])


# -- Python ------------------------------------------------------------------------------------------

_TRACEBACK = re.compile(r".*Traceback \(most recent call last\):")
"""The head of a traceback. Text before it had no line end, such as that of a progress bar."""
_NESTED = re.compile(r"[\s|+]+(?:Exception Group )?Traceback ")
_THREAD = re.compile(r"^Exception in thread \S+")
_FRAME = re.compile(r'^[\s|+]*File "(.*)", line (\d+)(?:,| in |$)')
_SYNTAX = re.compile(r"^(?:SyntaxError|IndentationError|TabError): ")
_CANNOT_START = re.compile(r"can't open file|No module named \S+$|can't find '__main__' module")
_INTERPRETER = re.compile(r"^\S+[/\\](?=\S+: )")
"""The folder of the interpreter in its own messages."""
_GROUP = re.compile(r"^[\s|+]+")
_RAISED = re.compile(r"^[\w.]+(?:: |$)")
"""The last line of a traceback: `KeyError: 'u9'`."""
_FATAL = "Fatal Python error: "


def _python(lines: Sequence[str]) -> Crash | None:
    begins = places_of(_TRACEBACK, lines)
    # A mistake in the program's own file has no traceback.
    if not begins:
        return _python_without_traceback(lines)
    nested = _NESTED.match(lines[begins[-1]]) is not None
    return _exception(lines[begins[-1] + 1 :], nested=nested)


def _exception(lines: Sequence[str], *, nested: bool = False) -> Crash | None:
    """The exception below the head of a traceback; `nested` in an exception group, which has a margin."""
    frames: list[PrintedFrame] = []
    for line in lines:
        shown = _GROUP.sub("", line) if nested else line
        if frame := _FRAME.match(line):
            frames.append((frame[1], frame[2]))
        elif nested and line.startswith(" ") and not _RAISED.match(shown):
            continue
        elif shown and not shown.startswith((" ", "\t")):
            return Crash(shown, last_own(frames, shown))
    # Only the head has come: the output was cut.
    return Crash("Traceback", last_own(frames)) if frames else None


def _python_without_traceback(lines: Sequence[str]) -> Crash | None:
    for place, line in from_the_end(lines):
        if _SYNTAX.match(line):
            return Crash(line, last_own(frames_of(_FRAME, lines[:place])[-1:]))
        if line.startswith(_FATAL):
            # The most recent call is first.
            return Crash(line.removeprefix(_FATAL), last_own(frames_of(_FRAME, lines[place:])[::-1]))
        if _CANNOT_START.search(line):
            return Crash(f"{NOT_STARTED}{_INTERPRETER.sub('', line)}")
    return None


def _thread(lines: Sequence[str]) -> Crash | None:
    """An error that ended a thread, but not the program: nothing drives the robot any more."""
    begins = places_of(_THREAD, lines)
    return _python(lines[begins[-1] :]) if begins else None


_CALL = re.compile(r'^\s*File "(.*)", line (\d+), in (.+)$')
_MARKERS = re.compile(r"^\s*[~^]+\s*$")


class OwnFrame(Struct, frozen=True):
    """A call in the program's own code: `place` is `robot.py:12`, `code` the line there, or empty."""

    place: str
    function: str
    code: str = ""


def own_frames(stderr: Sequence[str]) -> tuple[OwnFrame, ...]:
    """Calls in the program's own code that led to its last Python exception, the innermost first."""
    stderr = [without_escapes(line) for line in stderr]
    begins = places_of(_TRACEBACK, stderr)
    lines = stderr[begins[-1] :] if begins else ()
    error = next((line for line in lines[1:] if line[:1].strip()), "")
    found = []
    for line, after in pairwise((*lines, "")):
        call = _CALL.match(line)
        if call is not None and is_own(call[1], error):
            is_code = after.startswith("    ") and not (_CALL.match(after) or _MARKERS.match(after))
            place = f"{file_name(call[1])}:{call[2]}"
            found.append(OwnFrame(place, call[3], after.strip() if is_code else ""))
    return tuple(reversed(found))


# -- languages that are compiled -----------------------------------------------------------------------

_ASSERTION = re.compile(r"^(?:\S+: )?(\S+):(\d+): .*?: (Assertion [`'].*' failed)")
_SANITIZER = re.compile(r"^==\d+==\s*ERROR: (\w+Sanitizer: [\w-]+(?: [\w-]+)?)")
_STACK = re.compile(r"^\s*#\d+ 0x[0-9a-f]+ in .* (\S+?):(\d+)(?::\d+)?$")
_THROWN = re.compile(r"^terminate called after throwing an instance of '(.*)'")
_ABORTED = re.compile(
    r"^(?:\*\*\* .* \*\*\*.*|(?:double free|free\(\)|malloc\(\)|munmap_chunk\(\)|corrupted).*)$"
)
_PANIC = re.compile(r"^thread '.*?'.* panicked at (?:'(.*)', )?(\S+?):(\d+):\d+:?$")
_GO_PANIC = re.compile(r"^panic: .*")
_GO = re.compile(r"^\s+(\S+\.go):(\d+)")


def _compiled(lines: Sequence[str]) -> Crash | None:
    for place, line in from_the_end(lines):
        for pattern, crash in _COMPILED:
            if found := pattern.match(line):
                return crash(found, lines[place + 1 :])
    return None


def _asserted(found: re.Match[str], rest: Sequence[str]) -> Crash:
    return Crash(found[3], f"{file_name(found[1])}:{found[2]}")


def _sanitized(found: re.Match[str], rest: Sequence[str]) -> Crash:
    return Crash(found[1], last_own(frames_of(_STACK, rest)[:1]))


def _thrown(found: re.Match[str], rest: Sequence[str]) -> Crash:
    what = next((each.partition("what():")[2].strip() for each in rest if "what():" in each), "")
    return Crash(f"{found[1]}: {what}" if what else found[1])


def _rust_panic(found: re.Match[str], rest: Sequence[str]) -> Crash:
    return Crash(f"panic: {found[1] or first_said(rest)}", f"{file_name(found[2])}:{found[3]}")


def _go_panic(found: re.Match[str], rest: Sequence[str]) -> Crash:
    own = [each for each in frames_of(_GO, rest) if "/runtime/" not in each[0]]
    return Crash(found[0], last_own(own[:1]))


def _aborted(found: re.Match[str], rest: Sequence[str]) -> Crash:
    return Crash(found[0].strip("* "))


_COMPILED: tuple[tuple[re.Pattern[str], Callable[[re.Match[str], Sequence[str]], Crash]], ...] = (
    (_ASSERTION, _asserted),
    (_SANITIZER, _sanitized),
    (_THROWN, _thrown),
    (_PANIC, _rust_panic),
    (_GO_PANIC, _go_panic),
    (_ABORTED, _aborted),
)
"""First lines of errors, and the function that makes the crash from the line and those below it."""


# -- Java and JavaScript -------------------------------------------------------------------------------

_JAVA = re.compile(r'^Exception in thread ".*?" (.*)$')
_JAVA_FRAME = re.compile(r"^\s+at (?:[\w.]+/)?([\w.$<>]+)\(([\w$]+\.\w+):(\d+)\)")
_JAVA_LIBRARY = re.compile(r"^(?:java|javax|jdk|sun|com\.sun)\.")
_JAVA_START = re.compile(r"^Error: (?:Could not find or load main class|Unable to access jarfile).*")
_NODE_FRAME = re.compile(r"^\s+at (?:.* \()?(?:file://)?((?:/|\w:\\|node:)[^()]*?):(\d+):\d+\)?")
_NODE_HEAD = re.compile(r"^(?:file://)?((?:/|\w:\\).*):(\d+)$")
_NODE_ERROR = re.compile(r"^(?:Uncaught )?\w*Error(?: \[\w+\])?(?::.*)?$")
_NODE_MISSING = re.compile(r"^Error: Cannot find module '([^']*)'")
_CARETS = re.compile(r"^\s*\^+$")
_NODE_VERSION = re.compile(r"^Node\.js v\d")


def _java(lines: Sequence[str]) -> Crash | None:
    for place, line in from_the_end(lines):
        if _JAVA_START.match(line):
            return Crash(f"{NOT_STARTED}{line.removeprefix('Error: ')}")
        if found := _JAVA.match(line):
            frames = filter(None, map(_JAVA_FRAME.match, lines[place + 1 :]))
            own = next((frame for frame in frames if not _JAVA_LIBRARY.match(frame[1])), None)
            return Crash(found[1], "" if own is None else f"{own[2]}:{own[3]}")
    return None


def _node(lines: Sequence[str]) -> Crash | None:
    if not any(map(_NODE_VERSION.match, lines)):
        return None
    heads = frames_of(_NODE_HEAD, lines)
    errors = places_of(_NODE_ERROR, lines)
    if errors:
        return _node_error(lines[errors[-1] :], heads)
    # A value that is no Error has no stack: it is below the line of carets.
    thrown = places_of(_CARETS, lines)
    said = next((line for line in lines[thrown[-1] + 1 :] if line), "") if thrown else ""
    return Crash(said, last_own(heads[-1:])) if said else None


def _node_error(lines: Sequence[str], heads: Sequence[PrintedFrame]) -> Crash:
    """The error in the first line, with its stack below; `heads` are the places printed above it."""
    own = [each for each in frames_of(_NODE_FRAME, lines) if not is_foreign(each[0])]
    missing = _NODE_MISSING.match(lines[0])
    # Without a require stack the missing module is the program itself.
    if missing and not own and not heads:
        return Crash(f"{NOT_STARTED}Cannot find module '{missing[1]}'")
    return Crash(lines[0], last_own((own or heads)[:1]))


# -- Octave and MATLAB ---------------------------------------------------------------------------------

_OCTAVE = re.compile(r"^error: (?!called from)(.*)")
_OCTAVE_FRAME = re.compile(r"^ {4}(\S.*?) at line (\d+)(?: column \d+)?$")
_OCTAVE_PARSE = re.compile(r"^(?:parse error) near line (\d+) of file (.*)$")
_OCTAVE_NEAR = re.compile(r" near line (\d+),? column \d+$")
_OCTAVE_MISSING = re.compile(r"^(?:source: error sourcing file|could not find file|.*unable to find file)\b")
_MATLAB = re.compile(r"^(?:\{?(?:\[.)?)?Error (in|using) (\S+?)(?:>\S+)? \(line (\d+)\)")


def _octave(lines: Sequence[str]) -> Crash | None:
    errors = [(place, found[1]) for place, line in enumerate(lines) if (found := _OCTAVE.match(line))]
    if not errors:
        return None
    place, error = errors[-1]
    if found := _OCTAVE_PARSE.match(error):
        why = first_said(lines[place + 1 :])
        return Crash(f"parse error: {why}" if why else "parse error", f"{file_name(found[2])}:{found[1]}")
    if _OCTAVE_MISSING.match(error):
        return Crash(f"{NOT_STARTED}{error}")
    frames = frames_of(_OCTAVE_FRAME, lines[place:])
    # The innermost function is first; a nested one is printed as `outer>inner`.
    if frames:
        # A script of another folder, or with a name that is no variable's, is printed with its file.
        name = file_name(frames[0][0]).partition(">")[0].removesuffix(".m")
        return Crash(_OCTAVE_NEAR.sub("", error), f"{name}.m:{frames[0][1]}")
    near = _OCTAVE_NEAR.search(error)
    return Crash(error, f"line {near[1]}" if near else "")


def _matlab(lines: Sequence[str]) -> Crash | None:
    begins = [(place, found) for place, line in enumerate(lines) if (found := _MATLAB.match(line))]
    if not begins:
        return None
    place, found = begins[0]
    # "Error using" has its message below it; "Error in" has it above.
    near = lines[place + 1 :] if found[1] == "using" else reversed(lines[:place])
    error = next((line.strip("{} ") for line in near if line.strip("{} ")), "error")
    return Crash(error, f"{file_name(found[2])}.m:{found[3]}")


_LANGUAGES: tuple[Callable[[Sequence[str]], Crash | None], ...] = (
    *(_python, _node, _java, _compiled, _matlab, _octave, *ERROR_FORMATS),
)
