"""The daemon: owns camera, striker and recorder, and serves clients over a local socket."""
