"""Tables of packed numbers: a row takes its bytes and nothing else, and old rows give way to new ones."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Sequence
from struct import Struct
from typing import Annotated, Any, TypeVar, cast, get_type_hints, overload

import numpy as np
from numpy.typing import NDArray

Single = Annotated[float, "f"]
"""A number in single precision: enough for what is shown, 0.01 in of 100,000."""
Index = Annotated[int, "H"]
"""An index into a list of names."""
_CODES = {int: "i", float: "d", bool: "?"}
CHUNK = 2048
"""Rows that are packed, summed up and dropped together: a chunk of readings is 0.15 MB, and numpy's share of
the time to sum it up is below a tenth of packing it."""

Columns = NDArray[np.void]
"""Rows as a structured array, one field a column."""
RowT = TypeVar("RowT", bound="tuple[Any, ...]")


class RowTable(Sequence[RowT]):
    """The newest rows of one kind, oldest first; a row is made of its bytes when it is asked for.

    Rows are named tuples of numbers whose first field, `order`, grows.
    """

    def __init__(
        self,
        row: type[RowT],
        most: int,
        settle: Callable[[Columns], None],
        followers: Sequence[RowTable[Any]] = (),
    ) -> None:
        """Make an empty table.

        Args:
            row: Class of its rows.
            most: Rows kept at least.
            settle: Function that sums up rows; it is called with each row once.
            followers: Tables whose rows are dropped with the rows of their time here.
        """
        hints = get_type_hints(row, include_extras=True)
        codes = [getattr(hint, "__metadata__", [_CODES.get(hint)])[0] for hint in hints.values()]
        packed = Struct("<" + "".join(codes))
        self._pack, self._unpack, self._size = packed.pack, packed.unpack_from, packed.size
        self._dtype = np.dtype([(name, f"<{code}") for name, code in zip(hints, codes, strict=True)])
        self._row = row
        self._most = most
        self._settle = settle
        self._followers = followers
        self._chunks: deque[bytes] = deque()
        self._open = bytearray()
        self._full = packed.size * CHUNK
        self._settled = 0
        self.dropped = 0
        """Rows that are no longer kept."""

    def append(self, *values: float) -> None:
        """Add a row, its fields in order."""
        self._open += self._pack(*values)
        if len(self._open) == self._full:
            self.settle()
            self._chunks.append(bytes(self._open))
            self._open, self._settled = bytearray(), 0
            if (len(self._chunks) - 1) * CHUNK >= self._most:
                self._drop()
                for other in self._followers:
                    other.forget(self[0][0])

    def forget(self, order: int) -> None:
        """Drop what can be dropped of the rows before this `order`."""
        while self._chunks and self[CHUNK - 1][0] < order:
            self._drop()

    def _drop(self) -> None:
        self._chunks.popleft()
        self.dropped += CHUNK

    def settle(self) -> None:
        """Have the rows added since the last time summed up."""
        if self._settled < len(self._open):
            fresh = bytes(self._open[self._settled :])
            self._settled = len(self._open)
            self._settle(np.frombuffer(fresh, self._dtype))

    def __len__(self) -> int:
        return len(self._chunks) * CHUNK + len(self._open) // self._size

    @overload
    def __getitem__(self, place: int) -> RowT: ...

    @overload
    def __getitem__(self, place: slice) -> list[RowT]: ...

    def __getitem__(self, place: int | slice) -> RowT | list[RowT]:
        if isinstance(place, slice):
            return [self[each] for each in range(*place.indices(len(self)))]
        count = len(self)
        if not -count <= place < count:
            raise IndexError(place)
        chunk, row = divmod(place % count, CHUNK)
        data = self._chunks[chunk] if chunk < len(self._chunks) else self._open
        return cast("RowT", self._row._make(self._unpack(data, row * self._size)))  # type: ignore[attr-defined]

    def place_of(self, order: int) -> int:
        """The place of the first row whose `order` is not below this one."""
        return bisect_left(self, order, key=lambda row: row[0])

    def columns(self, begin: int = 0, end: int | None = None) -> Columns:
        """The rows from one place to another as columns."""
        begin, end, _ = slice(begin, end).indices(len(self))
        first, last = begin // CHUNK, -(-end // CHUNK)
        chunks = [*self._chunks, bytes(self._open)]
        parts = [np.frombuffer(each, self._dtype) for each in chunks[first:last]]
        rows = np.concatenate(parts) if parts else np.empty(0, self._dtype)
        return rows[begin - first * CHUNK : max(end - first * CHUNK, 0)]
