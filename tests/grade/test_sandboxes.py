"""Sandboxes without their processes: the commands that make them, orders to the launcher, ends and errors.

What the sandboxes keep from a program is tested with real ones (test_cheats.py, test_limits.py).
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from simmer_tui import platform_has
from simmer_tui.errors import GradeError, PortError, ProgramError, printable
from simmer_tui.grade import bubblewrap, container
from simmer_tui.grade.bubblewrap import Bubblewrap, limits_text, seen_folders
from simmer_tui.grade.call_filter import call_filter
from simmer_tui.grade.container import Container
from simmer_tui.grade.limits import Limits
from simmer_tui.grade.sandbox import LaunchedSandbox, package_folders, sandbox_environment
from simmer_tui.links.ports import PortRequest
from simmer_tui.program import ProgramOutput

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="there are sandboxes on Linux alone")

HOME = {"HOME": "/robot/home", "TMPDIR": "/tmp", "LANG": "C.UTF-8", "PYTHONPATH": "/simmer"}
REQUEST = PortRequest(9000, "commands", "--port", 7)
LIMITS = Limits(cpu=7.9, memory=3.0, disk=2.0, processes=5)


class Process:
    """A process that ends when it is killed, or told to."""

    def __init__(self, words: Sequence[str], said: bytes) -> None:
        self.words = list(words)
        self.pid = -1
        self.returncode: int | None = None
        self.kills = 0
        self.communicated = 0
        self._over = threading.Event()
        self._said = said
        out, self.stdout_end = os.pipe()
        err, self.stderr_end = os.pipe()
        self.stdout, self.stderr = os.fdopen(out, "rb"), os.fdopen(err, "rb")

    def end(self, code: int) -> None:
        if not self._over.is_set():
            self.returncode = code
            os.close(self.stdout_end)
            os.close(self.stderr_end)
            self._over.set()

    def kill(self) -> None:
        self.kills += 1
        self.end(-9)

    def poll(self) -> int | None:
        return self.returncode

    def wait(self) -> int:
        self._over.wait()
        assert self.returncode is not None
        return self.returncode

    def communicate(self) -> tuple[bytes, bytes]:
        self.communicated += 1
        self.end(1)
        self.stdout.close()
        self.stderr.close()
        return self._said, b"!"


class Launched:
    """Processes that were made, each with the simulator's orders to its launcher, and what it answers."""

    def __init__(self) -> None:
        self.answers: list[dict[str, object]] = []
        """Answers to the orders, in turn."""
        self.sends: list[list[int]] = []
        """The descriptors that the answers bring."""
        self.said = b"why it ended"
        self.processes: list[Process] = []
        self.options: dict[str, Any] = {}
        self.contents: list[bytes] = []
        """The inherited files."""
        self.link: socket.socket | None = None
        self.ends = "after its answers"
        """When the launcher's socket closes: or "at once", or "never"."""
        self.runs: list[tuple[object, object]] = []
        """Commands that were run to their end, with their options."""

    def popen(self, words: Sequence[str], **options: Any) -> Process:
        self.options = options
        if "pass_fds" in options:
            link, *files = options["pass_fds"]
            self.link = socket.socket(fileno=os.dup(link))
            self.contents = [os.read(each, 1 << 16) for each in files]
        else:
            self.link = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            name = next(each.split(":")[0] for each in words if each.endswith(":/door:ro"))
            with contextlib.chdir(name):  # in the container its path is short
                self.link.connect("launcher")
        for place, answer in enumerate(self.answers):
            sends = self.sends[place] if place < len(self.sends) else []
            socket.send_fds(self.link, [json.dumps(answer).encode()], sends)
        if self.ends == "at once":
            self.link.close()
        elif self.ends == "after its answers":
            self.link.shutdown(socket.SHUT_WR)
        self.processes.append(Process(words, self.said))
        return self.processes[-1]

    def run(self, words: Sequence[str], **options: Any) -> None:
        self.runs.append((words, options))

    def orders(self) -> list[dict[str, Any]]:
        assert self.link is not None
        self.link.setblocking(False)
        found = []
        while True:
            try:
                data = self.link.recv(1 << 17)
            except BlockingIOError:
                return found
            if not data:
                return found
            found.append(json.loads(data))


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Iterator[Launched]:
    made = Launched()
    monkeypatch.setattr(subprocess, "Popen", made.popen)
    monkeypatch.setattr(subprocess, "run", made.run)
    monkeypatch.setattr(bubblewrap, "made_group", lambda: None)
    yield made
    if made.link is not None:
        made.link.close()
    for each in made.processes:
        each.end(0)
        each.stdout.close()
        each.stderr.close()


