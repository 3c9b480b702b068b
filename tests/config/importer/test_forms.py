"""Configurations in the forms that teams use: each becomes a robot whose readings were worked out by hand.

Every room is 48 by 48 in without inner walls. The start is [18, 30] there, which is (18, 18) here, and the
rotation 180, heading 90: the front looks at the wall at y 48, the left at x 0. So a sensor f inches to the
front and l to the left reads

    to the front 48 - (18 + f) = 30 - f      to the back  18 + f
    to the left  18 - l                      to the right 48 - (18 - l) = 30 + l
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import pytest

from simmer_tui.config.importer.files import read_path
from simmer_tui.config.importer.set_writer import write_set
from simmer_tui.config.loader import load
from simmer_tui.sim import Simulator

ROOM = """
walls = [[1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 1]]
block_position = None
robot_start_position = [18, 30]
robot_start_rotation = 180
motors = {}
drives = {}
"""
# A class as many teams have it: the maximum is read from the key of the minimum.
SONAR = """
import config
from devices.device import Device

class Ultrasonic(Device):
    name = 'none'
    def __init__(self, given):
        place, turn = given['position'], given['rotation']
        super().__init__('a sonar', place, turn, False)
        self.name = 'ultrasonic'
        if 'height' in given:
            self.height = given['height']
        else:
            self.height = config.block_size
        self.num_rays, self.beamwidth = int(given.get('num_rays', 7)), float(given.get('beamwidth', 15))
        self.error_pct = given['error'] if 'error' in given else 0.02
        near = self.min_range = given.get('min_range', 0)
        far = self.max_range = given.get('min_range', 433)
        self.reading_bounds = [near, far]

    def simulate(self, value, environment):
        return min(environment['distances'])
"""


class Form(NamedTuple):
    """A team's config.py behind the room, its device classes by file, and the replies in order."""

    config: str
    replies: dict[str, float]
    devices: dict[str, str] = {}  # noqa: RUF012 - never changed


