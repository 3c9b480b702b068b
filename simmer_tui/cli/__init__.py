"""The composition root: options read, parts put together, one of them run, its end made an exit code.

Only this room imports argparse and knows exit codes (`simmer_tui.cli.command_line`); progress bars and
the start of the screen are here too. `simmer_tui.cli.main` has the table of commands and imports each
only when it is called for, and the screen only where one is drawn.
"""
