"""Notices of faults on a line, once each: programs repeat their mistakes many times a second."""

from collections import Counter
from collections.abc import Callable

UNKNOWN_MESSAGE = "unknown"
"""Beginning of the meaning of a message that no command matches; the nearest command follows."""
# A program with more faults uses another language, which twenty lines show as well as a thousand.
MOST_FAULTS = 20
"""Different faults that are reported while a port is open."""


class FaultNotices:
    """Tells each fault of a program, or of the rules, at its first occurrence, and at the end its number of
    occurrences.

    Args:
        tell: Called with a sentence.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._counts = Counter[object]()
        self._texts: dict[object, str] = {}
        self._unreported = 0

    def note(self, text: str, alike: object = None) -> None:
        """Count a fault. Faults with an equal `alike`, by default the text, are the same."""
        key = text if alike is None else alike
        if key not in self._texts:
            if len(self._texts) >= MOST_FAULTS:
                self._unreported += 1
                return
            self._texts[key] = text
            self._tell(text)
        self._counts[key] += 1

    def end(self) -> None:
        """Report the number of occurrences of each repeated fault, and forget them all."""
        for key, count in self._counts.items():
            if count > 1:
                self._tell(f"{count} times in all: {self._texts[key]}")
        if self._unreported:
            more = "1 more was" if self._unreported == 1 else f"{self._unreported} more were"
            self._tell(f"{MOST_FAULTS} different faults were reported, {more} not")
        self._counts, self._texts, self._unreported = Counter(), {}, 0
