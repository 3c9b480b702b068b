"""Modules that are changed when a program imports them.

It is imported into other people's programs, by whatever Python they use: standard library alone, Python 3.8
on, and nothing of the package.
"""

from __future__ import annotations

import importlib.machinery
import sys

TYPE_CHECKING = False  # the module typing would cost every start some milliseconds
if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any


def patch_when_imported(patches: Mapping[str, Callable[[Any], None]]) -> None:
    """Change each module, after its import, by the function of its name."""
    sys.meta_path.insert(0, _Finder(patches))


# Not of the classes of importlib.abc, whose import takes time.
class _Loader:
    """Loads a module as usual, and then patches it."""

    def __init__(self, loader: Any, patch: Callable[[Any], None]) -> None:
        self._loader = loader
        self._patch = patch

    def create_module(self, spec: Any) -> Any:
        return self._loader.create_module(spec)

    def exec_module(self, module: Any) -> None:
        self._loader.exec_module(module)
        try:
            self._patch(module)
        except Exception:
            # A file of the program may have the name of a library. It is not patched.
            if "-packages" in str(getattr(module, "__file__", "")):
                raise

    def __getattr__(self, name: str) -> Any:  # other attributes that an import asks its loader for
        return getattr(self._loader, name)


class _Finder:
    """Finds the modules that are to be patched, with the other finders."""

    def __init__(self, patches: Mapping[str, Callable[[Any], None]]) -> None:
        self._patches = patches

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        patch = self._patches.get(name)
        if patch is None:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = _Loader(spec.loader, patch)  # type: ignore[assignment]
        return spec
