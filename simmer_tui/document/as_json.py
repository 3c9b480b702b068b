"""JSON of documents and of plain values.

Tables are lists of objects under their keys, records one object. Our own sentences stand under `text`, by
the key of their paragraph, list or table.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import PurePath
from typing import Any

from msgspec import Struct, structs

from simmer_tui.document.model import Bullets, DataTable, Document, Paragraph, words


def json_text(value: object) -> str:
    """One JSON text of a document or of any value that `plain` takes."""
    if isinstance(value, Document):
        value = document_value(value)
    # ASCII only, so that text from outside cannot steer a terminal that the answer is printed on.
    return json.dumps(plain(value), indent=1, allow_nan=False) + "\n"


def document_value(document: Document) -> dict[str, object]:
    """Tables and sentences of a document by their keys."""
    answer: dict[str, Any] = {}
    text: dict[str, object] = {}
    for part in document.parts:
        match part:
            case DataTable():
                rows = list(part.objects())
                answer[part.key] = rows[0] if part.record else [*answer.get(part.key, ()), *rows]
                if part.note:
                    text[part.key] = part.note if part.key not in text else f"{text[part.key]} {part.note}"
            case Paragraph() if part.key and part.text:
                text[part.key] = words(part.text)
            case Bullets() if part.key:
                text[part.key] = [words(entry) for entry in part.entries]
    return {"text": text, **answer}


def plain(value: object) -> Any:
    """A value in JSON's own types.

    Records become objects by the names of their fields, kinds of things their names, numbers that are not
    finite (a range without a limit) null.
    """
    if isinstance(value, Struct):
        return plain(structs.asdict(value))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, type):
        return getattr(value, "name", value.__name__)
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {str(plain(key)): plain(each) for key, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, PurePath) else value
