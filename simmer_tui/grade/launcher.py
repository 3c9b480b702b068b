"""The first process inside a sandbox: listens for the simulator outside, then starts the program.

    python -I -S launcher.py DESCRIPTOR        (an inherited Unix socket, SOCK_SEQPACKET)
    python -I -S launcher.py PATH              (one to connect to)

Each message on the socket is an order in JSON. `{"listen": PORT}` is answered by `{"port": PORT}` and the
sockets that listen there, in the network of the sandbox, so no data needs a relay. `{"meter": 1}` is answered
by a socket that reports the buffers of all sockets in the sandbox (sock_diag). `{"run": WORDS, ...}` is the
last: the program's files are copied, the user changed, limits set, and the program begins, as a child. The
socket closes when it begins; before that, text on it is an error.

This process then waits for the program, and for orphaned processes, and ends with the program's exit code. It
has the program's limits, and its memory can neither be read nor written by the program (PR_SET_DUMPABLE).

The script imports nothing of this package: every run of a program waits for it.
"""

from __future__ import annotations

import ctypes
import errno
import json
import os
import shutil
import signal
import socket
import sys
from typing import Any

# Listening again sets another number, as `LaunchedSandbox.take` does.
_BACKLOG = 128
# An order holds the environment of the program: some kilobytes.
_LONGEST_ORDER = 1 << 17
# A port that is free for IPv4 may be used for IPv6; in a network of its own the first try works.
_TRIES = 50
_SET_DUMPABLE = 4  # PR_SET_DUMPABLE, linux/prctl.h
_SOCK_DIAG = 4  # NETLINK_SOCK_DIAG, linux/netlink.h
_NOT_STARTED = 127
"""Exit code of a child that could not execute the program, as in shells."""
_MISTAKES = (OSError, shutil.Error, ValueError)
"""Errors of an order, which the simulator gets as text. A NUL in a word is a ValueError."""


def main(arguments: list[str]) -> None:
    if sys.platform != "linux":
        raise NotImplementedError  # there are no sandboxes here
    ctypes.CDLL(None).prctl(_SET_DUMPABLE, 0, 0, 0, 0)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # the program, which may have the same user, may send them
    if arguments[0].isdecimal():
        link = socket.socket(fileno=int(arguments[0]))
    else:
        link = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        link.connect(arguments[0])
    link.set_inheritable(False)
    while order := link.recv(_LONGEST_ORDER):
        fields = json.loads(order)
        try:
            if "listen" in fields:
                port, sockets = _listen(fields["listen"])
                answer = json.dumps({"port": port}).encode()
                socket.send_fds(link, [answer], [each.fileno() for each in sockets])
                for each in sockets:
                    each.close()
            elif "meter" in fields:
                with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, _SOCK_DIAG) as meter:
                    socket.send_fds(link, [b"{}"], [meter.fileno()])
            else:
                _run(link, fields)
        except _MISTAKES as error:
            _send_error(link, error)


def _send_error(link: socket.socket, error: Exception) -> None:
    text = getattr(error, "strerror", None) or str(error)
    link.send(json.dumps({"error": text[:500]}).encode())


def _listen(port: int) -> tuple[int, list[socket.socket]]:
    """Sockets on 127.0.0.1 and, where there is one, ::1, on the same port; 0 is any free one."""
    for _ in range(_TRIES):
        sockets: list[socket.socket] = []
        try:
            sockets.append(_listening(socket.AF_INET, "127.0.0.1", port))
            number = sockets[0].getsockname()[1]
            try:
                sockets.append(_listening(socket.AF_INET6, "::1", number))
            except OSError as error:
                if error.errno == errno.EADDRINUSE:
                    raise
            return number, sockets
        except OSError as error:
            for each in sockets:
                each.close()
            if error.errno != errno.EADDRINUSE or port:
                raise
    raise OSError(errno.EADDRINUSE, "no port was free")


def _listening(family: socket.AddressFamily, address: str, port: int) -> socket.socket:
    made = socket.socket(family, socket.SOCK_STREAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            made.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        made.bind((address, port))
        made.listen(_BACKLOG)
    except OSError:
        made.close()
        raise
    return made


def _run(link: socket.socket, order: dict[str, Any]) -> None:
    """Run the program, and end with its exit code. Raises OSError."""
    if sys.platform != "linux":
        raise NotImplementedError  # there are no sandboxes here
    pid = os.fork()
    if pid == 0:
        try:
            _become(order)
        except _MISTAKES as error:
            _send_error(link, error)
        finally:
            os._exit(_NOT_STARTED)
    link.close()  # the child's copy closes when it executes the program
    null = os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1, 2):  # so the output ends with the program and its children
        os.dup2(null, standard)
    _limit(order["limits"])
    while True:
        ended, status = os.wait()
        if ended == pid:
            code = os.waitstatus_to_exitcode(status)
            os._exit(code if code >= 0 else 128 - code)


def _limit(limits: dict[str, int]) -> None:
    """Set limits, by the end of their RLIMIT_ names. Raises OSError."""
    if sys.platform != "linux":
        raise NotImplementedError  # there are no sandboxes here
    import resource  # imported here: it does not exist on all systems on which this module is found

    for name, value in limits.items():
        resource.setrlimit(getattr(resource, f"RLIMIT_{name}"), (value, value))


def _become(order: dict[str, Any]) -> None:
    """Become the program. Raises OSError."""
    if sys.platform != "linux":
        raise NotImplementedError  # there are no sandboxes here
    uid = order["uid"]
    if uid is not None:  # before the limits: that of processes does not apply to root
        os.setgroups([])
        os.setgid(uid)
        os.setuid(uid)
    home = order["home"]
    if order["files"]:  # a copy of its own, removed with the sandbox
        shutil.copytree(order["files"], home, symlinks=True)
    os.chdir(home)
    _limit(order["limits"])
    for name in ("SIGPIPE", "SIGXFSZ", "SIGINT", "SIGTERM", "SIGHUP"):  # ignored here; programs should not
        signal.signal(getattr(signal, name), signal.SIG_DFL)
    os.environ["PATH"] = order["environment"]["PATH"]  # where the program is looked for
    program = order["run"][0]
    try:
        os.execvpe(program, order["run"], order["environment"])
    except FileNotFoundError:  # also for a script whose interpreter is not there
        if shutil.which(program) is None and not os.path.lexists(program):
            raise FileNotFoundError(errno.ENOENT, f"the sandbox has no {program}") from None
        raise


if __name__ == "__main__":
    main(sys.argv[1:])
