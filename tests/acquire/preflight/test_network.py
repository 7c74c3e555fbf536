"""Checks of the way to the camera, of the firewall, the processor's clock and the motion blur."""

from __future__ import annotations

import ipaddress
import json
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from acquire.preflight.check import Outcome
from acquire.preflight.firewall import FirewallState, check_firewall, read_firewall
from acquire.preflight.network import Network, needed_mbit
from acquire.preflight.packet_filter import PacketFilter, Passage
from acquire.preflight.processor import Processor, check_governor
from schemas.rig import CameraConfig
from tests.acquire.preflight.bench import SUBNET, Bench, FakeNetwork, FakeProcessor, route_by
from tests.rig_text import CALIBRATION

CAMERA = "192.168.10.2"
TWO = [("enp3s0", SUBNET), ("eno1", SUBNET)]
ROUTES = """Iface Destination Gateway Flags RefCnt Use Metric Mask MTU Window IRTT
eno1 00000000 010AA8C0 0003 0 0 100 00000000 0 0 0
eno1 000AA8C0 00000000 0001 0 0 100 00FFFFFF 0 0 0
enp3s0 000AA8C0 00000000 0001 0 0 101 00FFFFFF 0 0 0
enp3s0 050AA8C0 00000000 0005 0 0 0 FFFFFFFF 0 0 0
eno1 0000FEA9 00000000 0001 0 0 0 0000FFFF 0 0 0
eno1 00000B0A 010AA8C0 0003 0 0 0 0000FFFF 0 0 0
"""
"""/proc/net/route of a computer of which two interfaces are in 192.168.10.0/24"""


@pytest.mark.skipif(
    not all(shutil.which(name) for name in ("unshare", "ip", "nsenter", "sysctl", "nft")),
    reason="iproute2, util-linux, procps and nftables are not installed",
)
def test_the_remedies_mend_what_the_checks_find_in_a_network_of_the_kernel() -> None:
    """Each is carried out as the check prints it, and packets of the camera come in after it, not before.

    Tried are: an address in the camera's subnet, an MTU (its check alone, without large packets), a route of
    the camera's own, a loose reverse path filter, a rule of nftables. Not tried: cables, ufw, firewalld, a
    processor's governor.
    """
    script = Path(__file__).with_name("network_trial.py")
    command = ["unshare", "--user", "--map-root-user", "--net", "--mount", sys.executable, str(script)]
    if subprocess.run([*command[:5], "true"], capture_output=True, check=False).returncode:
        pytest.skip("this system lets nobody make namespaces")
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert json.loads(done.stdout) == {
        "no route": "fail",
        "link": "images need 326 Mbit/s, near runs at 10000 Mbit/s",
        "packet size": ["fail", "pass"],
        "strict": ["fail", "fail", False],
        "loose": ["fail", "pass", True],
        "route of its own": ["pass", "pass", True],
        "firewall": ["fail", False],
        "chain": "inet guard input drops UDP from 192.168.77.2 at far",
        "let in": ["pass", True],
        "by a gateway": "fail",
        "in the subnet": "pass",
    }


@pytest.mark.parametrize(
    ("network", "failed", "word"),
    [
        (
            FakeNetwork(way=OSError(101, "Network is unreachable")),
            "route",
            "sudo ip address add 192.168.10.3/24",
        ),
        (FakeNetwork(near=[]), "route", "sudo ip address add"),
        (FakeNetwork(way=route_by(own_address="10.0.0.7")), "route", "sudo ip address add"),
        (FakeNetwork(near=TWO), "route", "sudo ip route add 192.168.10.2/32 dev IFACE"),
        (FakeNetwork(way=route_by(mtu_bytes=1500)), "packet size", "ip link set enp3s0 mtu 9000"),
        (FakeNetwork(speed=100), "link speed", "replace the cable"),
    ],
)
def test_each_fault_of_the_network_fails_one_check(
    bench: Bench, network: FakeNetwork, failed: str, word: str
) -> None:
    bench.network = network
    assert bench.failures() == {failed}
    assert word in bench.lines()[failed].remedy


def test_a_link_must_carry_the_images(bench: Bench) -> None:
    text = bench.rig_path.read_text(encoding="utf-8")
    bench.rig_path.write_text(text.replace("[camera]", "[camera]\nframe_rate_hz = 500.0"), encoding="utf-8")
    line = bench.lines()["link speed"]
    assert (line.outcome, line.remedy) == (Outcome.FAIL, "lower frame_rate_hz or the image size")
    assert line.found == "images need 1304 Mbit/s, enp3s0 runs at 1000 Mbit/s"


def test_small_packets_need_more_of_the_link() -> None:
    """At 120 Hz and 656 x 492 px: 309.8 Mbit/s of pixels, and 74 bytes for each packet's."""

    def config(packet_size: int) -> CameraConfig:
        return CameraConfig.model_validate({**_camera(), "packet_size": packet_size})

    assert needed_mbit(config(8192)) == pytest.approx(309.83 + 40 * 74 * 960e-6 + 0.21, abs=0.05)
    assert needed_mbit(config(1500)) == pytest.approx(309.83 + 221 * 74 * 960e-6 + 0.21, abs=0.05)


