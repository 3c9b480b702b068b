"""A call that is due later."""

from collections.abc import Callable


class Timer:
    """A call that is due later, unless it is cancelled before; without a call it is over."""

    def __init__(self, call: Callable[[], None] | None = None) -> None:
        self._call = call

    @property
    def pending(self) -> bool:
        """True until the call is made or cancelled."""
        return self._call is not None

    def cancel(self) -> None:
        """Cancel the call."""
        self._call = None

    def __call__(self) -> None:
        call, self._call = self._call, None
        if call is not None:
            call()
