"""`python -m simmer_tui` and the console script."""

from __future__ import annotations

import gc


def entry() -> None:
    """Run `simmer-tui`. Start-up makes much and drops nothing, so no garbage is looked for till it
    is over: about a fifteenth of its time."""
    gc.disable()
    from simmer_tui.cli.main import run

    run()


if __name__ == "__main__":
    entry()
