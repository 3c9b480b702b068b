"""Replies, who gets them, on which port, and how long a read takes; on a clock that the test moves."""

from __future__ import annotations

import contextlib
import socket
from typing import Any

import pytest

from simmer_tui.config.reply_formats import ReplyFormat
from simmer_tui.links.backend import MOST_COMMANDS, MOST_REFUSED
from simmer_tui.links.packet_link import IDLE_LIMIT, MOST_CONNECTIONS
from simmer_tui.links.protocol.packets import MAX_WAITING, Reply
from simmer_tui.run.events import ActionDone, ActionName
from simmer_tui.sim import Status


async def ended(bench: Any, reader: socket.socket) -> bytes:
    """The result of a read that must be over by now."""
    data: bytes = await bench.rest(reader)
    return data


# -- reads -----------------------------------------------------------------------------------


def test_a_read_with_nothing_to_fetch_ends_without_bytes_after_a_60th_of_a_second(on_clock: Any) -> None:
    async def scenario(bench: Any) -> bytes:
        reader = await bench.begin_read()
        await bench.clock.pass_by(0.016)
        assert bench.traffic.reads == 1
        await bench.clock.pass_by(0.001)
        assert not bench.traffic.reads
        return await ended(bench, reader)

    assert on_clock(scenario) == b""


def test_a_tight_loop_reads_sixty_times_a_second_at_most(on_clock: Any) -> None:
    async def scenario(bench: Any) -> int:
        reads = 0
        while bench.clock.time() < 1.0:
            reader = await bench.begin_read()
            while bench.traffic.reads:
                await bench.clock.pass_by(0.0005)
            assert await ended(bench, reader) == b""
            reads += 1
        return reads

    assert 50 <= on_clock(scenario) <= 60


def test_a_read_that_came_before_the_request_does_not_take_its_reply(on_clock: Any) -> None:
    """It may be a connection that never reads."""

    async def scenario(bench: Any) -> tuple[bytes, bytes]:
        early = await bench.begin_read()
        await bench.clock.pass_by(0.01)
        await bench.send(b"[m0]", 1)
        reply = await bench.read()
        await bench.clock.pass_by(0.01)
        return reply, await ended(bench, early)

    assert on_clock(scenario) == (b"[m0:0.0]", b"")


def test_the_newest_of_two_reads_that_wait_gets_the_reply(on_clock: Any) -> None:
    async def scenario(bench: Any) -> tuple[bytes, bytes]:
        sender = await bench.connect(0)
        await bench.clock.sock_sendall(sender, b"[m0")
        await bench.clock.until(lambda: bench.traffic.speaking)
        first, second = await bench.begin_read(), await bench.begin_read()
        await bench.clock.sock_sendall(sender, b"]")
        reply = await bench.rest(second)
        await bench.clock.pass_by(0.1)
        return reply, await ended(bench, first)

    assert on_clock(scenario) == (b"[m0:0.0]", b"")


def test_a_read_waits_for_a_packet_that_is_still_coming_in(on_clock: Any) -> None:
    async def scenario(bench: Any) -> bytes:
        sender = await bench.connect(0)
        await bench.clock.sock_sendall(sender, b"[m0,")
        await bench.clock.until(lambda: bench.link.busy and bench.traffic.speaking)
        reader = await bench.begin_read()
        await bench.clock.pass_by(0.09)
        assert bench.traffic.reads == 1
        await bench.clock.sock_sendall(sender, b"m1]")
        reply: bytes = await bench.rest(reader)
        return reply

    assert on_clock(scenario) == b"[m0:0.0,m1:0.0]"


