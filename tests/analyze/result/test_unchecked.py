"""Sentence on strikes that nothing confirms."""

import numpy as np

from analyze.estimation.checks import LeaveOneOut
from analyze.result.unchecked import unchecked_text


def test_strikes_that_the_others_leave_open_are_named_with_the_remedy():
    none = np.zeros((2, 2))
    strikes = [
        LeaveOneOut(f"s{i}", 0.3, 0.0, 0.1, None, None, 0.0, 60.0, none, none, checkable=i == 2)
        for i in (1, 2, 3)
    ]
    text = unchecked_text(strikes)
    assert text is not None
    assert text.startswith("not checked: strikes s1, s3: ")
    assert "strike those edges again" in text
    assert unchecked_text(strikes[1:2]) is None
