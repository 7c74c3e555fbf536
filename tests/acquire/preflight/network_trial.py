"""Virtual network in which the remedies of the network's checks are carried out, as the checks print them.

network_trial.py [camera]: run by `unshare` as root of namespaces of its own, it prints a JSON object. The
computer has two interfaces in one subnet, near and far; the camera, a process in a second namespace, is at
the far end. Packets are UDP from the camera to the computer. Does not model: a driver's link speed, GigE
Vision.
"""

from __future__ import annotations

import json
import re
import shlex
import socket
import subprocess
import sys

from acquire.preflight.check import Check
from acquire.preflight.firewall import FIREWALL_LINE, read_firewall
from acquire.preflight.network import Network, check_network
from schemas.rig import CameraConfig
from tests.acquire.capture.synthetic_rig import CALIBRATION

CAMERA, OWN, FAR, PORT = "192.168.77.2", "192.168.77.1", "192.168.77.3", 45000
CONFIG = CameraConfig(address=CAMERA, packet_size=1500, calibration=CALIBRATION)
RULES = """
table inet guard {
    chain tcp_services { tcp dport { 22, 80 } accept; udp dport 53 accept; }
    chain input {
        type filter hook input priority filter; policy drop;
        iif lo accept
        ct state vmap { established : accept, related : accept, invalid : drop }
        meta l4proto icmp accept
        ip saddr 192.168.78.0/24 accept
        jump tcp_services
    }
}
"""


def run(command: str, text: str | None = None) -> None:
    subprocess.run(shlex.split(command), input=text, text=True, check=True, capture_output=True)


def checks(config: CameraConfig = CONFIG) -> dict[str, Check]:
    return {check.name: check for check in check_network(Network(), read_firewall, config)}


def arrives(camera: subprocess.Popen[str], receiver: socket.socket) -> bool:
    """True if one of the packets that the camera sends now comes in; it asks for addresses (ARP) again."""
    run(f"nsenter --net --target {camera.pid} ip neigh flush dev camera")
    assert camera.stdin is not None
    assert camera.stdout is not None
    camera.stdin.write("send\n")
    camera.stdin.flush()
    assert camera.stdout.readline() == "sent\n"
    senders: list[str] = []
    try:
        while True:
            senders.append(receiver.recvfrom(100)[1][0])
    except TimeoutError:
        return CAMERA in senders


class Trial:
    """Checks and packets of one virtual network.

    Args:
        camera: process of the camera, which is ready.
        receiver: socket of this computer at which packets of the camera arrive.
    """

    def __init__(self, camera: subprocess.Popen[str], receiver: socket.socket) -> None:
        self._camera, self._receiver = camera, receiver
        self.found: dict[str, object] = {}
        """outcomes of checks by step, the last of which is whether a packet came in"""

    def note(self, step: str, *names: str) -> dict[str, Check]:
        """Store the outcomes of some checks, and whether a packet comes in."""
        now = checks()
        outcomes = [now[name].outcome.value for name in names]
        self.found[step] = [*outcomes, arrives(self._camera, self._receiver)]
        return now

    def set_up(self) -> None:
        """Connect both interfaces, one of them with the camera at its far end, and give them addresses."""
        run("ip link set lo up")
        run("ip link add near type veth peer name nowhere")
        run("ip link add far type veth peer name camera")
        run(f"ip link set camera netns {self._camera.pid}")
        for each in ("near", "nowhere", "far"):
            run(f"ip link set {each} up")
        run(f"nsenter --net --target {self._camera.pid} ip address add {CAMERA}/24 dev camera")
        run(f"nsenter --net --target {self._camera.pid} ip link set camera up")
        self.found["no route"] = checks()["route"].outcome.value
        run(f"ip address add {OWN}/24 dev near")
        self.found["link"] = checks()["link speed"].found
        large = CONFIG.model_copy(update={"packet_size": 8192})
        cut = checks(large)["packet size"]
        run(cut.remedy.partition(",")[0].removeprefix("sudo "))
        self.found["packet size"] = [each.outcome.value for each in (cut, checks(large)["packet size"])]
        run(f"ip address add {FAR}/24 dev far")

    def mend_paths(self) -> None:
        """Two interfaces in one subnet: a loose filter, then a route of the camera's own."""
        run("sysctl -w net.ipv4.conf.far.rp_filter=1")
        strict = self.note("strict", "route", "rp_filter")
        run(strict["rp_filter"].remedy.partition(",")[0].removeprefix("sudo "))
        self.note("loose", "route", "rp_filter")
        run("sysctl -w net.ipv4.conf.far.rp_filter=1")
        run(command_in(strict["route"], r"ip route add \S+ dev") + " far")
        self.note("route of its own", "route", "rp_filter")

    def mend_firewall(self) -> None:
        """Rules that drop the camera's packets, then the rule that lets them in."""
        run("nft -f -", RULES)
        shut = self.note("firewall", FIREWALL_LINE)[FIREWALL_LINE]
        self.found["chain"] = shut.found
        run(shut.remedy.removeprefix("sudo "))
        self.note("let in", FIREWALL_LINE)

    def mend_address(self) -> None:
        """No address in the camera's subnet, then one."""
        for each in ("near", "far"):
            run(f"ip address flush dev {each}")
        run("ip address add 10.9.9.9/24 dev far")
        run("ip route add default via 10.9.9.1")
        away = checks()["route"]
        self.found["by a gateway"] = away.outcome.value
        run(command_in(away, r"ip address add \S+ dev") + " far")
        self.found["in the subnet"] = checks()["route"].outcome.value


def command_in(check: Check, pattern: str) -> str:
    """Command in a check's remedy that the pattern matches after `sudo`."""
    found = re.search(f"sudo ({pattern}) ", check.remedy)
    assert found is not None
    return found[1]


def main() -> dict[str, object]:
    """Carry out all steps; outcomes by step."""
    run("mount -t sysfs sysfs /sys")
    command = ["unshare", "--net", sys.executable, __file__, "camera"]
    with (
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as camera,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
    ):
        assert camera.stdout is not None
        assert camera.stdout.readline() == "ready\n"
        receiver.bind(("", PORT))
        receiver.settimeout(0.3)
        trial = Trial(camera, receiver)
        try:
            trial.set_up()
            trial.mend_paths()
            trial.mend_firewall()
            trial.mend_address()
        finally:
            camera.kill()
    return trial.found


def be_camera() -> None:
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    for _ in sys.stdin:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for each in (OWN, FAR):
                for _ in range(3):
                    sender.sendto(b"image", (each, PORT))
        sys.stdout.write("sent\n")
        sys.stdout.flush()


if __name__ == "__main__":
    if sys.argv[1:] == ["camera"]:
        be_camera()
    else:
        sys.stdout.write(json.dumps(main()))
