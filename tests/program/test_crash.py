"""The error of a crash, found in what programs of many languages printed last."""

from __future__ import annotations

import pytest

from simmer_tui.program import ProgramOutput
from simmer_tui.program.crash import crash_of, own_frames
from simmer_tui.program.crash_parts import Crash

TRACEBACK = "Traceback (most recent call last):\n"
OWN = '  File "/home/a/robot.py", line 12, in step\n    return seen["u9"]\n'
LIBRARY = (
    '  File "/usr/lib/python3.11/json/decoder.py", line 355, in raw_decode\n    raise JSONDecodeError()\n'
)
# `simmer-tui examples` writes the client library beside the program.
COPY = '  File "/home/a/client.py", line 922, in _finite\n    raise InvalidInputError(text)\n'
CAUSED = "\nThe above exception was the direct cause of the following exception:\n\n"
NODE = (
    "/x/robot.js:1\nnull.x()\n     ^\n\nTypeError: no 'x'\n    at go (/x/robot.js:7:21)\n\nNode.js v20.1.0\n"
)
JAVA = (
    'Exception in thread "main" java.lang.RuntimeException: wrapped\n'
    "\tat java.base/java.util.List.of(List.java:9)\n\tat Robot.main(Robot.java:2)\n"
)
THROWN = "terminate called after throwing an instance of 'std::runtime_error'\n  what():  no wall\n"
OCTAVE = "error: 'x' undefined near line 2, column 7\nerror: called from\n    step at line 2 column 5\n"
PARSE = "error: parse error near line 3 of file /x/robot.m\n\n  syntax error\n\n>>> z = )\n        ^\n"
MATLAB = "Error using robot>step (line 3)\nNot enough input arguments.\n"
SANITIZER = (
    "==7==ERROR: AddressSanitizer: heap-buffer-overflow on address 0x1\n    #0 0x5 in main /x/robot.c:12:3\n"
)
COLOURED = (
    '  File \x1b[35m"/home/a/robot.py"\x1b[0m, line \x1b[35m12\x1b[0m, in \x1b[35mstep\x1b[0m\n'
    "    \x1b[31mseen\x1b[0m\x1b[1;31m['u9']\x1b[0m\n\x1b[1;35mKeyError\x1b[0m: \x1b[35m'u9'\x1b[0m\n"
)
RICH = """\
╭───────────────────── Traceback (most recent call last) ──────────────────────╮
│ /home/a/a folder with a rather long name/another folder with a rather long   │
│ name/robot.py:12 in <module>                                                 │
│                                                                              │
│ ❱ 12 step()                                                                  │
│      13                                                                      │
│ ╭───────── locals ─────────╮                                                 │
│ │ place = "/x/other.py:99" │                                                 │
│ ╰──────────────────────────╯                                                 │
│                                                                              │
│ /opt/venv/lib/python3.13/site-packages/textual/drivers/of_a_library_with_a_l │
│ ong_name.py:393 in run                                                       │
│                                                                              │
│ ❱ 393 │   raise KeyError("u9")                                               │
╰──────────────────────────────────────────────────────────────────────────────╯
KeyError: 'u9'
"""
IN_ASCII = str.maketrans("╭╮╰╯─│❱", "++++-|>")
IPYTHON = """\
---------------------------------------------------------------------------
KeyError                                  Traceback (most recent call last)
File ~/robot.py:12
      9 def step():
---> 12     {}['u9']

KeyError: 'u9'
"""
IPYTHON_7 = IPYTHON.replace("File ~/robot.py:12", "~/robot.py in <module>")
PERL_CALLS = "no wall at /x/robot.pl line 3.\n\tmain::step(1) called at /x/robot.pl line 9\n"
DOTNET = "Unhandled exception. System.Exception: no wall\n   at Robot.Main() in /x/Robot.cs:line 3\n"
JULIA = "ERROR: LoadError: no wall\nStacktrace:\n [1] top\nin expression starting at /x/robot.jl:3\n"
TCL = 'no wall\n    while executing\n"step"\n    (file "/x/robot.tcl" line 3)\n'
CASES = [
    (1, TRACEBACK + COLOURED, "KeyError: 'u9'", "robot.py:12"),
    (1, RICH, "KeyError: 'u9'", "robot.py:12"),
    (1, RICH.translate(IN_ASCII), "KeyError: 'u9'", "robot.py:12"),
    (1, IPYTHON, "KeyError: 'u9'", "robot.py:12"),
    (1, IPYTHON_7, "KeyError: 'u9'", "robot.py:12"),
    (1, "ERROR: KeyError: 'u9' in the end\n", "KeyError: 'u9' in the end", ""),
    (1, "/x/robot.py:12: in step\n2026-01-01 CRITICAL ValueError('u9')\n", "ValueError('u9')", "robot.py:12"),
    (255, "no wall at robot.pl line 3.\n", "no wall", "robot.pl:3"),
    (255, "no wall at robot.pl line 3, <STDIN> line 7.\n", "no wall", "robot.pl:3"),
    (255, PERL_CALLS, "no wall", "robot.pl:3"),
    (1, "robot.sh: line 4: nosuch: unbound variable\n", "nosuch: unbound variable", "robot.sh:4"),
    (2, "./robot.sh: 4: nosuch: parameter not set\n", "nosuch: parameter not set", "robot.sh:4"),
    (2, "t.sh: line 1: syntax error near `then'\nt.sh: line 1: `if then'\n", "near `then'", "t.sh:1"),
    (1, "lua: robot.lua:3: no wall\n", "no wall", "robot.lua:3"),
    (1, "robot.rb:3:in `step': no wall (RuntimeError)\n\tfrom robot.rb:9\n", "(RuntimeError)", "robot.rb:3"),
    (255, "PHP Fatal error:  Uncaught Exception: no wall in /x/r.php:3\n", "Exception: no wall", "r.php:3"),
    (134, DOTNET, "System.Exception: no wall", "Robot.cs:3"),
    (1, JULIA, "no wall", "robot.jl:3"),
    (1, TCL, "no wall", "robot.tcl:3"),
    (1, "Error in step() : no wall\nExecution halted\n", "no wall", ""),
    (1, "Error: File: robot.m Line: 3 Column: 5\nInvalid expression.\n", "Invalid expression.", "robot.m:3"),
    (1, TRACEBACK + OWN + "KeyError: 'u9'\n", "KeyError: 'u9'", "robot.py:12"),
    (1, TRACEBACK + OWN + LIBRARY + "json.X: bad\n", "json.X: bad", "robot.py:12"),
    (1, TRACEBACK + OWN + COPY + "client.RobotError: bad\n", "client.RobotError: bad", "robot.py:12"),
    (1, TRACEBACK + OWN + COPY + "KeyError: 'u9'\n", "KeyError: 'u9'", "client.py:922"),
    (1, f"{TRACEBACK}{LIBRARY}A: b\n{CAUSED}{TRACEBACK}{OWN}ValueError: c\n", "ValueError: c", "robot.py:12"),
    (1, TRACEBACK + OWN + "AssertionError\n", "AssertionError", "robot.py:12"),
    (1, f" 40%|####  | {TRACEBACK}{OWN}KeyError: 1\n", "KeyError: 1", "robot.py:12"),  # of a progress bar
    (
        1,
        '  File "/x/robot.py", line 3\n    x =\n       ^\nSyntaxError: bad\n',
        "SyntaxError: bad",
        "robot.py:3",
    ),
    (0, f"Exception in thread Thread-1:\n{TRACEBACK}{OWN}KeyError: 1\n", "KeyError: 1", "robot.py:12"),
    (139, "", "segmentation fault (SIGSEGV)", ""),
    (137, "", "killed (SIGKILL)", ""),
    (134, "robot: robot.c:3: main: Assertion `1==2' failed.\n", "Assertion `1==2' failed", "robot.c:3"),
    (134, THROWN, "std::runtime_error: no wall", ""),
    (1, SANITIZER, "AddressSanitizer: heap-buffer-overflow on", "robot.c:12"),
    (101, "thread 'main' panicked at src/main.rs:4:5:\nno u9\n", "panic: no u9", "main.rs:4"),
    (1, NODE, "TypeError: no 'x'", "robot.js:7"),
    (1, JAVA, "java.lang.RuntimeException: wrapped", "Robot.java:2"),
    (1, OCTAVE, "'x' undefined", "step.m:2"),
    (1, OCTAVE.replace("step", "step>inner"), "'x' undefined", "step.m:2"),
    (1, OCTAVE.replace("step", "my-robot.m"), "'x' undefined", "my-robot.m:2"),
    (1, OCTAVE.replace("step", "/a folder/robot.m"), "'x' undefined", "robot.m:2"),
    (1, PARSE, "parse error: syntax error", "robot.m:3"),
    (1, MATLAB, "Not enough input arguments.", "robot.m:3"),
    (2, "/usr/bin/python: can't open file 'no.py': [Errno 2]\n", "can't open file 'no.py': [Errno 2]", ""),
    (127, "sh: 1: nosuch: not found\n", "sh: 1: nosuch: not found", ""),
]