def test_a_read_waits_no_longer_than_a_tenth_of_a_second_for_a_packet_that_stalls(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        sender = await bench.connect(0)
        await bench.clock.sock_sendall(sender, b"[m0,")
        await bench.clock.until(lambda: bench.traffic.speaking)
        reader = await bench.begin_read()
        await bench.clock.pass_by(0.099)
        assert bench.traffic.reads == 1
        await bench.clock.pass_by(0.002)
        assert await ended(bench, reader) == b""
        another = await bench.begin_read()  # nobody waits for it a second time
        await bench.clock.pass_by(0.017)
        assert await ended(bench, another) == b""

    on_clock(scenario)


def test_what_was_sent_on_several_connections_before_a_read_is_merged(on_clock: Any) -> None:
    async def scenario(bench: Any) -> bytes:
        senders = [await bench.connect(0) for _ in range(3)]
        for sender, packet in zip(senders, (b"[m0]", b"[m1]", b"[m2]"), strict=True):
            await bench.clock.sock_sendall(sender, packet)
        reply: bytes = await bench.read()
        return reply

    assert sorted(on_clock(scenario)[1:-1].split(b",")) == [b"m0:0.0", b"m1:0.0", b"m2:0.0"]


def test_a_read_waits_while_a_drive_is_answered_at_its_end(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        await bench.send(b"[w0:6]", 0)
        await bench.clock.until(lambda: bench.simulator.moving)
        reader = await bench.begin_read()
        await bench.clock.pass_by(0.09)
        assert bench.traffic.reads == 1
        await bench.clock.pass_by(0.02)
        assert await ended(bench, reader) == b""
        await bench.clock.pass_by(0.88)
        late = await bench.begin_read()
        await bench.clock.pass_by(0.05)
        assert await bench.rest(late) == b"[w0:True]"
        assert not bench.simulator.moving

    on_clock(scenario, link={"answer_at_end": True})


@pytest.mark.parametrize("how", ["closes", "breaks off"])
def test_a_reader_that_goes_while_it_waits_takes_no_reply_with_it(on_clock: Any, how: str) -> None:
    async def scenario(bench: Any) -> bytes:
        sender = await bench.connect(0)
        await bench.clock.sock_sendall(sender, b"[m0")
        await bench.clock.until(lambda: bench.traffic.speaking)
        reader = await bench.begin_read()
        if how == "closes":
            reader.close()
        else:
            await bench.clock.sock_sendall(reader, b"[u0]")
            bench.reset(reader)
        await bench.clock.sock_sendall(sender, b"]")
        await bench.clock.until(lambda: bench.outcomes and not bench.traffic.reads)
        sender.close()
        reply: bytes = await bench.read()
        return reply

    assert on_clock(scenario) == b"[m0:0.0]"


def test_a_reader_that_has_closed_its_sending_side_is_answered(on_clock: Any) -> None:
    async def scenario(bench: Any) -> bytes:
        await bench.send(b"[m0]", 1)
        reader = await bench.connect(1)
        reader.shutdown(socket.SHUT_WR)
        reply: bytes = await bench.rest(reader)
        return reply

    assert on_clock(scenario) == b"[m0:0.0]"


def test_what_a_reader_sends_is_ignored_and_does_not_break_its_reply(on_clock: Any) -> None:
    async def scenario(bench: Any) -> tuple[bytes, bytes]:
        reader = await bench.begin_read()
        await bench.clock.sock_sendall(reader, b"[u0]")
        await bench.clock.pass_by(0.02)
        nothing = await ended(bench, reader)
        return nothing, await bench.ask(b"[m0]")

    assert on_clock(scenario) == (b"", b"[m0:0.0]")


def test_beyond_a_thousand_replies_the_oldest_go_and_a_line_says_so(on_clock: Any) -> None:
    async def scenario(bench: Any) -> bytes:
        for number in range(3):
            code = b"m%d" % number
            await bench.send(b"[" + b",".join([code] * 400) + b"]", 400)
        await bench.clock.pass_by(1.1)
        assert [text for text in bench.notices if "dropped" in text] == [
            f"200 replies dropped: nobody reads them on port {bench.ports[1].port}"
        ]
        reply: bytes = await bench.read()
        return reply

    items = on_clock(scenario)[1:-1].split(b",")
    assert len(items) == MAX_WAITING
    assert items[:200] == [b"m0:0.0"] * 200
    assert items[-400:] == [b"m2:0.0"] * 400


# -- senders that stay -------------------------------------------------------------------------


def test_a_sender_that_stays_gets_its_reply_after_50_ms_and_then_packet_after_packet(on_clock: Any) -> None:
    async def scenario(bench: Any) -> list[bytes]:
        sender = await bench.stay(b"[m0]", 1)
        await bench.clock.pass_by(0.049)
        assert len(bench.link.mailbox) == 1
        await bench.clock.pass_by(0.002)
        replies = [await bench.clock.sock_recv(sender, 1024)]
        for packet in (b"[w0:3]", b"[w0:0]", b"[m0,m1]"):
            await bench.clock.sock_sendall(sender, packet)
            replies.append(await bench.clock.sock_recv(sender, 1024))
        assert not bench.link.mailbox
        return replies

    assert on_clock(scenario) == [b"[m0:0.0]", b"[w0:True]", b"[w0:False]", b"[m0:0.0,m1:0.0]"]


def test_a_sender_that_stays_and_is_read_from_on_the_other_port_gets_nothing_on_its_own(
    on_clock: Any,
) -> None:
    async def scenario(bench: Any) -> None:
        sender = await bench.stay(b"[m0]", 1)
        for _ in range(3):
            await bench.clock.pass_by(0.04)
            assert await bench.read() == b"[m0:0.0]"
            await bench.clock.sock_sendall(sender, b"[m0]")
            await bench.clock.until(lambda: bench.link.mailbox)
        with pytest.raises(BlockingIOError):
            sender.recv(1)

    on_clock(scenario)


def test_several_replies_that_a_sender_waits_for_come_as_one_message(on_clock: Any) -> None:
    async def scenario(bench: Any) -> tuple[bytes, bytes]:
        sender = await bench.stay(b"[m0][m1]", 2)
        await bench.send(b"[m2]", 1)  # another program's, to be read on the other port
        await bench.clock.pass_by(0.06)
        return await bench.clock.sock_recv(sender, 1024), await bench.read()

    assert on_clock(scenario) == (b"[m0:0.0,m1:0.0]", b"[m2:0.0]")


def test_a_sender_that_stays_and_then_closes_its_sending_side_is_still_answered(on_clock: Any) -> None:
    async def scenario(bench: Any) -> list[bytes]:
        sender = await bench.stay(b"[m0]", 1)
        await bench.clock.pass_by(0.06)
        first = await bench.clock.sock_recv(sender, 1024)
        await bench.clock.sock_sendall(sender, b"[w0:6]")
        sender.shutdown(socket.SHUT_WR)
        await bench.clock.until(lambda: bench.simulator.moving)
        await bench.clock.pass_by(1.1)
        return [first, await bench.rest(sender)]

    replies = on_clock(scenario, link={"answer_at_end": True})
    assert replies == [b"[m0:0.0]", b"[w0:True]"]


def test_replies_to_one_who_read_on_its_own_connection_and_left_are_nobody_elses(on_clock: Any) -> None:
    async def scenario(bench: Any) -> bytes:
        sender = await bench.stay(b"[m0]", 1)
        await bench.clock.pass_by(0.06)
        assert await bench.clock.sock_recv(sender, 1024) == b"[m0:0.0]"
        await bench.clock.sock_sendall(sender, b"[w0:6]")
        await bench.clock.until(lambda: bench.simulator.moving)
        bench.reset(sender)
        await bench.clock.until(lambda: not bench.traffic.connections)
        await bench.clock.pass_by(1.1)
        assert bench.outcomes[-1].command.text == "w0:6"
        return bytes(await bench.ask(b"[m2]"))

    assert on_clock(scenario, link={"answer_at_end": True}) == b"[m2:0.0]"


@pytest.mark.slow
def test_a_sender_that_does_not_read_what_it_gets_is_dropped(on_clock: Any) -> None:
    async def scenario(bench: Any) -> bytes:
        packet = b"[" + b",".join([b"m0"] * 1000) + b"]"
        sender = await bench.stay(packet, 1000)
        await bench.clock.pass_by(0.06)
        while bench.traffic.connections:
            try:
                await bench.clock.sock_sendall(sender, packet)
            except (BrokenPipeError, ConnectionResetError):
                break
        await bench.clock.until(lambda: not bench.traffic.connections)
        assert any("does not read" in text for text in bench.notices)
        reply: bytes = await bench.ask(b"[m1]")
        return reply

    assert on_clock(scenario) == b"[m1:0.0]"


# -- silence and crowds ------------------------------------------------------------------------


def test_a_silent_connection_is_told_of_and_closed_in_the_end(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        silent = await bench.connect(0)
        await bench.clock.until(lambda: bench.traffic.connections)
        await bench.clock.pass_by(1.1)
        assert "has connected and sent nothing yet" in bench.notices[-1]
        assert await bench.ask(b"[m0]") == b"[m0:0.0]"
        await bench.clock.pass_by(IDLE_LIMIT)
        assert await bench.clock.sock_recv(silent, 1) == b""
        assert any("it has sent nothing for 600 s" in text for text in bench.notices)

    on_clock(scenario)


def test_when_there_are_too_many_connections_the_one_that_was_silent_longest_goes(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        oldest = await bench.connect(0)
        await bench.clock.until(lambda: bench.traffic.connections)
        await bench.clock.pass_by(0.2)
        for _ in range(MOST_CONNECTIONS - 1):
            await bench.connect(0)
        await bench.clock.until(lambda: bench.traffic.connections == MOST_CONNECTIONS)
        await bench.clock.pass_by(0.1)
        assert await bench.ask(b"[m0]") == b"[m0:0.0]"
        assert await bench.clock.sock_recv(oldest, 1) == b""
        assert any(f"{MOST_CONNECTIONS} connections at once are the most" in text for text in bench.notices)

    on_clock(scenario)


# The second crowd is a multiple of the connections that are taken from the system at once.
@pytest.mark.parametrize("surplus", [199, 191])
def test_in_a_crowd_a_request_goes_first_and_the_newest_silent_connections_stay(
    on_clock: Any, surplus: int
) -> None:
    async def scenario(bench: Any) -> None:
        *crowd, asker = [bench.connect_now(0) for _ in range(MOST_CONNECTIONS + surplus + 1)]
        asker.sendall(b"[m0]")
        reader = bench.connect_now(1)
        await bench.clock.until(lambda: bench.outcomes)
        assert bench.traffic.connections < MOST_CONNECTIONS / 2
        with pytest.raises(BlockingIOError):  # nor has time been spent on closing
            crowd[40].recv(1)
        assert await bench.rest(reader) == b"[m0:0.0]"
        await bench.clock.pass_by(1.5)
        assert bench.traffic.connections == MOST_CONNECTIONS
        assert await bench.clock.sock_recv(crowd[0], 1) == b""
        with pytest.raises(BlockingIOError):
            crowd[-1].recv(1)
        closed = [text for text in bench.notices if "connections at once are the most" in text]
        assert len(closed) == 2
        assert closed[1].startswith(f"{surplus} more connections closed")

    on_clock(scenario)


def test_when_too_many_reads_wait_the_oldest_ends(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        oldest = await bench.begin_read()
        for _ in range(MOST_CONNECTIONS):
            await bench.connect(1)
        assert await bench.clock.sock_recv(oldest, 1) == b""
        assert bench.traffic.reads == MOST_CONNECTIONS

    on_clock(scenario)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize(
    ("engine", "link"),
    [({"step_time": 1.0}, {}), ({"step_time": 1.0, "timed": False}, {}), ({}, {"answer_at_end": True})],
)
def test_a_stop_goes_before_any_number_of_drives(on_clock: Any, engine: Any, link: Any) -> None:
    """Whatever the drives wait for; those beyond a thousand are answered busy at once, and that is told."""

    async def scenario(bench: Any) -> None:
        flood = await bench.connect(0)
        await bench.clock.sock_sendall(flood, b"[w0:3]" * 1200)
        await bench.clock.until(lambda: len(bench.busy) >= 1200 - MOST_COMMANDS - 5)
        begun = len(bench.movements)
        assert begun < 5
        stopper = await bench.connect(0)
        await bench.clock.sock_sendall(stopper, b"[xx]")
        await bench.clock.until(lambda: any(each.status is Status.STOPPED for each in bench.outcomes))
        assert not bench.simulator.moving
        await bench.clock.pass_by(20.0)
        assert len(bench.movements) == begun, "no drive from before the stop begins after it"
        assert sum("1000 commands wait already" in text for text in bench.notices) == 1

    on_clock(scenario, engine=engine, link=link)


class Users:
    """The users behind connections, as a test says; no process is known."""

    now, of_run = 1000, None

    def user(self, sock: socket.socket, peer: str) -> int:
        return self.now

    def seek(self, sock: socket.socket, peer: str, known: Any, found: Any) -> None:
        found(None)


@pytest.mark.parametrize("user", [1000, 1001])
def test_where_all_users_are_let_in_one_users_flood_makes_only_that_one_busy(
    on_clock: Any, user: int
) -> None:
    users = Users()

    async def scenario(bench: Any) -> None:
        flood = await bench.connect(0)
        await bench.clock.sock_sendall(flood, b"[w0:3]" * 2200)
        await bench.clock.until(lambda: len(bench.busy) >= 2200 - MOST_COMMANDS - 5)
        before, users.now = len(bench.busy), user
        other = await bench.connect(0)
        await bench.clock.sock_sendall(other, b"[m0]")
        await bench.clock.until(lambda: bench.traffic.speaking == 2)
        await bench.clock.pass_by(5.0)
        assert len(bench.busy) - before == (user == 1000)

    on_clock(scenario, engine={"step_time": 1.0}, link={"processes": users, "any_user": True})


def test_bytes_that_wait_are_bounded_as_commands_are(on_clock: Any) -> None:
    long = b"[" + b",".join([b"w0:" + b"1" * 250] * 100) + b"]"

    async def scenario(bench: Any) -> None:
        flood = await bench.connect(0)
        await bench.clock.sock_sendall(flood, b"[m0]" + long * 5)
        await bench.clock.until(lambda: len(bench.busy) == 200)
        assert any("65536 bytes wait already" in text for text in bench.notices)

    on_clock(scenario, engine={"step_time": 1.0})


def test_a_flood_of_stops_is_bounded_too(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        flood = await bench.connect(0)
        await bench.clock.sock_sendall(flood, b"[w0:3][xx][xx,w0:1]" * 2000)
        await bench.clock.until(lambda: len(bench.busy) > 2000)
        assert not bench.simulator.moving
        stops = [each for each in bench.outcomes if each.status is Status.STOPPED]
        assert len(stops) <= MOST_COMMANDS, "what stops nothing waits for its turn as others do"

    on_clock(scenario, engine={"step_time": 1.0})


def test_one_that_never_waits_for_replies_is_dropped_in_the_end(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        flood = await bench.connect(0)
        with contextlib.suppress(ConnectionError):
            await bench.clock.sock_sendall(flood, b"[w0:3]" + b"[m0]" * (MOST_REFUSED + 4000))
        await bench.clock.until(lambda: bench.traffic.connections == 0)
        stopped = [each.action.name for each in bench.events if isinstance(each, ActionDone)]
        assert stopped == [ActionName.STOP], "a stop may be among what is not read any more"
        assert any("does not read its replies" in text for text in bench.notices)
        next_one = await bench.connect(0)
        await bench.clock.sock_sendall(next_one, b"[m1]")
        next_one.close()
        await bench.clock.until(lambda: bench.outcomes[-1].command.text == "m1")
        assert bench.outcomes[-1].status is Status.READING, "what the other had waiting counts no more"

    on_clock(scenario, engine={"step_time": 1.0})


def test_a_client_is_told_of_once_and_again_when_nothing_comes_any_more(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        for _ in range(3):
            await bench.ask(b"[m0]")
            await bench.clock.pass_by(4.0)
        assert bench.notices == ["client 127.0.0.1 sends packets"]
        await bench.clock.pass_by(1.5)
        assert bench.notices[1:] == ["client 127.0.0.1 gone after 3 requests: silent for 5 s"]
        assert bench.left == 1
        await bench.ask(b"[m0]")
        assert bench.notices[2:] == ["client 127.0.0.1 sends packets"]

    on_clock(scenario, link={"idle": 5.0})


def test_who_stays_connected_or_still_reads_has_not_left(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        sender = await bench.stay(b"[m0]", 1)
        await bench.clock.pass_by(20.0)
        assert bench.left == 0
        sender.close()
        await bench.clock.until(lambda: not bench.traffic.connections)
        for _ in range(5):
            await bench.clock.pass_by(4.0)
            await bench.begin_read()
            await bench.clock.pass_by(0.02)
        assert bench.left == 0
        await bench.clock.pass_by(5.1)
        assert bench.left == 1

    on_clock(scenario, link={"idle": 5.0})


def test_what_waits_for_a_program_that_has_left_is_dropped(on_clock: Any) -> None:
    async def scenario(bench: Any) -> list[bytes]:
        await bench.send(b"[m0,m1]", 2)
        await bench.clock.pass_by(4.9)
        kept = await bench.read()
        await bench.send(b"[m0,m1]", 2)
        await bench.clock.pass_by(5.1)
        assert bench.left == 1
        replies = [kept, await bench.ask(b"[m2]")]
        assert "2 replies dropped: another program begins" in bench.notices
        return replies

    assert on_clock(scenario, link={"idle": 5.0}) == [b"[m0:0.0,m1:0.0]", b"[m2:0.0]"]


def test_connections_without_a_request_make_no_client(on_clock: Any) -> None:
    async def scenario(bench: Any) -> None:
        (await bench.connect(0)).close()
        await bench.begin_read()
        await bench.clock.pass_by(20.0)
        assert bench.left == 0
        assert not [text for text in bench.notices if "talks" in text or "left" in text]

    on_clock(scenario)


# -- replies too great for the system to take at once ------------------------------------------

GREAT = Reply(ReplyFormat.FRAMED, (b"x" * 16_000,) * 500)


def test_a_great_reply_arrives_whole(on_clock: Any) -> None:
    async def scenario(bench: Any) -> bytes:
        bench.link.replies.post(GREAT)
        reply: bytes = await bench.read()
        assert not bench.traffic.unread
        return reply

    assert on_clock(scenario) == GREAT.message()


def test_one_who_comes_for_a_reply_and_does_not_read_it_is_dropped(on_clock: Any) -> None:
    async def scenario(bench: Any) -> bytes:
        bench.link.replies.post(GREAT)
        await bench.connect(1)
        await bench.clock.until(lambda: bench.traffic.unread)
        await bench.clock.pass_by(9.9)
        assert bench.traffic.unread
        await bench.clock.pass_by(0.2)
        assert not bench.traffic.unread
        reply: bytes = await bench.ask(b"[m0]")
        return reply

    assert on_clock(scenario) == b"[m0:0.0]"
