"""The one reader of JSON in files of ours: lines of logs, plans and results of runs, calibrated knowledge.

A file may be damaged, or made by anybody. Every value returned has the types of its struct, and finite
numbers. All else is a ValueError, for which the reader of each kind of file has its message.
"""

from __future__ import annotations

import json
import math
from pathlib import PurePath
from typing import Any, Generic, TypeVar

import msgspec

_Kind = TypeVar("_Kind")


class TypedJson(Generic[_Kind]):
    """Reads values of one type, which may contain paths, as text."""

    def __init__(self, kind: Any) -> None:
        """`kind` is a struct, or a union of tagged ones."""
        self._kind = kind
        decoder = msgspec.json.Decoder(kind, dec_hook=_path)
        self._decode, self._decode_lines = decoder.decode, decoder.decode_lines

    def decode(self, data: bytes) -> _Kind:
        """A value, lone halves of surrogate pairs in its texts included. Raises ValueError."""
        try:
            found: _Kind = self._decode(data)
        except RecursionError as error:
            raise ValueError(str(error)) from None
        except ValueError:
            if b"\\ud" not in data.lower():
                raise
            # Names of files that are no UTF-8 have lone surrogates, which msgspec refuses.
            return self._decoded_by_json(data)
        return found

    def decode_lines(self, data: bytes) -> list[_Kind] | None:
        """The values of whole lines, decoded at once, which is faster; None unless `decode` would give one
        for each."""
        try:
            found: list[_Kind] = self._decode_lines(data)
        except (RecursionError, ValueError):
            return None
        # A value on two lines, or two values on one, may be read: `}` and `{` enclose no line end in a value.
        return found if len(found) == data.count(b"\n") == data.count(b"}\n{") + 1 else None

    def _decoded_by_json(self, data: bytes) -> _Kind:
        try:
            fields = json.loads(data, parse_float=_finite, parse_constant=_refuse)
            found: _Kind = msgspec.convert(fields, self._kind, dec_hook=_path)
        except RecursionError as error:
            raise ValueError(str(error)) from None
        return found


def _finite(text: str) -> float:
    if not math.isfinite(value := float(text)):
        raise ValueError(f"{text} is no number")
    return value


def _refuse(name: str) -> float:
    raise ValueError(f"{name} is no JSON")


def _path(kind: type, value: Any) -> Any:
    if issubclass(kind, PurePath) and isinstance(value, str):
        return kind(value)
    raise ValueError(f"expected {kind.__name__}")
