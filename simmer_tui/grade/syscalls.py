"""A filter of system calls for sandboxed programs, as the kernel takes it (classic BPF).

It refuses what would open ways that the sandbox knows nothing of: user namespaces of the program's own
(in which it could mount memory without a limit), kernel keyrings (which stay behind), other processes'
memory, io_uring, performance counters, and memory that belongs to no process and no file system, which no
limit binds (memfd, System V's). All else is allowed. Layout and numbers: linux/seccomp.h,
linux/filter.h, asm/unistd_64.h and asm-generic/unistd.h.
"""

from __future__ import annotations

import platform
import struct
from collections.abc import Mapping
from types import MappingProxyType

_LOAD, _EQUAL, _ANY_BIT, _ABOVE, _RETURN = 0x20, 0x15, 0x45, 0x25, 0x06
_ALLOW, _KILL, _REFUSE, _UNKNOWN = 0x7FFF0000, 0x80000000, 0x00050001, 0x00050026  # EPERM, ENOSYS
_NUMBER, _ARCHITECTURE, _FIRST = 0, 4, 16
"""Offsets in struct seccomp_data: the call's number, the architecture, the low half of the first argument."""
_NEW_USER = 0x10000000  # CLONE_NEWUSER
_X32 = 0x3FFFFFFF
_ARCHITECTURES = MappingProxyType({"x86_64": 0xC000003E, "aarch64": 0xC00000B7})
_CALLS: Mapping[str, Mapping[str, int]] = MappingProxyType(
    {
        "x86_64": {
            "clone": 56, "unshare": 272, "clone3": 435,
            "ptrace": 101, "process_vm_readv": 310, "process_vm_writev": 311,
            "add_key": 248, "request_key": 249, "keyctl": 250,
            "bpf": 321, "perf_event_open": 298, "userfaultfd": 323,
            "io_uring_setup": 425, "io_uring_enter": 426, "io_uring_register": 427,
            "memfd_create": 319, "memfd_secret": 447, "shmget": 29, "semget": 64, "msgget": 68,
        },
        "aarch64": {
            "clone": 220, "unshare": 97, "clone3": 435,
            "ptrace": 117, "process_vm_readv": 270, "process_vm_writev": 271,
            "add_key": 217, "request_key": 218, "keyctl": 219,
            "bpf": 280, "perf_event_open": 241, "userfaultfd": 282,
            "io_uring_setup": 425, "io_uring_enter": 426, "io_uring_register": 427,
            "memfd_create": 279, "memfd_secret": 447, "shmget": 194, "semget": 190, "msgget": 186,
        },
    }
)  # fmt: skip


def call_filter(machine: str | None = None) -> bytes:
    """The filter for a machine, by default this one; empty for one whose numbers are not known here."""
    machine = machine or platform.machine()
    if machine not in _CALLS:
        return b""
    calls = dict(_CALLS[machine])
    flagged = [calls.pop("clone"), calls.pop("unshare")]
    clone3 = calls.pop("clone3")  # its flags lie in memory; without it, libraries take clone
    program = [
        (_LOAD, 0, 0, _ARCHITECTURE),
        (_EQUAL, 1, 0, _ARCHITECTURES[machine]),
        (_RETURN, 0, 0, _KILL),
        (_LOAD, 0, 0, _NUMBER),
    ]
    if machine == "x86_64":  # the x32 numbers are the same calls again
        program += [(_ABOVE, 0, 1, _X32), (_RETURN, 0, 0, _REFUSE)]
    program += [(_EQUAL, 0, 1, clone3), (_RETURN, 0, 0, _UNKNOWN)]
    for number in calls.values():
        program += [(_EQUAL, 0, 1, number), (_RETURN, 0, 0, _REFUSE)]
    for number in flagged:
        program += [
            (_EQUAL, 0, 4, number),
            (_LOAD, 0, 0, _FIRST),
            (_ANY_BIT, 0, 1, _NEW_USER),
            (_RETURN, 0, 0, _REFUSE),
            (_RETURN, 0, 0, _ALLOW),
        ]
    program.append((_RETURN, 0, 0, _ALLOW))
    return b"".join(struct.pack("=HBBI", *each) for each in program)
