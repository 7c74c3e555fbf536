"""Camera calibration section that the tests' rig files share."""

CALIBRATION = """[camera.calibration]
width = 656
height = 492
K = [[1430.0, 0.0, 327.5], [0.0, 1430.0, 245.5], [0.0, 0.0, 1.0]]
T_world_camera = [[1, 0, 0, 0.03], [0, 0, 1, -0.55], [0, -1, 0, 0.08], [0, 0, 0, 1]]
"""
