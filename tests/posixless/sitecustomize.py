"""Takes away from the modules of simmer_tui, and from them alone, what Windows does not have.

Python runs this at its start where it lies on the path (tests/test_posixless.py puts it there), also in the
workers and programs that the package starts. The standard library and other packages keep all they have:
asyncio and pyserial need it here, and `sys.platform` and `os.name` stay as they are.
"""

from __future__ import annotations

import builtins
import json
import os
import pathlib
import selectors
import stat
import sys
import types
from typing import Any

MODULES = frozenset(
    ("crypt", "curses", "fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty")
)
"""Modules that Windows does not have."""
_TAKEN: dict[str, frozenset[str]] = {
    name: frozenset(taken)
    for name, taken in json.loads(
        pathlib.Path(os.environ["SIMMER_TEST_TAKEN"]).read_text(encoding="utf-8")
    ).items()
}
"""Of other modules, the attributes that Windows does not have, by the type stubs of the standard library."""
_BETWEEN = frozenset(
    ("_collections_abc", "contextlib", "glob", "io", "os", "pathlib", "shutil", "tempfile", __name__)
)
"""Modules by which files are opened: who called them counts."""
_NOT_IN_NAMES = frozenset('<>:"|?*')
"""Characters that a name of a file cannot have on Windows."""
_OURS = "simmer_tui"


def _is_ours(name: str) -> bool:
    return name == _OURS or name.startswith(f"{_OURS}.")


def _asked_by_us() -> bool:
    """True if the package asks, by whatever of the standard library."""
    frame: Any = sys._getframe(1)
    while frame is not None:
        name = frame.f_globals.get("__name__", "")
        if name not in _BETWEEN:
            spec = frame.f_globals.get("__spec__")
            return _is_ours(spec.name if name == "__main__" and spec is not None else name)
        frame = frame.f_back
    return False


class _View(types.ModuleType):
    """A module as it is on Windows."""

    def __init__(self, real: types.ModuleType, others: dict[str, object]) -> None:
        super().__init__(real.__name__, real.__doc__)
        self.__dict__["_real"] = real
        self.__dict__.update(others)

    def __getattr__(self, name: str) -> Any:
        if name in _TAKEN.get(self.__name__, ()):
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r} on Windows")
        return getattr(self.__dict__["_real"], name)

    def __setattr__(self, name: str, value: object) -> None:
        setattr(self.__dict__["_real"], name, value)

    def __dir__(self) -> list[str]:
        return sorted(set(dir(self.__dict__["_real"])) - _TAKEN.get(self.__name__, frozenset()))


class _SocketSelector(selectors.SelectSelector):
    """A selector for sockets alone, as Windows has it."""

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        descriptor = fileobj if isinstance(fileobj, int) else fileobj.fileno()
        if not stat.S_ISSOCK(os.fstat(descriptor).st_mode):
            raise OSError(10038, "an operation was attempted on something that is not a socket")
        return super().register(fileobj, events, data)


_views: dict[str, _View] = {}


def _view(module: types.ModuleType) -> types.ModuleType:
    name = module.__name__
    if name not in _views:
        others: dict[str, object] = {}
        if name == "selectors":
            others = {"DefaultSelector": _SocketSelector}
        elif name in ("ctypes", "subprocess"):
            import fake_windows

            kernel = fake_windows.FakeKernel32()
            others = {
                "ctypes": {"WinDLL": lambda library, **options: kernel},
                "subprocess": {"Popen": fake_windows.FakePopen},
            }[name]
        _views[name] = _View(module, others)
    return _views[name]


_VIEWED = frozenset(_TAKEN) | {"ctypes", "selectors", "subprocess"}
_real_import = builtins.__import__


def _import(
    name: str,
    globals: Any = None,  # noqa: A002 - as Python names them
    locals: Any = None,  # noqa: A002
    fromlist: Any = (),
    level: int = 0,
) -> types.ModuleType:
    module = _real_import(name, globals, locals, fromlist, level)
    spec = (globals or {}).get("__spec__")
    caller = spec.name if spec is not None else (globals or {}).get("__name__", "")
    if level == 0 and _is_ours(caller):
        first = name.partition(".")[0]
        if first in MODULES:
            raise ModuleNotFoundError(f"No module named {name!r} on Windows", name=name)
        if first in _VIEWED and module.__name__ == first:
            return _view(module)
    return module


def _is_open_here(path: str) -> bool:
    """True if this process has the file open: Windows neither removes nor renames it then."""
    _looking.append(path)
    try:
        path = os.path.realpath(path)
        links = [os.path.realpath(f"/proc/self/fd/{name}") for name in os.listdir("/proc/self/fd")]
    finally:
        _looking.clear()
    return path in links


_looking: list[str] = []
"""The event that is looked at, whose own looks are not looked at."""


def _audit(event: str, given: tuple[Any, ...]) -> None:
    if _looking or event not in ("open", "os.listdir", "os.scandir", "os.remove", "os.rename", "os.mkdir"):
        return
    if not given or not isinstance(given[0], (str, os.PathLike)):
        return
    path = os.fspath(given[0])
    if not isinstance(path, str) or not _asked_by_us():
        return
    if path == "/proc" or path.startswith("/proc/"):
        raise FileNotFoundError(2, "there is no /proc on Windows", path)
    goals = given[:2] if event == "os.rename" else given[:1]
    if event in ("os.remove", "os.rename") and any(map(_is_open_here, goals)):
        raise PermissionError(13, "the file is open: Windows keeps it", path)
    writes = event == "os.mkdir" or (event == "open" and isinstance(given[2], int) and given[2] & os.O_CREAT)
    name = os.path.basename(path)
    if writes and path != os.devnull and (_NOT_IN_NAMES & set(name) or name != name.rstrip(". ")):
        raise OSError(22, "Windows has no such file name", path)


_real_stat = pathlib.Path.stat


def _stat(self: pathlib.Path, **options: Any) -> os.stat_result:
    if str(self).startswith("/proc") and _asked_by_us():
        raise FileNotFoundError(2, "there is no /proc on Windows", str(self))
    return _real_stat(self, **options)


pathlib.Path.stat = _stat  # type: ignore[method-assign]
builtins.__import__ = _import
sys.addaudithook(_audit)
