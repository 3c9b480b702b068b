"""Drives that take their time, as programs that send packets see them; on a clock the test moves."""

from __future__ import annotations

import math
from typing import Any

import pytest

from simmer_tui.links.peer import MOST_CONNECTIONS
from simmer_tui.robot.sessions import SLICE
from simmer_tui.run.events import Action, ActionName, MovementEnded
from simmer_tui.run.reducer import Reducer
from simmer_tui.run.state import checkpoint_of
from simmer_tui.sim import Pose, Status

LEGS = ["w0:36", "r0:90", "w0:36", "r0:90", "w0:12", "r0:-90", "w0:24", "r0:-90", "w0:6", "r0:720"]
"""From the start of the stock robot to in front of the block."""


def where(pose: Pose) -> tuple[float, ...]:
    return tuple(round(number, 6) for number in (pose.x, pose.y, pose.heading))


async def until_true(bench: Any, drive: str, pause: float) -> None:
    """Send a drive again and again until it is accepted, as the programs do."""
    while await bench.ask(f"[{drive}]".encode()) != f"[{drive[:2]}:True]".encode():
        await bench.clock.pass_by(pause)


@pytest.mark.slow
def test_dead_reckoning_through_the_maze_ends_in_front_of_the_block(on_clock: Any) -> None:
    async def scenario(bench: Any) -> list[bytes]:
        bench.simulator.noise = False
        for leg in LEGS:
            await until_true(bench, leg, 0.05)
        await until_true(bench, "w0:0", 0.05)
        pose = bench.simulator.pose
        assert math.dist((pose.x, pose.y), (66, 36)) < 0.05
        assert pose.heading == pytest.approx(90 - 720)
        assert bench.simulator.distance == pytest.approx(114.0)
        turned = [float(leg[3:]) for leg in LEGS if leg.startswith("r0")]
        assert sum(abs(angle) for angle in turned) == 1080
        assert bench.simulator.time >= 114 / 6 + 1080 / 120
        return [await bench.ask(b"[u0]"), await bench.ask(b"[u1,m0,m1]", 3)]

    ahead, counted = on_clock(scenario)
    assert ahead == b"[u0:2.5]"  # the block
    assert counted.startswith(b"[u1:11.0,")  # higher up, over the block: the wall


