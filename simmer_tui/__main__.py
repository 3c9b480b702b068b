"""`python -m simmer_tui`."""

from simmer_tui.cli import entry

if __name__ == "__main__":
    entry()