def _camera() -> dict[str, Any]:
    return tomllib.loads(f'[camera]\naddress = "{CAMERA}"\n{CALIBRATION}')["camera"]


def test_strict_filters_matter_only_at_a_second_interface_in_the_subnet(bench: Bench) -> None:
    bench.network = FakeNetwork(filters={"enp3s0": 1})
    assert bench.failures() == set()
    bench.network = FakeNetwork(near=TWO, filters={"eno1": 1})
    assert bench.failures() == {"route", "rp_filter"}
    assert "sysctl -w net.ipv4.conf.eno1.rp_filter=2" in bench.lines()["rp_filter"].remedy
    bench.network = FakeNetwork(near=TWO, filters={"eno1": 2})
    assert bench.failures() == {"route"}
    assert bench.lines()["rp_filter"].outcome is Outcome.PASS


def test_what_the_kernel_hides_is_not_checked_and_fails_nothing(bench: Bench, tmp_path: Path) -> None:
    hidden = Network(tmp_path, tmp_path)
    assert hidden.subnets(CAMERA) is None
    assert hidden.link_mbit("enp3s0") is None
    assert hidden.reverse_path_filter("enp3s0") is None
    bench.network = FakeNetwork(near=None, speed=None)
    bench.firewall = FirewallState(ufw=False, firewalld=False, legacy=False, rules=None)
    bench.processor = FakeProcessor(None)
    lines = bench.lines()
    assert bench.failures() == set()
    for name in ("route", "link speed", "firewall", "CPU governor"):
        assert lines[name].outcome is Outcome.NOT_CHECKED
    bench.network = FakeNetwork(way=None)
    assert bench.failures() == set()
    assert "ip route get" in bench.lines()["route"].remedy


def test_an_interface_outside_the_subnet_is_not_judged_further(bench: Bench) -> None:
    bench.network = FakeNetwork(way=route_by(mtu_bytes=1500), near=[], speed=100)
    assert bench.failures() == {"route"}
    assert bench.lines()["packet size"].outcome is Outcome.NOT_CHECKED


def test_the_kernels_routes_and_filters_are_read(tmp_path: Path) -> None:
    (tmp_path / "net").mkdir()
    (tmp_path / "net/route").write_text(ROUTES, encoding="ascii")
    network = Network(tmp_path, tmp_path)
    assert network.subnets(CAMERA) == [("eno1", SUBNET), ("enp3s0", SUBNET)]
    assert network.subnets("192.168.10.5") == [("enp3s0", ipaddress.IPv4Network("192.168.10.5/32"))]
    assert network.subnets("169.254.3.4") == [("eno1", ipaddress.IPv4Network("169.254.0.0/16"))]
    assert network.subnets("10.11.0.1") == [], "through a gateway"
    assert network.subnets("8.8.8.8") == [], "by the default route alone"
    for name, value in (("all", 1), ("eno1", 0), ("enp3s0", 2)):
        file = tmp_path / "sys/net/ipv4/conf" / name / "rp_filter"
        file.parent.mkdir(parents=True)
        file.write_text(f"{value}\n", encoding="ascii")
    assert (network.reverse_path_filter("eno1"), network.reverse_path_filter("enp3s0")) == (1, 2)
    for name, text in (("eno1", "100\n"), ("lost", "-1\n")):
        (tmp_path / "class/net" / name).mkdir(parents=True)
        (tmp_path / "class/net" / name / "speed").write_text(text, encoding="ascii")
    assert (network.link_mbit("eno1"), network.link_mbit("lost")) == (100, None)


def test_firewalls_that_only_root_reads_are_named_with_their_own_command(tmp_path: Path) -> None:
    (tmp_path / "etc/ufw").mkdir(parents=True)
    (tmp_path / "etc/ufw/ufw.conf").write_text("# ufw\nENABLED=yes\nLOGLEVEL=low\n", encoding="ascii")
    state = read_firewall(tmp_path, ("false",))
    assert (state.ufw, state.firewalld, state.rules) == (True, False, None)
    line = check_firewall(lambda: state, "enp3s0", CAMERA)
    assert (line.outcome, line.found) == (Outcome.NOT_CHECKED, "ufw is on, and only root reads its rules")
    assert line.remedy == "sudo ufw allow in on enp3s0 from 192.168.10.2 proto udp"
    (tmp_path / "etc/ufw/ufw.conf").write_text("ENABLED=no\n", encoding="ascii")
    (tmp_path / "run").mkdir()
    (tmp_path / "run/firewalld.pid").write_text("7\n", encoding="ascii")
    line = check_firewall(lambda: read_firewall(tmp_path, ("nft-is-not-here",)), "enp3s0", CAMERA)
    assert line.found.startswith("firewalld is on")
    assert "--change-interface=enp3s0" in line.remedy


def chain(policy: str, *expressions: list[dict[str, Any]]) -> list[dict[str, Any]]:
    place = {"family": "inet", "table": "t"}
    base = {"type": "filter", "hook": "input", "prio": 0, "policy": policy}
    return [
        {"chain": {**place, "name": "input", **base}},
        *({"rule": {**place, "chain": "input", "expr": each}} for each in expressions),
    ]


