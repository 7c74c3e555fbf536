"""Virtual rig: simulated physics, images and devices behind real protocols.

Production code never imports it.
"""
