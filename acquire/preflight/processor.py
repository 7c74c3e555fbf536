"""Check of the processor's clock governor, which lets a processor sleep that is to read frames in time."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Final

from acquire.preflight.check import Check, failed_check, passed_check, skipped_check

GOVERNOR_LINE = "CPU governor"
"""name of the check"""
SLOW_GOVERNORS: Final = ("powersave", "ondemand", "conservative")
"""governors that hold a clock at its lowest, or raise it only tens of milliseconds after work has come
(Linux, admin-guide/pm/cpufreq.rst)"""
SELF_SCALING_DRIVERS: Final = ("intel_pstate", "amd-pstate-epp")
"""drivers whose processors choose their clock themselves, also under the governor that they call powersave:
the preference decides how soon (Linux, admin-guide/pm/intel_pstate.rst and amd-pstate.rst)"""
SLOW_PREFERENCES: Final = ("power", "balance_power")
"""energy performance preferences with which such a processor is slow to raise its clock"""


class Processor:
    """Processors of this computer, as the kernel's cpufreq reports them.

    Args:
        sys: root of the tree /sys; a test passes its own.
    """

    def __init__(self, sys: Path = Path("/sys")) -> None:
        self._policies = sys / "devices/system/cpu/cpufreq"

    def habits(self) -> Counter[tuple[str, str, str]]:
        """Numbers of clocks by driver, governor and energy preference ("" if there is none)."""
        found: Counter[tuple[str, str, str]] = Counter()
        for policy in self._policies.glob("policy*"):
            names = ("scaling_driver", "scaling_governor", "energy_performance_preference")
            driver, governor, preference = (_text(policy / name) for name in names)
            if governor:
                found[driver, governor, preference] += 1
        return found


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""


def check_governor(processor: Processor) -> Check:
    """Check that no processor's clock waits at its lowest for work.

    A slow clock delays the reading of frames and of the servo, and with it the times that rest on arrivals.
    Not checked where the kernel reports no governor (virtual machine, container, board without cpufreq).
    """
    habits = processor.habits()
    if not habits:
        return skipped_check(GOVERNOR_LINE, "the kernel reports none (virtual machine, or a fixed clock)")
    slow = Counter({habit: count for habit, count in habits.items() if _is_slow(*habit)})
    found = ", ".join(sorted({_name(*habit) for habit in slow or habits}))
    if not slow:
        return passed_check(GOVERNOR_LINE, found)
    scales = any(driver in SELF_SCALING_DRIVERS for driver, _, _ in slow)
    file = "energy_performance_preference" if scales else "scaling_governor"
    remedy = (
        f"echo performance | sudo tee /sys/devices/system/cpu/cpufreq/policy*/{file}, or "
        "powerprofilesctl set performance"
    )
    found = f"{found} on {slow.total()} of {habits.total()} clocks: frames may be read late"
    return failed_check(GOVERNOR_LINE, found, remedy)


def _is_slow(driver: str, governor: str, preference: str) -> bool:
    if driver in SELF_SCALING_DRIVERS:
        return preference in SLOW_PREFERENCES
    return governor in SLOW_GOVERNORS


def _name(driver: str, governor: str, preference: str) -> str:
    return f"{governor} ({driver}, {preference})" if preference else f"{governor} ({driver or 'no driver'})"
