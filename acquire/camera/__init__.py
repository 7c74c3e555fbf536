"""Cameras: interface, drivers for GigE and USB3 Vision (Aravis) and for V4L2, stream of frames in host time.

A camera of another kind implements `Camera` (base.py); factory.py chooses the class.
"""
