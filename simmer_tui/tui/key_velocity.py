"""The velocity of a driving key that is held, with `--keys-velocity`."""

import time
from collections.abc import Callable

from simmer_tui.config.keys import keys_of
from simmer_tui.live.operating.robot_operator import DRIVES, Operator
from simmer_tui.live.server import Server
from simmer_tui.sim.command import parse_command
from simmer_tui.sim.velocity_commands import WAIT
from simmer_tui.tui.key_table import driving_keys

# Terminals send presses only: a held key shows only by its repeats. Systems begin to repeat after 0.25 to
# 0.66 s, and repeat 20 to 40 times a second.
AFTER_FIRST_PRESS = 0.7
"""Real seconds that the velocity lasts after the first press of a key."""
AFTER_REPEAT = 0.25
"""Real seconds that it lasts after each repeat."""
_OLD = 0.2
"""Real seconds after which a press is dropped: it was meant for the robot's earlier place."""
PERIOD = 1 / 15
"""Real seconds between two updates of a velocity that lasts."""
_HAIR = 0.005
"""Seconds: more than the rounding errors of a hundred waits."""
_STANDING = "0;0;0"


class KeyVelocity:
    """Drives the robot at a velocity while a key is held. The velocity is sent with its end, so the robot
    stops even if the screen hangs or its terminal is closed."""

    def __init__(
        self, operator: Operator, server: Server, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """`clock` returns real seconds, for presses and for `pass_time`."""
        self._operator, self._server, self._clock = operator, server, clock
        self._screen = server.configuration.settings.screen
        keys = server.configuration.settings.keys
        self._driving_keys, self._stop_keys = driving_keys(keys), frozenset(keys_of(keys, "stop"))
        self._held: tuple[str, bool] | None = None
        self._until = self._passed = self._age = 0.0

    def note_key(self, key: str, age: float) -> None:
        """Note that a key was pressed `age` real seconds ago; `key` is empty for one that is not the
        maze's.

        Any key but a driving key ends the velocity; the stop key does so by its own action.
        """
        self._age = age
        if key in self._stop_keys:
            self._held = None
        elif key not in self._driving_keys:
            self.release()

    def drive(self, name: str, fine: bool) -> str:
        """Drive by the driving key `name`, the one noted last. Returns an error text, or an empty one."""
        code, engine = self._operator.velocity_code, self._server.engine
        if not code:
            return "keys-velocity: this set's drive.csv has no enabled row velocity"
        if engine.paused:
            return "paused: a held key drives again after a resume"
        if self._age > _OLD:
            return ""
        self.pass_time()
        seconds = AFTER_REPEAT if self._held == (name, fine) else AFTER_FIRST_PRESS
        now = self._clock()
        if self._held is None:
            self._passed = now
        self._held, self._until = (name, fine), now + seconds
        simulated = seconds * (engine.time_scale if engine.timed else 1.0)
        self._send(f"{code}-{self._velocity(name, fine)};{simulated:g}")
        return ""

    def release(self) -> None:
        """End the velocity, for another key."""
        if self._held is not None:
            self._held = None
            self._send(f"{self._operator.velocity_code}-{_STANDING}")

    def pass_time(self) -> None:
        """Let the velocity last until now. Call it every `PERIOD` while it lasts.

        In instant motion, whose time only commands pass, this sends waits. A real robot is sent the
        velocity's end, which it may not know.
        """
        if self._held is None:
            return
        now = min(self._clock(), self._until)
        is_real = self._server.robot is not None
        is_over = now >= self._until
        if not is_real and not self._server.engine.timed and now > self._passed:
            # The last wait is longer by more than the rounding errors of all waits; otherwise the velocity
            # would last.
            self._send(f"{WAIT}-{now - self._passed + _HAIR * is_over:.4f}")
        self._passed = now
        if is_over:
            if is_real:
                self.release()
            self._held = None

    def _velocity(self, name: str, fine: bool) -> str:
        kind, sign = DRIVES[name]
        screen, direction = self._screen, kind.direction
        if kind.turns:
            size = screen.keys_turn_speed * (screen.fine_turn / screen.turn if fine and screen.turn else 1.0)
        else:
            size = screen.keys_speed * (screen.fine_step / screen.step if fine and screen.step else 1.0)
        # VX, VY and OMEGA have the directions of drives. Adding 0 turns -0 into 0.
        return ";".join(f"{sign * size * axis + 0.0:g}" for axis in (direction.x, direction.y, direction.r))

    def _send(self, text: str) -> None:
        self._operator.send(parse_command(text, "keys"))
