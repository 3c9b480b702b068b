"""The version of the package and where it is installed from, in a module that imports nothing."""

__version__ = "0.1.0"
"""The version of the package."""

REPOSITORY = "https://github.com/simmer-tui/simmer-tui"
"""The project's home on the web."""


def requirement(extra: str = "") -> str:
    """The requirement by which pip installs the package with an extra.

    It names the repository, since the package index has no release yet: a name that is free there could
    become anyone's.
    """
    return f"simmer-tui[{extra}] @ git+{REPOSITORY}" if extra else f"simmer-tui @ git+{REPOSITORY}"
