"""A control program beside the simulator: started, listened to, and ended with all that it started.

On Unix a small process of its own, the keeper (`keeper.py`), sees to it that nothing stays behind even
if the simulator is killed; on Windows a job object does the same.
"""

from simmer_tui.program.control_program import Program

__all__ = ["Program"]
