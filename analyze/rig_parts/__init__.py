"""Printable parts of a rig: arm, hinge, holders of servo, solenoid, camera and lamps, mat clamp."""
