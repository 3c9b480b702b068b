"""The kinds of sensor that a set brings with it: those of its device files, run or parsed."""

from __future__ import annotations

from pathlib import Path

from simmer_tui.config.device_file import DeviceFile, read_devices
from simmer_tui.config.device_outline import DeviceOutline, outline_of
from simmer_tui.config.device_trust import DeviceUse, is_trusted, untrusted
from simmer_tui.config.set_devices import DeviceStatus, SetDevices
from simmer_tui.config.settings_file import LoadedSettings
from simmer_tui.errors import ConfigurationError, Problem
from simmer_tui.sim.rules import listed
from simmer_tui.sim.sensors import SensorKinds
from simmer_tui.sim.specs import SensorKind

SETTING = "sensors.devices"


def set_devices(directory: Path, loaded: LoadedSettings, kinds: SensorKinds, use: DeviceUse) -> SetDevices:
    """The devices of a set.

    Args:
        directory: The folder of the set.
        loaded: Its settings, which name them.
        kinds: The kinds that there are without them.
        use: The use that is made of the files.

    Raises:
        ConfigurationError: with every mistake in them.
    """
    names, place = loaded.settings.sensors.devices, loaded.places[SETTING]
    problems: list[Problem] = []
    files = read_devices(directory, names, place, problems)
    known = dict(kinds)
    owners: dict[str, str] = {}
    statuses = []
    for file in files:
        outline = outline_of(file, problems)
        if problems:
            continue
        trusted = use is not DeviceUse.PARSE and is_trusted(file, directory, asks=use is DeviceUse.RUN)
        if use is DeviceUse.RUN and not trusted:
            problems.append(untrusted(file, place))
            continue
        found = _found(file, outline, problems) if trusted else outline.kinds
        for kind in found:
            if kind.name in known:
                taken = owners.get(kind.name, "a built-in kind")
                what = f"{kind.__name__} has the name {kind.name!r} of {taken}; built in are {listed(kinds)}"
                problems.append(Problem(file.path, what))
            known[kind.name] = kind
            owners[kind.name] = f"{kind.__name__} in {file.path}"
        names_found = tuple(kind.name for kind in found)
        statuses.append(
            DeviceStatus(file.path, file.sha256, trusted, trusted, names_found, outline.unfinished)
        )
    if problems:
        raise ConfigurationError(problems)
    return SetDevices(known, files, tuple(statuses))


def _found(file: DeviceFile, outline: DeviceOutline, problems: list[Problem]) -> tuple[type[SensorKind], ...]:
    """The kinds of a file that is run; those of its outline, and the problems, if it cannot be."""
    from simmer_tui.config.device_code import kinds_of

    try:
        return kinds_of(file)
    except ConfigurationError as error:
        problems += error.problems
        return outline.kinds
