"""Check of the firewall: whether UDP packets of the camera may come in, as far as its rules can be read.

Images come from a port of the camera at which this computer never called (Aravis sends nothing there), so a
rule for established connections does not let them in.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from acquire.preflight.check import Check, failed_check, passed_check, skipped_check
from acquire.preflight.packet_filter import PacketFilter, Passage

FIREWALL_LINE = "firewall"
"""name of the check"""
NFT_COMMAND: Final = ("nft", "-j", "list", "ruleset")
NFT_S = 5.0
"""longest time for listing the rules [s]"""


@dataclass(frozen=True)
class FirewallState:
    """Firewall of this computer, as far as this user can read it."""

    ufw: bool
    """True if ufw is switched on in its configuration"""
    firewalld: bool
    """True if firewalld runs"""
    legacy: bool
    """True if the older iptables holds rules; only root can read whether it does"""
    rules: list[dict[str, Any]] | None
    """rules of nftables, as `nft -j list ruleset` prints them; None if this user may not read them"""


ReadFirewall = Callable[[], FirewallState]


def read_firewall(root: Path = Path("/"), command: tuple[str, ...] = NFT_COMMAND) -> FirewallState:
    """State of this computer's firewall. Rules of nftables are listed only to root.

    Args:
        root: root of the file system; a test passes its own.
        command: command that lists the rules of nftables.
    """
    switch = _text(root / "etc/ufw/ufw.conf").replace('"', "").lower().splitlines()
    return FirewallState(
        ufw="enabled=yes" in [line.replace(" ", "") for line in switch],
        firewalld=(root / "run/firewalld.pid").exists(),
        legacy="filter" in _text(root / "proc/net/ip_tables_names").split(),
        rules=_list_rules(command),
    )


def _list_rules(command: tuple[str, ...]) -> list[dict[str, Any]] | None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=NFT_S, check=True)
        return list(json.loads(done.stdout)["nftables"])
    except (OSError, subprocess.SubprocessError, ValueError, KeyError):
        return None


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError:
        return ""


def check_firewall(read: ReadFirewall, interface: str, address: str) -> Check:
    """Check that the firewall lets images of the camera in. It fails only where the rules drop them for sure.

    Args:
        read: function that reads the firewall.
        interface: interface to which the camera is connected.
        address: IPv4 address of the camera.
    """
    state = read()
    source = f"UDP from {address} at {interface}"
    remedy = _let_in(state, interface, address)
    if state.rules is not None:
        packet_filter = PacketFilter(state.rules)
        passage, chain = packet_filter.passage(interface, address)
        if passage is Passage.DROPPED:
            return failed_check(
                FIREWALL_LINE, f"{chain} drops {source}", remedy or _nft_rule(chain, interface, address)
            )
        if passage is Passage.UNKNOWN:
            found = f"whether {chain} lets in {source} depends on more than its addresses"
            return skipped_check(FIREWALL_LINE, found, remedy or _nft_rule(chain, interface, address))
        if state.legacy:
            found = f"nftables lets in {source}; the older iptables has rules too"
            return skipped_check(FIREWALL_LINE, found, "read them: sudo iptables -S INPUT")
        return passed_check(FIREWALL_LINE, f"lets in {source}")
    if remedy:
        name = "ufw" if state.ufw else "firewalld"
        return skipped_check(FIREWALL_LINE, f"{name} is on, and only root reads its rules", remedy)
    return skipped_check(
        FIREWALL_LINE,
        "only root reads the rules of nftables",
        "if no frame arrives: sudo nft list ruleset (docs/how-to/hardware.md)",
    )


def _let_in(state: FirewallState, interface: str, address: str) -> str:
    """Command by which the firewall's own program lets the camera in; "" if none is on."""
    if state.ufw:
        return f"sudo ufw allow in on {interface} from {address} proto udp"
    if state.firewalld:
        return (
            f"sudo firewall-cmd --permanent --zone=trusted --change-interface={interface}, then "
            "sudo firewall-cmd --reload"
        )
    return ""


def _nft_rule(chain: str, interface: str, address: str) -> str:
    """Command that puts a rule for the camera at the beginning of a chain of nftables."""
    return f"sudo nft insert rule {chain} iifname {interface} ip saddr {address} meta l4proto udp accept"
