"""A program on its way to other machines: which files go along, and how it is started there."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from simmer_tui.errors import TrialsError
from simmer_tui.trials import cluster
from simmer_tui.trials.cluster import pack, unpack

posix = pytest.mark.skipif(sys.platform == "win32", reason="commands are split as a shell does it")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A student's folder: a program with a module and a data file, and much that is not part of it."""
    here = tmp_path / "here"
    for name, text in {
        "robot.py": "import sys, helper; print(helper.word, open('maps/a.txt').read(), *sys.argv[1:])",
        "helper.py": "word = 'helped'",
        "maps/a.txt": "a map",
        ".git/config": "secret",
        "__pycache__/robot.pyc": "old",
        "venv/pyvenv.cfg": "",
        "venv/lib/big.py": "",
        "results/trials.json": "{}",
        "results/runs/0001.jsonl": "{}",
        "src/tool.py": "print('tool')",
        "src/part.py": "",
    }.items():
        path = here / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return here


@pytest.fixture
def run_there(folder: Path, tmp_path: Path) -> Callable[[str], str]:
    """Packs a command, takes the folder it came from away, and runs it in another; returns what it says."""

    def run(command: str) -> str:
        packed = pack(command, folder)
        folder.rename(tmp_path / "gone")
        there = tmp_path / "there"
        there.mkdir()
        words = shlex.split(unpack(packed, there))
        return subprocess.run(words, cwd=there, capture_output=True, text=True, check=True).stdout.strip()

    return run


@posix
@pytest.mark.parametrize("interpreter", ["python", "python3", "/nowhere/bin/python3", sys.executable])
def test_program_runs_elsewhere_with_the_files_beside_it(
    run_there: Callable[[str], str], interpreter: str
) -> None:
    assert run_there(f"{interpreter} robot.py --speed 3 'two words'") == "helped a map --speed 3 two words"


@posix
def test_module_runs_elsewhere(run_there: Callable[[str], str]) -> None:
    assert run_there("python -m robot 1") == "helped a map 1"


@posix
def test_package_runs_elsewhere(folder: Path, run_there: Callable[[str], str]) -> None:
    (folder / "pack").mkdir()
    (folder / "pack/__main__.py").write_text(
        "from pack.other import word; import helper; print(word, helper.word)"
    )
    (folder / "pack/other.py").write_text("word = 'packed'")
    assert run_there("python -m pack") == "packed helped"


@posix
def test_program_that_is_started_by_its_path_stays_startable(
    folder: Path, run_there: Callable[[str], str]
) -> None:
    script = folder / "go"
    script.write_text("#!/bin/sh\nread -r line < maps/a.txt || :\necho $line\n")
    script.chmod(0o755)
    assert run_there("./go") == "a map"


@posix
def test_absolute_paths_outside_lead_to_the_files_that_went_along(
    folder: Path, tmp_path: Path, run_there: Callable[[str], str]
) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "main.py").write_text("import sys, beside; print(*[open(a).read() for a in sys.argv[1:]])")
    (outside / "beside.py").write_text("")
    (outside / "data.txt").write_text("data")
    command = f"python {outside}/main.py maps/a.txt {outside}/data.txt"
    packed = pack(command, folder)
    assert sorted(packed.files) == [
        "elsewhere/0/beside.py",
        "elsewhere/0/data.txt",
        "elsewhere/0/main.py",
        "elsewhere/2/data.txt",
        "maps/a.txt",
    ]
    assert run_there(command) == "a map data"


@posix
def test_only_the_folder_of_the_program_goes_along_without_what_is_not_part_of_it(folder: Path) -> None:
    assert sorted(pack("python robot.py", folder).files) == [
        "helper.py", "maps/a.txt", "robot.py", "src/part.py", "src/tool.py",
    ]  # fmt: skip
    packed = pack("python src/tool.py --map=maps/a.txt -- helper.py", folder)
    assert sorted(packed.files) == ["helper.py", "maps/a.txt", "src/part.py", "src/tool.py"]
    assert packed.words == ("python", "src/tool.py", "--map=maps/a.txt", "--", "helper.py")


@posix
@pytest.mark.parametrize("command", ["octave --eval run", "/bin/sh -c 'exit 3'", ""])
def test_what_is_installed_stays_where_it_is(folder: Path, command: str) -> None:
    packed = pack(command, folder)
    assert packed.files == {}
    assert list(packed.words) == shlex.split(command)


@posix
def test_too_much_is_refused_by_name(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "video.bin").write_bytes(bytes(100))
    monkeypatch.setattr(cluster, "MOST_PROGRAM_BYTES", 150)
    with pytest.raises(TrialsError, match=r"one file too many: .*put the program in a folder of its own"):
        pack("python robot.py", folder)


@posix
def test_command_that_cannot_be_split_is_said(folder: Path) -> None:
    with pytest.raises(TrialsError, match="--run 'python \"robot': No closing quotation"):
        pack('python "robot', folder)