@pytest.mark.parametrize("load", [0, 2000])
def test_36_inches_take_6_seconds_of_simulated_time_whatever_the_load(on_clock: Any, load: int) -> None:
    async def scenario(bench: Any) -> None:
        await bench.ask(b"[w0:36]")
        for _ in range(load // 500):
            await bench.ask(b"[" + b",".join([b"u0"] * 500) + b"]", 500)
            await bench.clock.pass_by(1.0)
        await bench.clock.pass_by(5.999 - bench.clock.time())
        assert await bench.ask(b"[w0:0]") == b"[w0:False]"
        await bench.clock.pass_by(6.001 - bench.clock.time())
        assert await bench.ask(b"[w0:0]") == b"[w0:True]"
        began = next(each.time for each in bench.outcomes if each.status is Status.ACCEPTED)
        ended = next(each for each in bench.events if isinstance(each, MovementEnded))
        assert ended.time - began == pytest.approx(6.0, abs=1e-9)
        assert bench.simulator.pose.y == pytest.approx(42)

    on_clock(scenario)


def test_sensors_odometers_and_gyros_are_read_in_mid_motion(on_clock: Any) -> None:
    async def scenario(bench: Any) -> list[bytes]:
        bench.simulator.noise = False
        await bench.ask(b"[w0:12]")
        await bench.clock.pass_by(0.5)
        half = await bench.ask(b"[u0,m0,m2]", 3)
        await bench.clock.pass_by(1.5)
        await bench.ask(b"[r0:90]")
        await bench.clock.pass_by(0.25)
        return [half, await bench.ask(b"[g0,c0]", 2)]

    half, turning = on_clock(scenario)
    assert half == b"[u0:36.0,m0:3.0,m2:0.0]"
    # 30 deg clockwise, and the gyro's drift of 0.1 deg/s in 2.25 s; the compass stood at -180 with a bias
    assert turning == b"[g0:30.225,c0:210.1]"


def test_a_wall_holds_the_robot_but_it_is_busy_for_the_whole_time(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        await bench.ask(b"[w0:72]")
        await bench.clock.pass_by(8.0)
        bench.engine.now()
        assert bench.simulator.pose.y == pytest.approx(45)
        assert await bench.ask(b"[w0:-1]") == b"[w0:False]"
        await bench.clock.pass_by(3.9)
        assert await bench.ask(b"[w0:-1]") == b"[w0:False]"
        await bench.clock.pass_by(0.2)
        assert await bench.ask(b"[w0:-1]") == b"[w0:True]"
        assert await bench.ask(b"[m0]") == b"[m0:72.0]"  # the wheels slipped
        await bench.clock.pass_by(1.0)
        bench.engine.now()
        assert bench.simulator.pose.y == pytest.approx(44)

    on_clock(scenario)


@pytest.mark.quick_cases(2)
@pytest.mark.parametrize(
    ("form", "scale"),
    [
        ("float64", 0.25),  # powers of two: any other makes the simulated times differ by rounding
        ("framed", 1000.0),
        ("float64", 1.0),
        ("float64", 64.0),
        ("framed", 0.3),
        ("framed", 10.0),
    ],
)
def test_the_same_requests_at_the_same_simulated_times_give_the_same_bytes(
    on_clock: Any, scale: float, form: str
) -> None:
    requests = [
        (0.0, "w0:24"),
        (0.5, "u0,u1,g0,c0,i0,m0"),
        (1.25, "w0:1"),
        (2.0, "u0,m2,c0"),
        (0.25, "r0:-450"),
        (0.5, "g0,c0,u0"),
        (1.0, "u1,i0"),
        (4.0, "xx"),
        (0.25, "d0:30"),
        (1.5, "m0,m1,m2,m3,u0,zz"),
    ]

    def rollout(scale: float) -> list[bytes]:
        async def scenario(bench: Any) -> list[bytes]:
            replies = []
            for pause, text in requests:
                await bench.clock.pass_by(pause / scale)
                packet = text.replace(":", "-") if form == "float64" else f"[{text}]"
                replies.append(await bench.ask(packet.encode(), text.count(",") + 1))
            return replies

        replies: list[bytes] = on_clock(scenario, engine={"time_scale": scale})
        return replies

    once = rollout(1.0)
    assert rollout(scale) == once
    assert len(set(once)) > 6


# -- stop --------------------------------------------------------------------------------------


def test_xx_stops_the_robot_where_it_is_and_the_next_drive_is_taken_at_once(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        bench.simulator.noise = False
        await bench.ask(b"[w0:36]")
        await bench.clock.pass_by(1.0)
        assert await bench.ask(b"[xx]") == b"[xx:DRIVE STOP]"
        assert where(bench.simulator.pose) == (6.0, 12.0, 90.0)
        await bench.clock.pass_by(1.0)
        bench.engine.now()
        assert bench.simulator.pose.y == pytest.approx(12.0)
        assert await bench.ask(b"[m0,w0:6]", 2) == b"[m0:6.0,w0:True]"
        await bench.clock.pass_by(1.1)
        bench.engine.now()
        assert bench.simulator.pose.y == pytest.approx(18.0)

    on_clock(scenario)


def test_xx_overtakes_a_drive_that_is_answered_at_its_end_and_those_behind_it(on_clock: Any) -> None:
    async def scenario(bench: Any) -> tuple[bytes, float]:
        await bench.send(b"[w0:36,r0:90]", 0)
        await bench.send(b"[d0:6]", 0)
        await bench.clock.until(lambda: bench.traffic.unanswered == 3)
        await bench.clock.pass_by(1.0)
        await bench.send(b"[xx]", 4)
        reply = await bench.read()
        await bench.clock.pass_by(5.0)
        bench.engine.now()
        return reply, bench.simulator.pose

    reply, pose = on_clock(scenario, link={"answer_at_end": True})
    # the one under way is done, as far as it came; those behind it do not begin
    assert sorted(reply[1:-1].split(b",")) == [
        b"d0:DRIVE STOP",
        b"r0:DRIVE STOP",
        b"w0:True",
        b"xx:DRIVE STOP",
    ]
    assert where(pose) == (6.0, 12.0, 90.0)


def test_xx_while_time_stands_still_leaves_nothing_waiting(on_clock: Any) -> None:
    async def scenario(bench: Any) -> bytes:
        await bench.send(b"[w0:36]", 0)
        await bench.clock.until(lambda: bench.simulator.moving)
        bench.engine.perform(Action(ActionName.PAUSE))
        await bench.send(b"[xx]", 1)
        assert not bench.simulator.moving
        bench.engine.perform(Action(ActionName.RESUME))
        await bench.clock.until(lambda: len(bench.outcomes) == 2)
        await bench.send(b"[d0:6]", 0)
        await bench.clock.until(lambda: bench.simulator.moving)
        await bench.clock.pass_by(1.1)
        reply: bytes = await bench.read()
        return reply

    assert on_clock(scenario, link={"answer_at_end": True}) == b"[w0:True,xx:DRIVE STOP,d0:True]"


@pytest.mark.parametrize("first", [1, SLICE - 1, SLICE, SLICE + 1])
def test_no_drive_sent_before_xx_begins_after_it_however_much_is_queued(on_clock: Any, first: int) -> None:
    async def scenario(bench: Any) -> tuple[bytes, Any]:
        packet = b"[" + b",".join([b"m2"] * first + [b"w0:36", b"xx"]) + b"]"
        reply = await bench.ask(packet, first + 2)
        await bench.clock.pass_by(7.0)
        bench.engine.now()
        return reply, bench.simulator.pose

    reply, pose = on_clock(scenario)
    assert reply.endswith(b",xx:DRIVE STOP]")
    assert where(pose) == (6.0, 6.0, 90.0)


def test_xx_is_a_word_of_packets_only(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        assert bench.simulator.execute("xx").status is Status.UNKNOWN

    on_clock(scenario)


def test_the_path_of_a_state_ends_where_xx_stopped_the_robot(on_clock: Any) -> None:
    async def scenario(bench: Any) -> list[float]:
        reducer = Reducer(checkpoint_of(bench.simulator))
        bench.engine.watch(reducer.apply)
        await bench.ask(b"[w0:36]")
        await bench.clock.pass_by(1.0)
        await bench.ask(b"[xx]")
        await bench.clock.pass_by(3.0)
        state = reducer.at(bench.engine.now())
        assert not state.moving
        return [float(y) for y in state.path[:, 1]]

    path = on_clock(scenario)
    assert (path[0], max(path)) == (6.0, pytest.approx(12.0))


def test_connections_with_open_requests_are_bounded_and_a_stop_comes_through(on_clock: Any) -> None:
    """1,500 of them used up all descriptors."""

    async def scenario(bench: Any) -> None:
        for _ in range(MOST_CONNECTIONS + 10):
            sender = await bench.connect(0)
            await bench.clock.sock_sendall(sender, b"[w0:3]")
        await bench.clock.until(lambda: bench.link.unanswered == MOST_CONNECTIONS + 10)
        assert bench.traffic.connections == MOST_CONNECTIONS
        stopper = await bench.connect(0)
        await bench.clock.sock_sendall(stopper, b"[xx]")
        await bench.clock.until(lambda: any(each.status is Status.STOPPED for each in bench.outcomes))
        assert bench.traffic.connections == MOST_CONNECTIONS
        assert not bench.simulator.moving

    on_clock(scenario, link={"answer_at_end": True})
