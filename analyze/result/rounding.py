"""Rounding of result documents, so that the same recordings give the same bytes."""

from __future__ import annotations

import json
from typing import Any, TypeVar

from schemas.document import Document, canonical_json

D = TypeVar("D", bound=Document)
SIGNIFICANT_DIGITS = 10
"""significant digits of every number in a Result, so that it does not depend on the order of sums in the
linear algebra library"""


def rounded(document: D) -> D:
    """Copy of a document with every float rounded to `SIGNIFICANT_DIGITS` significant digits."""
    return type(document).model_validate(_round(json.loads(canonical_json(document))))


def _round(value: Any) -> Any:
    """Copy of a JSON value with every float in it rounded to `SIGNIFICANT_DIGITS` significant digits."""
    if isinstance(value, float):
        return float(f"{value:.{SIGNIFICANT_DIGITS}g}")
    if isinstance(value, dict):
        return {key: _round(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_round(item) for item in value]
    return value
