"""Motion of a thrown body in free flight: centre of mass c, and ratios of the inertia tensor.

In flight c moves on a parabola, slowed by the air, and the body rotates without a moment but the air's. The
motion determines c and the inertia tensor up to one factor.
"""
