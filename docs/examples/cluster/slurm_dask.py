"""Analyse an archive on a Slurm cluster by Dask: python slurm_dask.py ARCHIVE RESULTS JOBS.

Submits JOBS jobs of one core, replaces those that are lost, and removes them at the end.
"""

import os
import subprocess
import sys
from pathlib import Path

import dask
from dask_jobqueue import SLURMCluster
from distributed.security import Security

# Dask looks after itself up to a hundred times a second, which takes 4 % of each worker's core.
SELDOM = {
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.memory.monitor-interval": "2s",
    "distributed.worker.profile.enabled": "False",
}


def slurm_cluster(keys: Security) -> SLURMCluster:
    """Dask's scheduler in this process, whose workers are to be Slurm's jobs."""
    dask.config.set(SELDOM)
    names = {name: f"DASK_{name.upper().replace('.', '__').replace('-', '_')}" for name in SELDOM}
    return SLURMCluster(
        cores=1,
        processes=1,
        memory="5GB",
        walltime="02:00:00",
        job_script_prologue=[f"export {names[name]}={value}" for name, value in SELDOM.items()],
        log_directory="slurm-logs",
        scheduler_options={"dashboard_address": None, "worker_ttl": "60s"},
        security=keys,
        shared_temp_directory=str(Path.cwd()),  # for the workers' keys; all nodes must see this folder
    )


def client_environment(keys: Security) -> dict[str, str]:
    """Environment in which `analyze batch` has the client's certificate."""
    return os.environ | {
        "DASK_DISTRIBUTED__COMM__TLS__CA_FILE": keys.tls_ca_file,
        "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT": keys.tls_client_cert,
        "DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY": keys.tls_client_key,
    }


def main(archive: str, results: str, jobs: str) -> int:
    """Run `analyze batch` on so many jobs; its exit code."""
    # Of this run alone: without keys everyone who reaches the scheduler's port could run programs as you.
    keys = Security.temporary()
    with slurm_cluster(keys) as cluster:
        cluster.adapt(minimum_jobs=int(jobs), maximum_jobs=int(jobs))
        command = ["analyze", "batch", archive, "--out", results, "--scheduler", cluster.scheduler_address]
        return subprocess.run(command, env=client_environment(keys), check=False).returncode


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
