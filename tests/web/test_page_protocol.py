"""The page's port: who is let in, what viewers get, and what they may do, over real sockets."""

from __future__ import annotations

import contextlib
import json
import re
import socket
import subprocess
import sys
import threading
import time
from http.client import HTTPConnection, HTTPResponse

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException

from simmer_tui.live.operating import robot_operator
from simmer_tui.report.player import RecordingEncoder
from simmer_tui.report.verdict import Outcome, Verdict
from simmer_tui.run.events import (
    Action,
    ActionDone,
    ActionName,
    CommandResult,
    Event,
    MovementEnded,
    MovementPlanned,
    Notice,
    NoticeKind,
)
from simmer_tui.web import page_server, run_frames, viewer
from tests.links.test_access import as_nobody, two_users
from tests.web.pages import SECONDS, PageRun, PageViewer, Recorded, page_run


def got(run: PageRun, path: str = "/", host: str = "", method: str = "GET") -> tuple[HTTPResponse, str]:
    """The answer to a request, and its text."""
    connection = HTTPConnection("127.0.0.1", run.port, timeout=SECONDS)
    connection.request(method, path, headers={"Host": host or run.host})
    response = connection.getresponse()
    text = response.read().decode()
    connection.close()
    return response, text


# -- the page ----------------------------------------------------------------------------------


def test_the_page_asks_no_other_host_for_anything() -> None:
    with page_run() as run:
        response, text = got(run)
    assert response.status == 200
    policy = response.headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert f"connect-src 'self' ws://{run.host} wss://{run.host};" in policy
    assert "frame-ancestors 'none'" in policy
    assert response.headers["X-Frame-Options"] == "DENY"
    assert not re.search(r"(src|href)=|@import|url\((?!#)", text.replace("http://www.w3.org", ""))


