"""Control parameters"""

rand_error = 0
rand_bias = 1
strength = [0.1, 2]
ppi = 12
foreground = (0, 0, 0)
frame_rate = 60
round_digits = 3
port_rx = 61200
port_tx = 61201
walls = [
    [3, 3, 1, 1, 0, 2, 0, 2],
    [3, 3, 0, 1, 1, 1, 1, 1],
    [1, 0, 2, 0, 0, 1, 0, 1],
    [1, 1, 1, 1, 1, 1, 0, 2],
]
wall_color = (255, 0, 0)
floor_segment_length = 3
robot_start_position = [6, 6]
robot_start_rotation = 0
robot_width = 6
robot_height = 7.5
block_position = [30, 6]
m0_info = {"id": "m0", "position": [3, 0], "rotation": 0, "visible": False}
m1_info = {"id": "m1", "position": [-3, 0], "rotation": 0, "visible": False}
motors = {"m0": MotorSimple(m0_info), "m1": MotorSimple(m1_info)}
w0_info = {
    "id": "w0",
    "position": [0, 0],
    "rotation": 0,
    "velocity": [0, 6],
    "ang_velocity": 0,
    "motors": [motors["m0"], motors["m1"]],
    "motor_direction": [1, 1],
    "bias": {"x": 0.01, "y": 0, "rotation": 0},
    "error": {"x": 0.02, "y": 0.05, "rotation": 1},
}
drives = {w0_info["id"]: Drive(w0_info)}
u0_info = {
    "id": "u0",
    "position": [0, 3],
    "height": 1,
    "rotation": 0,
    "error": 0.02,
    "outline": [pm.Vector2(-1, -0.5), pm.Vector2(-1, 0.5), pm.Vector2(1, 0.5)],
    "visible": True,
    "visible_measurement": True,
}
i0_info = {
    "id": "i0",
    "position": [0, -1],
    "height": 1.5,
    "rotation": 0,
    "fov": 60,
    "threshold": 0.7,
    "error": 0.05,
    "bias": 0.1,
    "color": (127, 127, 127),
}
sensors = {u0_info["id"]: Ultrasonic(u0_info), i0_info["id"]: Infrared(i0_info)}
