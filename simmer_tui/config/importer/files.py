"""The configuration of another simulator: a file that was named, or one in a folder."""

from pathlib import Path

from simmer_tui.config.importer.imported import Imported, text_of_file
from simmer_tui.config.importer.matlab import FILE as MAIN
from simmer_tui.config.importer.matlab import read_matlab
from simmer_tui.config.importer.simmer_python import FILE as CONFIG
from simmer_tui.config.importer.simmer_python import check_is_configuration, read_simmer_python
from simmer_tui.errors import ConfigurationError, Problem


def read_path(path: Path) -> Imported:
    """Read a `config.py`, a `Main.m`, or the folder with one of them.

    Raises ConfigurationError, also if the file is some other program.
    """
    shown = str(path)
    if path.is_dir():
        return read_path(path / _file_in(path))
    if path.suffix.lower() == ".m":
        return read_matlab(path.parent, path.name)
    if path.suffix.lower() != ".py":
        what = f"must be a {CONFIG} of simmer-python, a {MAIN}, or the folder that holds one"
        if not path.exists():
            what = "there is no such file or folder"
        raise ConfigurationError([Problem(shown, what)])
    text = text_of_file(path)
    name = path.name
    # A folder of a team may have many programs; only one of them describes a robot.
    check_is_configuration(text, name)
    return read_simmer_python(text, name, path.parent)


def _file_in(folder: Path) -> str:
    present = [name for name in (MAIN, CONFIG) if (folder / name).is_file()]
    if len(present) == 1:
        return present[0]
    if present:
        what = f"has a {MAIN} and a {CONFIG}: name the one to import"
    else:
        what = f"has no {MAIN} and no {CONFIG}: name the file to import"
    raise ConfigurationError([Problem(str(folder), what)])
