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
