"""Results that the console's pages show: estimates, angle curves, and the list of recordings."""

from __future__ import annotations

import math
from typing import Any

HOSTILE = '<img src=x onerror="document.title=1"> & "carton"'
"""name that would run a script if it were inserted as HTML"""
SIZE_M = (0.162, 0.110, 0.208)
"""box of the object [m]"""
COM_M = (0.0790, 0.0562, 0.0871)


def estimate(strikes_used: int, **more: Any) -> dict[str, Any]:
    """Estimate after a number of good strikes; the uncertainty shrinks with it."""
    sd = 0.0031 / strikes_used**1.25
    wander = [
        math.sin(strikes_used * 2.1) * sd,
        math.cos(strikes_used * 1.3) * sd,
        math.sin(strikes_used) * sd,
    ]
    covariance = [
        [sd**2, 0.45 * sd**2, 0.0],
        [0.45 * sd**2, 1.6 * sd**2, -0.5 * sd**2],
        [0.0, -0.5 * sd**2, 3.1 * sd**2],
    ]
    x, y, z = SIZE_M
    side = [[0, 0], [1, 0], [1, 0.86], [0.82, 1], [0, 1]]
    tensor = [2.214e-3, 2.871e-3, 1.642e-3, -0.041e-3, 0.018e-3, 0.112e-3]
    half = 1.96 * math.sqrt(3.1) * sd
    return {
        "kind": "estimate",
        "strike_id": f"s{strikes_used}.1",
        "strikes": strikes_used,
        "com_m": [a + b for a, b in zip(COM_M, wander, strict=True)],
        "com_covariance_m2": covariance,
        "com_open": [],
        "com_half_width_m": half,
        "inertia_kg_m2": tensor,
        "inertia_sd_kg_m2": [abs(v) * 0.05 / strikes_used + 4e-6 for v in tensor],
        "inertia_half_width": 0.12 / strikes_used,
        "checks": [
            {
                "name": "leave one out",
                "passed": True,
                "text": "each strike is predicted by the others within 1.7 sd",
            },
            {
                "name": "agreement",
                "passed": True,
                "text": "residuals of the planes: 0.9 of their expected size",
            },
            {
                "name": "physical tensor",
                "passed": True,
                "text": "positive, and the triangle inequality holds",
            },
        ],
        "target": {"com_m": 0.0005, "inertia": None, "met": half <= 0.0005, "reachable": True, "reason": ""},
        "forecast": {"least": 2, "most": 4},
        "next": {
            "strike_id": "s7",
            "reason": "Tipping over the back edge tells most about z: ± 0.9 mm becomes ± 0.5 mm.",
        },
        "bounds_m": [[0.0, 0.0, 0.0], list(SIZE_M)],
        "markers": [
            {"id": 12, "place_m": [0.0, -0.06, 0.1], "faces": [0, -1, 0]},
            {"id": 14, "place_m": [0.09, 0.05, 0.14], "faces": [1, 0, 0]},
            {"id": 15, "place_m": [0.08, 0.06, 0.2], "faces": [0, 0, 1]},
        ],
        "hull": [
            [[a * y, b * z] for a, b in side],
            [[a * x, b * z] for a, b in side],
            [[a * x, b * y] for a, b in [[0, 0], [1, 0], [1, 1], [0, 1]]],
        ],
    } | more


def curve() -> dict[str, Any]:
    """Angle curve of one strike that tips over."""
    phi, k = 36.41, 62.0
    time_s, theta = [], []
    angle, rate = 0.0, 6.6
    for i in range(-8, 50):
        time_s.append(i / 120)
        theta.append(math.degrees(angle) + 0.12 * math.sin(i * 12.9898))
        if i >= 0:
            for _ in range(10):
                rate += -k * math.sin(math.radians(phi) - angle) / 1200
                angle = min(angle + rate / 1200, math.pi / 2)
    inside = [i for i, t in enumerate(time_s) if 0.01 < t < 0.22]
    return {
        "time_s": time_s,
        "theta_deg": theta,
        "fit_time_s": [time_s[i] for i in inside],
        "fit_deg": [theta[i] - 0.12 * math.sin((i - 8) * 12.9898) for i in inside],
        "phi_deg": phi,
        "window_s": [0.012, 0.218],
    }


def archive() -> list[dict[str, Any]]:
    """List of recordings."""
    rows = [
        ("carton", "2026-11-29T14:05:00", 9, [79.02, 56.21, 87.13], [0.11, 0.14, 0.19], [], True),
        (
            "carton",
            "2026-11-28T09:41:00",
            9,
            [79.31, 56.02, 87.52],
            [0.12, 0.16, 0.22],
            ["2 strikes repeated"],
            True,
        ),
        (HOSTILE, "2026-11-27T17:20:00", 5, [42.1, 38.8, 120.4], [0.6, 0.7, 1.9], ["z weakly known"], True),
        ("spray bottle, half full", "2026-11-27T16:02:00", 3, None, None, ["frames lost"], False),
        ("parcel", "2026-11-20T11:11:00", 7, [201.4, 149.9, 98.2], [0.8, 0.9, 1.2], [], True),
    ]
    return [
        {
            "id": f"r{i}",
            "file": f"{name[:6].strip('<')}-{date.replace(':', '-')}.mcap",
            "object": name,
            "date": date,
            "strikes": count,
            "com_mm": com,
            "com_sd_mm": sd,
            "flags": flags,
            "earlier_strikes": 3 if i == 1 else 0,
            "size_bytes": 312_000_000 + 77_000_000 * i,
            "complete": complete,
        }
        for i, (name, date, count, com, sd, flags, complete) in enumerate(rows)
    ]
