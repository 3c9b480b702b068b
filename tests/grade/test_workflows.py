"""The workflow files to copy, the container, and the page that explains them: their commands work."""

from __future__ import annotations

import contextlib
import os
import re
import resource
import shlex
import shutil
import socket
import subprocess
import sys
import threading
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.cli.grade_command import run_grade
from simmer_tui.cli.main import main
from simmer_tui.grade import launcher
from simmer_tui.grade.container import Container
from simmer_tui.grade.course import read_course
from simmer_tui.grade.limits import Limits
from simmer_tui.links.ports import PortRequest
from simmer_tui.program.program_output import ProgramOutput
from tests.grade.conftest import SOLVE
from tests.grade.test_grading import QUICK

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["github-actions.yml", "gitlab-ci.yml"])
def test_commands_of_workflows_grade(
    isolation: str,
    make_course: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
) -> None:
    make_course({"a": SOLVE}, QUICK)
    monkeypatch.chdir(tmp_path)
    commands = re.findall(r"simmer-tui (grade .*)", (DOCS / "grading" / name).read_text())
    assert commands
    for command in commands:
        assert main(shlex.split(command)) == 0
    for artifact in re.findall(r"(grading/\S+)", (DOCS / "grading" / name).read_text()):
        assert (tmp_path / artifact).exists()


@pytest.mark.parametrize("name", ["github-actions.yml", "gitlab-ci.yml", "Containerfile"])
def test_workflows_install_from_the_repository_that_the_package_names(name: str) -> None:
    text = (DOCS / "grading" / name).read_text()
    project = tomllib.loads((DOCS.parent / "pyproject.toml").read_text())["project"]
    (source,) = re.findall(r'(?m)^ *(?:ARG )?SIMMER_TUI[:=] ?"(.*)"', text)
    assert source == f"{project['name']} @ git+{project['urls']['Source']}"
    assert re.findall(r"pip install (?:--\S+ )?(\S+)", text) == ['"$SIMMER_TUI"']
    assert "git" in re.findall(r"install -y.*", text)[0] or "actions/checkout" in text  # which git needs


def test_example_of_the_page_is_a_course(
    tmp_path: Path, exact_mission: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "course-set").symlink_to(exact_mission)
    for team in ("teams/blue", "handed-in/red"):
        (tmp_path / team).mkdir(parents=True)
    (example,) = re.findall(r"```toml\n(.*?)```", (DOCS / "grading.md").read_text(), re.DOTALL)
    (tmp_path / "teams.toml").write_text(example.replace("/opt/matlab", str(tmp_path)))
    course = read_course(tmp_path / "teams.toml")
    assert [team.name for team in course.teams] == ["red", "blue"]
    assert course.limits == Limits()
    assert course.rules.cells == {"drive.csv": ("Poll Character",)}


