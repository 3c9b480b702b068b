import math

import numpy as np
import pygame.math as pm
from devices.compass import Compass
from devices.drive import Drive
from devices.motors import MotorSimple
from devices.time_of_flight import TimeOfFlight
from devices.ultrasonic import Ultrasonic as Sonar

rand_error = True
error_seed = 5489
frame_start, frame_end = "[", "]"
block_size = 0
block_position = None
start_position = [6, 42]
start_rotation = 180.0
robot_outline = []
for i in range(8):
    angle = 2 * math.pi * i / 8
    robot_outline.append(pm.Vector2(4 * math.cos(angle), 4 * math.sin(angle)))
walls = [[1] * 1 + [1, 0, 1] for row in range(3)]
walls[0] = [1, 1, 1, 1]

sensors = {}
places = {"u0": [0, 3], "u1": [3, 0], "u2": [0, -3], "u3": [-3, 0]}
for code, place in places.items():
    sensors[code] = Sonar({"position": place, "rotation": 0, "height": 2.5, "error": 0.02})
infos = [{"position": [x, 2], "fov": 25, "max_range": 47} for x in np.linspace(-1, 1, 3)]
for number, info in enumerate(infos):
    sensors[f"t{number}"] = TimeOfFlight(info)
sensors["c0"] = Compass({"position": [0, 0], "error": 0.02})
sensors["l0"] = Lidar({"position": [0, 1], "range": 400})
corner = pm.Vector2(2, 0)
motors = {f"m{k}": MotorSimple({"position": corner.rotate(90 * k), "rotation": 90 * k}) for k in range(4)}
drives = {
    "w0": Drive(
        velocity=[0, 6], ang_velocity=0, motors=[motors["m0"], motors["m2"]], motor_direction=[1, -1]
    ),
    "r0": Drive({"velocity": [0, 0], "ang_velocity": 90, "error": {"x": 0, "y": 0, "rotation": 0.01}}),
}
