"""Collections of bounded size: packed tables, thinned traces, sums of errors."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from struct import Struct
from typing import Annotated, Any, Generic, Protocol, TypeVar, cast, overload

import numpy as np

from simmer_tui.sim.arrays import FloatArray, NDArray


class Timed(Protocol):
    """Something with a moment of the run."""

    @property
    def elapsed(self) -> float: ...


Item = TypeVar("Item")
TimedItem = TypeVar("TimedItem", bound=Timed)

BINS = 32
"""Bins of a histogram: the sixteen characters that show it take two each."""
# Least width of a bin: from a tiny first error, doubling would take long.
LEAST_WIDTH = 1e-9
LISTED = 200
"""First items of a kind that are kept besides the newest: a report lists or draws no more."""


class Thinned(Generic[Item]):
    """Up to `limit` items, evenly spread over all that were given.

    When it is full, every second item is dropped, and from then on only every second, fourth... is kept.
    """

    def __init__(self, limit: int) -> None:
        self.items: list[Item] = []
        self.stride = 1
        """One in this many items is kept."""
        self.given = 0
        self._limit = limit

    def wanted(self, count: int = 1) -> range:
        """Count `count` more items. Returns the indices of those that must be given to `keep`."""
        begin = -self.given % self.stride
        self.given += count
        return range(begin, count, self.stride)

    def keep(self, items: Iterable[Item]) -> None:
        """Keep the items that were `wanted`."""
        self.items += items
        # More than once where many were added at a time.
        while len(self.items) > self._limit:
            del self.items[1::2]
            self.stride *= 2


class First(Generic[Item]):
    """The first `limit` items, and how many there were."""

    def __init__(self, limit: int) -> None:
        self.items: list[Item] = []
        self.given = 0
        self._limit = limit

    def add(self, item: Item) -> None:
        self.given += 1
        if len(self.items) < self._limit:
            self.items.append(item)

    @property
    def more(self) -> int:
        """Number of items that are not kept."""
        return self.given - len(self.items)


class Newest(Generic[TimedItem]):
    """The newest `limit` items, and the `first` ones. From `since` on (elapsed seconds) none is missing."""

    def __init__(self, limit: int) -> None:
        self.first: First[TimedItem] = First(LISTED)
        self.items: deque[TimedItem] = deque()
        self.since = 0.0
        self._limit = limit

    def add(self, item: TimedItem) -> None:
        self.first.add(item)
        self.items.append(item)
        if len(self.items) > self._limit:
            self.items.popleft()
            self.since = max(self.since, self.items[0].elapsed)

    def after(self, given: int) -> list[TimedItem]:
        """The kept items among those that came after the first `given`."""
        # From the end: a deque is slow in its middle.
        count = min(self.first.given - given, len(self.items))
        return [self.items[-each] for each in range(count, 0, -1)]

    @property
    def dropped(self) -> int:
        """Number of items that newer ones have replaced."""
        return self.first.given - len(self.items)


class Errors:
    """Mean, standard deviation and histogram of numbers, which are not kept.

    Mean and standard deviation are merged as Chan, Golub and LeVeque (1979) do. The histogram's `BINS` bins
    lie around 0; their width doubles whenever a number falls outside.
    """

    def __init__(self) -> None:
        self.count = 0
        self.mean = 0.0
        self.worst = 0.0
        """The number farthest from 0."""
        self.bins = [0] * BINS
        self.width = 0.0
        """Width of a bin; 0 while all numbers were 0."""
        self._squares = 0.0

    def add(self, values: FloatArray) -> None:
        """Add finite numbers, (n,)."""
        if not len(values):
            return
        count, mean = len(values), float(values.mean())
        difference, total = mean - self.mean, self.count + count
        # Chan, Golub and LeVeque: stable where sums of squares cancel.
        self._squares += float(np.square(values - mean).sum()) + difference**2 * self.count * count / total
        self.mean += difference * count / total
        self.count = total
        worst = float(values[np.abs(values).argmax()])
        if abs(worst) > abs(self.worst):
            self.worst = worst
        if not self.width and worst:
            # A quarter of the first error: the histogram then reaches to four times that error.
            first = float(np.abs(values[values.nonzero()[0][0]]))
            self.width = max(first / 4, LEAST_WIDTH)
        while abs(worst) >= self.reach and worst:
            self._widen()
        places = np.floor(values / self.width).astype(np.int64) if self.width else np.zeros(count, np.int64)
        fresh = np.bincount(places + BINS // 2, minlength=BINS).tolist()
        self.bins = [old + new for old, new in zip(self.bins, fresh, strict=True)]

    @property
    def std(self) -> float:
        """The standard deviation; NaN of fewer than two numbers."""
        return math.sqrt(self._squares / (self.count - 1)) if self.count > 1 else math.nan

    @property
    def reach(self) -> float:
        """Upper end of the histogram; the lower end is its negative."""
        return self.width * BINS / 2

    def _widen(self) -> None:
        self.width *= 2
        bins, self.bins = self.bins, [0] * BINS
        for place, count in enumerate(bins):
            self.bins[(place - BINS // 2) // 2 + BINS // 2] += count


Single = Annotated[float, "f"]
"""A number in single precision: enough for the digits shown, 0.01 in of 100,000."""
Index = Annotated[int, "H"]
"""An index into a list of names."""
_CODES = {int: "i", float: "d", bool: "?"}
CHUNK = 2048
"""Rows that are packed, summed up and dropped together. A chunk of readings is 0.15 MB, and numpy takes less
than a tenth of the time for packing to sum it up."""

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
            row: Class of its rows. Its module must not import annotations from `__future__`: evaluating them
                here would take a millisecond a run.
            most: Rows kept at least.
            settle: Function that sums up rows; it is called with each row once.
            followers: Tables whose rows are dropped with the rows of their time here.
        """
        hints = row.__annotations__
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
        # A bytearray grows in place: an append costs the packing and little else.
        rows = self._open
        rows += self._pack(*values)
        if len(rows) == self._full:
            self._close()

    def extend(self, rows: Iterable[Iterable[float]]) -> None:
        """Add rows: the same as `append` for each, in less time."""
        pack, full, packed = self._pack, self._full, self._open
        for row in rows:
            packed += pack(*row)
            if len(packed) == full:
                self._close()
                packed = self._open

    def _close(self) -> None:
        """Close the open chunk, and drop the oldest if there are enough."""
        # Summed up before it is closed: dropped rows must be in the sums already.
        self.settle()
        self._chunks.append(bytes(self._open))
        self._open, self._settled = bytearray(), 0
        if (len(self._chunks) - 1) * CHUNK >= self._most:
            self._drop()
            for other in self._followers:
                other.forget(self[0][0])

    def forget(self, order: int) -> None:
        """Drop the rows before this `order`, as whole chunks."""
        while self._chunks and self[CHUNK - 1][0] < order:
            self._drop()

    def _drop(self) -> None:
        self._chunks.popleft()
        self.dropped += CHUNK

    def settle(self) -> None:
        """Sum up the rows that were added since the last time."""
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

    def before(self, order: int) -> RowT | None:
        """The last row whose `order` is below this one; None without any."""
        place = self.place_of(order)
        return self[place - 1] if place else None

    def columns(self, begin: int = 0, end: int | None = None) -> Columns:
        """The rows from one place to another as columns."""
        begin, end, _ = slice(begin, end).indices(len(self))
        first, last = begin // CHUNK, -(-end // CHUNK)
        chunks: list[bytes | bytearray] = [*self._chunks, self._open]
        # Joined as bytes: numpy copies rows column by column, which takes thirty times as long. A view of the
        # open chunk would forbid it to grow.
        rows = np.frombuffer(b"".join(chunks[first:last]), self._dtype)
        return rows[begin - first * CHUNK : max(end - first * CHUNK, 0)]
