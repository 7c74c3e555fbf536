"""Dense robust least squares.

One Levenberg-Marquardt, one Gauss-Newton, Huber's weights and a lag-one noise model.
"""
