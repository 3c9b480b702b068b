"""Archives, told by their names."""

from __future__ import annotations

import shutil

_ENDINGS = (*(ending for _, endings, _ in shutil.get_unpack_formats() for ending in endings), ".rar", ".7z")


def is_archive(name: str) -> bool:
    """True if a file's name is that of an archive."""
    return name.lower().endswith(_ENDINGS)
