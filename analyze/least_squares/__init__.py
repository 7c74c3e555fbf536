"""Dense robust least squares: one Levenberg-Marquardt, one Gauss-Newton, Huber's weights and a lag-one noise
model."""
