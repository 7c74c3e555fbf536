"""An archive behind an S3 server on loopback."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def bucket_of(folder: Path) -> Iterator[str]:
    """Put a folder into a new bucket for the duration of a `with` block; yields its URL, s3://archive."""
    import s3fs
    from moto.server import ThreadedMotoServer

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    host, port = server.get_host_and_port()
    settings = {
        "AWS_ACCESS_KEY_ID": "loopback",
        "AWS_SECRET_ACCESS_KEY": "loopback",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
    }
    before = {name: os.environ.get(name) for name in settings}
    os.environ.update(settings)
    try:
        # Connections of an earlier server are kept under the same arguments.
        s3fs.S3FileSystem.clear_instance_cache()
        system = s3fs.S3FileSystem(skip_instance_cache=True)
        system.mkdir("archive")
        system.put(f"{folder}/", "archive/", recursive=True)
        yield "s3://archive"
        system.rm("archive", recursive=True)  # moto keeps its buckets for the whole process
    finally:
        server.stop()
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