Kind = Callable[[], LaunchedSandbox]


@pytest.fixture(params=["bwrap", "docker"])
def sandbox(request: pytest.FixtureRequest, launched: Launched, tmp_path: Path) -> Iterator[LaunchedSandbox]:
    made: LaunchedSandbox
    if request.param == "bwrap":
        made = Bubblewrap(tmp_path, LIMITS)
    else:
        made = Container("docker", "", tmp_path, LIMITS)
    yield made
    made.close()


# -- orders to the launcher ------------------------------------------------------------------------


def test_a_port_is_taken_in_the_sandbox(sandbox: LaunchedSandbox, launched: Launched) -> None:
    with socket.create_server(("127.0.0.1", 0)) as one, socket.create_server(("127.0.0.1", 0)) as two:
        launched.answers, launched.sends = [{"port": 9000}], [[one.fileno(), two.fileno()]]
        names = [one.getsockname(), two.getsockname()]
        listener = sandbox.take("everywhere", REQUEST)
    assert (listener.port, listener.backlog) == (9000, 7)
    assert [each.getsockname() for each in listener.sockets] == names
    assert [each.getblocking() for each in listener.sockets] == [False, False]
    # tcpi_sacked of linux/tcp.h, which of a listening socket is the most connections that wait.
    waiting = [each.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 32)[28:] for each in listener.sockets]
    assert [int.from_bytes(each, sys.byteorder) for each in waiting] == [7, 7], (
        "not the launcher's own number"
    )
    listener.close()
    assert launched.orders() == [{"listen": 9000}]
    assert len(launched.processes) == 1


def test_a_port_that_cannot_be_taken_is_an_error_of_ports(
    sandbox: LaunchedSandbox, launched: Launched
) -> None:
    launched.answers = [{"error": "in use\a"}]
    with pytest.raises(PortError) as caught:
        sandbox.take("", REQUEST)
    assert str(caught.value) == r"port 9000 (commands): in use\x07"


def test_a_sandbox_that_ended_says_why(sandbox: LaunchedSandbox, launched: Launched) -> None:
    launched.ends = "at once"
    with pytest.raises(GradeError, match=r"^the sandbox could not be made: why it ended!$"):
        sandbox.take("", REQUEST)
    assert launched.processes[0].kills >= 1


def test_a_sandbox_that_does_not_answer_in_time_is_an_error(
    sandbox: LaunchedSandbox, launched: Launched, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("simmer_tui.grade.sandbox.ANSWER_TIMEOUT", 0.001)
    launched.said, launched.ends = b" slow\a", "never"
    with pytest.raises(GradeError) as caught:
        sandbox.take("", REQUEST)
    assert str(caught.value) == r"the sandbox did not answer: timed out: slow\x07!"


def test_a_sandbox_has_20_seconds_for_an_answer(
    sandbox: LaunchedSandbox, launched: Launched, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = []
    set_limit = socket.socket.settimeout
    monkeypatch.setattr(
        socket.socket, "settimeout", lambda self, seconds: limits.append(seconds) or set_limit(self, seconds)
    )
    launched.answers = [{"error": "no"}]
    with pytest.raises(PortError):
        sandbox.take("", REQUEST)
    # It is waited for a container in short steps, to see if the engine has ended.
    assert max(set(limits) - {None}) == 20.0


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (FileNotFoundError(2, "No such file", "bwrap"), "bwrap: No such file"),
        (OSError("odd"), "the sandbox: odd"),
    ],
)
def test_a_sandbox_that_cannot_be_started_is_an_error(
    sandbox: LaunchedSandbox, monkeypatch: pytest.MonkeyPatch, error: OSError, said: str
) -> None:
    def fail(*words: object, **options: object) -> None:
        raise error

    monkeypatch.setattr(subprocess, "Popen", fail)
    with pytest.raises(GradeError, match=f"^{said}$"):
        sandbox.take("", REQUEST)


