"""The same commands give the same bits on every processor, as far as numpy chooses by it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

try:  # numpy.show_runtime reads these tables too
    from numpy._core import _multiarray_umath
except ImportError:  # numpy 1
    from numpy.core import _multiarray_umath

WIDE = ("X86_V4", "AVX512")
"""Numpy's names of instructions with registers of 512 bits (since 2.4, and before)."""

DRIVE = """
import sys
from msgspec.structs import replace
try:
    from numpy._core import _multiarray_umath as numpy_core
except ImportError:
    from numpy.core import _multiarray_umath as numpy_core
from simmer_tui.config import load_default
from simmer_tui.sim import RobotSpec, Simulator

wanted = sys.argv[1] == "on"
wrong = [name for name in sys.argv[2].split() if numpy_core.__cpu_features__[name] is not wanted]
assert not wrong, f"not {sys.argv[1]}: {wrong}"
simulator = Simulator(replace(load_default().simulation, robot=RobotSpec.rectangle(6, 4)), seed=7)
drives = ("r1-47", "d1-3", "r1--103", "w1-2.5", "r1-400", "d1-20", "s1-4", "a1-2", "r1-31")
sensors = ("u1", "u2", "o1", "g1", "c1")
for number in range(1500):
    codes = drives if number % 2 else sensors
    outcome = simulator.execute(codes[number // 2 % len(codes)])
    pose, contact = outcome.pose, outcome.contact
    numbers = [outcome.reply, pose.x, pose.y, pose.heading]
    if contact is not None:
        numbers += [contact.turned, contact.translated, contact.time, *contact.point]
    print(*(number.hex() for number in numbers))
print("contacts", simulator.contacts)
"""


def replies(state: str, names: list[str]) -> list[str]:
    environment = {**os.environ, "NPY_DISABLE_CPU_FEATURES": " ".join(names) if state == "off" else ""}
    done = subprocess.run(
        [sys.executable, "-c", DRIVE, state, " ".join(names)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.slow
def test_replies_do_not_depend_on_avx512() -> None:
    features, dispatched = _multiarray_umath.__cpu_features__, _multiarray_umath.__cpu_dispatch__
    names = [name for name in dispatched if name.startswith(WIDE) and features[name]]
    if not names:
        pytest.skip("not checked: numpy finds no AVX-512 here that could be switched off")
    on, off = replies("on", names), replies("off", names)
    assert len(on) == 1501
    assert int(on[-1].split()[1]) > 100
    assert on == off