@pytest.mark.quick_cases(3)
@pytest.mark.parametrize(
    "host", ["attacker.example", "localhost.attacker.example:80", "", "a b", "[::1", "x" * 300]
)
def test_a_name_that_is_not_ours_gets_nothing(host: str) -> None:
    with page_run() as run, socket.create_connection(("127.0.0.1", run.port), SECONDS) as connection:
        connection.sendall(f"GET / HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
        answer = connection.makefile("rb").read()
    assert b"403" in answer.partition(b"\r\n")[0]
    assert b"<script" not in answer


@pytest.mark.parametrize("host", ["localhost:9999", "127.0.0.1", "[::1]:80", "LOCALHOST"])
def test_a_tunnel_may_end_on_any_port_of_this_machine(host: str) -> None:
    with page_run() as run:
        assert got(run, host=host)[0].status == 200


def test_other_paths_and_methods_are_refused_in_words() -> None:
    with page_run() as run:
        response, text = got(run, "/favicon.ico")
        assert (response.status, text) == (404, "there is one page here: /\n")
        with contextlib.suppress(OSError):  # older versions of websockets just end
            assert got(run, method="POST")[0].status in (400, 405)


# -- viewers -----------------------------------------------------------------------------------


def test_viewers_get_the_run_so_far_and_then_what_is_new() -> None:
    with page_run() as run:
        run.send("u1", "d1-3", "u1")
        first = Recorded()
        with PageViewer(run) as early:
            early.wait(lambda message: "run" in message and not first.take(message))
            run.send("r1-40", "zz", "d1-2", "u2")
            early.wait(lambda message: first.take(message) or len(first.rows["commands"]) == 3)
            with PageViewer(run) as late:
                second = Recorded()
                late.wait(lambda message: second.take(message) or "run" in message)
                run.send("d1-1", "u1")
                for each, recorded in ((early, first), (late, second)):
                    each.wait(lambda message: recorded.take(message) or len(recorded.rows["readings"]) == 4)  # noqa: B023
    assert first.frames == second.frames
    assert first.rows == second.rows
    assert [text for _, text in first.rows["commands"]] == ["d1-3", "r1-40", "d1-2", "d1-1"]
    assert [mark[1] for mark in first.rows["marks"]] == ["refused"]


def test_what_viewers_have_is_what_the_reports_player_has() -> None:
    with page_run(motion__motion="timed", motion__time_scale=50.0) as run, PageViewer(run) as watching:
        seen = Recorded()
        run.send("d1-3", "u1", "r1-30")
        run.server.call(run.server.engine.perform, Action(ActionName.RESET))
        run.wait(lambda event: isinstance(event, ActionDone))
        run.send("d1-2", "u1")
        watching.wait(lambda message: seen.take(message) or seen.has("d1-2", readings=2))
        live = run.page._frames._recording._recording
        live.update()
        whole = Recorded()
        whole.take(json.loads(json.dumps({"run": {}, "news": RecordingEncoder(live).news()})))
    assert seen.frames == whole.frames
    assert seen.rows == whole.rows


def test_in_timed_motion_poses_come_while_the_robot_drives() -> None:
    with page_run(motion__motion="timed") as run, PageViewer(run) as watching:
        seen = Recorded()
        run.operate("d1-6")
        watching.wait(lambda message: seen.take(message) or (message.get("news") or {}).get("doing"))
        begun = seen.frames[-1]
        watching.wait(lambda message: seen.take(message) or seen.frames[-1][1] > begun[1] + 20)
        assert watching.messages[-1]["news"]["doing"][1] == "d1-6"
        assert not seen.rows["commands"], "it has not ended"


def test_no_time_is_shown_of_which_not_all_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_server, "_HEARTBEAT", 0.05)
    told, go_on = threading.Event(), threading.Event()
    begins: list[int] = []

    def hold(event: Event) -> None:
        if isinstance(event, MovementPlanned):
            begins.append(round(1000 * event.time))
            told.set()
            go_on.wait(SECONDS)

    with page_run(motion__motion="timed", first=hold) as run, PageViewer(run) as watching:
        watching.wait(lambda message: "run" in message)
        run.operate("d1-6")
        assert told.wait(SECONDS)
        ends = [watching.wait(lambda message: message.get("news"))["news"]["end"] for _ in range(10)]
        go_on.set()
        assert max(ends) <= begins[0] + 1
        seen = Recorded()
        watching.wait(lambda message: seen.take(message) or (message.get("news") or {}).get("doing"))


def test_a_page_that_lost_events_restarts_and_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_frames, "MOST_WAITING_EVENTS", 10)
    with page_run() as run, PageViewer(run) as watching:
        watching.wait(lambda message: "run" in message)
        held = threading.Event()
        run.page._call(held.wait, SECONDS)  # the page's thread is elsewhere
        run.send(*["u1"] * 20, "d1-3")
        held.set()
        run.send("d1-1")
        seen = Recorded()
        watching.wait(lambda message: "run" in message and not seen.take(message))
        run.send("d1-2")
        watching.wait(lambda message: seen.take(message) or seen.has("d1-2"))
        assert seen.frames[-1][1] == round(run.server.simulator.pose.x * 100)


# -- who ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("origin", ["http://attacker.example", "http://localhost:1", "null", None])
def test_a_page_of_another_origin_is_not_let_in(origin: str | None) -> None:
    with page_run(web__control=True) as run:
        with pytest.raises(InvalidStatus) as refused:
            PageViewer(run, origin=origin)
        assert refused.value.response.status_code == 403
        assert not run.server.simulator.commands


def test_a_name_that_was_bound_to_this_machine_is_not_let_in() -> None:
    with page_run(web__control=True) as run, upgraded(run, "rebound.example") as asking:
        assert b"403" in asking.makefile("rb").readline()


def test_viewers_come_in_by_one_path_alone() -> None:
    with page_run() as run, upgraded(run, run.host, "/anything") as asking:
        assert b"404" in asking.makefile("rb").readline()


