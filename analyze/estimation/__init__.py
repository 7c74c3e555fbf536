"""Estimation of centre of mass, inertia tensor and masses inside the object, from the strikes' motions.

The data of a strike are phi, its balance angle [rad], and k = m g R / I_edge [rad/s^2].
"""
