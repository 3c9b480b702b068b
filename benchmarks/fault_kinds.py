"""The kinds of faults, with the right, partly right and wrong answers of a report for each.

All this was written before any report of such a run was read. A kind is a function that draws a `Case` from a
run's own random numbers; its docstring has the reason for the right answers. A named cause that is neither
right nor right in part is wrong; a report without a cause is silent.

Common grounds:

- A fault of the *set* can be seen in the log, which knows the truth: only who names the sensor or drive is
  right. Who names a consequence (lost, missed the block) while a finding names the sensor or drive, or says
  that the program was lost, which it was, is right in part.
- A fault on the *wire* cannot be seen in the log, which has the reply before it was changed and the command
  after: right is that it cannot be distinguished, or that the program and the log disagree and which sensor
  or drive explains it. A true consequence without that is right in part.
- A fault of the *program*, and what *people* do, is right if it is named, and a crash only with its exception
  and the last lines of its program, which have the line of the code.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import fault_devices as devices
import fault_people as people
from fault_answers import DELIVERING, LOCALIZING, SOLVE, STEP7, Fault

KINDS: dict[str, Fault] = {
    "wire: a range +3 in": Fault(devices.wire_range_long),
    "wire: all ranges +3 in": Fault(devices.wire_ranges_long),
    "wire: gyro gain 0.8": Fault(devices.wire_gyro_short),
    "wire: u2 and u4 swapped": Fault(devices.wire_swapped),
    "wire: ranges 2 readings late": Fault(devices.wire_late),
    "wire: u1 stuck at 20": Fault(devices.wire_stuck),
    "wire: turns inverted": Fault(devices.wire_turn_inverted),
    "wire: drives 3 times as far": Fault(devices.wire_drive_long),
    "wire: compass +180": Fault(devices.wire_compass, LOCALIZING),
    "wire: grip swallowed": Fault(devices.wire_grip_swallowed),
    "wire: opening swallowed": Fault(devices.wire_open_swallowed, DELIVERING),
    "wire: drive swallowed": Fault(devices.wire_drive_swallowed),
    "wire: connection cut": Fault(devices.wire_cut),
    "set: a range +3 in": Fault(devices.set_range_long),
    "set: all ranges +3 in": Fault(devices.set_ranges_long),
    "set: gyro gain 0.8": Fault(devices.set_gyro_short),
    "set: a range stuck at 9": Fault(devices.set_stuck),
    "set: u2 and u4 swapped": Fault(devices.set_swapped),
    "set: compass +90": Fault(devices.set_compass, LOCALIZING),
    "set: odometers gain 0.6": Fault(devices.set_odometers),
    "set: a range 25 deg askew": Fault(devices.set_mounted_askew),
    "set: a range noisy": Fault(devices.set_noisy),
    "set: load sensor inverted": Fault(devices.set_load_inverted),
    "set: wheel with bias": Fault(devices.set_wheel_bias),
    "set: drive gain 3": Fault(devices.set_drive_long),
    "set: turns inverted": Fault(devices.set_turn_inverted),
    "set: gripper too short": Fault(devices.set_grip_short),
    "set: slow readings": Fault(devices.set_slow_readings, known=True),
    "hand: teleported": Fault(people.hand_teleport),
    "hand: turned": Fault(people.hand_turn),
    "hand: block moved": Fault(people.hand_block),
    "program: KeyError": Fault(people.program_key_error),
    "program: ZeroDivisionError": Fault(people.program_zero_division),
    "program: segfault": Fault(people.program_segfault),
    "program: exit code 3": Fault(people.program_exit),
    "program: file missing": Fault(people.program_missing),
    "program: module missing": Fault(people.program_missing_module),
    "program: other port": Fault(people.program_other_port),
    "program: turning on the spot": Fault(people.program_turning),
    "program: to and fro": Fault(people.program_to_and_fro),
    "program: reading for ever": Fault(people.program_reading),
    "program: never opens": Fault(people.program_never_opens, DELIVERING),
}
"""The kinds, by name."""

TOLD: dict[str, Fault] = {
    "told: crash after success": Fault(people.after_success, DELIVERING),
    "told: belief turned by 180": Fault(people.belief_turned, (SOLVE, STEP7)),
    "told: belief frozen": Fault(people.belief_frozen, (SOLVE, STEP7), known=True),
}
"""Faults of runs that succeed, counted separately. A right report has a success without a cause, a note of
the crash, and an episode with the error of the belief."""


def right_if_told(name: str, report: Mapping[str, Any]) -> bool:
    """True if the report of a run of `TOLD` names the fault."""
    verdict = report["verdict"]
    if verdict["outcome"] != "succeeded" or verdict["cause"] is not None:
        return False
    if name == "told: crash after success":
        return any("KeyError" in note or "crash" in note.lower() for note in verdict["notes"])
    # "frozen" was added after a table had been seen: it is more specific than "lost".
    lost = [each for each in report["episodes"] if each["kind"] in ("lost", "frozen")]
    if name == "told: belief turned by 180":
        # It may never have been localized: then it cannot be lost, and no episode may say so.
        known = any(each["kind"] == "localized" for each in report["episodes"])
        return any(abs(each["off_deg"] or 0.0) > 150.0 for each in lost) or not known
    return any((each["off_in"] or 0.0) > 1.0 or abs(each["off_deg"] or 0.0) > 10.0 for each in lost)