def upgraded(run: PageRun, host: str, path: str = "/live") -> socket.socket:
    """A connection that asks as a browser does that was led to a page at this host."""
    made = socket.create_connection(("127.0.0.1", run.port), SECONDS)
    key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13"
    upgrade = f"Upgrade: websocket\r\nConnection: Upgrade\r\n{key}"
    made.sendall(
        f"GET {path} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n{upgrade}\r\n\r\n".encode()
    )
    return made


def test_with_a_host_each_link_has_a_word_of_128_bits() -> None:
    with page_run(web__host="127.0.0.1", web__control=True) as run:
        words = run.word("look"), run.word("drive")
        assert len(set(words)) == 2
        assert all(len(word) >= 22 for word in words)  # of 6 bits each
        for word, role in zip(words, ("look", "drive"), strict=True):
            with PageViewer(run, word) as watching:
                assert watching.next()["role"] == role
        assert all(link.role == role for link, role in zip(run.page.links, ("look", "drive"), strict=True))
        assert not any(word in str(event) for event in run.told for word in words)


def test_a_guessed_word_costs_a_second_and_nobody_else_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_server, "_WRONG_WORD", 0.4)
    with page_run(web__host="127.0.0.1", web__control=True) as run:
        begun = time.monotonic()
        with PageViewer(run, "guessed" * 4) as guessing:
            guessing.say(word=run.word("drive"))  # a second word is not looked at
            guessing.say(line="d1-3")
            with PageViewer(run, run.word("look")) as watching:
                watching.wait(lambda message: "run" in message)
            with pytest.raises(ConnectionClosed) as ended:
                guessing.next()
            assert time.monotonic() - begun >= 0.4
            assert ended.value.rcvd is not None
            assert ended.value.rcvd.code == 4401
        assert not run.server.simulator.commands


def test_who_may_only_look_drives_nothing() -> None:
    with page_run() as run, PageViewer(run) as watching:
        assert watching.next()["role"] == "look"
        for _ in range(3):
            watching.say(line="d1-3", key="forward")
        run.send("u1")
        watching.wait(lambda message: (message.get("news") or {}).get("readings", {}).get("t"))
        assert run.server.simulator.commands == 1


@two_users
def test_a_browser_of_another_user_is_turned_away() -> None:
    with page_run(server__any_user=True) as run:
        assert as_nobody(run.port, f"GET / HTTP/1.1\r\nHost: {run.host}\r\n\r\n") == "got b''"
        told = run.wait(lambda event: isinstance(event, Notice) and event.kind is NoticeKind.TURNED_AWAY)
        assert isinstance(told, Notice)
        assert told.text.endswith(
            "this robot is somebody else's; --web-host ADDRESS lets others look, by a link"
        )
        assert got(run)[0].status == 200, "we are let in ourselves"


@two_users
def test_with_a_host_another_user_needs_the_word_alone() -> None:
    with page_run(web__host="127.0.0.1") as run:
        assert as_nobody(run.port, f"GET / HTTP/1.1\r\nHost: {run.host}\r\n\r\n").startswith(
            "got b'HTTP/1.1 200"
        )


# -- driving -----------------------------------------------------------------------------------


def test_lines_and_keys_go_the_way_of_the_consoles() -> None:
    with page_run(web__control=True) as run, PageViewer(run) as driving:
        role = driving.next()
        assert role["role"] == "drive"
        assert role["keys"]["w"] == ["forward", 0]
        assert role["keys"]["W"] == ["forward", 1]
        assert role["keys"]["shift+ArrowUp"] == ["forward", 1]
        driving.say(line="d1-3")
        moved = run.wait(lambda event: isinstance(event, MovementEnded))
        assert isinstance(moved, MovementEnded)
        assert moved.command.source == "console"
        driving.say(key="turn_left", fine=True)
        turned = run.wait(lambda event: isinstance(event, MovementEnded) and event is not moved)
        assert isinstance(turned, MovementEnded)
        assert (turned.command.source, turned.command.text) == ("keys", "r1-3")
        driving.say(line=":teleport 30 40 90")
        done = run.wait(lambda event: isinstance(event, ActionDone))
        assert isinstance(done, ActionDone)
        assert done.pose.heading == 90
        driving.say(line="d1-nonsense")
        assert "nonsense" in driving.wait(lambda message: "told" in message)["told"]
        driving.say(key="poll")
        run.wait(lambda event: isinstance(event, CommandResult) and event.reading is not None)


