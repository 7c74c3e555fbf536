"""Way of one UDP packet through the rules of nftables, in three values: accepted, dropped, or unknown.

What is decided: interface, sender, protocol, port of the receiver below the ephemeral ones, and the state
"new" of a connection. Sets by name, marks, limits, and chains of bridges and ingress are not evaluated.
Format of the rules: libnftables-json(5).
"""

from __future__ import annotations

import enum
import ipaddress
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final, cast

Json = dict[str, Any]
_HOOKS: Final = ("prerouting", "input")
_FAMILIES: Final = ("ip", "inet")
_FIRST_EPHEMERAL_PORT: Final = 32768
"""lowest port of the kernel's choice for a socket (net.ipv4.ip_local_port_range)"""
_FACTS: Final[dict[tuple[str, Any], tuple[Any, ...]]] = {
    ("meta", "l4proto"): ("udp", 17),
    ("ip", "protocol"): ("udp", 17),
    ("meta", "protocol"): ("ip", 8),
    ("meta", "nfproto"): ("ipv4", 2),
    ("ct", "state"): ("new",),
}
"""what holds for the packet, by kind and field of a match: names and numbers of the value"""
_PROTOCOLS: Final = ("ip", "udp", "th", "ether")
"""protocols whose fields the packet has"""
_DEEPEST: Final = 16
"""longest sequence of jumps that the kernel allows (NFT_JUMP_STACK_SIZE)"""


class Passage(enum.Enum):
    """What becomes of a packet."""

    ACCEPTED = "accepted"
    DROPPED = "dropped"
    UNKNOWN = "unknown"


_NEXT: Final = "next"
"""outcome of a chain or rule that decides nothing: the next rule does"""
_ACCEPT, _DROP, _RETURN = "accept", "drop", "return"
_VERDICTS: Final = {
    "accept": {_ACCEPT},
    "drop": {_DROP},
    "reject": {_DROP},
    "return": {_RETURN},
    "queue": {_ACCEPT, _DROP},
    "xt": {_ACCEPT, _DROP, _NEXT},
}
"""possible outcomes of a statement, by its first word; xt is a rule of iptables that nftables holds"""


@dataclass(frozen=True)
class _Packet:
    interface: str
    source: str


class PacketFilter:
    """Rules of nftables.

    Args:
        objects: tables, chains and rules as `nft -j list ruleset` lists them.
    """

    def __init__(self, objects: Iterable[Json]) -> None:
        self._chains: dict[tuple[str, str, str], Json] = {}
        self._rules: dict[tuple[str, str, str], list[list[Json]]] = {}
        for each in objects:
            if chain := each.get("chain"):
                self._chains[chain["family"], chain["table"], chain["name"]] = chain
            elif rule := each.get("rule"):
                key = rule["family"], rule["table"], rule["chain"]
                self._rules.setdefault(key, []).append(rule.get("expr", []))

    def passage(self, interface: str, source: str) -> tuple[Passage, str]:
        """What becomes of the first UDP packet from an IPv4 address at an interface, to an ephemeral port.

        Returns:
            The passage, and the chain ("family table chain") that drops the packet or is unknown; "" if it is
            accepted.
        """
        packet, unknown = _Packet(interface, source), ""
        for key, chain in sorted(self._chains.items(), key=lambda item: _order(item[1])):
            if chain.get("hook") not in _HOOKS or key[0] not in _FAMILIES or chain.get("type") != "filter":
                continue
            outcomes = self._walk(key, packet, 0)
            if _NEXT in outcomes:
                outcomes = outcomes - {_NEXT} | {str(chain.get("policy", _ACCEPT))}
            if outcomes == {_DROP}:
                return Passage.DROPPED, " ".join(key)
            if outcomes != {_ACCEPT}:
                unknown = unknown or " ".join(key)
        return (Passage.UNKNOWN, unknown) if unknown else (Passage.ACCEPTED, "")

    def _walk(self, key: tuple[str, str, str], packet: _Packet, depth: int) -> set[str]:
        """Possible outcomes of a chain: accept, drop, or next."""
        if depth > _DEEPEST:
            return {_ACCEPT, _DROP}
        possible: set[str] = set()
        for statements in self._rules.get(key, []):
            matches, outcomes = True, {_NEXT}
            for statement in statements:
                decided = _matches(statement, packet)
                if decided is False:
                    matches = False
                    break
                if decided is None:
                    matches = None
                outcomes = self._outcomes(statement, key, packet, depth)
                if outcomes != {_NEXT}:
                    break
            if matches is False:
                continue
            possible |= outcomes - {_NEXT, _RETURN} | ({_NEXT} if _RETURN in outcomes else set())
            if matches and _NEXT not in outcomes:
                return possible
        return possible | {_NEXT}

    def _outcomes(self, statement: Json, key: tuple[str, str, str], packet: _Packet, depth: int) -> set[str]:
        """Possible outcomes of a statement that its rule reaches: accept, drop, return, or next."""
        if "vmap" in statement:
            found: set[str] = set()
            for verdict in _map_verdicts(statement["vmap"]):
                found |= self._outcomes(verdict, key, packet, depth)
            return found | {_NEXT}
        for word in ("jump", "goto"):
            if word in statement:
                target = key[0], key[1], str(statement[word]["target"])
                outcomes = self._walk(target, packet, depth + 1)
                return outcomes - {_NEXT} | {_RETURN} if word == "goto" and _NEXT in outcomes else outcomes
        return next((set(_VERDICTS[word]) for word in _VERDICTS if word in statement), {_NEXT})


