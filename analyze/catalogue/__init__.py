"""Catalogue of an archive's recordings: what each holds, whether its bytes are whole, which are copies."""
