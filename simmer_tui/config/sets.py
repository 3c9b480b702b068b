"""Configuration sets as folders: listing, finding and copying them."""

import contextlib
import os
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

from simmer_tui.config import drive_csv, maze_csv, mission_toml, robot_csv, sensors_csv, settings_file
from simmer_tui.config.device_file import DEVICE_FOLDER as DEVICES
from simmer_tui.config.device_file import read_devices
from simmer_tui.config.given_path import drive_hint, given_path
from simmer_tui.config.leftovers import is_leftover
from simmer_tui.config.set_sketches import WIRING_FILE, sketch_files
from simmer_tui.errors import ConfigurationError, Problem, reason_of
from simmer_tui.sim.command import first_of, typed_path
from simmer_tui.sim.rules import did_you_mean
from simmer_tui.whole_file import write_whole

FILES = (maze_csv.FILE, robot_csv.FILE, sensors_csv.FILE, drive_csv.FILE, settings_file.FILE)
"""The five files of every set."""
DEFAULT_SET = "default"
"""The name of the bundled set that is used if no other is found."""
MISSION_SET = "mission"
"""The name of the bundled set that missions use when no other is named."""
LOCAL_FOLDER = "config"
"""The folder of the working directory that is used when none is named."""
_MOST_NAMED = 5
"""Files in the way that a message names: all of a set without a mission. A course has ten times as many."""


PACKAGE = Path(__file__).resolve().parent.parent
"""The folder of the package."""


def installed_folder(name: str, source: str) -> Path:
    """A folder with files for users: inside the installed package, to which the build copies them from a
    `source` beside it, or that source in a checkout."""
    installed = PACKAGE / name
    return installed if installed.is_dir() else PACKAGE.parent / source


def bundled_folder() -> Path:
    """The folder of the default set."""
    return installed_folder("bundled", "config")


def bundled_sets() -> Mapping[str, Path]:
    """The sets that come with the program, by name."""
    return _sets_in(bundled_folder())


# They do not change while the program runs, and trials need them after each run.
@cache
def _sets_in(folder: Path) -> Mapping[str, Path]:
    """The set in a folder itself and those in its subfolders, by name."""
    others = sorted(path.parent for path in folder.glob(f"*/{maze_csv.FILE}"))
    return {DEFAULT_SET: folder, **{path.name: path for path in others}}


def set_name(directory: Path) -> str:
    """A set's display name: that of a bundled set, else the folder."""
    resolved = directory.resolve()
    for name, path in bundled_sets().items():
        if path.resolve() == resolved:
            return name
    return str(directory)


def find_set(name_or_path: str | None) -> Path:
    """The folder of a set, by path or by the name of a bundled one.

    None means `config` in the working directory if it has any of the five files, else the bundled default.
    Raises ConfigurationError if there is no such set.
    """
    if name_or_path is None:
        local = Path(LOCAL_FOLDER)
        return local if has_set(local) else bundled_folder()
    shown = str(name_or_path)
    if not name_or_path.strip():
        raise ConfigurationError([Problem("the configuration set", "its name is blank; name a folder")])
    try:
        folder = given_path(name_or_path)
        if folder.is_dir():
            return set_in(folder)
        is_other = folder.exists()
    except PermissionError as error:
        raise ConfigurationError([Problem(shown, f"cannot be read: {reason_of(error)}")]) from None
    except (OSError, ValueError) as error:
        # A name that is too long for the system, or has a NUL, is not a folder either.
        raise ConfigurationError([Problem(shown, f"cannot be a folder: {reason_of(error)}")]) from None
    sets = bundled_sets()
    if is_other:
        what = "is not a folder; a set is a folder with five files, and simmer-tui init DIR makes one"
        if has_set(folder.parent):
            what = f"is not a folder; the set of this file is {typed_path(folder.parent)}"
        raise ConfigurationError([Problem(shown, what)])
    if name_or_path in sets:
        return sets[name_or_path]
    hint = drive_hint(name_or_path) or did_you_mean(name_or_path, [*sets, *_folders_here()])
    hint = hint or "; simmer-tui init DIR makes a folder"
    what = f"there is no such folder, and no set of that name; bundled sets: {', '.join(sets)}{hint}"
    raise ConfigurationError([Problem(shown, what)])


def _folders_here() -> list[str]:
    """The names of the folders in the working directory that have a set."""
    with contextlib.suppress(OSError):
        return sorted(path.name for path in Path().iterdir() if has_set(path) or has_set(path / LOCAL_FOLDER))
    return []


def find_mission_set(name_or_path: str | None) -> Path:
    """The folder of a set for missions, by path or by the name of a bundled one.

    None means `config` in the working directory if it has a mission.toml, as in the folder of a course, else
    the bundled set `mission`. Raises ConfigurationError if there is no such set.
    """
    if name_or_path is not None:
        return find_set(name_or_path)
    local = Path(LOCAL_FOLDER)
    return local if (local / mission_toml.FILE).is_file() else bundled_sets()[MISSION_SET]


