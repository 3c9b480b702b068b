"""The first line of a run log: what ran, with which configuration, from which seed and state."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import msgspec
from msgspec.structs import replace

from simmer_tui.config.loader import Configuration, Override, load
from simmer_tui.config.settings import Settings, all_settings
from simmer_tui.errors import RunLogError
from simmer_tui.run.state import Checkpoint, MissionProgress, starts_of
from simmer_tui.runlog.encode import header_text
from simmer_tui.runlog.entries import LARGEST
from simmer_tui.runlog.numbers import number, numbers
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import escape
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.simulator import Simulator
from simmer_tui.sim.specs import Axes, DriveKind
from simmer_tui.version import __version__

FORMAT = 2
"""The version of the format that this program writes; logs of format 1 are read as well."""
_SUFFIXES = (".csv", ".toml")
_OF_THE_RUN = ("seed", "randerror", "sim", "serial.port")
"""Settings that say where a run's randomness came from and what it drove; a log is simulated from
the seed in its header."""
_TOKEN_LINE = re.compile(r"(?m)^([ \t]*(?:server\.)?token[ \t]*=[ \t]*).*$")
"""The line of settings.toml with the word that lets programs drive."""


@dataclass(frozen=True, slots=True)
class TakenOver:
    """Where a run began that goes on from a moment of another one: the name of that one's log, the last
    line of it that counts, and the moment, elapsed seconds."""

    log: str
    line: int
    elapsed: float

    def __str__(self) -> str:
        return f"from {escape(self.log, 80)} at {self.elapsed:.2f} s"


@dataclass(frozen=True, slots=True)
class Header:
    """What the first line says.

    `t`, `number`, `pose`, `block`, `holding`, `noise` and `bias` are the state the log began in:
    simulated time, commands before it, and what a person may have changed till then. `mission`
    tells that a mission was under way. `written` is the format the file itself is in. `taken_over` says
    that the run began as another one did, and from which moment on it is its own.
    """

    program: str
    configuration: str
    files: Mapping[str, str]
    settings: Mapping[str, Any]
    seed: int
    start: str
    wall: float
    t: float
    number: int
    pose: Pose
    block: Pose
    holding: bool
    noise: bool
    mission: bool
    bias: Mapping[DriveKind, Axes]
    written: int = FORMAT
    taken_over: TakenOver | None = None

    def beginning(self, configuration: Configuration) -> Checkpoint:
        """What a fold must know of the run when the log begins."""
        spec = configuration.simulation
        start, start_block = starts_of(spec)
        block = Block(self.block.x, self.block.y, spec.block_size, self.block.heading)
        return Checkpoint(
            start=start,
            start_block=start_block,
            time=self.t,
            pose=self.pose,
            block=block,
            seed=self.seed,
            holding=self.holding,
            noise=self.noise,
            time_scale=configuration.settings.motion.time_scale,
            commands=self.number,
            mission=MissionProgress() if self.mission else None,
        )

    @property
    def simulated(self) -> bool:
        """Whether the robot was a simulated one."""
        return self.settings.get("sim") is not False


def header_line(
    configuration: Configuration,
    simulator: Simulator,
    now: datetime,
    mission: bool = False,
    taken_over: TakenOver | None = None,
) -> str:
    """The first line for a log that begins now."""
    pose, block = simulator.pose, simulator.block
    return header_text(
        {
            "t": float(simulator.time),
            "kind": "header",
            "format": FORMAT,
            "program": __version__,
            "start": now.isoformat(timespec="seconds"),
            "wall": now.timestamp(),
            "seed": simulator.seed,
            "configuration": configuration.name,
            "number": simulator.commands,
            "pose": [float(pose.x), float(pose.y), float(pose.heading)],
            "block": [float(block.x), float(block.y), float(block.heading)],
            "holding": simulator.holding,
            "noise": simulator.noise,
            "mission": mission,
            **({} if taken_over is None else {"taken_over": asdict(taken_over)}),
            "bias": {
                kind.value: [float(axes.x), float(axes.y), float(axes.r)]
                for kind, axes in simulator.bias.items()
            },
            "settings": msgspec.to_builtins(_without_token(configuration.settings)),
            "files": {name: _TOKEN_LINE.sub(r'\1""', text) for name, text in configuration.files.items()},
        }
    )


def parse_header(line: bytes, shown: str) -> Header:
    """Read the first line. Raises RunLogError, which names the log as `shown`, if it is not one."""
    not_a_log = f"{shown} is not a run log: its first line is not the header of one"
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        raise RunLogError(not_a_log) from None
    if not isinstance(fields, dict) or fields.get("kind") != "header" or "format" not in fields:
        raise RunLogError(not_a_log)
    if fields["format"] != FORMAT:
        version = escape(str(fields["format"]), 20)
        program = escape(str(fields.get("program", "?")), 20)
        raise RunLogError(
            f"{shown} is a run log of format {version}, written by simmer-tui {program}; "
            f"simmer-tui {__version__} reads formats 1 and {FORMAT}"
        )
    try:
        return _header(fields)
    except KeyError as error:
        raise RunLogError(f"{shown}: the header has no field {error.args[0]!r}") from None
    except (ValueError, TypeError, OverflowError, AttributeError) as error:
        raise RunLogError(f"{shown}: the header is broken: {escape(str(error), 120)}") from None


def _header(fields: dict[str, Any]) -> Header:
    files, settings = fields["files"], fields["settings"]
    if not isinstance(files, dict) or not all(isinstance(text, str) for text in files.values()):
        raise ValueError("files must be texts by name")
    if not isinstance(settings, dict):
        raise ValueError("settings must be values by name")
    for name in ("seed", "number"):
        if not isinstance(fields[name], int) or fields[name] < 0:
            raise ValueError(f"{name} must be a whole number, 0 or more")
    return Header(
        program=str(fields["program"]),
        configuration=str(fields["configuration"]),
        files=files,
        settings=settings,
        seed=fields["seed"],
        start=str(fields["start"]),
        wall=_bounded(number(fields["wall"]), 1e10),
        t=_bounded(number(fields["t"])),
        number=fields["number"],
        pose=Pose(*map(_bounded, numbers(fields["pose"], 3))),
        block=Pose(*map(_bounded, numbers(fields["block"], 3))),
        holding=fields["holding"] is True,
        noise=fields["noise"] is True,
        mission=fields["mission"] is True,
        written=fields.get("written", FORMAT),
        taken_over=_taken_over(fields.get("taken_over")),
        bias={
            DriveKind(kind): Axes(*map(_bounded, numbers(axes, 3))) for kind, axes in fields["bias"].items()
        },
    )


def _taken_over(fields: Any) -> TakenOver | None:
    if fields is None:
        return None
    line, elapsed = fields["line"], _bounded(number(fields["elapsed"]))
    if not isinstance(line, int):
        raise ValueError("taken_over: line must be a whole number")
    return TakenOver(str(fields["log"]), line, elapsed)


def _bounded(value: float, limit: float = LARGEST) -> float:
    if not abs(value) <= limit:
        raise ValueError(f"{value} is too large")
    return value


def rebuild(header: Header) -> Configuration:
    """The configuration of a logged run, read by the ordinary loader from the header's texts.

    Raises ConfigurationError for mistakes in them, RunLogError for names that are no files of a set.
    """
    with tempfile.TemporaryDirectory(prefix="simmer-tui-") as folder:
        for name, text in header.files.items():
            if not _is_plain_name(name):
                raise RunLogError(f"the header holds {escape(name, 80)!r}, which is no file of a set")
            (Path(folder) / name).write_bytes(text.encode("utf-8", "surrogatepass"))
        loaded = load(Path(folder), _overrides(header.settings))
    return replace(loaded, directory=Path(header.configuration), name=header.configuration)


def _without_token(settings: Settings) -> Settings:
    """A log is handed on; who may drive the robot is nobody else's affair."""
    return replace(settings, server=replace(settings.server, token=""))


def _is_plain_name(name: str) -> bool:
    """Whether a file of this name stays in its folder, on any system."""
    plain = PurePosixPath(name).name == name == PureWindowsPath(name).name
    return plain and name.isprintable() and name.isascii() and name.endswith(_SUFFIXES) and len(name) < 100


def _overrides(settings: Mapping[str, Any]) -> dict[str, Override]:
    overrides = {"sim": Override("sim in the log", True)}
    for name in (item.name for item in all_settings()):
        value = _looked_up(settings, name.split("."))
        if value is not None and name not in _OF_THE_RUN:
            overrides[name] = Override(f"{name} in the log", value)
    return overrides


def _looked_up(tree: Any, keys: Iterable[str]) -> Any:
    for key in keys:
        if not isinstance(tree, Mapping) or key not in tree:
            return None
        tree = tree[key]
    return tree
