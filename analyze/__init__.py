"""The offline toolkit: plans strikes, reads recordings, tracks, fits, estimates and reports."""