def has_set(folder: Path) -> bool:
    """True if a folder has any of the five files."""
    return any((folder / name).is_file() for name in FILES)


def set_in(folder: Path) -> Path:
    """The folder itself, or `config` in it if only that has a set, as in the folder of a course."""
    inner = folder / LOCAL_FOLDER
    return inner if has_set(inner) and not has_set(folder) else folder


def init_set(destination: Path, source: Path) -> tuple[Path, ...]:
    """Copy the files of the set in `source`, unchanged, into `destination`, which is created if necessary.

    Returns the new files. Raises ConfigurationError, before anything is written, if a file would
    be overwritten.
    """
    return write_files(destination, read_files(source))


def read_files(source: Path) -> dict[str, bytes]:
    """The files of a set by name, its own device files and sketches by their paths in it. Raises
    ConfigurationError if there are none, or if one cannot be copied."""
    found = (path for path in source.iterdir() if not is_leftover(path.name) and path.is_file())
    paths = sorted(path for path in found if path.suffix.lower() in (".csv", ".toml"))
    if not paths:
        raise ConfigurationError([Problem(str(source), "holds no files of a set to copy")])
    # Windows finds Sensors.CSV as sensors.csv, and other systems do not: a copy has the usual names.
    files = {_usual_name(name): data for name, data in read_all(paths, source).items()}
    problems: list[Problem] = []
    devices = sorted(path.name for path in (source / DEVICES).glob("*.py") if not is_leftover(path.name))
    own = [f"{DEVICES}/{name}" for name in devices]
    files |= {device.path: device.data for device in read_devices(source, own, DEVICES, problems)}
    if WIRING_FILE in files:
        files |= read_all(sketch_files(source, files[WIRING_FILE]), source)
    if problems:
        raise ConfigurationError(problems)
    return files


def read_all(paths: Iterable[Path], folder: Path) -> dict[str, bytes]:
    """The bytes of files in a folder, by path in it. Raises ConfigurationError if one cannot be read."""
    try:
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
    except OSError as error:
        raise unreadable(error, folder) from None


def decoded(name: str, data: bytes, encoding: str = "utf-8-sig") -> str:
    """The text of a file. Raises ConfigurationError if it is not text."""
    try:
        return data.decode(encoding)
    except UnicodeDecodeError:
        raise ConfigurationError([Problem(name, "is not UTF-8 text; save it as UTF-8")]) from None


def unreadable(error: OSError, path: Path) -> ConfigurationError:
    """The error for a file, or one of a folder, that cannot be read."""
    where = str(error.filename or path)
    return ConfigurationError([Problem(where, f"cannot be read: {reason_of(error)}")])


def _usual_name(name: str) -> str:
    return name.lower() if name.lower() in FILES else name


def write_files(destination: Path, files: Mapping[str, bytes]) -> tuple[Path, ...]:
    """Write files (by name, which may have a folder) into a folder, which is created if necessary; returns
    their paths. Raises ConfigurationError, before anything is written, if one would be overwritten."""
    shown = str(destination)
    # Before anything is written: a mixture of two sets would be worse than none.
    present = [name for name in files if (destination / name).exists()]
    if present:
        what = f"has {first_of(present, _MOST_NAMED)} already; nothing is overwritten, name another folder"
        raise ConfigurationError([Problem(shown, what)])
    written: list[Path] = []
    try:
        for name, data in files.items():
            path = destination / name
            path.parent.mkdir(parents=True, exist_ok=True)
            written.append(path)
            write_whole(path, data)
    except OSError as error:
        # A second try would find the first half, and refuse to overwrite it.
        for path in written:
            with contextlib.suppress(OSError):
                path.unlink()
        why = "it is a file, not a folder" if destination.is_file() else reason_of(error)
        raise _unwritable(shown, why) from None
    return tuple(destination / name for name in files)


def check_free(destination: Path) -> None:
    """Check that a folder is empty and can be made. Raises ConfigurationError before the work, whose result
    would be lost."""
    shown = str(destination)
    if destination.exists() and (not destination.is_dir() or any(destination.iterdir())):
        what = "is there already, and not empty; nothing is overwritten, name another folder"
        raise ConfigurationError([Problem(shown, what)])
    there = next(each for each in (destination, *destination.absolute().parents) if each.exists())
    if not there.is_dir() or not os.access(there, os.W_OK):
        why = "may not be written to" if there.is_dir() else "is not a folder"
        raise _unwritable(shown, f"{there} {why}")


def _unwritable(shown: str, why: str) -> ConfigurationError:
    return ConfigurationError([Problem(shown, f"cannot be written: {why}")])
