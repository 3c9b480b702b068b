"""Files of the kind teams have, written for these tests."""

from __future__ import annotations

from pathlib import Path

import pytest

STOCK = """
import pygame.math as pm
from devices.ultrasonic import Ultrasonic
from devices.drive import Drive

rand_error = False
rand_bias = False
bias_strength = [0.05, 1]
port_rx, port_tx = 61200, 61201
frame_start = '['
frame_end = ']'
block_position = [66, 5]
block_size = 3
robot_start_position = [6, 42]
robot_start_rotation = 180
side = 6
robot_outline = [pm.Vector2(-side/2, -side/2), pm.Vector2(-side/2, side/2),
                 pm.Vector2(side/2, side/2), pm.Vector2(side/2, -side/2)]
walls = [[3,3,1,1,0,2,0,2], [3,3,0,1,1,1,1,1], [1,0,2,0,0,1,0,1], [1,1,1,1,1,1,0,2]]
wall_segment_length = 12

motors = {
    'm0': MotorSimple({'position': [2, 0], 'rotation': 0}),
    'm1': MotorSimple({'position': [-2, 0], 'rotation': 0}),
    'm2': MotorSimple({'position': [0, 2], 'rotation': 90}),
    'm3': MotorSimple({'position': [0, -2], 'rotation': 90}),
}
none = {'x': 0, 'y': 0, 'rotation': 0}
drives = {
    'w0': Drive({'velocity': [0, 6], 'ang_velocity': 0, 'motors': [motors['m0'], motors['m1']],
                 'motor_direction': [1, 1], 'bias': none, 'error': none}),
    'd0': Drive({'velocity': [-6, 0], 'ang_velocity': 0, 'motors': [motors['m2'], motors['m3']],
                 'motor_direction': [1, 1], 'bias': none, 'error': none}),
    'r0': Drive({'velocity': [0, 0], 'ang_velocity': 120,
                 'motors': [motors['m0'], motors['m1'], motors['m2'], motors['m3']],
                 'motor_direction': [1, -1, 1, -1], 'bias': none, 'error': none}),
}
front = {'position': [0, 3], 'height': 2, 'rotation': 0, 'error': 0.02, 'visible': True}
sensors = {
    'u0': Ultrasonic(front),
    'u1': Ultrasonic({**front, 'position': [0, 1], 'height': 4}),
    'g0': Gyroscope({'position': [0, 0], 'rotation': 0, 'error': 0.02, 'bias': 0.1}),
    'c0': Compass({'position': [0, 0], 'rotation': 0, 'error': 0.02, 'bias': 0.1}),
    'i0': Infrared({'position': [0, -1], 'height': 1.5, 'rotation': 0, 'fov': 60, 'threshold': 0.7,
                    'error': 0.05}),
}
"""

MAIN = """% settings
bot_center = [9.5,42];  % where it starts
bot_rot = -90;
block_center = [25 41];
blocksize = 6/2;
num_segments = 20;
strength = [0.1, 2];\t% how much
step_time = 0;
%{
bot_rot = 17;
%}
randerror = 0;
randbias = 1;
sim = 1;
plot_robot = 1; plot_sense = 1;
plot_sense = 0;
bot_perim = import_bot;
[s_cmd, s_rply] = tcp_setup('server', 9100, 9101);
while sim
    bot_center = bot_center_old;
    %fwrite(s_rply, reply, 'double')
    fwrite(s_cmd, reply, 'single')
end
"""


@pytest.fixture
def stock() -> str:
    """A `config.py` that describes simmer-python's stock robot."""
    return STOCK


@pytest.fixture
def matlab_folder(tmp_path: Path) -> Path:
    """A MATLAB SimMeR folder."""
    folder = tmp_path / "matlab"
    config = folder / "config"
    config.mkdir(parents=True)
    (folder / "Main.m").write_text(MAIN, encoding="utf-8")
    (folder / "tcpclient_write.m").write_text(
        "reply = fread(s_cmd, s_cmd.BytesAvailable/4, 'single');\n", encoding="utf-8"
    )
    (config / "maze.csv").write_text("1,1,1\n1,0,1\n1,1,1\n1,1,1\n", encoding="utf-8")
    (config / "robot.csv").write_text("circle (0) / rectangle (1),1\nsize,5\ny-size,4\n", encoding="utf-8")
    (config / "sensors.csv").write_text(
        "ID,Poll Character,Enabled,X Position (in),Y Position (in),Z Position (in),Rotation (deg),"
        "Percent Error (0-1),Field of View (deg),Threshold,,\n"
        "ultra1,u1,1,3,0,6,0,0.02,5,0,,front\n"
        "radar1,l1,1,0,0,6,0,0.02,5,0,,own\n"
        "ir1,i1,0,2,0,1,0,0.05,40,0.8,,\n",
        encoding="utf-8",
    )
    (config / "drive.csv").write_text(
        "ID,    Poll Character, Enabled, Y-Axis Error, X-Axis Error, Rotation Error, "
        "Y-Axis Bias, X-Axis Bias, Rotation Bias\n"
        "right,d1,1,0.02,0.05,0.02,0,0,0\nrot,r1,1,0.003,0.003,0.02,0,0,0\n",
        encoding="utf-8",
    )
    return folder
