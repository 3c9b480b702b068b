"""Step 7, the whole mission, in which readings take time: localize, fetch the block, deliver it.

    simmer-tui --mission    (and in a second terminal: python samples/course/step7_mission.py)
    simmer-tui --mission --run "python samples/course/step7_mission.py"
    simmer-tui trials --runs 50 --run "python samples/course/step7_mission.py" --require 0.9

The other steps have all parts. New are the recovery when a part fails, and driving with the block. Robot and
block together are too long to turn in a corridor, so this robot keeps its heading.
"""

from __future__ import annotations

import sys

import numpy as np
from step3_dead_reckoning import turned
from step4_particle_filter import look
from step5_planning import LostError, Pilot, cell_at
from step6_block import BLOCK, GAP, RADIUS, Fetcher

from simmer_tui.client import NoMissionError, Robot, RobotUnreachableError

LENGTH = 2 * RADIUS + GAP + BLOCK  # in, of robot and block together
MIDDLE = LENGTH / 2 - RADIUS  # in, from the robot's centre to the middle of both
TRIES = 4
BLUR = (2.0, 2.0, 4.0)  # in, in, deg: spread of the particles for a lost robot that cannot turn


class Mission:
    """The robot, and the parts of its mission."""

    def __init__(self, pilot: Pilot, random: np.random.Generator) -> None:
        self.pilot, self.fetcher, self.random = pilot, Fetcher(pilot), random
        self.holding = False
        self.located = False

    def run(self, drop_zone: tuple[float, float]) -> bool:
        """Do all parts, and repeat those that fail. True if the block has been delivered."""
        for _ in range(TRIES):
            try:
                if not self.located:
                    self.say("where am I?")
                    self.located = self.pilot.localize()
                if self.located and not self.holding:
                    self.say("fetching the block")
                    self.holding = self.fetcher.fetch()
                    if not self.holding:
                        self.step_back()
                if self.holding:
                    self.deliver(drop_zone)
                    return not self.fetcher.holds()
            except LostError as error:
                self.say(f"lost: {error}")
                self.recover()
        return False

    def deliver(self, drop_zone: tuple[float, float]) -> None:
        """Carry the block to the drop zone, without a turn, and set it down."""
        self.say("carrying the block")
        heading = 90 * round(self.pilot.pose[2] / 90)
        self.pilot.travel(cell_at(np.array(drop_zone)), heading, ahead=MIDDLE)
        self.pilot.robot.drive("p1", 0)

    def step_back(self) -> None:
        """After a grip that took nothing: open the gripper, and back away from the block."""
        self.say("missed it")
        self.pilot.robot.drive("p1", 0)
        back = self.pilot.pose[:2] - turned(3.0, 0, self.pilot.pose[2])
        if self.fetcher.room(back[None]) > 0.5:
            self.pilot.go(back, self.pilot.pose[2])

    def recover(self) -> None:
        """Localize the robot again: in the whole maze, or close by if it must not turn with its block."""
        if not self.holding:
            self.located = False
            return
        localizer = self.pilot.localizer
        localizer.particles = localizer.particles + self.random.normal(0, BLUR, localizer.particles.shape)
        for _ in range(3):
            look(self.pilot.robot, localizer, "where am I?")

    def say(self, text: str) -> None:
        """Report what happens, here and in the app."""
        self.pilot.note = text
        print(text, flush=True)


if __name__ == "__main__":
    random = np.random.default_rng(0)
    try:
        with Robot() as robot:
            drop_zone = robot.mission().drop_zone  # in, in: what a program may know of its mission
            delivered = Mission(Pilot(robot, random), random).run(drop_zone)
    except (NoMissionError, RobotUnreachableError) as error:
        sys.exit(f"step7: {error}")
    print("delivered" if delivered else "failed")
    sys.exit(0 if delivered else 1)
