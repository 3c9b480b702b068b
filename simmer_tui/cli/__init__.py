"""The composition root: it reads options, puts the parts together, and runs one of them.

In: the words of a command line.
Out: text, files, and an exit code.

Only this room imports argparse and knows exit codes (`simmer_tui.cli.command_line`). Progress bars and the
start of the screen are here too. Each command has a file `NAME_command.py`, and its line in the table of
`simmer_tui.cli.main`, which imports it only when it is used; the screen only where one is drawn.
"""
