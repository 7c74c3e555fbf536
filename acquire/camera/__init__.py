"""GigE Vision cameras: interface, Aravis driver, stream that maps frame times to the host clock.

A camera of another kind implements `Camera` (base.py); capture/process.py chooses the class.
"""
