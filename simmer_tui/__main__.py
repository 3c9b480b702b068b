"""`python -m simmer_tui` and the console script."""

from __future__ import annotations

import gc
import os
import sys


def entry() -> None:
    """Run `simmer-tui`. Garbage collection is off during the start, which allocates much and frees little:
    that saves a fifteenth of its time."""
    gc.disable()
    if sys.argv[1:2] in (["calibrate"], ["report"]):
        # Their matrices are small: threads that wait for each other take longer than one, and the whole
        # machine; a report's take 15 ms to start alone. This is read when numpy is loaded. It is not for
        # other commands: those run programs, which would have it too.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from simmer_tui.cli.main import run

        run()
    except KeyboardInterrupt:  # while modules were loaded; later it has its own places
        sys.exit(130)  # ExitCode.INTERRUPTED, whose module may not be loaded yet


if __name__ == "__main__":
    entry()
