"""A sketch compiled by a process of its own, which may run in a sandbox.

    python -m simmer_tui.sketch.build_order ORDER

ORDER is a `BuildOrder` in JSON. The answer on standard output is a `BuildAnswer` in MessagePack, with the
compiled sketch itself, so that no folder of a sandbox need be read.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import msgspec
from msgspec import Struct

from simmer_tui.errors import ConfigurationError, Problem, reason_of
from simmer_tui.sketch.boards import BOARDS
from simmer_tui.sketch.build import compile_sketch
from simmer_tui.sketch.compiler import Compiler


class BuildOrder(Struct, frozen=True, kw_only=True):
    """A sketch to compile for a kind of board, with the compiler's command and the compiled runtime. `place`
    is the sketch's in wiring.toml."""

    compiler: tuple[str, ...]
    sketch: str
    kind: str
    place: str
    runtime: str


class BuildAnswer(Struct, frozen=True, kw_only=True):
    """A compiled sketch, its hash and warnings; or the problems for which there is none."""

    program: bytes = b""
    digest: str = ""
    warnings: tuple[str, ...] = ()
    problems: tuple[tuple[str, str], ...] = ()


def carry_out(order: BuildOrder) -> BuildAnswer:
    """Compile a sketch in a new temporary folder."""
    try:
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
            built = compile_sketch(
                Compiler(order.compiler),
                Path(order.sketch),
                BOARDS[order.kind],
                order.place,
                Path(order.runtime),
                Path(name),
            )
            return BuildAnswer(
                program=built.program.read_bytes(), digest=built.digest, warnings=built.warnings
            )
    except ConfigurationError as error:
        problems = error.problems
    except OSError as error:
        problems = (Problem(order.place, f"cannot be compiled: {reason_of(error)}"),)
    except (MemoryError, RecursionError, ValueError) as error:
        problems = (Problem(order.place, f"cannot be compiled: {type(error).__name__}"),)
    return BuildAnswer(problems=tuple((each.where, each.what) for each in problems))


def main(arguments: list[str]) -> None:
    order = msgspec.json.decode(arguments[0], type=BuildOrder)
    sys.stdout.buffer.write(msgspec.msgpack.encode(carry_out(order)))


if __name__ == "__main__":
    main(sys.argv[1:])
