"""Short form of `make attack`: some requests to a daemon that records."""

from __future__ import annotations

import time

from tests.attack.findings import Finding
from tests.attack.requests import attack_requests

REQUESTS = 2000


def test_the_daemon_stops_the_arm_beside_rubbish() -> None:
    findings: list[Finding] = []
    attack_requests(4, REQUESTS, time.monotonic() + 60.0, lambda tally: findings.extend(tally.findings))
    assert findings == []
