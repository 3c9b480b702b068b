"""The workflow files to copy, the container, and the page that explains them: their commands work."""

from __future__ import annotations

import re
import shlex
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.cli.grade_command import run_grade
from simmer_tui.cli.main import main
from simmer_tui.grade import launcher
from simmer_tui.grade.container import Container
from simmer_tui.grade.course import read_course
from simmer_tui.grade.limits import Limits
from simmer_tui.grade.syscalls import call_filter
from simmer_tui.links.ports import PortRequest
from tests.grade.conftest import SOLVE
from tests.grade.test_grading import QUICK

DOCS = Path(__file__).resolve().parents[2] / "docs"


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


def test_example_of_the_page_is_a_course(
    tmp_path: Path, course_set: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "course-set").symlink_to(course_set)
    for team in ("teams/blue", "handed-in/red"):
        (tmp_path / team).mkdir(parents=True)
    (example,) = re.findall(r"```toml\n(.*?)```", (DOCS / "grading.md").read_text(), re.DOTALL)
    (tmp_path / "teams.toml").write_text(example)
    course = read_course(tmp_path / "teams.toml")
    assert [team.name for team in course.teams] == ["red", "blue"]
    assert course.limits == Limits()
    assert course.rules.cells == {"drive.csv": ("Poll Character",)}


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
    monkeypatch.setattr("simmer_tui.grade.container.PATIENCE", 0.3)
    container = Container(str(engine), "x", tmp_path, Limits())
    with pytest.raises(Exception, match="no such image"):
        container.take("127.0.0.1", PortRequest(0, "x", ""))
    container.close()


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_filter_is_whole_instructions(machine: str) -> None:
    assert len(call_filter(machine)) % 8 == 0
    assert call_filter(machine)
    assert call_filter("a machine of tomorrow") == b""
