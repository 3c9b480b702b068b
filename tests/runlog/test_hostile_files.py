"""Files that are no logs of ours, or are in the way of one: bombs, links, clocks that are set back."""

from __future__ import annotations

import gzip
import itertools
import os
import sys
import time
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from simmer_tui.errors import RunLogError
from simmer_tui.runlog import reader, writer
from simmer_tui.runlog.reader import READS_LARGE, Logged, LogReader
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator

UNIX = pytest.mark.skipif(sys.platform == "win32", reason="modes and links of Unix")


@pytest.fixture
def small_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limits a thousand times smaller: a megabyte for a gigabyte."""
    monkeypatch.setattr(reader, "MOST_UNPACKED", 1_000_000)


@pytest.mark.usefixtures("small_limit")
def test_a_bomb_is_said_to_be_one_and_not_read_on(varied_log: Path) -> None:
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    zeros = bytes(1 << 18)
    bomb = varied_log.with_name("bomb.jsonl.gz")
    pieces = (packer.compress(zeros) for _ in range(64))
    bomb.write_bytes(b"".join((packer.compress(varied_log.read_bytes()), *pieces, packer.flush())))
    with pytest.raises(RunLogError, match=r"unpacks to more than 50 times its size .* --large reads it"):
        LogReader(bomb)
    token = READS_LARGE.set(True)
    try:
        with LogReader(bomb) as log:
            assert log.size > 64 << 18
    finally:
        READS_LARGE.reset(token)


@pytest.mark.usefixtures("small_limit")
def test_a_long_log_is_no_bomb(varied_log: Path) -> None:
    """A log packs to a tenth: however long, it stays below 50 times."""
    head, *rest = varied_log.read_bytes().splitlines(keepends=True)
    times = 2_000_000 // len(b"".join(rest)) + 1
    packed = varied_log.with_name("long.jsonl.gz")
    # Joined of many, as appended logs are: a file of one line a thousand times would pack far better.
    packed.write_bytes(gzip.compress(head) + b"".join(gzip.compress(b"".join(rest)) for _ in range(times)))
    with LogReader(packed) as log:
        assert log.size > 2_000_000


@UNIX
@pytest.mark.parametrize(("umask", "mode"), [(0o000, 0o644), (0o022, 0o644), (0o077, 0o600)])
def test_others_never_write_a_log(configuration: Any, tmp_path: Path, umask: int, mode: int) -> None:
    before = os.umask(umask)
    try:
        RunLog(tmp_path / "a.jsonl", configuration, Simulator(configuration.simulation)).close()
        named_by_date = writer.new_file(tmp_path)
    finally:
        os.umask(before)
    assert (tmp_path / "a.jsonl").stat().st_mode & 0o777 == mode
    assert named_by_date.stat().st_mode & 0o777 == mode


@UNIX
@pytest.mark.parametrize("there", [True, False])
def test_no_file_is_written_through_a_link(configuration: Any, tmp_path: Path, there: bool) -> None:
    target, link = tmp_path / "target", tmp_path / "log.jsonl"
    if there:
        target.touch()
    link.symlink_to(target)
    with pytest.raises(RunLogError, match=r"log\.jsonl: (it is a link to a file|No such file)"):
        RunLog(link, configuration, Simulator(configuration.simulation))
    assert not there or target.read_bytes() == b""
    assert target.exists() == there


@UNIX
def test_a_link_to_a_pipe_is_written(configuration: Any, tmp_path: Path) -> None:
    """/dev/stdout is one."""
    reading, writing = os.pipe()
    link = tmp_path / "out"
    link.symlink_to(f"/dev/fd/{writing}")
    with RunLog(link, configuration, Simulator(configuration.simulation)):
        assert os.read(reading, 8) == b'{"kind":'
    os.close(reading)
    os.close(writing)


def test_a_clock_that_is_set_back_or_on_moves_no_line(
    configuration: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    jumps: Iterator[float] = itertools.cycle((3600.0, -7200.0, 86400.0))
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + next(jumps))
    path = tmp_path / "jumps.jsonl"
    simulator = Simulator(configuration.simulation)
    with RunLog(path, configuration, simulator) as log:
        for _ in range(20):
            log(simulator.execute("u1"))
    with LogReader(path) as read:
        times = [line.real_time for line in read if isinstance(line, Logged)]
        assert len(times) == 20
        assert times == sorted(times)
        assert 0.0 <= times[-1] - read.header.real_time < 60.0
