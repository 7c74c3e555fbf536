"""Estimation of centre of mass, inertia tensor and inner masses of an object, from strikes' motions.

The data of a strike are its balance angle phi [rad] and its rate constant k = m g R / I_edge [rad/s^2]; R is
the distance of the centre of mass from the edge about which the object tips, I_edge the moment about it.
"""
