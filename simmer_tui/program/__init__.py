"""A control program beside the simulator: its start, its output, and its end with all that it started.

No process stays behind even if the simulator is killed. On Unix a small process, the keeper (`keeper.py`),
ends the remaining ones; on Windows a job object does.
"""

from simmer_tui.program.control_program import Program, RunningProgram
from simmer_tui.program.kept_process import Keeper
from simmer_tui.program.program_output import ProgramOutput

__all__ = ["Keeper", "Program", "ProgramOutput", "RunningProgram"]
