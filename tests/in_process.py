"""`simmer-tui` in this process: as a process of its own, without the 0.25 s of CPU of its start."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from simmer_tui.cli.main import main


def simmer(
    *words: object,
    cwd: Path | None = None,
    env: Mapping[str, str] | None = None,
    stdout: int | None = None,
    stdin: int | None = None,
) -> subprocess.CompletedProcess[str]:
    """A command that ends by itself, with the exit code and outputs of a process.

    Its programs have the same standard streams as it, by their numbers. `env` is added to the variables.
    `stdout` and `stdin` are open file descriptors in place of a file and of nothing.
    """
    with contextlib.ExitStack() as stack:
        out, err = (stack.enter_context(tempfile.TemporaryFile()) for _ in range(2))
        null = stack.enter_context(open(os.devnull, "rb"))  # noqa: PTH123
        given = (null.fileno() if stdin is None else stdin, out.fileno() if stdout is None else stdout)
        stack.enter_context(_surroundings(cwd, env or {}))
        with _streams(*given, err.fileno()):
            try:
                code = main([str(word) for word in words])
            except SystemExit as end:  # argparse ends a program itself
                code = end.code if isinstance(end.code, int) else int(end.code is not None)
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read().decode("utf-8", "surrogateescape").replace(os.linesep, "\n"))
    return subprocess.CompletedProcess(["simmer-tui", *map(str, words)], code, *texts)


@contextlib.contextmanager
def _surroundings(cwd: Path | None, env: Mapping[str, str]) -> Iterator[None]:
    variables = dict(os.environ)
    os.environ.update(env)
    try:
        with contextlib.chdir(cwd or Path.cwd()):
            yield
    finally:
        os.environ.clear()
        os.environ.update(variables)


@contextlib.contextmanager
def _streams(*numbers: int) -> Iterator[None]:
    """The descriptors 0 to 2, and Python's streams of them, are others for a while."""
    sys.stdout.flush()
    sys.stderr.flush()
    before = [os.dup(number) for number in range(3)]
    streams = sys.stdin, sys.stdout, sys.stderr
    for number, other in enumerate(numbers):
        os.dup2(other, number)
    options = {"encoding": "utf-8", "errors": "backslashreplace", "closefd": False}
    sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stdout, sys.stderr = (open(number, "w", buffering=1, **options) for number in (1, 2))  # noqa: PTH123, SIM115
    ours = sys.stdin, sys.stdout, sys.stderr
    try:
        yield
    finally:
        for stream in ours[1:]:
            with contextlib.suppress(OSError):  # a full disk
                stream.flush()
        for stream in ours:
            with contextlib.suppress(OSError):
                stream.close()
        sys.stdin, sys.stdout, sys.stderr = streams
        for number, kept in enumerate(before):
            os.dup2(kept, number)
            os.close(kept)
