"""The filter of system calls, carried out as the kernel would: what it says to each call.

Numbers are of Linux: asm/unistd_64.h for x86_64, asm-generic/unistd.h for aarch64, linux/audit.h for the
architectures, linux/sched.h for flags, linux/seccomp.h for verdicts.
"""

from __future__ import annotations

import struct

import pytest

from simmer_tui.grade.call_filter import call_filter

ARCHITECTURES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
CLONE = {"x86_64": 56, "aarch64": 220}
UNSHARE = {"x86_64": 272, "aarch64": 97}
NEW_USER, NEW_NET, FORK = 0x10000000, 0x40000000, 0x01200011
CLONE3 = 435
REFUSED = {
    # ptrace, process_vm_*, keys, bpf, perf_event_open, userfaultfd, io_uring, memfd_*, System V's memory,
    # semaphores and queues, inotify_init*, fanotify_init
    "x86_64": {
        *(101, 310, 311, 248, 249, 250, 321, 298, 323, 425, 426, 427, 319, 447, 29, 64, 68, 253, 294, 300)
    },
    "aarch64": {
        *(117, 270, 271, 217, 218, 219, 280, 241, 282, 425, 426, 427, 279, 447, 194, 190, 186, 26, 262)
    },
}
FLOCK = {"x86_64": 73, "aarch64": 32}
FCNTL = {"x86_64": 72, "aarch64": 25}
ALLOWED, KILLED, NOT_PERMITTED, NO_SUCH_CALL = 0x7FFF0000, 0x80000000, 0x00050000 | 1, 0x00050000 | 38
NO_LOCK = 0x00050000 | 37
"""SECCOMP_RET_ALLOW, SECCOMP_RET_KILL_PROCESS, and SECCOMP_RET_ERRNO with EPERM, ENOSYS and ENOLCK."""

machines = pytest.mark.parametrize("machine", ["x86_64", "aarch64"])


def verdict(
    machine: str, call: int, argument: int = 0, architecture: int | None = None, second: int = 0
) -> int:
    """The filter's answer to a call, by the instructions of classic BPF that it uses (linux/bpf_common.h)."""
    architecture = ARCHITECTURES[machine] if architecture is None else architecture
    data = struct.pack("=IIQQQ", call, architecture, 0x7F0000001000, argument, second)  # struct seccomp_data
    program = list(struct.iter_unpack("=HBBI", call_filter(machine)))
    held, at = 0, 0
    while True:
        code, if_true, if_false, number = program[at]
        at += 1
        match code:
            case 0x20:  # BPF_LD | BPF_W | BPF_ABS
                held = struct.unpack_from("=I", data, number)[0]
            case 0x15:  # BPF_JMP | BPF_JEQ
                at += if_true if held == number else if_false
            case 0x25:  # BPF_JMP | BPF_JGT
                at += if_true if held > number else if_false
            case 0x45:  # BPF_JMP | BPF_JSET
                at += if_true if held & number else if_false
            case 0x06:  # BPF_RET
                return number
            case _:
                raise AssertionError(f"no instruction of classic BPF that is known here: {code:#x}")


@machines
def test_it_refuses_the_calls_that_open_other_ways_and_no_others(machine: str) -> None:
    answers = {call: verdict(machine, call) for call in range(600)}
    refused = {call for call, answer in answers.items() if answer == NOT_PERMITTED}
    assert refused == REFUSED[machine]
    rest = {call for call in answers if call not in refused and call not in (CLONE3, FLOCK[machine])}
    assert {answers[call] for call in rest} == {ALLOWED}


@machines
def test_clone3_is_not_there_so_that_libraries_take_clone(machine: str) -> None:
    assert verdict(machine, CLONE3) == NO_SUCH_CALL
    assert verdict(machine, CLONE3, NEW_USER) == NO_SUCH_CALL


@machines
@pytest.mark.parametrize("calls", [CLONE, UNSHARE], ids=["clone", "unshare"])
def test_only_a_user_namespace_is_refused(machine: str, calls: dict[str, int]) -> None:
    call = calls[machine]
    assert verdict(machine, call, FORK) == ALLOWED
    assert verdict(machine, call, NEW_NET) == ALLOWED
    assert verdict(machine, call, NEW_USER) == NOT_PERMITTED
    assert verdict(machine, call, NEW_USER | NEW_NET | FORK) == NOT_PERMITTED
    assert verdict(machine, call, 0xFFFFFFFF & ~NEW_USER) == ALLOWED


@machines
def test_calls_of_another_architecture_end_the_program(machine: str) -> None:
    for architecture in (0x40000003, *(each for name, each in ARCHITECTURES.items() if name != machine)):
        assert verdict(machine, 0, architecture=architecture) == KILLED


def test_the_second_set_of_numbers_of_x86_is_refused_whole() -> None:
    for call in (0x40000000, 0x40000000 | 101, 0x40000000 | 56, 0xFFFFFFFF):
        assert verdict("x86_64", call) == NOT_PERMITTED
    assert verdict("x86_64", 0x3FFFFFFF) == ALLOWED
    assert verdict("aarch64", 0x40000000) == ALLOWED


def test_an_unknown_machine_has_no_filter() -> None:
    assert call_filter("a machine of tomorrow") == b""


@machines
def test_sockets_are_of_families_that_a_namespace_confines(machine: str) -> None:
    """IP, Unix and netlink (linux/socket.h); not vsock, which reaches past the sandbox, nor packets."""
    for call in {"x86_64": (41, 53), "aarch64": (198, 199)}[machine]:
        allowed = {family for family in range(60) if verdict(machine, call, family) == ALLOWED}
        assert allowed == {0, 1, 2, 10, 16}
        assert verdict(machine, call, 40) == NOT_PERMITTED


@machines
def test_locks_of_all_kinds_are_not_there(machine: str) -> None:
    """They hang on the file, which other sandboxes see as well (linux/fcntl.h)."""
    assert verdict(machine, FLOCK[machine]) == NO_LOCK
    answers = {command: verdict(machine, FCNTL[machine], 5, second=command) for command in range(1100)}
    refused = {command for command, answer in answers.items() if answer == NO_LOCK}
    # F_SETLK, F_SETLKW, F_OFD_SETLK, F_OFD_SETLKW, F_SETLEASE, F_NOTIFY, F_SET_RW_HINT, F_SET_FILE_RW_HINT,
    # F_SETDELEG; not F_GETLK, F_SETFL, F_DUPFD_CLOEXEC, F_SETPIPE_SZ and all others
    assert refused == {6, 7, 37, 38, 1024, 1026, 1036, 1038, 1040}
    assert {answers[command] for command in answers if command not in refused} == {ALLOWED}


@machines
def test_only_comparisons_jump(machine: str) -> None:
    """Loads and returns have no offsets; a program ends with a return."""
    program = list(struct.iter_unpack("=HBBI", call_filter(machine)))
    assert all(jumps == [0, 0] for code, *jumps, _ in program if code in (0x20, 0x06))
    assert program[-1][0] == 0x06
