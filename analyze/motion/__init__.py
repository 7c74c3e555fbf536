"""Balance angle phi and rate k of each strike, from the tracked poses of its markers."""
