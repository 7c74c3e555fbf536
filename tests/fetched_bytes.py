"""Count the bytes that a copy of a remote recording without its images costs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fsspec.core import url_to_fs

from analyze.batch.sparse_copy import RemoteFile, fetch_without_images


def fetched_without_images(url: str, folder: Path) -> tuple[Path, int]:
    """Copy one remote file of a recording without its images.

    Args:
        url: URL of the file.
        folder: folder for the copy, which the caller removes.

    Returns:
        Path of the copy, and number of bytes fetched for it.

    Raises:
        OSError: the file cannot be fetched.
        RecordingError: the file is damaged, cut short, or in another format.
    """
    system, path = url_to_fs(url, skip_instance_cache=True)
    read, sizes = system.cat_file, list[int]()

    def count(*arguments: Any, **options: Any) -> Any:
        data = read(*arguments, **options)
        sizes.append(len(data))
        return data

    system.cat_file = count
    remote = RemoteFile(system, path, int(system.info(path)["size"]), folder / url.rsplit("/", 1)[-1])
    fetch_without_images(remote, url)
    return remote.copy, sum(sizes)
