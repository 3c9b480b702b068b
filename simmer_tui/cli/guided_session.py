"""`simmer-tui calibrate --guided`: a session with the robot connected, on the terminal."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from simmer_tui.calibrate.estimates import shown
from simmer_tui.calibrate.fit import Fit, fit
from simmer_tui.calibrate.guided import WANTED, SessionPlanner, drive_guided, guided_run, where_to_put
from simmer_tui.calibrate.measured_run import read_runs
from simmer_tui.config.loader import Configuration
from simmer_tui.config.reply_formats import ReplyForm, ReplyFormat
from simmer_tui.errors import CalibrationError
from simmer_tui.links.backend import BackendSwitch, Message
from simmer_tui.links.robot_bridge import bridge_to
from simmer_tui.links.serial_link import SerialLink
from simmer_tui.robot.engine import Engine
from simmer_tui.runlog.writer import RunLog
from simmer_tui.sim.command import counted, parse_command
from simmer_tui.sim.records import CommandResult
from simmer_tui.sim.simulator import Simulator

_NAMES = {
    "main": "biases of the drives, along their axes",
    "angle": "mounting angles of range sensors, deg",
    "range": "biases of range sensors, in",
}
_OTHER_LINES = 6
"""Lines of the picture that are neither goals nor figures."""


def hold_session(configuration: Configuration, log: Path, console: Console) -> None:
    """Drive the robot on the set's serial port, and log the session.

    Ends when enough is known, when the robot cannot move, or at Ctrl-C, which stops the robot. Raises
    RunLogError if the log cannot be written.
    """
    configuration = configuration.with_settings({"sim": False})
    guide = SessionPlanner(configuration, np.random.default_rng(secrets.randbits(64)))
    if configuration.dialect is not None and not (guide.drives and guide.looks()):
        what = "reads a sensor" if guide.drives else "drives by a length"
        raise CalibrationError(f"no message of the dialect {what}; simmer-tui check lists what each one does")
    console.print(Text(where_to_put(guide)))
    try:
        console.input("Press Enter when it stands there (Ctrl-C to give up). ")
    except EOFError:
        raise CalibrationError("--guided needs somebody who puts the robot there and presses Enter") from None
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_session(configuration, guide, log, console))
    # A spin takes seven: with fewer than ten no drive but the turning one has moved twice.
    if guide.count < 10:
        raise CalibrationError("the session ended before there was enough to estimate anything")
    if guide.stuck:
        console.print(Text(f"The session ended after {guide.count} movements: {guide.stuck}"))


async def _session(configuration: Configuration, guide: SessionPlanner, log: Path, console: Console) -> None:
    loop = asyncio.get_running_loop()
    settings = configuration.settings
    twin = Simulator(configuration.simulation, 0)
    # With a dialect a movement takes its planned time: the robot need not answer it.
    dialect = configuration.dialect
    engine = Engine(twin, timed=dialect is not None and dialect.protocol is None)
    engine.start(loop)
    form = ReplyForm(ReplyFormat(settings.server.reply_format), settings.server.byte_order)
    with RunLog(log, configuration, twin) as written:
        engine.watch(written)
        switch = BackendSwitch(engine)
        serial = settings.serial
        link = SerialLink(serial.port, serial.baud, moves_dtr=serial.dtr)
        bridge = bridge_to(configuration, engine, link, serial, switch)
        switch.use(bridge)
        session = engine.session()

        async def ask(text: str) -> float:
            answered: asyncio.Future[float] = loop.create_future()
            message = Message(f"{text}\n".encode(), (parse_command(text),), form)
            switch.submit(message, session, partial(_answer, answered))
            return await answered

        async def learn() -> Fit | None:
            def work() -> Fit | None:
                with contextlib.suppress(CalibrationError):
                    return fit(guided_run(read_runs([log])))
                return None

            return await asyncio.to_thread(work)

        with Live(console=console, refresh_per_second=4) as live:

            def show(what: str) -> None:
                link = bridge.port if bridge.connected else bridge.hindrance
                live.update(progress_picture(guide, what, link, console.height))

            try:
                await drive_guided(ask, guide, learn, time.time, show)
                show("done")
            except asyncio.CancelledError:
                bridge.stop()
                # Time for the stop to be sent before the port is closed.
                await asyncio.sleep(0.3)
                raise
            finally:
                bridge.close()


def _answer(asked: asyncio.Future[float], results: Sequence[CommandResult], _: bytes | None) -> None:
    """Give a command's reply to the session, unless it is ending: then nobody waits for it."""
    if not asked.done():
        asked.set_result(results[0].reply)


def progress_picture(guide: SessionPlanner, what: str, link: str, height: int) -> Group:
    """The progress of the session in `height` lines: the present step, and the intervals of the parameters,
    the least known first."""
    pose = guide.pose
    head = Text(
        f"movement {guide.count} of at most {guide.most}, now: {what}   [{link}]\n"
        f"the robot is believed at ({pose.x:.1f}, {pose.y:.1f}), heading {pose.heading:.0f}",
        overflow="ellipsis",
        no_wrap=True,
    )
    goals = Table("median standard error", "now", "wanted", box=None)
    for name, now in guide.reached.items():
        goals.add_row(_NAMES[name], "?" if np.isinf(now) else f"{now:.3g}", f"{WANTED[name]:g}")
    if guide.fit is None:
        return Group(head, goals)
    figures = Table("part", "parameter", "is", "95 % interval", "uncertainty left", box=None)
    found = guide.fit
    remaining = found.standard_errors / [parameter.spread for parameter in found.space.parameters]
    room = max(height - _OTHER_LINES - len(goals.rows), 1)
    order = np.argsort(-remaining, kind="stable")
    for index in order[:room]:
        parameter, is_identified = found.space.parameters[index], found.identified[index]
        value, spread = float(found.state.parameters[index]), float(found.standard_errors[index])
        middle, low, high = shown(value, *parameter.interval(value, spread))
        bar = "#" * max(1, min(20, round(20 * float(remaining[index]))))
        cells = (middle, f"{low} to {high}") if is_identified else ("?", "not identified yet")
        figures.add_row(parameter.owner, parameter.label, *cells, bar)
    rest = Text(f"and {counted(len(order) - room, 'parameter')} known better" if len(order) > room else "")
    return Group(head, goals, figures, rest)
