"""Dense robust least squares.

One Levenberg-Marquardt and one Gauss-Newton minimiser, Huber's weights and a lag-one noise model.
"""