@pytest.mark.parametrize(("code", "stderr", "error", "place"), CASES)
def test_error_and_line_of_a_crash(code: int, stderr: str, error: str, place: str) -> None:
    found = crash_of(code, stderr.splitlines(), ())
    assert found is not None
    assert (found.error.endswith(error), found.place) == (True, place), found
    could_not_start = code == 127 or "can't open" in stderr
    assert found.error.startswith("could not start") == could_not_start


def test_the_calls_of_an_error_leave_out_a_copy_of_our_client() -> None:
    printed = f"{TRACEBACK}{OWN}{COPY}client.RobotError: bad".splitlines()
    assert [frame.place for frame in own_frames(printed)] == ["robot.py:12"]
    printed[-1] = "KeyError: 1"
    assert [frame.place for frame in own_frames(printed)] == ["client.py:922", "robot.py:12"]


def test_who_gives_up_has_not_crashed() -> None:
    assert crash_of(1, ["I give up"], ()) is None
    assert crash_of(0, [TRACEBACK.strip(), "KeyError: 1"], ()) is None
    assert crash_of(3, (), ["Traceback is a word"]) is None


def test_an_error_on_standard_output_is_found_too() -> None:
    assert crash_of(1, (), (TRACEBACK + OWN + "KeyError: 1").splitlines()) == Crash(
        "KeyError: 1", "robot.py:12"
    )


def test_lines_are_kept_without_their_colours() -> None:
    output = ProgramOutput(lambda: 0.0)
    output.stderr.add(f"{TRACEBACK}{COLOURED}\x1b]0;title\x07\x1b[?25hend\x1b[1;3".encode())
    ended = output.end(1)
    assert (ended.error, ended.place) == ("KeyError: 'u9'", "robot.py:12")
    assert not any("\x1b" in line.text for line in ended.stderr)
    assert ended.stderr[-1].text == "end"


def test_floods_long_lines_and_bytes_that_are_no_text_are_bounded() -> None:
    output = ProgramOutput(lambda: 2.5)
    for _ in range(20):
        output.stdout.add(b"line\n" * 100_000)
    output.stderr.add(b"\xff" * 3_000_000)
    output.stderr.add(b"\nlast")
    ended = output.end(3)
    assert [line.text for line in ended.stdout] == ["line"] * 20
    long, last = ended.stderr
    assert (last.text, last.time) == ("last", 2.5)
    assert set(long.text.split("\\xff")) == {""}
    assert len(long.text) <= 4000
