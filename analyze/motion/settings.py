"""Limits of the motion analysis that a caller may change."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from analyze.motion.contact import ContactErrors


@dataclass(frozen=True)
class WindowLimits:
    """Bounds of the gravity-only window."""

    guard_frames: int = 2
    """number of frames left out after the impact, in which the striker may still touch"""
    guard_s: float = 0.008
    """least time left out after the impact [s], for frame rates above 240 Hz"""
    past_phi: float = math.radians(25.0)
    """end of the window beyond phi [rad], before friction gives out"""
    above_rest: float = math.radians(0.7)
    """theta [rad] below which the resting face may touch"""


@dataclass(frozen=True)
class VerdictLimits:
    """Limits beyond which a strike is no clean tip."""

    min_turn: float = math.radians(0.5)
    """largest theta [rad] below which the object has not moved"""
    slip: float = 0.004
    """sliding along the table before the balance point [m]"""
    lift: float = 0.002
    """height of the edge above the table [m]"""
    edge_moved: float = 1.5e-4
    """sliding or lifting beyond noise [m] above which the edge is no longer taken as a hinge"""
    twist: float = math.radians(5.0)
    """rotation about axes other than the pivot [rad]"""
    speed_jump_ratio: float = 0.06
    """sudden change of speed over the speed at release"""
    second_impact_ratio: float = 0.12
    """the same ratio above which the change is a second impact however early it comes"""
    speed_jump_chi2: float = 14.0
    """least gain in chi^2 by a sudden change of speed; noise alone reaches it in one strike of some two
    hundred"""
    hard_energy_ratio: float = 3.5
    """energy ratio above which any lift before landing counts; 1.03 to 1.3 is planned, up to 3 may happen"""
    phi_sd: float = math.radians(1.0)
    """standard deviation of phi [rad] above which a fit is not used"""
    min_marker_share: float = 0.8
    """least share of the frames between impact and landing in which a marker is found"""
    max_marker_gap: int = 5
    """most consecutive frames without a marker"""
    max_image_gap_share: float = 0.4
    """longest gap between images as a share of the tip's time; free motion can be predicted across a shorter
    one"""


@dataclass(frozen=True)
class MotionSettings:
    """All settings of the motion analysis; the defaults are the documented ones."""

    window: WindowLimits = field(default_factory=WindowLimits)
    """bounds of the gravity-only window"""
    verdict: VerdictLimits = field(default_factory=VerdictLimits)
    """limits of a clean tip"""
    contact: ContactErrors = field(default_factory=ContactErrors)
    """errors by a contact that is no perfect hinge"""
    smoothing_points: int = 5
    """width of the moving mean of the paper's sign_change [frames]"""
