"""Files and folders that systems, editors, packers and tools leave among those of a person."""

from __future__ import annotations

import re
from pathlib import Path

_ENVIRONMENTS = frozenset({".venv", "venv", "virtualenv", ".conda", "site-packages", "node_modules"})
"""Usual names of installed packages, in small letters. A folder named `env` may be a team's own."""
_ENVIRONMENT_FILES = ("pyvenv.cfg", "conda-meta")
"""Entries that an environment of any name has: those of venv and virtualenv, and of conda."""
# By the manuals of their makers: Python's tools, version control, editors, macOS, Windows, Linux, Synology.
_FOLDERS = re.compile(
    r"""__pycache__ | \.(pytest|mypy|ruff)_cache | \.hypothesis | \.tox | \.nox | \.eggs | \.ipynb_checkpoints
    | \.git.* | \.svn | \.hg | \.bzr | cvs
    | \.idea | \.vscode | \.vs
    | __macosx | \.appledouble | \.trashes | \.spotlight-v100 | \.fseventsd | \.temporaryitems
    | \$recycle\.bin | system\ volume\ information
    | lost\+found | \.trash(-\d+)? | @eadir""",
    re.IGNORECASE | re.VERBOSE,
)
_FILES = re.compile(
    r"""\._.* | \.ds_store | \.localized | icon\r              # macOS: ._NAME has attributes of NAME
    | (eh)?thumbs\.db | desktop\.ini | .*:zone\.identifier    # Windows
    | \.directory | \.nfs[0-9a-f]+ | \.fuse_hidden.*          # Linux
    | .*~ | ~\$.* | \.~lock\..*\# | \#.*\# | \.\#.* | \..*\.sw[a-p]    # editors: copies and locks""",
    re.IGNORECASE | re.VERBOSE | re.DOTALL,
)


def is_leftover(name: str) -> bool:
    """True if a file's name is that of a leftover."""
    return _FILES.fullmatch(name) is not None


def is_leftover_folder(name: str) -> bool:
    """True if a folder's name is that of a leftover: a cache, version control, a packer's or system's own."""
    return _FOLDERS.fullmatch(name) is not None


def has_environment_name(name: str) -> bool:
    """True if a folder's name is a usual one for installed packages."""
    return name.lower() in _ENVIRONMENTS


def is_environment(folder: Path) -> bool:
    """True if a folder has installed packages: a virtual environment of any name, or node_modules."""
    return has_environment_name(folder.name) or any((folder / each).exists() for each in _ENVIRONMENT_FILES)
