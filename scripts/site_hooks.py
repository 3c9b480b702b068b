"""Hooks for mkdocs.yml: links that lead out of docs/ go to the repository.

On a code host `../scripts/solve.py` is the file beside; the site has only what is in docs/.
"""

from __future__ import annotations

import posixpath
import re
from typing import Any

_LINK = re.compile(r"(?<=\]\()(\.\./[^)#]+)")


def on_page_markdown(markdown: str, page: Any, config: Any, **_: Any) -> str:
    """Called for each page by MkDocs."""

    def outside(found: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join("docs", posixpath.dirname(page.file.src_uri), found[1]))
        return found[1] if path.startswith("docs/") else f"{config['repo_url'].rstrip('/')}/blob/main/{path}"

    return _LINK.sub(outside, markdown)
