"""Files and folders that the user may not read or write: one line names them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from simmer_tui.cli.main import main, run


def simmer(*arguments: object) -> tuple[int, str]:
    """Exit code and standard error of `simmer-tui` for a user whom permissions bind: root, too, without the
    capabilities that override them."""
    rights = "-dac_override,-dac_read_search"
    before: list[str] = []
    if os.geteuid() == 0:
        if shutil.which("setpriv") is None:
            pytest.skip("root reads everything, and there is no setpriv to take that away")
        before = ["setpriv", "--bounding-set", rights, "--inh-caps", rights]
    command = [*before, sys.executable, "-m", "simmer_tui", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


@pytest.mark.slow
def test_a_set_in_a_closed_folder_is_named(tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    assert main(["init", str(closed)]) == 0
    closed.chmod(0)
    assert simmer("check", closed) == (2, f"{closed}: cannot be read: Permission denied\n")


@pytest.mark.slow
def test_a_course_with_a_closed_folder_is_not_graded(tmp_path: Path) -> None:
    team = tmp_path / "course" / "team"
    team.mkdir(parents=True)
    team.chmod(0)
    code, said = simmer("grade", tmp_path / "course", "--out", tmp_path / "out", "--isolation", "none")
    assert said.count("\n") == 1
    assert said.startswith(f"simmer-tui grade: {team}")
    assert said.endswith("cannot be opened: Permission denied\n")
    assert code == 2


@pytest.mark.parametrize("command", ["doctor", "grade"])
def test_no_folder_for_temporary_files_is_told_in_one_line(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A container with read-only files has none, unless it has a tmpfs."""
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setattr("tempfile._candidate_tempdir_list", lambda: [str(tmp_path / "none")])
    monkeypatch.setattr("shutil.which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr("simmer_tui.platform_has.LINUX", True)
    (tmp_path / "teams" / "a").mkdir(parents=True)
    told = "there is no folder for temporary files: set TMPDIR to one that can be written"
    words = (
        [command]
        if command == "doctor"
        else [command, str(tmp_path / "teams"), "--out", str(tmp_path / "out")]
    )
    with monkeypatch.context() as patch:
        patch.setattr(sys, "argv", ["simmer-tui", *words])
        with pytest.raises(SystemExit) as ended:
            run()
    out, err = capsys.readouterr()
    assert told in out + err
    assert "Traceback" not in out + err
    assert ended.value.code == (0 if command == "doctor" else 2)


def test_a_command_that_needs_a_temporary_file_ends_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setattr("tempfile._candidate_tempdir_list", lambda: [str(tmp_path / "none")])
    monkeypatch.setattr("simmer_tui.cli.main.main", tempfile.gettempdir)
    with pytest.raises(SystemExit) as ended:
        run()
    assert ended.value.code == 2
    assert capsys.readouterr().err == (
        "simmer-tui: there is no folder for temporary files: set TMPDIR to one that can be written\n"
    )
