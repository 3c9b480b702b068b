"""Files that are written whole: complete or not at all, in every module of the package."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from simmer_tui.whole_file import whole_file, write_whole

PACKAGE = Path(__file__).parent.parent / "simmer_tui"
TEMPORARY = {
    "grade/board_build.py": "a temporary folder",
    "grade/submission_copy.py": "a copy that is removed if it fails",
    "runlog/header.py": "a temporary folder",
    "trials/cluster.py": "a temporary folder on another machine",
    "trials/logged_trial.py": "a temporary folder",
    "links/serial_link.py": "a record that grows line by line",
    "sketch/build.py": "a temporary folder, which gets its name when it is complete",
}
"""Modules that write files on their own, and the reason."""
posix = pytest.mark.skipif(sys.platform == "win32", reason="modes and links are those of POSIX")


def test_a_file_has_its_name_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    with whole_file(path) as file:
        file.write(b"half")
        assert not path.exists()
    assert path.read_bytes() == b"half"
    assert [*tmp_path.iterdir()] == [path]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("before", [None, b"of the last time"])
def test_nothing_has_happened_if_the_writing_fails(
    tmp_path: Path, error: BaseException, before: bytes | None
) -> None:
    path = tmp_path / "page.html"
    if before is not None:
        path.write_bytes(before)

    def fail() -> None:
        with whole_file(path) as file:
            file.write(b"half")
            raise error

    with pytest.raises(type(error)):
        fail()
    assert [each.read_bytes() for each in tmp_path.iterdir()] == ([] if before is None else [before])


def test_a_name_of_the_greatest_length_is_written(tmp_path: Path) -> None:
    path = tmp_path / ("a" * 255)
    write_whole(path, "grün\n")
    assert path.read_bytes() == "grün\n".encode()


def test_an_error_names_the_file_itself(tmp_path: Path) -> None:
    path = tmp_path / "none" / "page.html"
    with pytest.raises(FileNotFoundError) as caught:
        write_whole(path, "")
    assert caught.value.filename == str(path)
    with pytest.raises(IsADirectoryError if sys.platform != "win32" else PermissionError):
        write_whole(tmp_path, "")


@posix
def test_permissions_are_those_of_any_new_file_or_of_the_old_one(tmp_path: Path) -> None:
    usual, new, old, private = (tmp_path / name for name in ("usual", "new", "old", "private"))
    usual.touch()
    old.touch()
    old.chmod(0o666)
    for path in (new, old):
        write_whole(path, "text")
    write_whole(private, "text", mode=0o600)
    assert new.stat().st_mode == usual.stat().st_mode
    assert [each.stat().st_mode & 0o777 for each in (old, private)] == [0o666, 0o600]


@posix
def test_links_pipes_and_devices_are_written_as_they_are(tmp_path: Path) -> None:
    target, link, pipe = tmp_path / "target", tmp_path / "link", tmp_path / "pipe"
    target.touch()
    link.symlink_to(target)
    write_whole(link, "through")
    assert link.is_symlink()
    assert target.read_text() == "through"
    os.mkfifo(pipe)
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_whole(pipe, "through")
        assert os.read(reading, 100) == b"through"
    finally:
        os.close(reading)
    write_whole(Path(os.devnull), "gone")
    assert pipe.is_fifo()


@pytest.mark.posix
@pytest.mark.skipif(getattr(os, "geteuid", lambda: 1)() != 0, reason="only root can become another user")
def test_a_user_who_may_not_write_a_file_does_not_replace_it(tmp_path: Path) -> None:
    theirs, shared = tmp_path / "theirs", tmp_path / "shared"
    theirs.mkdir()
    (theirs / "fixed").write_text("as before")
    (theirs / "fixed").chmod(0o444)
    theirs.chmod(0o777)
    shared.mkdir()
    (shared / "open").write_text("as before")
    (shared / "open").chmod(0o666)
    tmp_path.chmod(0o755)  # it is the working folder, so those above it do not matter
    script = (
        "import os, sys; from pathlib import Path; from simmer_tui.whole_file import write_whole\n"
        "os.setuid(65534)\n"
        "for name in sys.argv[1:]:\n"
        "    try: write_whole(Path(name), 'new')\n"
        "    except PermissionError as error: print(error.strerror)\n"
    )
    files = [theirs / "fixed", shared / "open"]
    names = [each.relative_to(tmp_path) for each in files]
    done = subprocess.run(
        [sys.executable, "-c", script, *names], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout == "Permission denied\n"
    assert [each.read_text() for each in files] == ["as before", "new"]


def test_no_other_module_writes_a_whole_file_on_its_own() -> None:
    writes = re.compile(r"""\.write_(?:text|bytes)\(|\bopen\([^)\n]*["'][wx]b?["']""")
    found = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if writes.search(path.read_text("utf-8"))
    }
    assert found - {"whole_file.py"} <= TEMPORARY.keys()
