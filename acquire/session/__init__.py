"""Sessions: the state machine, the energy of the next strike, and the client that carries them out."""
