"""Travel from place to place: straight where there is room, with turns where there is room for them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from solve_beliefs import FloatArray
from solve_ground import ENOUGH, Body, Cell, Ground, cell_at, centre
from solve_pilot import LostError, Pilot, bearing, direction

CLEAR = 0.8  # in, least clearance of a straight line
DETOURS = 3  # most detours of one journey


class Travel:
    """Brings the robot to a place, with the block or without.

    `ahead` is the distance of a held block's centre from the robot's, inches.
    """

    def __init__(self, pilot: Pilot, ground: Ground, body: Body, ahead: float) -> None:
        self._pilot = pilot
        self._ground = ground
        self._body = body
        self._ahead = ahead

    def to(self, target: FloatArray) -> None:
        """Go to a place from bend to bend of the route, skipping bends that can be cut. With the block, stop
        where there is room for both to turn, and with the block in the middle of the target."""
        cells = self._ground.route(cell_at(self._pilot.place), cell_at(target))
        if not cells:
            raise LostError("there is no way from here")
        bends = [cells[at] for at in range(1, len(cells) - 1) if bent(*cells[at - 1 : at + 2])]
        points = [*map(centre, bends), target]
        detours = DETOURS
        while points:
            stops = [self._stop(points, index) for index in range(len(points))]
            clear = [index for index, stop in enumerate(stops) if self._is_clear(self._pilot.place, stop)]
            if not clear and detours:
                stop, detours = self._detour(points[0]), detours - 1
            else:
                index = clear[-1] if clear else 0
                stop, points = stops[index], points[index + 1 :]
            if self._body.loaded:
                self._aim(stop)
            self._pilot.go(stop, tolerance=0.5)

    def _stop(self, points: Sequence[FloatArray], index: int) -> FloatArray:
        """A place to stop at for one of the points of a route."""
        place, point = self._pilot.place, points[index]
        arrival = bearing(point - place)
        if not self._body.loaded:
            return point
        if index + 1 < len(points):
            turn = math.remainder(bearing(points[index + 1] - point) - arrival, 360.0)
            return self._body.spot_to_turn(point, arrival, turn)
        return point - min(self._ahead, float(np.hypot(*(point - place)))) * direction(arrival)

    def _is_clear(self, start: FloatArray, stop: FloatArray) -> bool:
        """True if the straight line from one place to another has room enough."""
        return self._body.room_ahead(start, stop) > CLEAR

    def _detour(self, point: FloatArray) -> FloatArray:
        """The intermediate place if a point cannot be reached straight: the one with most room on the way
        there, for the turn, and on the way from there."""
        place = self._pilot.place
        steps = np.arange(-12.0, 12.1, 1.5)
        spots = place + np.array([(x, y) for x in steps for y in steps if x or y])
        spots = spots[self._ground.clearance(spots) >= self._body.radius + CLEAR]
        ahead = self._ahead if self._body.loaded else 0.0

        def room(spot: FloatArray) -> float:
            arrival, on = bearing(spot - place), bearing(point - spot)
            end = point - min(0.3 * ahead, float(np.hypot(*(point - spot)))) * direction(on)
            turn = math.remainder(on - arrival, 360.0)
            rooms = (
                self._body.room_ahead(place, spot),
                self._body.room_to_turn(spot, arrival, turn),
                self._body.room_ahead(spot, end),
            )
            return min(*rooms, ENOUGH) - 0.01 * float(np.hypot(*(spot - place)))

        return max(spots, key=room, default=point)

    def _aim(self, target: FloatArray) -> None:
        """Turn to a place in the direction with more room, after driving forward or back if there is too
        little."""
        start, heading = self._pilot.place, self._pilot.heading
        plans = []
        for on in np.arange(-10.0, 10.1, 0.5).tolist():
            place = start + on * direction(heading)
            short = math.remainder(bearing(target - place) - heading, 360.0)
            line = np.linspace(start, place, 5)
            on_the_way = self._body.room(line, np.full(5, heading))
            for turn in (short, short - math.copysign(360.0, short)):
                room = min(on_the_way, self._body.room_to_turn(place, heading, turn), ENOUGH)
                plans.append((room - 0.01 * abs(on) - 0.0005 * abs(turn), on, turn))
        _, on, turn = max(plans)
        if on:
            self._pilot.go(start + on * direction(heading), tolerance=0.5, backwards=on < 0)
        while abs(turn) > 60.0:  # in parts, so that it turns in this direction
            self._pilot.turn(math.copysign(60.0, turn))
            self._pilot.look()
            turn -= math.copysign(60.0, turn)
        self._pilot.face(bearing(target - self._pilot.place))


def bent(before: Cell, cell: Cell, after: Cell) -> bool:
    """True if three cells of a route are not in a line."""
    return (before[0] + after[0], before[1] + after[1]) != (2 * cell[0], 2 * cell[1])
