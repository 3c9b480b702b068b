"""The simulated link between programs and the robot: the delay of each message."""

from simmer_tui.sim import noise

# A stream of its own: the noise of sensors and drives is the same with and without a link.
LINK_STREAM = "link"
"""Name of the random stream that only the jitter is drawn from."""


class LinkDelay:
    """Latency of each message in each direction, simulated seconds: a constant and a uniformly distributed
    jitter."""

    def __init__(self, latency: float, jitter: float, seed: int) -> None:
        self._latency = latency
        self._jitter = jitter
        self.restart(seed)

    def restart(self, seed: int) -> None:
        """Restart the random stream, as at the start of a run with this seed."""
        self._random = noise.stream(seed, LINK_STREAM)

    def draw(self) -> float:
        """Draw the latency of the next message, simulated seconds."""
        return self._latency + (self._jitter * self._random.random() if self._jitter else 0.0)