FORMS = {
    # Front 30 - 3, back 18 - 3, left 18 - 2, right 30 - 2; the class has the slip, and no reading is 433.
    "official class, entries one by one": Form(
        """
block_size = 3
u0_info = {'id': 'u0', 'position': [0, 3], 'rotation': 0, 'error': 0, 'visible': True}
u1_info = {'id': 'u1', 'position': [0, -3], 'rotation': 180, 'error': 0, 'visible': True}
u2_info = {'id': 'u2', 'position': [2, 0], 'rotation': -90, 'error': 0, 'visible': True}
u3_info = {'id': 'u3', 'position': [-2, 0], 'rotation': 90, 'error': 0, 'visible': True}
sensors = {'u0': Ultrasonic(u0_info), 'u1': Ultrasonic(u1_info), 'u2': Ultrasonic(u2_info),
           'u3': Ultrasonic(u3_info)}
""",
        {"u0": 27, "u1": 15, "u2": 16, "u3": 28},
        {"ultrasonic.py": SONAR},
    ),
    # A loop with f-strings; n quarter turns clockwise: front 30 - 3, right 30, back 18, left 18.
    "loop and f-string": Form(
        """
sensors = {}
for n in range(4):
    code = f'u{n}'
    sensors[code] = Ultrasonic({'id': code, 'position': [0, 3 if n == 0 else 0], 'rotation': 90 * n,
                                'error': 0, 'visible': n % 2 == 0})
""",
        {"u0": 27, "u1": 30, "u2": 18, "u3": 18},
        {"ultrasonic.py": SONAR},
    ),
    # 30 - 2.5, 18 - 1.5.
    "comprehension over pairs": Form(
        """
PLACES = [('u0', (0, 2.5), 0), ('u1', (1.5, 0), -90)]
infos = {key: dict(id=key, position=list(place), rotation=turn, error=0.0) for key, place, turn in PLACES}
sensors = {key: Ultrasonic(info) for key, info in infos.items() if info['error'] < 0.5}
""",
        {"u0": 27.5, "u1": 16.5},
    ),
    # 30 - 7/2 = 26.5; the second is 1 in further back, 27.5.
    "helper that returns a device": Form(
        """
LENGTH = 7
def sonar(code, forward=LENGTH / 2, *, turn=0):
    '''A sensor on the middle line.'''
    info = {'id': code, 'position': [0, forward], 'rotation': turn, 'error': 0}
    return Ultrasonic(info)
sensors = dict(u0=sonar('u0'), u1=sonar('u1', LENGTH / 2 - 1), u2=sonar('u2', 0, turn=180))
""",
        {"u0": 26.5, "u1": 27.5, "u2": 18},
    ),
    # The helper fills the table itself: left 18 - 2 and right 30 - 2.
    "helper that fills the table": Form(
        """
sensors = {}
def add(side, sign):
    code = 'u' + str(len(sensors))
    sensors.update({code: Ultrasonic({'position': [sign * 2, 0], 'rotation': -90 * sign, 'error': 0})})
    print('added', side)
for side, sign in (('left', 1), ('right', -1)):
    add(side, sign)
""",
        {"u0": 16, "u1": 28},
    ),
    # One dict for all: 30 - 3, then 30 - 1, then 18 - 1 to the back; each device keeps what it was made of.
    "one dict, changed again and again": Form(
        """
info = {'position': [0, 3], 'rotation': 0}
info.update(error=0, visible=False)
sensors = {}
sensors['u0'] = Ultrasonic(info)
info['position'][1] -= 2
sensors['u1'] = Ultrasonic(info)
info['position'] = [0, -1]
info['rotation'] += 180
sensors['u2'] = Ultrasonic(info)
""",
        {"u0": 27, "u1": 29, "u2": 17},
    ),
    # The branch for the big robot: half of 8 in, 30 - 4.
    "branches of constants": Form(
        """
BIG, DEBUG = True, False
if BIG and not DEBUG:
    side = 8
elif DEBUG:
    side = 4
else:
    side = 6
front = {'position': [0, side / 2], 'rotation': 0, 'error': 0}
sensors = {'u0': Ultrasonic(front)}
if 'u0' in sensors and side >= 8:
    sensors['u1'] = Ultrasonic({**front, 'rotation': 180 if DEBUG else 90})
if __name__ == '__main__':
    sensors = {}
""",
        {"u0": 26, "u1": 30},
    ),
    # Copied and renamed, with the slip, and 3 in at least: the wall is 30 - 28 = 2 in away.
    "class copied under another name": Form(
        """
block_size = 3
sensors = {'u0': HCSR04({'id': 'u0', 'position': [0, 28], 'rotation': 0, 'min_range': 3, 'error': 0}),
           'u1': HCSR04({'id': 'u1', 'position': [0, 3], 'rotation': 0, 'error': 0})}
""",
        {"u0": 3, "u1": 27},
        {"hcsr04.py": SONAR.replace("class Ultrasonic", "class HCSR04")},
    ),
    # The class takes centimetres and counts the angle the other way: 5.08 cm are 2 in, so 18 - 2 and 30 - 2;
    # nothing is read beyond 50.8 cm, 20 in.
    "class in centimetres": Form(
        """
sensors = {'u0': SideSonar({'left_cm': 5.08, 'angle': 90, 'max_range': 50.8}),
           'u1': SideSonar({'left_cm': -5.08, 'angle': -90, 'max_range': 254})}
""",
        {"u0": 16, "u1": 28},
        {
            "side.py": """
from devices.ultrasonic import Ultrasonic
CM = 2.54
class SideSonar(Ultrasonic):
    def __init__(self, info):
        self.position = [info['left_cm'] / CM, 0]
        self.rotation = -info['angle']
        self.max_range = self.inches(info['max_range'])
        self.error_pct = 0
    def inches(self, length):
        return length / CM
"""
        },
    ),
    # Constants as attributes of classes and namespaces: 30 - 3.5 and 18 - 2.25.
    "names in classes": Form(
        """
from types import SimpleNamespace
class Body:
    LENGTH, WIDTH = 7, 4.5
    HALF = LENGTH / 2
class Sensor:
    def __init__(self, place, turn):
        self.place = place
        self.turn = turn
    def info(self):
        return {'position': self.place, 'rotation': self.turn, 'error': 0}
here = SimpleNamespace(front=Sensor([0, Body.HALF], 0), left=Sensor([Body.WIDTH / 2, 0], -90))
sensors = {'u0': Ultrasonic(here.front.info()), 'u1': Ultrasonic(here.left.info())}
""",
        {"u0": 26.5, "u1": 15.75},
    ),
    # Other names for classes and modules: 30 - 3 and 30 + 1 to the right.
    "import under other names": Form(
        """
from devices.ultrasonic import Ultrasonic as US
import devices.ultrasonic as du
make = US
sensors = {'u0': make({'position': [0, 3], 'rotation': 0, 'error': 0}),
           'u1': du.Ultrasonic({'position': [1, 0], 'rotation': 90, 'error': 0})}
""",
        {"u0": 27, "u1": 31},
        {"ultrasonic.py": SONAR},
    ),
    # No block, and a drive with a turning speed of almost 0, which there turns by 1 degree an inch: w0-6 ends
    # in direction 84. Its ten segments of 0.6 in turn by 0.6 degrees first, so it goes ahead by the sum of
    # 0.6 cos(0.6 k) for k from 1 to 10, 5.98734. Then it reads (48 - 18 - 5.98734) / sin 84 = 24.1449.
    "moved block and odd drives": Form(
        """
block_position = [-50, -50]
drives['w0'] = Drive({'velocity': [0, 6], 'ang_velocity': 0.01, 'motors': [], 'motor_direction': []})
drives['r0'] = Drive({'velocity': [0, 0], 'ang_velocity': 120, 'motors': [], 'motor_direction': []})
sensors = {'u0': Ultrasonic({'position': [0, 0], 'rotation': 0, 'error': 0, 'num_rays': 1, 'height': 1})}
""",
        {"u0": 30, "w0-6": math.inf, "u0 then": 24.1449},
    ),
    # Four on a circle of 3 in, by vectors: at 0, 90, 180 and 270 degrees from +x (left) towards +y (front),
    # each looking outwards: left 18 - 3, front 30 - 3, right 30 - 3, back 18 - 3.
    "vectors on a circle": Form(
        """
import math
import pygame.math as pm
import numpy as np
robot_outline = [(4 * math.cos(a), 4 * math.sin(a)) for a in np.linspace(0, 2 * np.pi, 12, endpoint=False)]
arm = pm.Vector2(3, 0)
sensors = {}
for n, angle in enumerate(np.arange(0, 360, 90)):
    place = arm.rotate(angle)
    sensors['u%d' % n] = Ultrasonic({'position': [place.x, place.y], 'rotation': angle - 90, 'error': 0})
""",
        {"u0": 15, "u1": 27, "u2": 27, "u3": 15},
    ),
    # A while loop over names in a text: 30 - 1, 30 - 2, 30 - 3.
    "while loop and text": Form(
        """
names = 'u0 u1 u2'.split()
sensors, n = {}, 0
while n < len(names):
    n += 1
    if n > 5:
        break
    sensors |= {names[n - 1]: Ultrasonic(dict(position=[0, n], rotation=0, error=0))}
del n
""",
        {"u0": 29, "u1": 28, "u2": 27},
    ),
    # The class has one ray, whatever the description says, and reads nothing below 4 in. At rotation 30 a
    # single ray meets the front wall at 30 / cos 30 = 34.6410, and the right one at 30 / sin 30 = 60. A fan
    # would read less. 30 - 27 is below the least range.
    "class that does not ask": Form(
        """
sensors = {'u0': Beam({'position': [0, 0], 'rotation': 30, 'num_rays': 9, 'error': 0}),
           'u1': Beam({'position': [0, 27], 'rotation': 0, 'num_rays': 9, 'error': 0})}
""",
        {"u0": 34.641, "u1": 4},
        {
            "beam.py": SONAR
            + """
class Beam(Ultrasonic):
    def __init__(self, info):
        super().__init__(info)
        self.num_rays = 1
        self.reading_bounds = [4, 100]
"""
        },
    ),
    # A class of config.py makes the description itself: 30 - 3 and 30 - 1.
    "class that describes itself": Form(
        """
from devices.ultrasonic import Ultrasonic
class FrontSonar(Ultrasonic):
    def __init__(self, forward):
        super().__init__({'id': 'u', 'position': [0, forward], 'rotation': 0, 'error': 0})
sensors = {'u0': FrontSonar(3), 'u1': FrontSonar(forward=1)}
""",
        {"u0": 27, "u1": 29},
    ),
    # Defaults behind `try`, a deep copy, and attributes that are set afterwards: 30 - 2 - 0.5, and 18 - 1.
    "copies and attributes set later": Form(
        """
from copy import deepcopy
try:
    gap = extras['gap']
except NameError:
    gap = 0.5
base = {'place': [0, 2 + gap], 'rotation': 0}
other = deepcopy(base)
other['place'][:] = [1, 0]
other['place'] = [1, 0]
front, left = Ultrasonic({'position': base['place'], 'rotation': 0}), Ultrasonic({'position': other['place']})
left.rotation = -90
for each in (front, left):
    each.error_pct = 0
sensors = {'u0': front, 'u1': left}
""",
        {"u0": 27.5, "u1": 17},
    ),
}


@pytest.mark.parametrize("name", FORMS)
def test_the_readings_are_those_worked_out_by_hand(name: str, tmp_path: Path) -> None:
    form = FORMS[name]
    (tmp_path / "config.py").write_text(ROOM + form.config)
    (tmp_path / "devices").mkdir()
    for file, text in form.devices.items():
        (tmp_path / "devices" / file).write_text(text)
    write_set(read_path(tmp_path), tmp_path / "set")
    simulator = Simulator(load(tmp_path / "set").simulation, 1)
    replies = {command: simulator.execute(command.partition(" ")[0]).reply for command in form.replies}
    assert replies == pytest.approx(form.replies, abs=1e-3)


def test_the_slip_of_a_class_is_told_once_with_its_line(tmp_path: Path) -> None:
    form = FORMS["official class, entries one by one"]
    (tmp_path / "config.py").write_text(ROOM + form.config)
    (tmp_path / "devices").mkdir()
    (tmp_path / "devices" / "ultrasonic.py").write_text(SONAR)
    told = [str(each) for each in read_path(tmp_path).left_out if "slip" in each.what]
    what = "self.max_range is read from 'min_range', a slip; it is taken from 'max_range'"
    assert told == [f"devices/ultrasonic.py:18: {what}"]
