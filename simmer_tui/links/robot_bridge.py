"""The connection to a real robot: by the course's protocols, or in the team's own language."""

from __future__ import annotations

from simmer_tui.config.dialects import TEAM
from simmer_tui.config.loader import Configuration
from simmer_tui.config.settings import SerialSettings
from simmer_tui.errors import reason_of
from simmer_tui.links.backend import BackendSwitch
from simmer_tui.links.real_robot import RealRobot
from simmer_tui.links.serial_link import RobotLink
from simmer_tui.robot.engine import Engine


def bridge_to(
    configuration: Configuration,
    engine: Engine,
    link: RobotLink,
    serial: SerialSettings,
    switch: BackendSwitch,
) -> RealRobot:
    """Begin to drive the robot at the other end of a link. Its exchange is recorded if `serial` says so."""
    if serial.record:
        from simmer_tui.links.serial_link import RecordedLink

        try:
            link = RecordedLink(link, serial.record, serial.baud)
        except OSError as error:
            text = f"what the robot says is not recorded: {serial.record}: {reason_of(error)}"
            engine.tell_fault(text)
    rules = configuration.dialect
    if rules is not None and rules.protocol is None and TEAM in configuration.settings.server.listeners:
        from simmer_tui.links.dialect_robot import DialectRobot

        robot = DialectRobot(engine, link, serial, rules, switch)
        switch.byte_robot = robot
        return robot
    from simmer_tui.links.serial_bridge import SerialBridge

    return SerialBridge(engine, link, serial)