def match(left: dict[str, Any], right: Any, op: str = "==") -> dict[str, Any]:
    return {"match": {"op": op, "left": left, "right": right}}


SADDR = {"payload": {"protocol": "ip", "field": "saddr"}}
IIFNAME, STATE = {"meta": {"key": "iifname"}}, {"ct": {"key": "state"}}
DPORT = {"payload": {"protocol": "udp", "field": "dport"}}
ACCEPT, DROP = {"accept": None}, {"drop": None}
HALF = {"prefix": {"addr": "192.168.0.0", "len": 16}}


@pytest.mark.parametrize(
    ("rules", "passage"),
    [
        ([], Passage.ACCEPTED),
        (chain("accept", [match(SADDR, "10.0.0.1"), DROP]), Passage.ACCEPTED),
        (chain("drop"), Passage.DROPPED),
        (chain("drop", [match(STATE, ["established", "related"], "in"), ACCEPT]), Passage.DROPPED),
        (chain("drop", [match(IIFNAME, "enp3s0"), {"counter": {}}, ACCEPT]), Passage.ACCEPTED),
        (chain("drop", [match(SADDR, HALF), ACCEPT]), Passage.ACCEPTED),
        (chain("drop", [match(SADDR, {"set": ["10.0.0.1", HALF]}), ACCEPT]), Passage.ACCEPTED),
        (chain("drop", [match(SADDR, "@cameras"), ACCEPT]), Passage.UNKNOWN),
        (chain("drop", [match(DPORT, {"set": [53, 123]}), ACCEPT]), Passage.DROPPED),
        (chain("drop", [match(DPORT, 40000), ACCEPT]), Passage.UNKNOWN),
        (chain("accept", [match(SADDR, CAMERA, "!="), DROP]), Passage.ACCEPTED),
        (chain("accept", [match(SADDR, HALF), {"reject": {}}]), Passage.DROPPED),
        (chain("accept", [{"limit": {"rate": 1}}, DROP]), Passage.UNKNOWN),
        (chain("accept", [{"xt": {"type": "match", "name": "addrtype"}}, DROP]), Passage.UNKNOWN),
        (
            chain("accept", [{"jump": {"target": "none"}}], [{"goto": {"target": "none"}}], [DROP]),
            Passage.ACCEPTED,
        ),
        (chain("drop", [{"return": None}], [ACCEPT]), Passage.DROPPED),
    ],
)
def test_the_way_of_a_packet_through_rules(rules: list[dict[str, Any]], passage: Passage) -> None:
    assert PacketFilter(rules).passage("enp3s0", CAMERA)[0] is passage


@pytest.mark.parametrize(
    ("habit", "outcome"),
    [
        (("acpi-cpufreq", "performance", ""), Outcome.PASS),
        (("acpi-cpufreq", "schedutil", ""), Outcome.PASS),
        (("acpi-cpufreq", "powersave", ""), Outcome.FAIL),
        (("cpufreq-dt", "ondemand", ""), Outcome.FAIL),
        (("intel_pstate", "powersave", "balance_performance"), Outcome.PASS),
        (("intel_pstate", "powersave", "power"), Outcome.FAIL),
    ],
)
def test_the_clock_governor(tmp_path: Path, habit: tuple[str, str, str], outcome: Outcome) -> None:
    """The remedy writes the file that holds the habit; it could not be tried, as no kernel here has one."""
    for number in range(2):
        folder = tmp_path / f"devices/system/cpu/cpufreq/policy{number}"
        folder.mkdir(parents=True)
        names = ("scaling_driver", "scaling_governor", "energy_performance_preference")
        for name, value in zip(names, habit, strict=True):
            if value:
                (folder / name).write_text(f"{value}\n", encoding="ascii")
    line = check_governor(Processor(tmp_path))
    assert line.outcome is outcome
    if outcome is Outcome.FAIL:
        assert "on 2 of 2 clocks" in line.found
        assert ("energy_performance_preference" if habit[2] else "scaling_governor") in line.remedy


def test_motion_blur_follows_exposure_speed_and_scale(bench: Bench) -> None:
    """0.96 m/s at the tip and e = 0.4 are 1.344 m/s; 1430 px at 0.55 m are 2.6 px/mm; 1.5 ms: 5.24 px."""
    line = bench.lines()["motion blur"]
    assert line.outcome is Outcome.PASS
    assert line.measured is not None
    assert line.measured.value == pytest.approx(1.5e-3 * 1.344 * 2600, rel=1e-6)
    text = bench.rig_path.read_text(encoding="utf-8")
    bench.rig_path.write_text(text.replace("[camera]", "[camera]\nexposure_us = 4000"), encoding="utf-8")
    assert bench.failures() == {"motion blur"}
    assert "exposure_us = 1717 or less" in bench.lines()["motion blur"].remedy
    bench.rig_path.write_text(text.replace("[0, 0, 1, -0.55]", "[0, 0, 1, 0.55]"), encoding="utf-8")
    assert bench.lines()["motion blur"].outcome is Outcome.NOT_CHECKED
