"""The virtual rig: physics, images and devices behind real wires. Production code never imports it."""
