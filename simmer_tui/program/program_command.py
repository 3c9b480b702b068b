"""The command of a program: its words, and the consequences of its being Python."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PureWindowsPath

from simmer_tui import platform_has
from simmer_tui.errors import ProgramError
from simmer_tui.program.shell_syntax import shell_problem, shell_syntax
from simmer_tui.sim.command import WORD, cut, typed_path
from simmer_tui.sim.rules import did_you_mean

HOOK_FOLDER = Path(__file__).resolve().parent / "hook"
"""The folder with our sitecustomize.py. First on the path of a Python program, it replaces the program's
clock and serial port."""
STACK = "SIMMER_STACK_FILE"
"""Variable with the file to which a Python program writes its stacks when it is ended."""
HOOKED = ("SIMMER_CLOCK_PORT", "SIMMER_DIALECT_PORT", STACK)
"""Variables of programs that need it."""
_PATH = "PYTHONPATH"
SCRIPTS = (".py", ".m", ".sh", ".jar")
"""Suffixes of files that an interpreter runs."""
_USUAL = ("python", "python3", "matlab", "octave", "node", "java")
"""Programs whose names are compared with one that does not exist."""
_INTERPRETERS = {".py": ["python"], ".jar": ["java", "-jar"], ".js": ["node"], ".sh": ["sh"]}
"""The words before a file, by its suffix."""


def with_hook(environment: Mapping[str, str], folder: str = str(HOOK_FOLDER)) -> dict[str, str]:
    """The variables of a program; if it needs the folder, with that in front of its path.

    Args:
        environment: All its variables.
        folder: Where it sees our folder.
    """
    if not any(name in environment for name in HOOKED):
        return dict(environment)
    given = environment.get(_PATH, "")
    before = [each for each in given.split(os.pathsep) if each != folder] if given else []
    return {**environment, _PATH: os.pathsep.join([folder, *before])}


def is_python(word: str) -> bool:
    """True if the first word of a command is Python, of any version, with a folder or without."""
    return _program_name(word).rstrip("0123456789.") in ("py", "python")


def runs_python(command: str) -> bool:
    """True if a command starts Python."""
    return is_python(_first_word(command.strip()))


def _program_name(word: str) -> str:
    """The name of a program, without folder and ending."""
    # Windows paths have both kinds of slashes.
    return PureWindowsPath(word).name.lower().removesuffix(".exe")


def out_of_reach(command: str, *, windows: bool = not platform_has.POSIX) -> str:
    """The reason why our hook cannot be used in a program of this command; empty if none is seen."""
    try:
        words = shlex.split(command, posix=not windows)
    except ValueError:
        return ""
    if not words:
        return ""
    if _program_name(words[0]) == "matlab":
        return "MATLAB opens ports of the system" if windows else ""
    if not is_python(words[0]):
        return ""
    for word in _options_of(words[1:]):
        # -W and -X have a value, which may have any letters.
        flags = word[1:].partition("W")[0].partition("X")[0]
        if found := sorted(set(flags) & set("EIS")):
            return f"Python was started with -{found[0]}"
    return ""


def _options_of(words: Iterable[str]) -> Iterator[str]:
    """The words that are options of Python itself."""
    rest = iter(words)
    for word in rest:
        if not word.startswith("-") or word.startswith("--") or word in ("-", "-m", "-c"):
            return
        yield word
        if word in ("-W", "-X"):
            next(rest, "")


def words_of(command: str, python: str = sys.executable) -> list[str]:
    """The command split into words as a Unix shell does. `python` is the path of the interpreter that the
    word `python` means if there is no other: our own, or that of a sandbox. Raises ProgramError."""
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise ProgramError(f"--run {command!r}: {error}") from None
    if not words:
        raise _no_program()
    check_no_shell(command, windows=False)
    if _is_ours(words[0]):
        words[0] = python
    return words


def command_line_of(command: str) -> str:
    """The command for Windows, where each program splits its own line. `python` means our own interpreter if
    there is no other. Raises ProgramError."""
    line = command.strip()
    if not line:
        raise _no_program()
    check_no_shell(line, windows=True)
    first = _first_word(line)
    quotes = 2 if line.startswith('"') else 0
    return f'"{sys.executable}"{line[len(first) + quotes :]}' if _is_ours(first) else line


def check_no_shell(command: str, *, windows: bool = not platform_has.POSIX) -> None:
    """Raises ProgramError, with the option to type, if a command has a shell's syntax."""
    if problem := shell_problem(command, windows=windows):
        raise ProgramError(f"--run {command!r}: {problem}")


def _no_program() -> ProgramError:
    return ProgramError("--run needs a program, such as --run 'python my_robot.py'")


def _is_ours(word: str) -> bool:
    """True if the first word of a command is a plain Python, and the path has none but ours."""
    # A folder or a minor version asks for that one, and no other.
    if not is_python(word) or any(sign in word for sign in "/\\."):
        return False
    from shutil import which  # imported only when needed: it takes time

    return which(word) is None


