"""A control program as a process beside the simulator: its start, output, clock, serial port and end.

In: the command line of `--run`, and the address of the simulator.
Out: the program's lines, its exit, and the last error that it printed.

No process stays behind even if the simulator is killed. On Unix a small process, the keeper (`keeper.py`),
ends the remaining ones; on Windows a job object does.
"""

from simmer_tui.program.control_program import Program, RunningProgram
from simmer_tui.program.kept_process import Keeper
from simmer_tui.program.program_output import ProgramOutput

__all__ = ["Keeper", "Program", "ProgramOutput", "RunningProgram"]