def start(sandbox: LaunchedSandbox, command: str = "python3 'a b.py'") -> SimpleNamespace:
    """A started program: its exit codes, its lines, and the event of its end."""
    codes: list[int] = []
    lines: list[str] = []
    ended = threading.Event()

    def end(code: int) -> None:
        codes.append(code)
        ended.set()

    output = ProgramOutput()
    program = sandbox.start(command, {"SIMMER_PORT": "9000", "LANG": "de"}, end, lines.append, output)
    return SimpleNamespace(codes=codes, lines=lines, ended=ended, output=output, program=program)


def test_the_last_order_starts_the_program(
    sandbox: LaunchedSandbox, launched: Launched, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    is_metered = isinstance(sandbox, Bubblewrap)
    monkeypatch.setattr(platform_has, "user_id", lambda: 1000)
    # A PATH may have no python3: then the command gets the path of this one.
    (tmp_path / "python3").symlink_to(sys.executable)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    launched.answers = [{}] * is_metered
    run = start(sandbox)
    process = launched.processes[0]
    os.write(process.stdout_end, b"one\n")
    os.write(process.stderr_end, b"two\n")
    process.end(3)
    assert run.ended.wait(20)
    assert (run.codes, sorted(run.lines)) == ([3], ["one", "two"])
    *before, order = launched.orders()
    assert before == [{"meter": 1}] * is_metered
    python = f"{Path(sys.executable).parent}" if is_metered else "/usr/local/bin"
    limits = {"CPU": 7, "AS": 3_000_000, "NPROC": 5, "FSIZE": 2_000_000, "NOFILE": 256, "CORE": 0}
    if not is_metered:  # an engine counts them
        del limits["NPROC"]
    assert order == {
        "run": ["python3", "a b.py"],
        "environment": {
            "PATH": f"{python}:/usr/local/bin:/usr/bin:/bin",
            **HOME,
            "LANG": "de",
            "PYTHONHASHSEED": "0",
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "SIMMER_PORT": "9000",
        },
        "uid": None,
        "files": "/program",
        "home": "/robot/home",
        "limits": limits,
    }
    sandbox.close()
    assert process.kills == 0


def test_a_program_with_a_clock_of_its_own_has_the_hook_in_the_sandbox(
    sandbox: LaunchedSandbox, launched: Launched
) -> None:
    from simmer_tui.program.program_command import HOOKED

    launched.answers = [{}] * isinstance(sandbox, Bubblewrap)
    variables = {next(iter(HOOKED)): "1"}
    sandbox.start("x", variables, lambda code: None, lambda line: None, ProgramOutput())
    path = launched.orders()[-1]["environment"]["PYTHONPATH"]
    assert path == "/simmer/simmer_tui/program/hook:/simmer"


def test_a_program_that_runs_is_killed_with_its_sandbox(sandbox: LaunchedSandbox, launched: Launched) -> None:
    launched.answers = [{}] * isinstance(sandbox, Bubblewrap)
    run = start(sandbox)
    sandbox.close()
    assert (run.codes, run.program.stopped) == ([128 + 9], True)
    assert launched.processes[0].kills == 1


def test_a_program_that_cannot_be_started_is_its_own_error(
    sandbox: LaunchedSandbox, launched: Launched
) -> None:
    with socket.socket() as meter:
        is_metered = isinstance(sandbox, Bubblewrap)
        launched.answers = [*([{}] * is_metered), {"error": "not found\a"}]
        launched.sends = [[meter.fileno()]] * is_metered
        with pytest.raises(ProgramError) as caught:
            start(sandbox, "x\a y")
    assert str(caught.value) == r"x\x07 y: not found\x07"


def test_a_program_whose_sandbox_has_gone_cannot_be_started(
    sandbox: LaunchedSandbox, launched: Launched
) -> None:
    launched.ends = "at once"
    with pytest.raises(GradeError, match=r"^the sandbox did not answer: .*Broken pipe: why it ended!$"):
        start(sandbox)


def test_a_sandbox_without_a_program_is_ended(sandbox: LaunchedSandbox, launched: Launched) -> None:
    launched.answers = [{"error": "no"}]
    with pytest.raises(PortError):
        sandbox.take("", REQUEST)
    (process,) = launched.processes
    sandbox.close()
    assert (process.kills, process.communicated) == (1, 1)
    assert launched.link is not None
    assert launched.orders() == [{"listen": 9000}]  # and its end: the simulator's is closed
    sandbox.close()
    assert (process.kills, process.communicated) == (1, 1)


def test_limits_of_a_sandbox_end_its_program(launched: Launched, tmp_path: Path) -> None:
    """The time of no process at all is more than that of this limit."""
    sandbox = Bubblewrap(tmp_path, Limits(cpu=-1.0))
    with socket.socket() as meter:
        launched.answers, launched.sends = [{}], [[meter.fileno()]]
        run = start(sandbox)
    assert run.ended.wait(20)
    sandbox.close()
    reason = "ended: its processes took more than -1 s of processor time together"
    assert (run.lines, run.codes) == ([reason], [137])
    assert [line.text for line in run.output.end(1).stderr] == [reason]


def test_a_group_is_limited_entered_and_removed(
    launched: Launched, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files in memory count as memory; bubblewrap and the launcher as processes."""
    noted: list[object] = []
    group = SimpleNamespace(
        entry=["enter"],
        limit=lambda *given: noted.append(given),
        remove=lambda: noted.append("removed"),
        processor_time=lambda: 0.0,
    )
    monkeypatch.setattr(bubblewrap, "made_group", lambda: group)
    sandbox = Bubblewrap(tmp_path, LIMITS)
    launched.answers = [{}]
    start(sandbox)
    assert launched.processes[0].words[:2] == ["enter", "bwrap"]
    launched.processes[0].end(0)
    sandbox.close()
    assert noted == [(3_000_000 + 2_000_000 + 2 * 16_000_000, 5 + 2), "removed"]


def test_our_package_is_all_that_a_sandbox_sees_of_ours() -> None:
    package = Path(bubblewrap.__file__).parents[1]
    assert package_folders() == {
        package: "/simmer/simmer_tui",
        package.parent / "config": "/simmer/config",
    }
    assert sandbox_environment("/a/b/python")["PATH"] == "/a/b:/usr/local/bin:/usr/bin:/bin"


# -- bubblewrap ------------------------------------------------------------------------------------


def words_of(launched: Launched) -> list[str]:
    """The options of bubblewrap, which it reads from a file."""
    return launched.contents[1].decode().removesuffix("\0").split("\0")


def made(launched: Launched, *given: Any) -> Process:
    """The process of a sandbox of bubblewrap."""
    sandbox = Bubblewrap(*given)
    launched.answers = [{"error": "no"}]
    with pytest.raises(PortError):
        sandbox.take("", REQUEST)
    sandbox.close()
    return launched.processes[-1]


def test_bubblewrap_is_started_without_anything_secret(launched: Launched, tmp_path: Path) -> None:
    process = made(launched, tmp_path, LIMITS)
    link, rules, options = launched.options.pop("pass_fds")
    assert process.words == [
        *("bwrap", "--args", str(options), "--", sys.executable, "-I", "-S"),
        *("/simmer/simmer_tui/grade/launcher.py".replace("simmer_tui/grade/", ""), str(link)),
    ]
    assert launched.contents[0] == call_filter()
    assert words_of(launched)[-2:] == ["--seccomp", str(rules)]
    assert launched.options == {
        "env": {"PATH": os.defpath},
        "cwd": "/",
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "start_new_session": True,
    }


def test_a_machine_without_a_filter_has_none(
    launched: Launched, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bubblewrap, "call_filter", lambda: b"")
    made(launched, tmp_path, LIMITS)
    assert words_of(launched)[-2:] == ["--remount-ro", "/proc"]


@pytest.mark.parametrize("user", [0, 1000])
def test_namespaces_and_folders_of_bubblewrap(
    launched: Launched, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, user: int
) -> None:
    monkeypatch.setattr(platform_has, "user_id", lambda: user)
    launched.answers = []
    made(launched, tmp_path, LIMITS)
    root = ["--cap-drop", "ALL", "--cap-add", "CAP_SETUID", "--cap-add", "CAP_SETGID"]
    first = [
        *("--die-with-parent", "--new-session", "--as-pid-1", "--hostname", "robot", "--clearenv"),
        *("--unshare-ipc", "--unshare-pid", "--unshare-net", "--unshare-uts", "--unshare-cgroup-try"),
        *(["--unshare-user"] if user else root),
        *("--proc", "/proc", "--dev", "/dev"),
        *("--perms", "1777", "--size", "16000000", "--tmpfs", "/dev/shm"),
        *("--perms", "1777", "--size", "16000000", "--tmpfs", "/tmp"),
        *("--perms", "1777", "--size", "2000000", "--tmpfs", "/robot"),
    ]
    words = words_of(launched)
    assert words[: len(first)] == first
    etc = ("ld.so.cache", "ld.so.conf", "ld.so.conf.d", "alternatives", "localtime", "fonts")
    last = ["--perms", "0755", "--dir", "/etc", "--perms", "0755", "--dir", "/simmer"]
    for name in etc:
        last += ["--ro-bind-try", f"/etc/{name}", f"/etc/{name}"]
    for path, place in package_folders().items():
        last += ["--ro-bind", str(path), place]
    launcher = str(Path(bubblewrap.__file__).with_name("launcher.py"))
    last += ["--ro-bind", launcher, "/simmer/launcher.py", "--ro-bind", str(tmp_path), "/program"]
    last += ["--remount-ro", "/dev", "--remount-ro", "/", "--remount-ro", "/proc"]
    end = words.index("--seccomp") if "--seccomp" in words else len(words)
    assert words[end - len(last) : end] == last
    shown = words[len(first) : end - len(last)]
    assert {word for word in shown if word.startswith("--")} <= {
        "--perms", "--dir", "--symlink", "--ro-bind",
    }  # fmt: skip
    for path in seen_folders():
        if path.is_symlink():
            assert shown[shown.index(str(path)) - 2 :][:2] == ["--symlink", str(path.readlink())]


def test_more_folders_that_are_seen(launched: Launched, tmp_path: Path) -> None:
    """Each once; the contents of a private one; none that is not there."""
    plain, private = tmp_path / "plain", tmp_path / "private"
    (plain / "inner").mkdir(parents=True)
    private.mkdir()
    (private / "b.txt").touch()
    (private / "a").symlink_to("elsewhere")
    (plain / "link").symlink_to("inner")
    for path, mode in ((tmp_path, 0o700), (plain, 0o755), (plain / "inner", 0o755), (private, 0o750)):
        path.chmod(mode)
    extra = [plain, plain / "inner", plain / "link", private, tmp_path / "missing"]
    made(launched, tmp_path, LIMITS, [*map(str, extra)])
    words = words_of(launched)

    def folders(path: Path) -> list[str]:
        found = []
        for each in [*reversed(path.parents)][1:]:
            found += ["--perms", "0755", "--dir", str(each)]
        return found

    expected = [
        *folders(plain), "--ro-bind", str(plain), str(plain),
        "--symlink", "inner", str(plain / "link"),
        *folders(private / "x"), "--symlink", "elsewhere", str(private / "a"),
        "--ro-bind", str(private / "b.txt"), str(private / "b.txt"),
    ]  # fmt: skip
    place = words.index(str(plain))
    begin = place - 1 - len(folders(plain))
    assert words[begin : begin + len(expected)] == expected
    assert str(plain / "inner") not in words
    assert str(tmp_path / "missing") not in words
    roots = ["/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", sys.prefix, sys.base_prefix]
    assert seen_folders([*map(str, extra)]) == [
        *(path for path in map(Path, dict.fromkeys(roots)) if path.exists()),
        *extra[:-1],
    ]


def test_the_user_of_a_program_is_nobody_of_this_machine(
    launched: Launched, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(platform_has, "user_id", lambda: 0)
    sandbox = Bubblewrap(tmp_path, LIMITS)
    launched.answers = [{}]
    start(sandbox)
    assert launched.orders()[-1]["uid"] == 1_000_000_000 + threading.get_native_id()
    sandbox.close()


def test_what_bubblewrap_lacks_is_said(launched: Launched, monkeypatch: pytest.MonkeyPatch) -> None:
    found: dict[str, str] = {}
    launched.ends = "at once"
    with monkeypatch.context() as patch:
        patch.setattr(platform_has, "LINUX", True)
        patch.setattr(shutil, "which", lambda name: f"/usr/bin/{name}")
        found["broken"] = bubblewrap.what_is_missing()
    with monkeypatch.context() as patch:
        patch.setattr(platform_has, "LINUX", False)
        found["other system"] = bubblewrap.what_is_missing()
    with monkeypatch.context() as patch:
        patch.setattr(platform_has, "LINUX", True)
        patch.setattr(shutil, "which", lambda name: None)
        found["not installed"] = bubblewrap.what_is_missing()
    assert found == {
        "broken": "bubblewrap cannot make a sandbox here: the sandbox could not be made: why it ended!; as "
        "root it mostly can (sudo), and in a container that may make namespaces",
        "other system": "bubblewrap is for Linux only",
        "not installed": "bubblewrap is not installed: apt-get install bubblewrap",
    }


@pytest.mark.parametrize("code", [0, 1])
def test_bubblewrap_is_tried_with_a_program(
    launched: Launched, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        launched.answers, launched.sends = [{"port": 1}, {}], [[listening.fileno()]]
        popen = launched.popen

        def ended(words: Sequence[str], **options: Any) -> Process:
            process = popen(words, **options)
            files = Path(words_of(launched)[words_of(launched).index("/program") - 1])
            assert files.stat().st_mode & 0o777 == 0o755  # every user can read it
            process.end(code)
            return process

        monkeypatch.setattr(shutil, "which", lambda name: name)
        monkeypatch.setattr(subprocess, "Popen", ended)
        missing = bubblewrap.what_is_missing()
    nobody = "a program in a sandbox of bubblewrap does not run here: can every user read "
    assert missing == ("" if code == 0 else f"{nobody}{sys.prefix}?")
    listen, meter, run = launched.orders()
    assert (listen, meter, run["run"][1:]) == ({"listen": 0}, {"meter": 1}, ["-S", "-c", "pass"])


def test_how_limits_are_kept_is_said(launched: Launched, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bubblewrap, "tells_descendants", lambda: True)
    assert limits_text().startswith("A supervisor limits memory and processor time of each run")
    monkeypatch.setattr(bubblewrap, "tells_descendants", lambda: False)
    assert limits_text().startswith("Memory and processor time are limited for each process")
    removed: list[int] = []
    group = SimpleNamespace(remove=lambda: removed.append(1))
    monkeypatch.setattr(bubblewrap, "made_group", lambda: group)
    assert limits_text().startswith("A control group (cgroup v2) limits memory")
    assert removed == [1]


# -- containers ------------------------------------------------------------------------------------


def test_the_command_of_a_container(launched: Launched, tmp_path: Path) -> None:
    limits = Limits(time=10.2, memory=3.0, disk=2.0, processes=5)
    container = Container("docker", "", tmp_path, limits, ["/opt/matlab"])
    words = container.words()
    container.close()
    name = words[4]
    door = next(word.split(":")[0] for word in words if word.endswith(":/door:ro"))
    assert Path(door).name == name
    assert not Path(door).exists()
    volumes = []
    for path, place in (
        *package_folders().items(), (tmp_path, "/program"), (door, "/door"), ("/opt/matlab", "/opt/matlab"),
    ):  # fmt: skip
        volumes += ["--volume", f"{path}:{place}:ro"]
    assert words == [
        *("docker", "run", "--rm", "--name", name, "--network", "none", "--read-only"),
        *("--cap-drop", "ALL", "--security-opt", "no-new-privileges", "--user", "65534:65534"),
        *("--ipc", "private", "--hostname", "robot", "--log-driver", "none"),
        *("--pids-limit", "5", "--shm-size", "16000000"),
        *("--memory", "3000000", "--memory-swap", "3000000"),
        *("--tmpfs", "/tmp:rw,exec,mode=1777,size=16000000"),
        *("--tmpfs", "/robot:rw,exec,mode=1777,size=2000000"),
        *volumes,
        *("--entrypoint", "timeout", "python:3.12-slim", "-s", "KILL", "31"),
        *("python3", "-I", "-S", "/simmer/simmer_tui/grade/launcher.py", "/door/launcher"),
    ]


@pytest.mark.parametrize("depth", [0, 200])
def test_the_door_of_a_container_is_for_one_launcher(
    launched: Launched, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, depth: int
) -> None:
    """The folder for temporary files has any length; the path of a Unix socket has at most 107 bytes."""
    (tmp_path / ("x" * depth)).mkdir(exist_ok=True)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / ("x" * depth)))
    modes: list[int] = []
    popen = launched.popen

    def noting(words: Sequence[str], **options: Any) -> Process:
        door = Path(next(word.split(":")[0] for word in words if word.endswith(":/door:ro")))
        modes.extend(path.stat().st_mode & 0o777 for path in (door, door / "launcher"))
        return popen(words, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(subprocess, "Popen", noting)
        sandbox = Container("docker", "image", tmp_path, LIMITS)
        launched.answers = [{"error": "no"}]
        with pytest.raises(PortError):
            sandbox.take("", REQUEST)
    (door,) = (word.split(":")[0] for word in launched.processes[0].words if word.endswith(":/door:ro"))
    assert modes == [0o755, 0o666]
    assert list(Path(door).iterdir()) == []
    assert launched.options == {
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "start_new_session": True,
    }
    sandbox.close()
    options = {"capture_output": True, "timeout": 20.0, "check": False}
    assert launched.runs == [(["docker", "kill", Path(door).name], options)]
    assert launched.processes[0].kills == 1


@pytest.mark.parametrize("has_ended", [False, True])
def test_a_container_that_does_not_begin_says_why(
    launched: Launched, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_ended: bool
) -> None:
    process = Process([], b"a" + b"z" * 400)
    if has_ended:
        process.end(125)
    else:
        monkeypatch.setattr(container, "_START_TIMEOUT", 0.001)
    monkeypatch.setattr(subprocess, "Popen", lambda *given, **more: process)
    sandbox = Container("docker", "image", tmp_path, LIMITS)
    with pytest.raises(GradeError, match=r"^the container did not begin: z+!$"):
        sandbox.take("", REQUEST)
    assert (process.kills, process.communicated) == (1, 1)
    sandbox.close()


def test_a_silent_container_has_a_reason_too(
    launched: Launched, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    process = Process([], b"")
    process.end(125)
    monkeypatch.setattr(process, "communicate", lambda: (b"", b"\n"))
    monkeypatch.setattr(subprocess, "Popen", lambda *given, **more: process)
    sandbox = Container("docker", "image", tmp_path, LIMITS)
    with pytest.raises(GradeError, match=r"^the container did not begin: its engine says nothing$"):
        sandbox.take("", REQUEST)
    process.stdout.close()
    process.stderr.close()


@pytest.mark.parametrize(
    ("code", "error", "said"),
    [
        (0, "a warning", ""),
        (1, " " + "q" * 300 + "\n", "docker does not answer: " + "q" * 200),
        (1, "a\x1b[2J", "docker does not answer: a\\x1b[2J"),
        (None, "", "docker does not answer: "),
    ],
)
def test_an_engine_is_asked_if_it_runs(
    monkeypatch: pytest.MonkeyPatch, code: int | None, error: str, said: str
) -> None:
    asked: list[object] = []

    def run(words: Sequence[str], **options: object) -> SimpleNamespace:
        asked.append((words, options))
        if code is None:
            raise subprocess.TimeoutExpired(words, 30.0)
        return SimpleNamespace(returncode=code, stderr=error)

    monkeypatch.setattr(shutil, "which", lambda name: name)
    monkeypatch.setattr(subprocess, "run", run)
    missing = container.what_is_missing("docker", "ours")
    missing = printable(missing)
    assert missing == said if code is not None else missing.startswith(said)
    options = {"capture_output": True, "text": True, "timeout": 30.0, "check": False}
    image = [(["docker", "image", "inspect", "ours"], options)] if code == 0 else []
    assert asked == [(["docker", "info"], options), *image]


def test_engines_that_are_not_there_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert container.what_is_missing("podman", "") == "podman is not installed"
    monkeypatch.setattr(shutil, "which", lambda name: name)
    monkeypatch.setattr(platform_has, "POSIX", False)
    assert container.what_is_missing("podman", "") == "podman needs to be on the same Linux machine"
