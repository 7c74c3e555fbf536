"""`analyze advise`: the answer so far of a session, and the strike that tells most."""
