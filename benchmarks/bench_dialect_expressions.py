"""Time and memory of the most expensive expressions that a dialect.toml may have.

    python benchmarks/bench_dialect_expressions.py [--quick] [--json FILE]

The goals are 1 ms and 64 KB for each expression, and for a field of a reply.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import tracemalloc
from collections.abc import Callable, Sequence
from pathlib import Path

from simmer_tui.config.loader import find_set, load
from simmer_tui.dialect.device import DialectDevice
from simmer_tui.dialect.dialect_rules import DialectRules, Parts
from simmer_tui.dialect.expressions import LONGEST_TEXT, MOST_RAYS, Expression, FieldValue
from simmer_tui.dialect.templates import parsed_reply
from simmer_tui.errors import ExpressionError
from simmer_tui.links.dialect_link import SimulatedHost, reply_value
from simmer_tui.robot.engine import Engine
from simmer_tui.sim.simulator import Simulator

MOST_SECONDS, MOST_BYTES = 0.001, 65_536
HALF = "x" * (LONGEST_TEXT // 2)
LISTS: dict[str, FieldValue] = {"codes": ("u0",) * 30_000, "others": ("u0",) * 30_000}
NAMES: dict[str, FieldValue] = {"s": HALF, "h": 10**39, "i": 2**53, "f": 1e308, **LISTS}
HARD: dict[str, Callable[[int], str]] = {
    "sums of texts": lambda n: "pick(0, " + ", ".join(["s+s"] * n) + ")",
    "texts held": lambda n: "(s+s)==(" * n + "1" + ")" * n,
    "texts compared": lambda n: "len(s+s)" + "+len(s+s)" * n,
    "powers": lambda n: "max(" + ", ".join(["h**64"] * n) + ")",
    "powers of powers": lambda n: "(" * n + "i" + "**64)" * n,
    "remainders": lambda n: "%".join(["h"] * n),
    "quotients": lambda n: "//".join(["f"] * n),
    "brackets": lambda n: "(" * n + "1" + ")" * n,
    "signs": lambda n: "-" * n + "1",
    "comparisons": lambda n: "1" + "<2" * n,
    "rounding": lambda n: "round(f, 15)" + "+round(f, 15)" * n,
    "a scan": lambda n: f"scan(0, 1, {MOST_RAYS})",
    "rays": lambda n: "ray(1)" + "+ray(2)" * min(n, 3),
    "lists compared": lambda n: " and ".join(["codes!=others or others==codes"] * n),
}
"""Expressions of a size; the largest one that is not refused is measured."""
FIELDS = {
    "a scan in words": f"{{scan(0, 1, {MOST_RAYS}):.17f|,}}",
    "a long number": "{f:99.17f}",
}
"""Fields of a reply."""


class Names:
    """Values, and a simulated robot whose lidar has been read: a reply reads it once, for all its fields."""

    def __init__(self) -> None:
        spec = load(find_set("lidar")).simulation
        simulator = Simulator(spec, 0)
        parts = Parts(spec.sensors)
        rules = DialectRules(parts=parts)
        host = SimulatedHost(Engine(simulator), rules, lambda data, droppable: None)
        self._device = DialectDevice(rules, host)
        self._readings = {code: reply_value(simulator.execute(code)) for code in parts.lidars}

    def value(self, name: str) -> FieldValue:
        return NAMES[name]

    def call(self, function: str, arguments: Sequence[FieldValue]) -> FieldValue:
        return self._device.sense(function, arguments, self._readings)


def cost(work: Callable[[], object], rounds: int) -> tuple[float, int]:
    """The least seconds of several rounds, since other processes use the machine too, and the most bytes."""

    def done() -> None:
        try:
            work()
        except ExpressionError:  # an expression that is refused during evaluation has its cost as well
            return

    best = min(_timed(done) for _ in range(rounds))
    tracemalloc.start()
    done()
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return best, most


def _timed(work: Callable[[], None]) -> float:
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def hardest(text: Callable[[int], str]) -> Expression:
    """The largest expression of a kind that is not refused."""
    for size in range(200, 0, -1):
        try:
            return Expression(text(size))
        except ValueError:
            continue
    raise AssertionError(f"none of {text(1)} is allowed")


def costs(rounds: int) -> dict[str, tuple[float, int]]:
    """Seconds and bytes of all expressions and fields."""
    names = Names()
    made = {name: hardest(text) for name, text in HARD.items()}
    found = {name: cost(lambda each=each: each.value(names), rounds) for name, each in made.items()}  # type: ignore[misc]
    replies = {name: parsed_reply(text)[0] for name, text in FIELDS.items()}
    return found | {
        name: cost(lambda each=each: each.text(names, ""), rounds) for name, each in replies.items()
    }  # type: ignore[misc]


def main() -> int:
    """Returns 1 if one takes more than the goals."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="5 rounds in place of 50")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures to a file too")
    options = parser.parse_args()
    found = costs(5 if options.quick else 50)
    for name, (seconds, size) in sorted(found.items(), key=lambda each: -each[1][0]):
        print(f"{1000 * seconds:7.3f} ms {size / 1024:7.1f} KB  {name}")
    slowest, largest = max(s for s, _ in found.values()), max(size for _, size in found.values())
    print(f"at most {1000 * slowest:.3f} ms and {largest / 1024:.1f} KB; the goals are 1 ms and 64 KB")
    if options.json is not None:
        options.json.write_text(json.dumps({"most_ms": 1000 * slowest, "most_kb": largest / 1024}))
    return int(slowest > MOST_SECONDS or largest > MOST_BYTES)


if __name__ == "__main__":
    sys.exit(main())
