"""Sessions: state machine, choice of the next tip speed, and the client that executes them.

A session strikes an object by a plan (placements and strikes) and records every strike in one recording. The
tip speed is the speed of the striker's tip at impact.
"""
