"""Virtual rig: simulated physics, camera images and servo, reached by the real devices' protocols.

The camera uses GigE Vision on loopback, the servo Dynamixel protocol 2.0 on a pseudo-terminal. Apart from the
demo no production code imports this package.
"""
