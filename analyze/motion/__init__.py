"""Analysis of each strike's motion: from tracked marker poses to balance angle phi and rate k.

A strike is one impact that tips the object about an edge. phi [rad] is the tipping angle theta at which its
centre of mass stands above that edge; k [rad/s^2] is the rate in theta'' = -k sin(phi - theta).
"""