def test_a_page_far_ahead_of_its_answers_is_told_and_can_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_operator, "MOST_UNANSWERED", 3)
    with page_run(web__control=True) as run, PageViewer(run) as driving:
        driving.say(line=":pause")
        for _ in range(4):
            driving.say(line="d1-3")
        assert "d1-3: dropped, 3 commands wait" in driving.wait(lambda message: "told" in message)["told"]
        driving.say(line=":stop")
        run.wait(lambda event: isinstance(event, ActionDone) and event.action.name is ActionName.STOP)
        driving.say(line=":resume")
        run.wait(lambda event: isinstance(event, CommandResult))


@pytest.mark.quick_cases(3)
@pytest.mark.parametrize(
    "line", [":quit", ":save /tmp/x", ":log auto", ":shot x.svg", ":robot /dev/ttyS0", ":report", ":web"]
)
def test_programs_and_files_are_not_for_pages(line: str) -> None:
    with page_run(web__control=True) as run, PageViewer(run) as driving:
        driving.say(line=line)
        told = driving.wait(lambda message: "told" in message)["told"]
        assert "is for the simulator's own screen" in told
        assert run.server.running


@pytest.mark.quick_cases(3)
@pytest.mark.parametrize("data", ["{", "[]", '{"line": 3}', '{"word": {"a": 1}}', "x" * 3000, b"\x00\xff"])
def test_malformed_messages_end_only_their_sender(data: str | bytes) -> None:
    with page_run(web__control=True) as run, PageViewer(run) as other:
        with PageViewer(run) as broken:
            broken.socket.send(data)
            with contextlib.suppress(ConnectionClosed):  # it may be gone already
                broken.socket.send(json.dumps({"line": "u1"}))
        run.send("d1-1")
        other.wait(lambda message: (message.get("news") or {}).get("commands"))


# -- those who misbehave -----------------------------------------------------------------------


@pytest.mark.slow
def test_a_viewer_that_does_not_read_is_dropped_and_holds_up_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer, "STALLED", 0.3)
    monkeypatch.setattr(viewer, "SEND_BUFFER", 4096)
    with page_run() as run, PageViewer(run) as other, upgraded(run, run.host) as deaf:
        other.wait(lambda message: "run" in message)
        deaf.sendall(b"\x81\x82\0\0\0\0{}")
        seen = Recorded()
        viewers = [len(run.page._viewers)]
        until = time.monotonic() + SECONDS
        while viewers[-1] != 1 or 2 not in viewers:
            assert time.monotonic() < until
            run.send(*["u1"] * 100)
            other.wait(lambda message: seen.take(message) or message["news"]["readings"]["t"])
            viewers.append(len(run.page._viewers))


def test_who_says_nothing_keeps_nobody_out() -> None:
    """A newcomer whose request takes some milliseconds stays, though others come in a loop."""
    with page_run() as run, contextlib.ExitStack() as stack:

        def come() -> socket.socket:
            return stack.enter_context(socket.create_connection(("127.0.0.1", run.port), SECONDS))

        def is_served(sock: socket.socket) -> bool:
            sock.sendall(f"GET / HTTP/1.1\r\nHost: {run.host}\r\n\r\n".encode())
            return sock.recv(12) == b"HTTP/1.1 200"

        oldest, *_ = [come() for _ in range(80)]
        newcomer = come()
        for _ in range(100):
            come()
        assert is_served(come()), "all before it have been accepted"
        assert oldest.recv(1) == b"", "the oldest goes first"
        assert is_served(newcomer)


