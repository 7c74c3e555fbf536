"""A private Slurm cluster on loopback for tests: controller, node daemons, munge, all in one folder.

Each node is a process namespace with a host name of its own, so that a node can be lost as a whole: the
kernel kills all of a namespace's processes with its first one.
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "scontrol", "squeue", "unshare")
SEARCHED = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"
APT = "apt-get install --no-install-recommends munge slurmctld slurmd slurm-client"
NODE_TIMEOUT_S = 10
"""time after which the controller gives up a node that does not answer [s]"""
START_S, STOP_S = 30.0, 10.0

CONFIGURATION = """\
ClusterName=percuss
SlurmctldHost=localhost(127.0.0.1)
SlurmctldPort={port}
SlurmUser=root
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
AuthInfo=socket={folder}/munge.socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
ProctrackType=proctrack/linuxproc
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SlurmdParameters=config_overrides
SlurmdTimeout={timeout}
MessageTimeout=5
KillWait=5
ReturnToService=2
"""


def missing() -> str:
    """Why Slurm cannot be started here, with the command that installs it; "" if it can."""
    absent = [name for name in PROGRAMS if shutil.which(name, path=SEARCHED) is None]
    if absent:
        return f"no {', '.join(absent)}: {APT}"
    return "" if os.geteuid() == 0 else "nodes are namespaces, which only root may make"


@dataclass
class Slurm:
    """Running cluster: its folder, the environment of its commands, and its nodes."""

    folder: Path
    environment: dict[str, str]
    """environment with which `sbatch` and the other commands find this cluster"""
    nodes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)
    """by name, the process outside of the node's namespace"""

    def command(self, *words: str) -> str:
        """Run one of Slurm's commands, and return what it prints, without the line's end.

        Raises:
            RuntimeError: the command failed.
        """
        done = subprocess.run(
            words, env=self.environment, cwd=self.folder, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise RuntimeError(f"{' '.join(words)}: {done.stderr.strip()}")
        return done.stdout.strip()

    def lose(self, node: str) -> None:
        """Kill all processes of a node at once, its daemon and its jobs, as a power cut does."""
        _stop(self.nodes.pop(node), kill=True)

    def wait_for(self, state: str, nodes: int) -> None:
        """Wait until so many nodes are in a state, such as "idle" or "down".

        Raises:
            TimeoutError: they are not within START_S.
        """
        ends = time.monotonic() + START_S
        while (found := self.command("sinfo", "-h", "-N", "-o", "%T").replace("*", "").split()).count(
            state
        ) < nodes:
            if time.monotonic() > ends:
                raise TimeoutError(f"{nodes} nodes {state}: {found}\n{self.logs()}")
            time.sleep(0.2)

    def queue(self) -> list[str]:
        """Jobs that wait or run, a line each: id, state and node."""
        return self.command("squeue", "-h", "-r", "-o", "%i %T %N").splitlines()

    def logs(self) -> str:
        """Ends of the daemons' logs."""
        parts = [
            f"{path.name}:\n{path.read_text(errors='replace')[-2000:]}" for path in self.folder.glob("*.log")
        ]
        return "\n".join(parts)


@contextmanager
def slurm(
    folder: Path, nodes: Sequence[str] = ("node1", "node2"), *, cpus: int = 1, memory_mb: int = 6000
) -> Iterator[Slurm]:
    """Run a Slurm cluster for the duration of a `with` block.

    Args:
        folder: new folder for keys, sockets, state and logs, which only its owner may enter.
        nodes: names of the nodes.
        cpus: processor cores of each node as stated to Slurm, whatever the machine has.
        memory_mb: memory of each node as stated to Slurm [MiB], whatever the machine has.

    Yields:
        The cluster, all of whose nodes are idle.
    """
    folder.mkdir(mode=0o700)
    (folder / "state").mkdir()
    key = folder / "munge.key"
    key.touch(mode=0o600)
    key.write_bytes(os.urandom(1024))
    ports = _free_ports(len(nodes) + 1)
    lines = [
        f"NodeName={name} NodeHostname={name} NodeAddr=127.0.0.1 Port={port} CPUs={cpus} "
        f"RealMemory={memory_mb}\n"
        for name, port in zip(nodes, ports[1:], strict=True)
    ]
    configuration = CONFIGURATION.format(folder=folder, port=ports[0], timeout=NODE_TIMEOUT_S)
    partition = f"PartitionName=main Nodes={','.join(nodes)} Default=YES MaxTime=INFINITE State=UP\n"
    (folder / "slurm.conf").write_text(configuration + "".join(lines) + partition)
    (folder / "hosts").write_text(f"127.0.0.1 localhost {' '.join(nodes)}\n")
    environment = os.environ | {"SLURM_CONF": str(folder / "slurm.conf"), "PATH": SEARCHED}
    cluster = Slurm(folder, environment)
    with ExitStack() as stack:
        stack.enter_context(_running(_munged(folder), cluster))
        _wait_for(folder / "munge.socket", cluster)
        stack.enter_context(_running(["slurmctld", "-D", "-c"], cluster))
        stack.callback(lambda: [_stop(process, kill=True) for process in cluster.nodes.values()])
        for name in nodes:
            cluster.nodes[name] = _start(_node(name, folder), cluster)
        cluster.wait_for("idle", len(nodes))
        yield cluster


def _munged(folder: Path) -> list[str]:
    # --force: munged wants a socket that every user may reach, and here only its owner shall.
    files = {"key-file": "munge.key", "socket": "munge.socket", "pid-file": "munged.pid"}
    files |= {"log-file": "munged.log", "seed-file": "munged.seed"}
    return [
        "munged",
        "--foreground",
        "--force",
        *(f"--{name}={folder / file}" for name, file in files.items()),
    ]


def _node(name: str, folder: Path) -> list[str]:
    apart = ["unshare", "--pid", "--fork", "--kill-child", "--mount-proc", "--uts"]
    # A daemon that listens on loopback alone does so by its node's name.
    steps = 'hostname "$0" && mount --bind "$1/hosts" /etc/hosts && exec slurmd -D -N "$0"'
    return [*apart, "sh", "-c", steps, name, str(folder)]


def _start(command: Sequence[str], cluster: Slurm) -> subprocess.Popen[bytes]:
    with (cluster.folder / "daemons.log").open("ab") as log:
        return subprocess.Popen(
            command,
            env=cluster.environment,
            cwd=cluster.folder,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
        )


@contextmanager
def _running(command: Sequence[str], cluster: Slurm) -> Iterator[None]:
    process = _start(command, cluster)
    try:
        yield
    finally:
        _stop(process)


def _stop(process: subprocess.Popen[bytes], *, kill: bool = False) -> None:
    if kill:
        process.kill()
    else:
        process.terminate()
    try:
        process.wait(STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _wait_for(path: Path, cluster: Slurm) -> None:
    ends = time.monotonic() + START_S
    while not path.exists():
        if time.monotonic() > ends:
            raise TimeoutError(f"no {path}\n{cluster.logs()}")
        time.sleep(0.05)


def _free_ports(number: int) -> list[int]:
    with ExitStack() as stack:
        probes = [stack.enter_context(socket.socket()) for _ in range(number)]
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        return [int(probe.getsockname()[1]) for probe in probes]