@pytest.mark.slow
def test_practice_as_the_page_has_it(
    make_course: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_course({"my-robot": SOLVE}, QUICK).rename(tmp_path / "course.toml")
    (tmp_path / "teams" / "my-robot").rename(tmp_path / "my-robot")
    monkeypatch.chdir(tmp_path)
    assert run_grade(shlex.split("--practice my-robot --course course.toml --jobs 1")) == 0


def test_container_has_no_network_and_sees_nothing_of_the_grading(tmp_path: Path) -> None:
    files = tmp_path / "program"
    container = Container("podman", "grader", files, Limits(), ["/opt/matlab"])
    words = container.words()
    container.close()
    assert words[:2] == ["podman", "run"]
    assert words[words.index("--network") + 1] == "none"
    volumes = [words[index + 1] for index, word in enumerate(words) if word == "--volume"]
    assert f"{files}:/program:ro" in volumes
    assert all(volume.endswith(":ro") for volume in volumes)
    assert not any(volume.startswith(f"{tmp_path}:") for volume in volumes)
    assert words[words.index("--pids-limit") + 1] == "64"


without_timeout = pytest.mark.skipif(
    shutil.which("timeout") is None, reason="a container's time limit is that of timeout, of coreutils"
)


def _engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A podman that starts the command of a container here, and notes what it does not start."""
    engine = tmp_path / "bin" / "podman"
    engine.parent.mkdir()
    engine.write_text(
        f"""#!{sys.executable}
import os, sys
if sys.argv[1] != "run":
    sys.exit(0)
words = sys.argv[1:]
place = words.index("--entrypoint")
seen = [words[n + 1].rsplit(":", 2) for n, word in enumerate(words) if word == "--volume"]
command = [words[place + 1], *words[place + 3 :]]
for path, name, _ in seen:
    command = [word.replace(name, path, 1) if word.startswith(name + "/") else word for word in command]
os.execvp(command[0], command)
"""
    )
    engine.chmod(0o755)
    monkeypatch.setenv("PATH", f"{engine.parent}{os.pathsep}{os.environ['PATH']}")


@pytest.mark.slow
@without_timeout
def test_container_ends_by_itself_when_nobody_ends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after kill -9 of the grader: what it runs has a time limit of its own."""
    _engine(tmp_path, monkeypatch)
    files, ended = tmp_path / "files", threading.Event()
    files.mkdir()
    monkeypatch.setattr("simmer_tui.grade.container.ANSWER_TIMEOUT", 1.0)
    monkeypatch.setattr("simmer_tui.grade.sandbox.SANDBOXED_FILES", str(files))
    monkeypatch.setattr("simmer_tui.grade.sandbox.HOME", str(tmp_path / "home"))
    with contextlib.closing(Container("podman", "x", files, Limits(time=2.0))) as container:
        container.take("127.0.0.1", PortRequest(0, "x", "")).close()
        container.start(
            shlex.join([sys.executable, "-c", "import time; time.sleep(600)"]),
            {},
            lambda code: ended.set(),
            lambda line: None,
            ProgramOutput(),
        )
        assert ended.wait(20)


@without_timeout
def test_processes_of_a_container_are_counted_by_its_engine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """RLIMIT_NPROC would count those of all containers together: they have the same user."""
    _engine(tmp_path, monkeypatch)
    files, home = tmp_path / "files", tmp_path / "home"
    files.mkdir()
    (files / "main.py").write_text(
        "import resource\nprint(resource.getrlimit(resource.RLIMIT_NPROC)[0])\n"
        "print(resource.getrlimit(resource.RLIMIT_CORE)[0])\n"
    )
    monkeypatch.setattr("simmer_tui.grade.sandbox.SANDBOXED_FILES", str(files))
    monkeypatch.setattr("simmer_tui.grade.sandbox.HOME", str(home))
    said: list[str] = []
    ended = threading.Event()
    with contextlib.closing(Container("podman", "x", files, Limits(processes=7))) as container:
        container.take("127.0.0.1", PortRequest(0, "x", "")).close()
        container.start(
            f"{sys.executable} -S main.py", {}, lambda code: ended.set(), said.append, ProgramOutput()
        )
        assert ended.wait(20)
    assert said == [str(resource.getrlimit(resource.RLIMIT_NPROC)[0]), "0"]


def test_launcher_knocks_at_a_door_and_hands_out_sockets(tmp_path: Path) -> None:
    """The way of a container, without one."""
    door = str(tmp_path / "door")
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listening:
        listening.bind(door)
        listening.listen(1)
        listening.settimeout(20)
        with subprocess.Popen([sys.executable, "-I", "-S", launcher.__file__, door]) as process:
            link, _ = listening.accept()
            with link:
                link.send(b'{"listen": 0}')
                answer, descriptors, _, _ = socket.recv_fds(link, 4096, 4)
                sockets = [socket.socket(fileno=each) for each in descriptors]
                port = int(re.findall(rb"\d+", answer)[0])
                with socket.create_connection(("127.0.0.1", port)):
                    sockets[0].accept()[0].close()
                for each in sockets:
                    each.close()
            assert process.wait(20) == 0


def test_container_whose_engine_fails_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An engine that ends at once: the launcher never comes."""
    engine = tmp_path / "podman"
    engine.write_text("#!/bin/sh\necho no such image\nexit 125\n")
    engine.chmod(0o755)
    monkeypatch.setattr("simmer_tui.grade.container.ANSWER_TIMEOUT", 0.3)
    container = Container(str(engine), "x", tmp_path, Limits())
    with pytest.raises(Exception, match="no such image"):
        container.take("127.0.0.1", PortRequest(0, "x", ""))
    container.close()
