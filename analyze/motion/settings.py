"""Limits of the motion analysis that a caller may change."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from analyze.motion.contact import ContactErrors


@dataclass(frozen=True)
class WindowLimits:
    """Bounds of the fit's window: the frames in which the object tips freely, the striker being off.

    It begins a number of frames and a time [s] after the impact, above a least tipping angle [rad]. It ends
    an angle [rad] past balance; on a round rim earlier, if the object turns aside.
    """

    guard_frames: int = 2
    """number of frames left out after the impact, because the striker may still touch the object"""
    guard_s: float = 0.008
    """least time left out after the impact [s]; it decides at frame rates above 250 Hz"""
    past_phi: float = math.radians(25.0)
    """angle past the balance angle phi [rad] at which the window ends; beyond it the edge may lose its grip
    and slide"""
    off_axis: float = math.radians(4.0)
    """turn about other axes [rad] at which the window ends past balance, on a round rim: an object that falls
    over one turns aside ever faster, and no longer tips in a plane"""
    above_rest: float = math.radians(0.7)
    """tipping angle theta [rad] below which the resting face may touch"""


@dataclass(frozen=True)
class VerdictLimits:
    """Limits beyond which a strike (one impact on the object) does not count as a clean tip."""

    min_turn: float = math.radians(0.5)
    """least peak of the tipping angle theta [rad] of an object that has moved"""
    slip: float = 0.004
    """largest sliding along the table before the balance point [m]"""
    lift: float = 0.002
    """largest height of the edge above the table [m]"""
    edge_moved: float = 1.5e-4
    """sliding or lifting beyond noise [m] above which the edge is no longer taken as a hinge"""
    twist: float = math.radians(5.0)
    """largest rotation about axes other than the pivot [rad]"""
    speed_jump_ratio: float = 0.06
    """least sudden change of speed that counts as a jump, over the speed at release"""
    second_impact_ratio: float = 0.12
    """ratio of a jump in speed to the speed at release from which it is a second impact, however soon after
    the first it comes"""
    speed_jump_chi2: float = 14.0
    """least gain in chi^2 by a jump in speed; noise alone reaches it in about one strike of two hundred"""
    hard_energy_ratio: float = 3.5
    """energy ratio (impact energy over the energy needed to tip) from which any lift before landing counts;
    1.03 to 1.3 is planned, up to 3 may happen"""
    phi_sd: float = math.radians(1.0)
    """standard deviation of phi [rad] above which a fit is not used"""
    min_marker_share: float = 0.8
    """least share of the frames between impact and landing in which a marker is found"""
    max_marker_gap: int = 5
    """most consecutive frames without a marker"""
    max_image_gap_share: float = 0.4
    """longest gap between images, as a share of the tip's duration; across a shorter gap the free motion can
    be predicted"""


@dataclass(frozen=True)
class MotionSettings:
    """Settings of the motion analysis: bounds of the fit's frames, limits of a clean tip, contact errors.

    The defaults are those of docs/explanation/method.md, section 3.
    """

    window: WindowLimits = field(default_factory=WindowLimits)
    """bounds of the gravity-only window"""
    verdict: VerdictLimits = field(default_factory=VerdictLimits)
    """limits of a clean tip"""
    contact: ContactErrors = field(default_factory=ContactErrors)
    """errors of phi and k caused by a contact that is not a perfect hinge"""
    smoothing_points: int = 5
    """width [frames] of the moving mean in `sign_change`, the paper's estimator"""