def test_what_a_page_has_in_its_queue_goes_with_it() -> None:
    with page_run(web__control=True) as run:
        with PageViewer(run) as viewer:
            viewer.wait(lambda message: "run" in message)
            run.server.call(run.server.engine.perform, Action(ActionName.PAUSE))
            for line in ("d1-1", "d1-1", ":nothing"):
                viewer.socket.send(json.dumps({"line": line}))
            viewer.wait(lambda message: "told" in message)
        while run.page._viewers:
            time.sleep(0.001)
        run.server.call(run.server.engine.perform, Action(ActionName.RESUME))
        run.send("u1", "u1")
        assert {event.command.code for event in run.told if isinstance(event, CommandResult)} == {"u1"}


FLOOD = """
import socket, sys, threading
place = ("127.0.0.1", int(sys.argv[1]))
silent = [socket.create_connection(place) for _ in range(40)]
def flood():
    while True:
        try:
            with socket.create_connection(place) as sock:
                sock.sendall(b"GET / HTTP/1.1\\r\\nHost: x\\r\\n" + b"A: b\\r\\n" * 100 + b"\\r\\n" * 500)
        except OSError:
            pass
for _ in range(4):
    threading.Thread(target=flood, daemon=True).start()
print("flooding", flush=True)
sys.stdin.read()
"""


def join_as_a_page_does(run: PageRun) -> None:
    """See the run. A newcomer waits behind the flood in the system's queue. If it is slow to speak it makes
    room for others, and a page then tries again."""
    until = time.monotonic() + SECONDS
    while True:
        try:
            with PageViewer(run, open_timeout=SECONDS) as late:
                late.wait(lambda message: "run" in message)
            return
        except (OSError, WebSocketException):  # a time-out is an OSError
            assert time.monotonic() < until


# A newcomer waits for 3 to 11 s in the system's queue, behind the flood.
@pytest.mark.slow
@pytest.mark.parametrize("newcomer", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_flood_on_the_port_holds_up_neither_viewers_nor_the_robot_nor_the_end(newcomer: bool) -> None:
    with page_run() as run, PageViewer(run) as watching:
        watching.wait(lambda message: "run" in message)
        flood = [sys.executable, "-c", FLOOD, str(run.port)]
        with subprocess.Popen(flood, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as flooding:
            try:
                assert flooding.stdout is not None
                flooding.stdout.readline()
                for _ in range(20):
                    run.send("u1")
                seen = Recorded()
                watching.wait(lambda message: seen.take(message) or len(seen.rows.get("readings", ())) >= 20)
                if newcomer:
                    join_as_a_page_does(run)
                begun = time.monotonic()
                run.page.stop()
                assert time.monotonic() - begun < 2.0
                run.page._thread.join(SECONDS)
                assert not run.page._thread.is_alive()
            finally:
                flooding.kill()


def test_the_end_is_told_to_viewers() -> None:
    with page_run() as run, PageViewer(run) as watching:
        watching.wait(lambda message: "run" in message)
        run.page.stop()
        watching.wait(lambda message: message.get("over"))
        with pytest.raises(ConnectionClosed):
            watching.next()


def test_a_verdict_is_shown_until_the_run_restarts() -> None:
    with page_run() as run, PageViewer(run) as watching:
        watching.wait(lambda message: "run" in message)
        run.send("d1-3")
        run.page.judged(
            Verdict(
                outcome=Outcome.FAILED,
                headline="It fell.",
                text="It fell.",
                elapsed=1.5,
                line=0,
                advice="Mend.",
            )
        )
        judged = watching.wait(lambda message: message.get("verdict"))
        assert judged["verdict"]["lines"] == ["It fell.", "Mend."]
        assert judged["moment"] == 1500
        run.server.call(run.server.engine.perform, Action(ActionName.RESET))
        assert watching.wait(lambda message: "verdict" in message)["verdict"] is None
