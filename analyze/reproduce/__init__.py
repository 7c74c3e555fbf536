"""Reproduction of published results: the paper's experiments, and tosses of a real cube."""
