"""The first line of a run log: configuration, seed and state of the run."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from datetime import datetime
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import msgspec
from msgspec.structs import replace

from simmer_tui.config.device_trust import DeviceUse
from simmer_tui.config.loader import Configuration, Override, load
from simmer_tui.config.set_devices import DeviceStatus
from simmer_tui.config.sets import FILES
from simmer_tui.config.settings import all_settings, settings_from
from simmer_tui.errors import RunLogError, reason_of
from simmer_tui.run.events import Real
from simmer_tui.run.state import Checkpoint, MissionProgress
from simmer_tui.runlog.line_form import logged_pose
from simmer_tui.runlog.log_records import Count, LoggedPose, RealSeconds
from simmer_tui.runlog.logged_devices import (
    LoggedDevice,
    logged_devices,
    logged_kinds,
    recorded_kinds,
    runnable_kinds,
    same_files,
)
from simmer_tui.runlog.run_command import RunCommand
from simmer_tui.runlog.typed_json import TypedJson
from simmer_tui.sim.block import Block
from simmer_tui.sim.command import WORD, cut
from simmer_tui.sim.fingerprint import math_fingerprint
from simmer_tui.sim.pose import Pose
from simmer_tui.sim.sensors import SensorKinds
from simmer_tui.sim.sensors.recorded_kinds import RecordedKind
from simmer_tui.sim.simulator import Simulator
from simmer_tui.sim.specs import Axes, DriveKind
from simmer_tui.version import __version__

# Goes up with every change that an older reader would misread; logs of other formats are refused.
FORMAT = 1
"""Version of the log format that this program writes and reads."""
_SUFFIXES = (".csv", ".toml")
# A log is simulated from the seed in its header, and always without the real robot.
_OF_THE_RUN = ("seed", "randerror", "sim", "serial.port")
"""Settings for the source of a run's randomness, and for its robot."""
_TOKEN_LINE = re.compile(r"(?m)^([ \t]*(?:server\.)?token[ \t]*=[ \t]*).*$")
"""The line of settings.toml with the access token."""


class TakenOver(msgspec.Struct, frozen=True):
    """The origin of a run that continues another one: the name of that run's log, its last line that counts,
    and the moment, elapsed seconds."""

    log: str
    line: int
    elapsed: Real

    def __str__(self) -> str:
        return f"from {cut(self.log)} at {self.elapsed:.2f} s"


