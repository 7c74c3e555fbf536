"""Two hosts on one machine for tests: namespaces with processes, host name and network of their own.

A pair of virtual Ethernet cards connects them. Killing a namespace's first process kills all others, as a
power cut does. The disks are shared.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

PROGRAMS = ("ip", "nsenter", "unshare")
APART = ("--pid", "--mount", "--uts", "--net")


def missing() -> str:
    """Why there can be no second host here; "" if there can."""
    absent = [name for name in PROGRAMS if shutil.which(name) is None]
    if absent:
        return f"no {', '.join(absent)}: apt-get install iproute2 util-linux"
    return "" if os.geteuid() == 0 else "only root may make namespaces with a network"


@dataclass
class Host:
    """One host: its address, and the process outside of its namespaces whose end is the host's."""

    address: str
    power: subprocess.Popen[bytes]
    started: list[subprocess.Popen[str]] = field(default_factory=list)

    @property
    def first(self) -> int:
        """Process id, as seen from outside, of the host's first process."""
        children = Path(f"/proc/{self.power.pid}/task/{self.power.pid}/children").read_text().split()
        return int(children[0])

    def start(
        self, command: Sequence[str], log: Path | None = None, environment: dict[str, str] | None = None
    ) -> subprocess.Popen[str]:
        """Start a program on the host; its output is piped, or appended to a log."""
        with (log or Path(os.devnull)).open("a") as file:
            process = subprocess.Popen(
                ["nsenter", "--target", str(self.first), *APART, f"--wdns={Path.cwd()}", *command],
                stdout=file if log else subprocess.PIPE,
                stderr=file if log else subprocess.PIPE,
                text=True,
                env=os.environ | (environment or {}),
            )
        self.started.append(process)
        return process

    def processes(self) -> list[int]:
        """Ids, as seen from outside, of the host's processes without its first."""
        space = Path(f"/proc/{self.first}/ns/pid").readlink()
        found: list[int] = []
        for path in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if (path / "ns/pid").readlink() == space and int(path.name) != self.first:
                    found.append(int(path.name))
        return found

    def find(self, word: str) -> list[int]:
        """Ids, as seen from outside, of the host's processes whose command line contains a word."""
        found: list[int] = []
        for process in self.processes():
            with contextlib.suppress(OSError):
                if word in Path(f"/proc/{process}/cmdline").read_text().replace("\0", " "):
                    found.append(process)
        return found

    def stop(self) -> None:
        """Stop all processes of the host, as an overloaded or sleeping host does; `go_on` continues them."""
        self._signal(signal.SIGSTOP)

    def go_on(self) -> None:
        """Continue the processes that `stop` stopped."""
        self._signal(signal.SIGCONT)
        # `nsenter` stops itself with its child.
        for process in self.started:
            process.send_signal(signal.SIGCONT)

    def cut(self, cable: str) -> None:
        """Cut the host from the network ("down"), or connect it again ("up")."""
        self.run("ip", "link", "set", "wire", cable)

    def lose(self) -> None:
        """Kill all processes of the host at once."""
        self.power.kill()
        self.power.wait()
        for process in self.started:
            process.send_signal(signal.SIGCONT)
            process.wait()

    def _signal(self, number: signal.Signals) -> None:
        for process in self.processes():
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, number)

    def run(self, *command: str) -> None:
        """Run a program on the host to its end.

        Raises:
            subprocess.CalledProcessError: it failed.
        """
        inside = ["nsenter", "--target", str(self.first), *APART, *command]
        subprocess.run(inside, check=True, capture_output=True)


@contextmanager
def two_hosts() -> Iterator[tuple[Host, Host]]:
    """Two connected hosts for the duration of a `with` block."""
    hosts: list[Host] = []
    try:
        for number in (1, 2):
            command = ["unshare", *APART, "--fork", "--kill-child", "--mount-proc", "sleep", "infinity"]
            hosts.append(Host(f"10.77.0.{number}", subprocess.Popen(command)))
        _wait_until_apart(hosts)
        ends = [["wire", "netns", str(host.first)] for host in hosts]
        subprocess.run(["ip", "link", "add", *ends[0], "type", "veth", "peer", "name", *ends[1]], check=True)
        # Both ends of the cable go with one host; the other keeps its address on a bridge.
        hosts[0].run("ip", "link", "add", "lan", "type", "bridge")
        hosts[0].run("ip", "link", "set", "wire", "master", "lan")
        for number, (host, device) in enumerate(zip(hosts, ("lan", "wire"), strict=True), 1):
            host.run("hostname", f"host{number}")
            host.run("ip", "address", "add", f"{host.address}/24", "dev", device)
            for each in ("lo", "wire", device):
                host.run("ip", "link", "set", each, "up")
        yield hosts[0], hosts[1]
    finally:
        for host in hosts:
            host.lose()


def _wait_until_apart(hosts: Sequence[Host]) -> None:
    ends = time.monotonic() + 10
    own = Path("/proc/self/ns/net").readlink()
    for host in hosts:
        while True:
            with contextlib.suppress(OSError, IndexError):
                if Path(f"/proc/{host.first}/comm").read_text() == "sleep\n":
                    break
            assert time.monotonic() < ends
            time.sleep(0.01)
        assert Path(f"/proc/{host.first}/ns/net").readlink() != own