def _first_word(line: str) -> str:
    """The program of a command line of Windows, which may have quotes around its path."""
    return line[1:].partition('"')[0] if line.startswith('"') else "".join(line.split(maxsplit=1)[:1])


def console_variables(command: str, code_page: int) -> dict[str, str]:
    """Environment with which a program writes to a pipe as to a console of Windows: at once, and in the
    console's code page. Only Python has such variables; it is empty for other commands."""
    if not runs_python(command):
        return {}
    return {"PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": f"cp{code_page}:backslashreplace"}


def with_interpreter(command: str, *, windows: bool = not platform_has.POSIX) -> str:
    """The command; a Python file that does not start by itself gets `python` before it."""
    words = _words(command)
    if not words or not words[0].lower().endswith(".py") or not Path(words[0]).is_file():
        return command
    from shutil import which  # imported only when needed: it takes time

    # A file with a folder needs the right to be executed; one without is searched for in the path.
    starts = not windows and which(words[0]) is not None
    return command if starts else f"python {command.strip()}"


def missing_program(command: str) -> str:
    """The reason why the program of a command cannot be started: its file, or the first word, is not there.
    Empty if it is there, or if it is not known: with a shell's syntax, which has a reason of its own."""
    words = () if shell_syntax(command) else _words(command)
    name = words[0] if words else ""
    if is_python(name):
        name = next(_script_of(words[1:]), "")
    elif name and not any(sign in name for sign in "/\\") and not name.lower().endswith(SCRIPTS):
        from shutil import which  # imported only when needed: it takes time

        if which(name) or Path(name).exists():
            return ""
        others = [usual for usual in _USUAL if usual != name]
        return f"there is no program {cut(name, WORD)}{did_you_mean(name, others)}"
    if not name or Path(name).exists():
        return ""
    near = _with_slashes(command) or file_nearby(name)
    hint = f"; did you mean {typed_path(near)}?" if near else ""
    folder = "" if Path(name).is_absolute() else f" in {Path.cwd()}"
    return f"there is no file {name}{folder}{hint}"


def _with_slashes(command: str) -> Path | None:
    """The file that a command means with a path of Windows, whose backslashes other shells take away."""
    if not platform_has.POSIX or "\\" not in command:
        return None
    words = _words(command.replace("\\", "/"))
    return next((Path(word) for word in words if "/" in word and Path(word).is_file()), None)


def start_advice(command: str) -> str:
    """The reason why a command could not be started, with the command that works, if its file is the reason.
    Otherwise it is empty."""
    words = _words(command)
    if missing := missing_program(command):
        return missing
    path = Path(words[0]) if words else Path()
    starts = starting_words(path) if path.is_file() else [str(path)]
    if starts == [str(path)]:
        return ""
    line = platform_has.shell_line([*starts, *words[1:]])
    return f"{path} does not start by itself; {run_option(line)} starts it"


def starting_words(path: Path) -> list[str]:
    """The words that start the program of a file."""
    from shutil import which  # imported only when needed: it takes time

    name, suffix = str(path), path.suffix.lower()
    if suffix == ".m":
        if which("octave") and not which("matlab"):
            return ["octave", name]
        return ["matlab", "-sd", str(path.parent), "-batch", path.stem]
    if suffix in _INTERPRETERS:
        return [*_INTERPRETERS[suffix], name]
    return [name if os.sep in name else f".{os.sep}{name}"]


def run_option(command: str) -> str:
    """`--run "CMD ..."` as it is typed."""
    plain = not set(command) & set('"$`\\!')
    return f'--run "{command}"' if plain else f"--run {typed_path(command)}"


def file_nearby(name: str) -> Path | None:
    """A file of the same name in this folder, in a folder of it, or in the one around it."""
    wanted = Path(name).name
    if not wanted:
        return None
    try:
        below = sorted(path / wanted for path in Path().iterdir() if path.is_dir())
        places = [Path(wanted), *below, Path("..", wanted)]
        return next((path for path in places if path.is_file()), None)
    except OSError:
        return None


def _words(command: str) -> list[str]:
    """The words of a command; none of one with a quote that is not closed."""
    try:
        return shlex.split(command, posix=platform_has.POSIX)
    except ValueError:
        return []


def _script_of(words: Iterable[str]) -> Iterator[str]:
    """The file among the words after Python; none after `-m` or `-c`."""
    rest = iter(words)
    for word in rest:
        if not word.startswith("-"):
            yield word
            return
        # Letters may stand together, as in -um; what follows the last one is its value.
        if word == "-" or (not word.startswith("--") and word[-1] in "mc"):
            return
        if word in ("-W", "-X", "--check-hash-based-pycs"):
            next(rest, "")
