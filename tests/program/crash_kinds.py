"""Programs that end as they should not, one of each sort, and what every place must say of them."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
READS = (
    f"import sys; sys.path.append({str(ROOT)!r})\nfrom simmer_tui.client import Robot\nRobot().read('u1')\n"
)
"""Three lines of a program that does something before it ends."""
ENDS = READS + "import os, signal\nos.kill(os.getpid(), signal.{})\n"


@dataclass(frozen=True)
class CrashKind:
    """A program: its file with its lines, and the command that runs it. `said` must be in every verdict, in
    this order."""

    said: tuple[str, ...]
    file: str = "robot.py"
    lines: str = ""
    command: str = "python robot.py"
    build: str = ""
    """Command that makes the program of its file."""

    @property
    def needs(self) -> str:
        """The interpreter or compiler."""
        return (self.build or self.command).split()[0]

    def made(self, folder: Path) -> str:
        """Write the program to a folder; the command that runs it from any folder."""
        (folder / self.file).write_text(self.lines)
        if self.build:
            subprocess.run(shlex.split(self.build), cwd=folder, check=True)
        words = [sys.executable if word == "python" else word for word in shlex.split(self.command)]
        return shlex.join(str(folder / word) if (folder / word).exists() else word for word in words)

    @property
    def is_possible(self) -> bool:
        """True if there is what it needs."""
        return self.needs in ("python", "./nosuch") or shutil.which(self.needs) is not None


KINDS = {
    "exception": CrashKind(("Crashed after", "KeyError: 'u9' in robot.py:4"), lines=READS + "{}['u9']\n"),
    "missing file": CrashKind(("The program could not start", "nosuch.py"), command="python nosuch.py"),
    "missing module": CrashKind(
        ("ModuleNotFoundError: No module named 'my_localization' in robot.py:1",),
        lines="import my_localization\n",
    ),
    "segfault": CrashKind(("Crashed after", "segmentation fault (SIGSEGV)"), lines=ENDS.format("SIGSEGV")),
    "exit code 3": CrashKind(("exit code 3",), lines=READS + "raise SystemExit(3)\n"),
    "killed": CrashKind(("Crashed after", "killed (SIGKILL)"), lines=ENDS.format("SIGKILL")),
    "never connected": CrashKind(("the program sent no command",), lines="print('all is well')\n"),
    "other port": CrashKind(
        ("Crashed after", "RobotUnreachableError", "in robot.py:3"),
        lines=READS.replace("Robot()", "Robot(port=9, reply_port=9)"),
    ),
    "no such command": CrashKind(("The program could not start", "nosuch"), command="./nosuch"),
    "C": CrashKind(
        ("Crashed after", "Assertion `1 == 2' failed in robot.c:3"),
        "robot.c",
        "#include <assert.h>\nint main(void) {\n  assert(1 == 2);\n}\n",
        "./robot",
        "gcc robot.c -o robot",
    ),
    "C++": CrashKind(
        ("Crashed after", "std::runtime_error: no wall"),
        "robot.cpp",
        '#include <stdexcept>\nint main() {\n  throw std::runtime_error("no wall");\n}\n',
        "./robot",
        "g++ robot.cpp -o robot",
    ),
    "Java": CrashKind(
        ("Crashed after", "java.lang.RuntimeException: no wall in Robot.java:3"),
        "Robot.java",
        "class Robot {\n  public static void main(String[] words) {\n"
        '    throw new RuntimeException("no wall");\n  }\n}\n',
        "java -cp . Robot",
        "javac Robot.java",
    ),
    "JavaScript": CrashKind(
        ("Crashed after", "Error: no wall in robot.js:2"),
        "robot.js",
        "const wall = 1;\nthrow new Error('no wall');\n",
        "node robot.js",
    ),
    "Octave": CrashKind(
        ("Crashed after", "'no_wall' undefined"),
        "robot.m",
        "x = 1;\ny = no_wall + x;\n",
        "octave-cli --no-gui robot.m",
    ),
}
QUICK = ("exception",)
"""The one whose places are looked at in quick tests."""
