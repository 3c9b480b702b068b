"""Cost of logging, and the time to open a long log and seek in it.

    python benchmarks/bench_runlog.py [--quick] [--against DIR] [--json FILE]

Round trips over TCP with and without a log alternate in the same run, so that the ratio is comparable between
machines. The long log is made of the lines of a real run with changed times and numbers. It is opened as by
`replay`, in a process of its own to measure its memory. Goal: a report of a million commands takes at most
9 s of an idle core.

With --against, `report --json` of a failed mission with beliefs, of 20,000 commands (--commands), alternates
with that of another checkout in DIR (`git worktree add DIR 7f3c640`). Each reads its own log of the same run.
Goal: 0.85 of its processor time.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from msgspec.structs import replace

from simmer_tui.config import load_default
from simmer_tui.config.loader import Configuration
from simmer_tui.live.server import Server
from simmer_tui.robot.engine import Engine
from simmer_tui.run.events import Event
from simmer_tui.runlog.index import EntryFlag, RunLogIndex
from simmer_tui.runlog.playback import Playback
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim import Simulator, parse_command

ROOT = Path(__file__).resolve().parent.parent
PATTERN = ("u1", "u2", "u3", "u4", "i1", "g1", "o1", "c1", "d1-2", "r1-25")


def free_ports(configuration: Configuration) -> Configuration:
    server = replace(configuration.settings.server, port=0, reply_port=0)
    return replace(configuration, settings=replace(configuration.settings, server=server))


def round_trips(folder: Path, seconds: float, rounds: int) -> dict[str, float]:
    """Round trips a second on loopback, with a log and without, in turns."""
    rates: dict[str, list[float]] = {"without": [], "with": []}
    for number in range(rounds):
        for name in ("without", "with") if number % 2 else ("with", "without"):
            server = Server(free_ports(load_default()))
            watcher: Callable[[Event], None] = lambda event: None  # noqa: E731
            if name == "with":
                watcher = RunLog(folder / f"trip{number}.jsonl", server.configuration, server.simulator)
            server.start(watcher)
            try:
                rates[name].append(_in_own_process("--client", _address(server), str(seconds))["rate"])
            finally:
                server.stop()
    ratios = [logged / bare for logged, bare in zip(rates["with"], rates["without"], strict=True)]
    return {
        "without a log (median)": statistics.median(rates["without"]),
        "with a log (median)": statistics.median(rates["with"]),
        "ratio (median of the rounds)": statistics.median(ratios),
    }


def _address(server: Server) -> str:
    return f"{server.environment['SIMMER_HOST']}:{server.environment['SIMMER_PORT']}"


def rate(address: str, seconds: float) -> float:
    """Round trips a second of a client that sends the pattern for some time."""
    host, port = address.rsplit(":", 1)
    with socket.create_connection((host, int(port))) as client:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return _rate(client, seconds)


def _rate(client: socket.socket, seconds: float) -> float:
    texts = [f"{text}\n".encode() for text in PATTERN]
    begin, count = time.perf_counter(), 0
    while (elapsed := time.perf_counter() - begin) < seconds:
        for text in texts:
            client.sendall(text)
            reply = client.recv(8)
            while len(reply) < 8:
                reply += client.recv(8 - len(reply))
            struct.unpack(">d", reply)
        count += len(texts)
    return count / elapsed


_LONG_MISSION = {"time_limit": "1e9", "contacts": "1000000", "start": "[30.0, 42.0]", "heading": "0.0"}
"""Lines of mission.toml for a mission that only its program ends."""
_WANDER = f"{sys.executable} {ROOT / 'scripts' / 'wander.py'} --steps {{}} --start 30,42,0 --seed 3"
_STEP = len(PATTERN)  # commands that wander.py sends a step: nine sensors and a movement


def against(other: Path, folder: Path, rounds: int, commands: int) -> dict[str, float]:
    """Processor time of a report here and in another checkout, seconds (medians), and their ratio."""
    logs = {
        tree: _mission_log(tree, folder / f"mission{number}", commands)
        for number, tree in enumerate((ROOT, other))
    }
    times: dict[Path, list[float]] = {tree: [] for tree in logs}
    for number in range(rounds):
        for tree in list(logs)[:: 1 if number % 2 else -1]:
            begin = _children_time()
            _simmer_tui(tree, "report", str(logs[tree]), "--json")
            times[tree].append(_children_time() - begin)
    ratios = [mine / theirs for mine, theirs in zip(times[ROOT], times[other], strict=True)]
    return {
        "here, s of a core (median)": statistics.median(times[ROOT]),
        "there, s of a core (median)": statistics.median(times[other]),
        "here, s of a core (least)": min(times[ROOT]),
        "there, s of a core (least)": min(times[other]),
        "ratio (median of the rounds)": statistics.median(ratios),
    }


def _mission_log(tree: Path, place: Path, commands: int) -> Path:
    """The log of so many commands of wander.py in a mission that it does not complete, written by a
    checkout."""
    log = place.with_suffix(".jsonl")
    _simmer_tui(tree, "init", str(place), "--from", "mission")
    mission = place / "mission.toml"
    lines = mission.read_text("utf-8").splitlines()
    for key, value in _LONG_MISSION.items():
        lines = [f"{key} = {value}" if line.startswith(f"{key} =") else line for line in lines]
    mission.write_text("\n".join(lines), "utf-8")
    _simmer_tui(
        tree,
        *("--config", str(place), "--no-ui", "--mission", "--seed", "5", "--port", "0", "--reply-port", "0"),
        *("--log", str(log), "--run", _WANDER.format(commands // _STEP)),
    )
    return log


def _simmer_tui(tree: Path, *arguments: str) -> None:
    """Run the command of a checkout. A mission that failed is no error here."""
    command = [sys.executable, "-m", "simmer_tui", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    # Without this variable both are compiled once, as in an installation.
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    done = subprocess.run(command, check=False, capture_output=True, env=environment, cwd=tree)
    if done.returncode > 1:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr.decode(errors='replace')[-500:]}")


def _children_time() -> float:
    """Processor time of all processes started and ended so far, seconds."""
    times = os.times()
    return times.children_user + times.children_system


def make_long_log(path: Path, commands: int) -> None:
    """Write a log of so many commands: a real run's lines again and again, with increasing times."""
    configuration = load_default()
    simulator = Simulator(configuration.simulation, 7)
    engine = Engine(simulator)
    with RunLog(path, configuration, simulator) as log:
        engine.watch(log)
        session = engine.session()
        for text in PATTERN * 60:
            session.submit(parse_command(text), lambda result: None)
    header, *lines = path.read_text().splitlines(keepends=True)
    duration, count = simulator.time, simulator.commands
    templates = [_template(line) for line in lines]
    with path.open("w") as file:
        file.write(header)
        for lap in range(-(-commands // count)):
            time, number = lap * duration, lap * count
            file.writelines(
                line % {name: value + (number if name == "n" else time) for name, value in values.items()}
                for line, values in templates
            )


def _template(line: str) -> tuple[str, dict[str, float]]:
    """A line as a template for its times and number, with their values."""
    values: dict[str, float] = {}

    def take(found: re.Match[str]) -> str:
        name = "n" if found[1] == "n" else f"time{len(values)}"
        values[name] = int(found[2]) if name == "n" else float(found[2])
        return f'"{found[1]}":%({name})r'

    return re.sub(r'"(t|n|end|begin)":([0-9.e-]+)', take, line.replace("%", "%%")), values


def _peak_memory() -> float:
    """Peak memory of this process, MB."""
    if sys.platform == "linux":
        status = Path("/proc/self/status").read_text()
        return int(status.split("VmHWM:")[1].split()[0]) / 1024
    import resource

    unit = 2**20 if sys.platform == "darwin" else 2**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def open_long_log(path: Path) -> dict[str, float]:
    """Seconds to open a log and to seek in it, and its memory."""
    begin = time.perf_counter()
    log = RunLogIndex(path)
    opened = time.perf_counter() - begin
    playback = Playback(log)
    chance = random.Random(1)
    seeks, frames = [], []
    for _ in range(50):
        elapsed = chance.uniform(0, log.duration)
        begin = time.perf_counter()
        playback.state_at(log.find_time(elapsed), elapsed)
        seeks.append(time.perf_counter() - begin)
        begin = time.perf_counter()
        playback.state_at(log.find_time(elapsed + 0.1), elapsed + 0.1)
        frames.append(time.perf_counter() - begin)
    begin = time.perf_counter()
    log.find_next(0, EntryFlag.FAULTY)
    log.find_previous(log.count, EntryFlag.CONTACT)
    hunt = time.perf_counter() - begin
    return {
        "entries": log.count,
        "megabytes": path.stat().st_size / 1e6,
        "bytes a command": _bytes_a_command(path),
        "open, s": opened,
        "seek, s (slowest of 50)": max(seeks),
        "next frame, s (median)": statistics.median(frames),
        "next refused and last contact, s": hunt,
        "memory, MB": _peak_memory(),
    }


def _bytes_a_command(path: Path) -> float:
    """Mean size of a command in the log, bytes, without the header."""
    with path.open("rb") as file:
        _, *lines = file.readlines(10_000_000)
    commands = sum(b'"kind":"checkpoint"' not in line for line in lines)
    return sum(map(len, lines)) / commands


def stream_long_log(path: Path) -> dict[str, float]:
    """Seconds and memory of `report` for a log, and the ratio of its time to json's time for decoding the
    lines."""
    from simmer_tui.cli.log_reports import build_report

    busy = time.process_time()
    with path.open("rb") as file:
        for line in file:
            json.loads(line)
    decoding = time.process_time() - busy
    begin, busy = time.perf_counter(), time.process_time()
    run = build_report(path, recorded=False)
    took = time.process_time() - busy
    return {
        "report, s": time.perf_counter() - begin,
        "report, s of a core": took,
        "report, us of a core a command": 1e6 * took / run.totals.commands,
        "report, ratio to json.loads": took / decoding,
        "report memory, MB": _peak_memory(),
    }


def _in_own_process(*arguments: str) -> dict[str, float]:
    output = subprocess.run(
        [sys.executable, __file__, *arguments], check=True, capture_output=True, text=True
    )
    found: dict[str, float] = json.loads(output.stdout)
    return found


def measured(folder: Path, options: argparse.Namespace) -> dict[str, dict[str, float]]:
    """All figures asked for, by title."""
    seconds, rounds = (0.5, 5) if options.quick else (1.0, 11)
    if options.against:
        other = options.against.resolve()
        title = f"a report of {options.commands:,} commands, against another"
        return {title: against(other, folder, rounds, options.commands)}
    results = {"round trips a second": round_trips(folder, seconds, rounds)}
    path = folder / "long.jsonl"
    make_long_log(path, 100_000 if options.quick else 1_000_000)
    results["a long log"] = _in_own_process("--open", str(path))
    results["its report"] = _in_own_process("--report", str(path))
    return results


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="shorter runs, a log of 100,000 commands")
    parser.add_argument("--json", type=Path, help="write the numbers there too")
    parser.add_argument("--against", type=Path, metavar="DIR", help="compare reports with another checkout's")
    parser.add_argument("--commands", type=int, default=20_000, help="commands of a log with --against")
    parser.add_argument("--client", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--open", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--report", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.client:
        address, seconds = options.client
        print(json.dumps({"rate": rate(address, float(seconds))}))
        return
    if options.open or options.report:
        numbers = open_long_log(options.open) if options.open else stream_long_log(options.report)
        print(json.dumps(numbers))
        return
    with tempfile.TemporaryDirectory() as name:
        results = measured(Path(name), options)
    for title, numbers in results.items():
        print(title)
        for name, value in numbers.items():
            print(f"  {name:34} {value:12,.4g}")
    if options.json:
        options.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
