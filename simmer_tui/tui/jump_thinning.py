"""Pictures of a robot that jumps from place to place."""

# Instant movements have no frames between, and each picture is a new one. 8 of 15 are enough to see
# where the robot goes, in half the bytes.
_SHOWN = 8
_OF = 15


class JumpThinning:
    """Leaves out about every other picture while the robot jumps."""

    def __init__(self) -> None:
        self._turn = 0

    def passes_over(self, jumps: bool) -> bool:
        """True if the next picture is left out. `jumps` is true while the robot jumps."""
        self._turn = self._turn % _OF + _SHOWN if jumps else _OF
        return self._turn < _OF
