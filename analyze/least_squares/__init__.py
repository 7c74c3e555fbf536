"""Dense least squares: Levenberg-Marquardt with Huber's robust loss, and plain Gauss-Newton.

Also Huber's weights, a robust scale, and the correlation of residuals from sample to sample.
"""
