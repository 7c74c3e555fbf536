"""Network sockets of the daemon and its processes: only to the addresses that the rig file names."""

from __future__ import annotations

import contextlib
import ipaddress
import re
import sys
from pathlib import Path

import pytest

from tests.loopback import loopback
from tests.system.fault_rig import fault_rig, wait_until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(90)]
ADDRESS = loopback(124)
LISTENS = "0A"


def sockets_of(pid: int) -> list[tuple[str, ipaddress.IPv4Address | ipaddress.IPv6Address, int, str]]:
    """(protocol, local address, port, state) of every internet socket of a process."""
    inodes = set()
    for link in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            if found := re.fullmatch(r"socket:\[(\d+)\]", str(link.readlink())):
                inodes.add(found[1])
    found = []
    for protocol in ("tcp", "udp", "tcp6", "udp6", "raw", "raw6"):
        for line in Path(f"/proc/{pid}/net/{protocol}").read_text(encoding="ascii").splitlines()[1:]:
            fields = line.split()
            if fields[9] in inodes:
                host, port = fields[1].split(":")
                words = [int(host[i : i + 8], 16).to_bytes(4, sys.byteorder) for i in range(0, len(host), 8)]
                found.append((protocol, ipaddress.ip_address(b"".join(words)), int(port, 16), fields[3]))
    return found


def test_nothing_is_open_to_the_network_but_what_the_rig_file_names() -> None:
    with fault_rig() as rig:
        rig.camera(ADDRESS)
        daemon = rig.daemon(rig.rig_file("d", ADDRESS))
        client = rig.client(daemon)
        rig.open_recording(client)
        wait_until(lambda: daemon.capture and daemon.watcher, 10.0)
        wait_until(lambda: client.call("status")["frames"] > 10, 20.0, 0.05)
        open_to = {pid: sockets_of(pid) for pid in (daemon.pid, daemon.capture, daemon.watcher)}
        client.call("recording.close")
    assert open_to.pop(daemon.pid) == []
    (capture, watcher) = sorted(open_to.values(), key=len, reverse=True)
    assert watcher == []
    # GVCP and GVSP, to the camera that the rig file names
    assert {protocol for protocol, *_ in capture} == {"udp"}, capture
    assert all(address.is_loopback for _, address, _, _ in capture), capture
    assert LISTENS not in {state for protocol, _, _, state in capture if protocol.startswith("tcp")}
