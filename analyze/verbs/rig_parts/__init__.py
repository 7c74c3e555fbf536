"""The command `analyze rig-parts`."""