def _order(chain: Json) -> tuple[int, int]:
    hook = chain.get("hook")
    return (_HOOKS.index(hook) if hook in _HOOKS else len(_HOOKS), int(chain.get("prio", 0)))


def _map_verdicts(vmap: Json) -> Iterator[Json]:
    """Verdicts of a map that the packet may take; of one by connection state, that of "new" alone."""
    data = vmap.get("data")
    entries = cast("list[Any]", data.get("set", [])) if isinstance(data, dict) else []
    by_state = cast("Json", vmap.get("key", {})).get("ct", {}).get("key") == "state"
    if cast("Json", vmap.get("key", {})).get("payload", {}).get("protocol", "ip") not in _PROTOCOLS:
        return
    if not entries:
        yield from ({"accept": None}, {"drop": None})
    for value, verdict in entries:
        if not by_state or value == "new":
            yield verdict


def _matches(statement: Json, packet: _Packet) -> bool | None:
    """Whether a statement lets its rule go on; None if that is unknown."""
    if "limit" in statement or "xt" in statement or "quota" in statement:
        return None
    match = statement.get("match")
    if match is None:
        return True
    left = cast("Json", match["left"]) if isinstance(match["left"], dict) else {}
    payload = cast("Json", left.get("payload", {}))
    if payload.get("protocol", "ip") not in _PROTOCOLS:
        return False  # of another protocol: tcp, icmp, ip6 ...
    equal = _is_value(left, payload, match["right"], packet)
    if equal is None or match["op"] not in ("==", "!=", "in"):
        return None
    return equal if match["op"] != "!=" else not equal


def _is_value(left: Json, payload: Json, right: Any, packet: _Packet) -> bool | None:
    """Whether what a match looks at has the value, or one of the values, `right`; None if that is unknown."""
    values = _values(right)
    if values is None:
        return None
    kind = next((kind for kind in ("meta", "ct") if kind in left), str(payload.get("protocol")))
    field = payload.get("field") if payload else cast("Json", left.get(kind, {})).get("key")
    if kind == "ip" and field == "saddr":
        return _contains(values, packet.source)
    if field == "dport" and all(isinstance(value, int) and value < _FIRST_EPHEMERAL_PORT for value in values):
        return False
    known = {**_FACTS, ("meta", "iifname"): (packet.interface,), ("meta", "iif"): (packet.interface,)}
    if (kind, field) not in known or any(str(value).endswith("*") for value in values):
        return None
    return any(value in values for value in known[kind, field])


def _values(right: Any) -> list[Any] | None:
    """Values of the right side of a match; None if they are not listed there."""
    if isinstance(right, dict):
        for word in ("set", "|"):
            if word in right:
                return list(cast("list[Any]", right[word]))
        return [right] if "prefix" in right or "range" in right else None
    if isinstance(right, list):
        return list(cast("list[Any]", right))
    return None if isinstance(right, str) and right.startswith("@") else [right]


def _contains(values: list[Any], source: str) -> bool | None:
    """Whether an IPv4 address is among addresses, prefixes and ranges; None if one of them is unknown."""
    address = ipaddress.IPv4Address(source)
    for value in values:
        try:
            if isinstance(value, dict) and "prefix" in value:
                prefix = cast("Json", value["prefix"])
                found = address in ipaddress.IPv4Network(f"{prefix['addr']}/{prefix['len']}", strict=False)
            elif isinstance(value, dict) and "range" in value:
                low, high = (ipaddress.IPv4Address(end) for end in cast("list[str]", value["range"]))
                found = low <= address <= high
            else:
                found = address == ipaddress.IPv4Address(value)
        except (ValueError, KeyError, TypeError):
            return None
        if found:
            return True
    return False
