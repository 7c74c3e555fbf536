"""Loopback addresses for virtual cameras that no other test process uses.

A virtual camera holds UDP port 3956 of its address, so two test runs that name the same addresses are in each
other's way. Each process that runs tests therefore has a network 127.N.0.x of its own. It holds an abstract
unix socket named after that network: such sockets belong to the same network namespace as the addresses, and
vanish when the process ends, however it ends. 127.0.0.x is left to cameras that are started by hand.
"""

from __future__ import annotations

import atexit
import functools
import os
import socket

VARIABLE = "PERCUSS_TEST_NETWORK"
"""environment variable with the first three numbers of the test network, such as 127.77.0; chosen
automatically if not set"""


def loopback(host: int) -> str:
    """Loopback address 127.N.0.`host` in the network that this test process holds."""
    return f"{_network()}.{host}"


@functools.cache
def _network() -> str:
    if chosen := os.environ.get(VARIABLE):
        return chosen
    first = os.getpid()
    for number in range(254):
        network = f"127.{1 + (first + number) % 254}.0"
        holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            holder.bind(f"\0percuss-test-{network}")
        except OSError:
            holder.close()
            continue
        atexit.register(holder.close)
        return network
    raise AssertionError(
        f"all networks from 127.1.0 to 127.254.0 are in use by tests: end some, or set {VARIABLE}"
    )
