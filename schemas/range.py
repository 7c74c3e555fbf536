"""Feasible interval of a quantity that a person or the striker is to produce, and the value to aim at."""

from __future__ import annotations

from schemas.document import Document


class Range(Document):
    """Feasible interval of a quantity and the value to aim at.

    The unit is in the name of the entry that holds the range, for example `impulse_n_s`.
    """

    min: float
    """smallest feasible value of the quantity"""
    target: float
    """value of the quantity to aim at"""
    max: float
    """largest feasible value of the quantity"""
