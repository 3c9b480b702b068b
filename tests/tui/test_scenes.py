"""Snapshots turned into scenes."""

from __future__ import annotations

import numpy as np

from simmer_tui.live.operating.switches import SHOWN
from simmer_tui.live.snapshot import Recorder
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Belief
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import FloorPatch, Pose, RangeScan, SimulationSpec, Simulator, parse_command
from simmer_tui.tui.maze.scene import Scene, scene_of


class Run:
    def __init__(self, spec: SimulationSpec) -> None:
        self.engine = Engine(Simulator(spec, 5))
        reducer = Reducer(checkpoint_of(self.engine.simulator))
        self.recorder = Recorder(self.engine, reducer)
        self.engine.watch(self.recorder.apply)
        self._session = self.engine.session()

    def give(self, *commands: str) -> None:
        for command in commands:
            self._session.submit(parse_command(command), lambda outcome: None)

    def scene(self, shown: frozenset[str] = SHOWN) -> Scene:
        simulator = self.engine.simulator
        return scene_of(simulator.spec, simulator.maze, self.recorder.snapshot(), shown=shown)


def test_only_what_was_read_since_the_robot_moved_is_shown(course_spec: SimulationSpec) -> None:
    run = Run(course_spec)
    run.give("u1", "i1", "c1")
    assert [type(view.view) for view in run.scene().views] == [RangeScan, FloorPatch]
    run.give("d1-1")
    assert run.scene().views == ()
    run.give("t1", "u1", "t1")
    assert [(type(view.view), len(view.view.distances)) for view in run.scene().views] == [(RangeScan, 5)] * 2


def test_pose_block_trail_and_contact_are_those_of_the_snapshot(course_spec: SimulationSpec) -> None:
    run = Run(course_spec)
    run.give("d1-2", "w1-100")
    shown = SHOWN - {"plot_sense", "trail"}
    scene = run.scene(shown)
    assert scene.pose == run.engine.simulator.pose
    assert scene.block_centre == (25.0, 41.0)
    assert scene.contact is not None
    assert abs(scene.contact[1] - 48.0) < 1e-9
    assert scene.trail[0][0, :2].tolist() == [9.5, 42.0]
    assert scene.trail[-1][-1, :2].tolist() == [scene.pose.x, scene.pose.y]
    assert scene.shown == shown


def test_a_belief_brings_its_particles_with_or_without_headings(course_spec: SimulationSpec) -> None:
    run = Run(course_spec)
    assert run.scene().belief is None
    run.engine.tell(Belief(0.0, Pose(1, 2, 3), Pose(0, 0, 0), 0.5))
    belief = run.scene().belief
    assert belief is not None
    assert (belief.pose, belief.spread, belief.particles) == (Pose(1, 2, 3), 0.5, None)
    run.engine.tell(Belief(0.0, Pose(1, 2, 3), Pose(0, 0, 0), None, ((1.0, 2.0), (3.0, 4.0, 90.0))))
    belief = run.scene().belief
    assert belief is not None
    assert belief.particles is not None
    assert np.array_equal(belief.particles, [[1, 2], [3, 4]])
