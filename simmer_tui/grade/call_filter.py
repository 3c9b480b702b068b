"""The filter of system calls for a sandboxed program, as the kernel expects it (classic BPF).

It refuses calls that the other means of the sandbox do not confine. These are user namespaces of the
program's own (in which it could mount memory without a limit), kernel keyrings (which remain afterwards),
other processes' memory, io_uring and performance counters. So are memory outside processes and file systems,
which has no limit (memfd, System V), and sockets of families that no namespace confines.

It also refuses calls by which one sandbox could observe another through common files: locks, leases and
hints, which belong to a file and not to its name, and watches (inotify, fanotify, dnotify). A lock is
answered with "no locks available" (ENOLCK), as on a file system without any. All else is allowed.

Layout and numbers: linux/seccomp.h, linux/filter.h, linux/fcntl.h, asm/unistd_64.h, asm-generic/unistd.h.
"""

from __future__ import annotations

import platform
import struct
from collections.abc import Mapping
from types import MappingProxyType

# Instructions of classic BPF: LD | W | ABS, then JMP by JEQ, JSET and JGT with a constant, and RET.
_LOAD, _EQUAL, _ANY_BIT, _ABOVE, _RETURN = 0x20, 0x15, 0x45, 0x25, 0x06
_ALLOW, _KILL = 0x7FFF0000, 0x80000000  # SECCOMP_RET_ALLOW, SECCOMP_RET_KILL_PROCESS
_REFUSE, _UNKNOWN, _NO_LOCK = 0x00050001, 0x00050026, 0x00050025
"""SECCOMP_RET_ERRNO with EPERM, ENOSYS and ENOLCK."""
_NUMBER, _ARCHITECTURE, _FIRST, _SECOND = 0, 4, 16, 24
"""Offsets in struct seccomp_data: the call's number, the architecture, the low halves of two arguments."""
_NEW_USER = 0x10000000  # CLONE_NEWUSER
_X32 = 0x3FFFFFFF  # call numbers above have __X32_SYSCALL_BIT
_FAMILIES = (0, 1, 2, 10, 16)
"""Families of sockets allowed: none, Unix, IPv4, IPv6, netlink. Some others are not confined by
namespaces."""
_LOCKS = (6, 7, 37, 38, 1024, 1026, 1036, 1038, 1040)
"""Commands of fcntl: F_SETLK, F_SETLKW, F_OFD_SETLK, F_OFD_SETLKW, F_SETLEASE, F_NOTIFY, F_SET_RW_HINT,
F_SET_FILE_RW_HINT, F_SETDELEG."""
# AUDIT_ARCH_X86_64 and AUDIT_ARCH_AARCH64, linux/audit.h.
_ARCHITECTURES = MappingProxyType({"x86_64": 0xC000003E, "aarch64": 0xC00000B7})
_CALLS: Mapping[str, tuple[int, int | None]] = MappingProxyType(
    {
        "clone": (56, 220), "unshare": (272, 97), "socket": (41, 198), "socketpair": (53, 199),
        "clone3": (435, 435),
        "ptrace": (101, 117), "process_vm_readv": (310, 270), "process_vm_writev": (311, 271),
        "add_key": (248, 217), "request_key": (249, 218), "keyctl": (250, 219),
        "bpf": (321, 280), "perf_event_open": (298, 241), "userfaultfd": (323, 282),
        "io_uring_setup": (425, 425), "io_uring_enter": (426, 426), "io_uring_register": (427, 427),
        "memfd_create": (319, 279), "memfd_secret": (447, 447),
        "shmget": (29, 194), "semget": (64, 190), "msgget": (68, 186),
        "inotify_init": (253, None), "inotify_init1": (294, 26), "fanotify_init": (300, 262),
        "flock": (73, 32), "fcntl": (72, 25),
    }
)  # fmt: skip
"""Numbers of system calls on x86_64 and on aarch64, which has no inotify_init."""


def call_filter(machine: str | None = None) -> bytes:
    """The filter for a machine, by default this one; empty for one whose call numbers are not in `_CALLS`."""
    machine = machine or platform.machine()
    if machine not in _ARCHITECTURES:
        return b""
    column = list(_ARCHITECTURES).index(machine)
    calls = {name: number for name, numbers in _CALLS.items() if (number := numbers[column]) is not None}
    flagged = [calls.pop("clone"), calls.pop("unshare")]
    sockets = [calls.pop("socket"), calls.pop("socketpair")]
    clone3 = calls.pop("clone3")  # a filter cannot read its flags in memory; libraries fall back to clone
    flock, fcntl = calls.pop("flock"), calls.pop("fcntl")
    program = [
        _load(_ARCHITECTURE),
        (_EQUAL, 1, 0, _ARCHITECTURES[machine]),
        _return(_KILL),
        _load(_NUMBER),
    ]
    if machine == "x86_64":  # the x32 numbers are the same calls again
        program += [(_ABOVE, 0, 1, _X32), _return(_REFUSE)]
    answers = {clone3: _UNKNOWN, flock: _NO_LOCK, **dict.fromkeys(calls.values(), _REFUSE)}
    for number, answer in answers.items():
        program += [(_EQUAL, 0, 1, number), _return(answer)]
    program += [(_EQUAL, 0, len(_LOCKS) + 3, fcntl), _load(_SECOND)]
    program += [(_EQUAL, len(_LOCKS) - at, 0, command) for at, command in enumerate(_LOCKS)]
    program += [_return(_ALLOW), _return(_NO_LOCK)]
    for number in flagged:
        program += [(_EQUAL, 0, 4, number), _load(_FIRST), (_ANY_BIT, 0, 1, _NEW_USER)]
        program += [_return(_REFUSE), _return(_ALLOW)]
    for number in sockets:
        program += [(_EQUAL, 0, len(_FAMILIES) + 3, number), _load(_FIRST)]
        program += [(_EQUAL, len(_FAMILIES) - at, 0, family) for at, family in enumerate(_FAMILIES)]
        program += [_return(_REFUSE), _return(_ALLOW)]
    program.append(_return(_ALLOW))
    return b"".join(struct.pack("=HBBI", *each) for each in program)


def _load(offset: int) -> tuple[int, int, int, int]:
    """Instruction to load a word of struct seccomp_data."""
    return _LOAD, 0, 0, offset


def _return(verdict: int) -> tuple[int, int, int, int]:
    """Instruction to end with a verdict."""
    return _RETURN, 0, 0, verdict
