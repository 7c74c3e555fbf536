"""Sessions: state machine, choice of the next tip speed, and the client that executes them."""
