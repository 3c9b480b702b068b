"""Serial ports: listing and opening them, guessing the device behind one, and explaining failures."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simmer_tui import platform_has
from simmer_tui.sim.command import cut

WRITE_TIMEOUT = 2.0
"""Seconds after which a port that takes no bytes counts as lost."""

# USB vendor IDs, as in usb.ids: of Arduino itself, and of the chips and boards that are sold as one.
_ARDUINO = frozenset({0x2341, 0x2A03})
_USB_SERIAL = {
    0x1A86: "CH340",
    0x0403: "FTDI",
    0x10C4: "CP210x",
    0x067B: "PL2303",
    0x16C0: "Teensy",
    0x1B4F: "SparkFun",
    0x239A: "Adafruit",
    0x2E8A: "RP2040",
    0x303A: "ESP32",
}
_BLUETOOTH = ("bluetooth", "bthenum", "rfcomm", "hc-05", "hc-06", "spp")


@dataclass(frozen=True, slots=True)
class SerialPort:
    """A serial port of this machine. `mark` is the device that it probably leads to, or empty."""

    device: str
    description: str
    mark: str


def list_ports() -> tuple[SerialPort, ...]:
    """The serial ports of this machine, sorted."""
    from serial.tools.list_ports import comports

    return describe_ports(comports())


def describe_ports(found: Iterable[Any]) -> tuple[SerialPort, ...]:
    """pyserial's `ListPortInfo`s as ports with marks; text from devices is made safe to show."""
    return tuple(
        SerialPort(cut(str(info.device)), cut(_description(info)), _mark(info)) for info in sorted(found)
    )


def _description(info: Any) -> str:
    text = info.description or ""
    return "" if text == "n/a" else str(text)


def _mark(info: Any) -> str:
    words = f"{info.device} {info.description or ''} {info.hwid or ''} {info.manufacturer or ''}".lower()
    if any(word in words for word in _BLUETOOTH):
        return "Bluetooth"
    if info.vid in _ARDUINO or "arduino" in words:
        return "Arduino"
    if info.vid in _USB_SERIAL:
        return f"probably Arduino ({_USB_SERIAL[info.vid]})"
    return ""


def is_usb(name: str) -> bool:
    """True if a port belongs to a USB adapter, or to a board with its own USB. Most of these boards start
    again when their port is opened. Ports of Bluetooth, pseudo-terminals and URLs do not do that."""
    from serial.tools.list_ports import comports

    if "://" in name:
        return False
    # A name of udev, such as /dev/serial/by-id/..., is a link; macOS has two names for each port.
    device = os.path.realpath(name) if platform_has.POSIX else name
    device = device.replace("/dev/tty.", "/dev/cu.").lower()
    return any(info.vid is not None and str(info.device).lower() == device for info in comports())


def open_port(name: str, baud: int, *, moves_dtr: bool = True) -> Any:
    """A pyserial port, opened for this program only.

    Without `moves_dtr` the line DTR stays where it is, as far as the system allows. Windows leaves it low.
    Linux and macOS raise it whenever a port is opened, so there it stays high when the port is closed: from
    the second time on, opening it does not move it.

    Raises OSError, ValueError for an invalid URL or baud rate, and any other error that pyserial lets through
    (termios.error on Unix). `explain` puts it into words.
    """
    import serial

    if "://" in name:
        # Not every kind of URL can limit the time of a write.
        return serial.serial_for_url(name, baudrate=baud)
    port = serial.Serial(None, baud, write_timeout=WRITE_TIMEOUT, exclusive=True)
    port.port = name
    if not (moves_dtr or platform_has.POSIX):
        # RTS as well: boards with an ESP32 start again by either.
        port.dtr = port.rts = False
    port.open()
    if not moves_dtr and platform_has.POSIX:
        _keep_dtr(port.fileno())
    return port


def _keep_dtr(descriptor: int) -> None:
    """Keep a terminal's lines as they are when it is closed."""
    if sys.platform != "win32":
        import termios

        attributes = termios.tcgetattr(descriptor)
        attributes[2] &= ~termios.HUPCL
        termios.tcsetattr(descriptor, termios.TCSANOW, attributes)


def close_port(port: Any) -> None:
    """Close a pyserial port, however broken it is."""
    sock = getattr(port, "_socket", None)
    with contextlib.suppress(OSError):  # the device is gone, and its buffers with it
        if sock is None:
            port.close()
            return
        # pyserial would sleep, and would not close a socket that the other end has reset.
        port.is_open = False
        sock.shutdown(socket.SHUT_RDWR)
    if sock is not None:
        sock.close()


def explain(error: Exception, name: str, *, was_open: bool = False) -> str:
    """The reason why a port could not be opened, or was lost, and the next step."""
    shown, detail = cut(name), str(error)
    if was_open:
        if "timeout" in detail.lower():
            return f"{shown} takes no more bytes: is the robot on, and in reach?"
        return f"{shown} has gone: unplugged, switched off or out of reach"
    number = getattr(error, "errno", None)
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO) or "FileNotFoundError" in detail:
        return f"there is no port {shown}; {_ports_there_are()}"
    if number in (errno.EBUSY, errno.EAGAIN) or (not platform_has.POSIX and "PermissionError" in detail):
        return f"{shown} is in use: close the other program that has it open (a serial monitor?)"
    if number in (errno.EACCES, errno.EPERM):
        return f"no permission to open {shown}{_group_to_join(name)}"
    return f"{shown} cannot be opened: {detail}"


def _ports_there_are() -> str:
    names = [port.device for port in list_ports()]
    return f"there are {', '.join(names)}" if names else "there is no serial port at all"


def _group_to_join(name: str) -> str:
    """Unix: the group whose members may use a device."""
    try:
        group = platform_has.group_name(Path(name).stat().st_gid)
    except OSError:
        group = ""
    if not group:
        return ""
    return f": it belongs to the group {group}; join with: sudo usermod -aG {group} $USER, then log in again"
