"""Text of values with as many digits as their 95 % intervals carry, and units with a power of ten."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.least_squares.intervals import SIGMAS_95
from schemas.quantity import Quantity

if TYPE_CHECKING:
    from analyze.types import Array

INTERVAL_DIGITS = 2
"""significant digits of the half width of an interval; its value is shown to the same place"""
UNBOUNDED_DIGITS = 3
"""significant digits of a value that has no interval"""
EXACT_DIGITS = 6
"""significant digits of a value whose interval has no width, such as a mass that is given without an error"""
LOPSIDED_SHARE = 0.1
"""difference of an interval's two sides over its half width, above which both ends are shown"""
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class ScaledUnit:
    """Unit in which values are shown: a power of ten of an SI unit, common to a table or a whole answer."""

    exponent: int
    """power of ten"""
    unit: str
    """SI unit, such as kg m²"""

    @property
    def factor(self) -> float:
        """Factor that turns a value in the SI unit into the number shown."""
        return 10.0**-self.exponent

    @property
    def label(self) -> str:
        """Unit in print, such as 10⁻⁴ kg m²."""
        if self.exponent == 0:
            return self.unit
        return f"10{str(self.exponent).translate(_SUPERSCRIPT)}\u00a0{self.unit}"


def inertia_unit(moments: Array | list[float]) -> ScaledUnit:
    """Unit 10^n kg m² in which the largest of `moments` (array of any shape [kg m²]) is from 1 to 10."""
    largest = float(np.max(np.abs(moments), initial=0.0))
    exponent = math.floor(math.log10(largest)) if largest > 0 and math.isfinite(largest) else 0
    return ScaledUnit(exponent, "kg\u00a0m²")


def decimals(half: float) -> int:
    """Number of decimals with which a half width has two significant digits; 0 if it is 10 or more."""
    if not (half > 0 and math.isfinite(half)):
        return 0
    # Rounded first: 0.0996 becomes 0.10, not 0.100.
    half = float(f"{half:.{INTERVAL_DIGITS - 1}e}")
    return max(0, INTERVAL_DIGITS - 1 - math.floor(math.log10(half)))


def number(value: float, digits: int) -> str:
    """Text of a number with `digits` decimals and a typographic minus; no sign if it rounds to 0."""
    return f"{value:z.{digits}f}".replace("-", "−")


def signed(value: float, digits: int) -> str:
    """Text of a number with `digits` decimals and its sign, plus or minus; no sign if it rounds to 0."""
    text = number(value, digits)
    return f"+{text}" if value > 0 and float(text) != 0 else text


def value_text(value: float, ends: tuple[float, float] | None) -> str:
    """Text of a value with its 95 % interval, as "8.85 ± 0.19", or "12.0 (9.6 to 12.9)" if lopsided.

    Args:
        value: value in the unit shown.
        ends: lower and upper end of the interval in that unit; None if there is none.
    """
    if ends is None:
        return f"{value:.{UNBOUNDED_DIGITS}g}".replace("-", "−")
    low, high = ends
    half = (high - low) / 2
    if half <= 0:
        return f"{value:.{EXACT_DIGITS}g}".replace("-", "−")
    if abs(high + low - 2 * value) > 2 * LOPSIDED_SHARE * half:
        return span_text(value, ends)
    digits = decimals(half)
    return f"{number(value, digits)} ± {number(half, digits)}"


def span_text(value: float, ends: tuple[float, float]) -> str:
    """Text of a value with both ends of its 95 % interval, as "12.0 (9.6 to 12.9)"."""
    digits = decimals((ends[1] - ends[0]) / 2)
    return f"{number(value, digits)} ({number(ends[0], digits)} to {number(ends[1], digits)})"


def with_interval(quantity: Quantity | None, factor: float, unit: str = "") -> str:
    """Text of a scalar with its 95 % interval; "–" if there is no value.

    Args:
        quantity: quantity in SI units; its interval is ± 1.96 sd where it states none.
        factor: conversion from SI to `unit`.
        unit: unit to print; "" for none.
    """
    if quantity is None or not isinstance(quantity.value, float):
        return "–"
    return f"{value_text(factor * quantity.value, _ends(quantity, factor))} {unit}".rstrip()


def open_interval(quantity: Quantity, factor: float) -> str:
    """Text of a scalar with both ends of its 95 % interval, as "12.0 (11.5 to 12.5)".

    A quantity that is not observed gives "not observed" in place of its value.

    Args:
        quantity: scalar in SI units, with an interval.
        factor: conversion from SI to the unit shown.

    Raises:
        TypeError: the quantity is no scalar, or has no interval.
    """
    low, high = (factor * end for end in quantity.interval_ends())
    shown = span_text(factor * quantity.as_scalar(), (low, high))
    return shown if quantity.observed else f"not observed {shown[shown.index('(') :]}"


def _ends(quantity: Quantity, factor: float) -> tuple[float, float] | None:
    """Ends of a scalar's 95 % interval times `factor`, by default ± 1.96 sd; None without an sd."""
    if isinstance(quantity.interval95, list):
        low, high = quantity.interval_ends()
        return factor * low, factor * high
    if not isinstance(quantity.sd, float):
        return None
    value, half = quantity.as_scalar(), SIGMAS_95 * quantity.sd
    return factor * (value - half), factor * (value + half)
