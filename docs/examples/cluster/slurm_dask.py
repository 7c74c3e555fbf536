"""Analyse an archive on a Slurm cluster by Dask: python slurm_dask.py ARCHIVE RESULTS JOBS.

Submits JOBS jobs of one core, replaces those that are lost, and removes them at the end.
"""

import os
import subprocess
import sys
from pathlib import Path

from dask_jobqueue import SLURMCluster
from distributed.security import Security

archive, results, jobs = sys.argv[1:]
# Keys of this run alone: without them everyone who reaches the scheduler's port could run programs as you.
keys = Security.temporary()
with SLURMCluster(
    cores=1,
    processes=1,
    memory="5GB",
    walltime="02:00:00",
    security=keys,
    shared_temp_directory=str(Path.cwd()),  # for the workers' keys; all nodes must see this folder
    log_directory="slurm-logs",
    scheduler_options={"dashboard_address": None, "worker_ttl": "60s"},
) as cluster:
    cluster.adapt(minimum_jobs=int(jobs), maximum_jobs=int(jobs))
    own = {
        "DASK_DISTRIBUTED__COMM__TLS__CA_FILE": keys.tls_ca_file,
        "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT": keys.tls_client_cert,
        "DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY": keys.tls_client_key,
    }
    command = ["analyze", "batch", archive, "--out", results, "--scheduler", cluster.scheduler_address]
    done = subprocess.run(command, env=os.environ | own, check=False)
sys.exit(done.returncode)