class Header(msgspec.Struct, tag_field="kind", tag="header", frozen=True, kw_only=True, omit_defaults=True):
    """The first line of a log.

    `t`, `number`, `pose`, `block`, `holding`, `noise` and `bias` are the state in which the log began. It has
    simulated time, the number of commands before it, and values that a person may have changed. `real_time`
    is seconds since 1970. `mission` is true if a mission was under way. `taken_over` is the origin of a run
    that continues another one. `run` is the command of `--run`, if there was one. `mathematics` is the
    fingerprint of the machine's sines; empty if it is not known. `devices` are the set's own device files by
    hash, and `kinds` describes the kinds of sensor that are not built in. `sketches` are those of a run with
    boards, by board: file and hash.
    """

    t: Real
    format: int
    program: str
    start: str
    real_time: RealSeconds = msgspec.field(name="real")
    seed: Count
    configuration: str
    number: Count
    logged_pose: LoggedPose = msgspec.field(name="pose")
    logged_block: LoggedPose = msgspec.field(name="block")
    holding: bool
    noise: bool
    mission: bool
    taken_over: TakenOver | None = None
    run: RunCommand | None = None
    mathematics: str = ""
    logged_bias: dict[DriveKind, LoggedPose] = msgspec.field(name="bias")
    settings: dict[str, Any]
    files: dict[str, str]
    devices: tuple[LoggedDevice, ...] = ()
    kinds: tuple[RecordedKind, ...] = ()
    sketches: dict[str, str] = {}

    def checkpoint(self, configuration: Configuration) -> Checkpoint:
        """The checkpoint at which the log begins."""
        spec = configuration.simulation
        block = Block(self.block.x, self.block.y, spec.block_size, self.block.heading)
        return Checkpoint(
            spec=spec,
            bias=self.bias,
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
    def pose(self) -> Pose:
        """The robot's pose when the log began."""
        return Pose(*self.logged_pose)

    @property
    def block(self) -> Pose:
        """The block's pose when the log began."""
        return Pose(*self.logged_block)

    @property
    def bias(self) -> dict[DriveKind, Axes]:
        """The drive bias in force when the log began."""
        return {kind: Axes(*error) for kind, error in self.logged_bias.items()}

    @property
    def simulated(self) -> bool:
        """True if the robot was a simulated one."""
        return self.settings.get("sim") is not False

    @property
    def can_run_again(self) -> bool:
        """True if the log names a program that can be run again from the start of a simulated run."""
        return self.simulated and self.taken_over is None and self.run is not None and bool(self.run.line)


class _Version(msgspec.Struct, tag_field="kind", tag="header"):
    """The part of a header that every format has."""

    format: Any
    program: Any = "?"


_VERSION: TypedJson[_Version] = TypedJson(_Version)
_HEADER: TypedJson[Header] = TypedJson(Header)


def header_of(
    configuration: Configuration,
    simulator: Simulator,
    now: datetime,
    mission: bool = False,
    taken_over: TakenOver | None = None,
    run: RunCommand | None = None,
    sketches: Mapping[str, str] | None = None,
) -> Header:
    """The header of a log that begins now."""
    return Header(
        t=simulator.time,
        format=FORMAT,
        program=__version__,
        start=now.isoformat(timespec="seconds"),
        real_time=now.timestamp(),
        seed=simulator.seed,
        configuration=configuration.name,
        number=simulator.commands,
        logged_pose=logged_pose(simulator.pose),
        logged_block=logged_pose(simulator.block),
        holding=simulator.holding,
        noise=simulator.noise,
        mission=mission,
        taken_over=taken_over,
        run=run,
        mathematics=math_fingerprint(),
        logged_bias={kind: (axes.x, axes.y, axes.r) for kind, axes in simulator.bias.items()},
        # Logs get shared, so the access token is removed.
        settings=msgspec.to_builtins(settings_from({"server.token": ""}, configuration.settings)),
        files={name: _TOKEN_LINE.sub(r'\1""', text) for name, text in configuration.files.items()},
        devices=logged_devices(configuration.devices),
        kinds=logged_kinds(configuration.simulation.sensors),
        sketches=dict(sketches or {}),
    )


def parse_header(line: bytes, shown: str) -> Header:
    """Read the first line. Raises RunLogError, which names the log as `shown`, if it is not a header of
    this format."""
    try:
        version = _VERSION.decode(line)
    except ValueError:
        raise RunLogError(
            f"{shown} is not a run log: its first line is not the header of one; --log FILE writes a log"
        ) from None
    # Checked before the whole header is decoded: other formats have other fields.
    if version.format != FORMAT:
        raise RunLogError(
            f"{shown} is a run log of format {cut(repr(version.format), WORD)}, written by simmer-tui "
            f"{cut(str(version.program), WORD)}; simmer-tui {__version__} reads format {FORMAT}: "
            "log the run again, with --log"
        )
    try:
        return _HEADER.decode(line)
    except ValueError as error:
        raise RunLogError(f"{shown}: the header is broken: {cut(str(error))}") from None


def rebuild(header: Header, kinds: SensorKinds | None = None) -> Configuration:
    """The configuration of a logged run, read by the ordinary loader from the header's texts. Kinds that are
    not built in are as the header describes them, unless `kinds` are given; sensors of described kinds cannot
    be read.

    Raises ConfigurationError for mistakes in them, RunLogError for names that are no files of a set
    and if no temporary file can be written.
    """
    known = recorded_kinds(header.kinds) if kinds is None else kinds
    for name in header.files:
        if not _is_plain_name(name):
            raise RunLogError(f"the header holds {cut(name)!r}, which is no file of a set")
    if missing := [name for name in FILES if name not in header.files]:
        raise RunLogError(f"the header lacks {', '.join(missing)}: the robot of this log is not known")
    # As files, so that the ordinary loader finds the same mistakes with the same messages.
    with ExitStack() as stack:
        try:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="simmer-tui-"))
            for name, text in header.files.items():
                (Path(folder) / name).write_bytes(text.encode("utf-8", "surrogatepass"))
        except OSError as error:
            what = "the set of the log cannot be unpacked into a temporary folder"
            raise RunLogError(f"{what}: {reason_of(error)}") from None
        loaded = load(Path(folder), _overrides(header.settings), known, devices=DeviceUse.GIVEN)
    kinds_of = tuple(kind.name for kind in header.kinds)
    statuses = tuple(
        DeviceStatus(each.path, each.sha256, trusted=False, ran=False, kinds=kinds_of)
        for each in header.devices
    )
    directory = Path(header.configuration)
    return replace(loaded, directory=directory, name=header.configuration, device_statuses=statuses)


def rebuild_to_run(header: Header, folder: Path | None = None) -> Configuration:
    """The same with the device files of the run, so that its sensors can be read. They are searched in a
    `folder`, or in that of the run's set. Raises RunLogError if one is missing, changed or not trusted."""
    if not header.kinds and not header.devices:
        return rebuild(header)
    where = Path(header.configuration) if folder is None else folder
    files = same_files(header.devices, where)
    kinds = runnable_kinds(files, where)
    for kind in header.kinds:
        if kind.name not in kinds:
            raise RunLogError(
                f"the run had sensors of the kind {cut(kind.name, WORD)!r}, which is in none of its device "
                "files: they were given in Python, and can be run again from there only"
            )
    return replace(rebuild(header, kinds), devices=files)


def _is_plain_name(name: str) -> bool:
    """True if a file of this name stays in its folder, on any system."""
    # Both systems' rules: a log may come from another one, and must write nowhere else.
    plain = PurePosixPath(name).name == name == PureWindowsPath(name).name
    return plain and name.isprintable() and name.isascii() and name.endswith(_SUFFIXES) and len(name) < 100


def _overrides(settings: Mapping[str, Any]) -> dict[str, Override]:
    # Looking at a log never drives a robot.
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
