"""Real footage through `analyze compact`: `python -m tests.benchmarks.compact --footage PATH`.

Videos, folders of images and recordings. What is no recording becomes one of raw grey images, as the recorder
writes it. Without loss the whole command runs, with its proof. A loss is judged by strikes, which footage has
none of: of it only the coded size is measured, and that every pixel stays within the noise.
"""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from acquire.recorder.image import RawImageEncoder
from analyze.compact.codings import lossy_codings
from analyze.compact.compact import INFORMATION_SHARES, CompactOptions, compact
from analyze.compact.images import COMPRESSED, RAW, is_recoded, recode
from analyze.progress import no_progress
from analyze.reading.indexed_file import open_finished
from schemas import topics
from schemas.document import canonical_json
from schemas.session_manifest import MANIFEST_NAME, manifest_entries
from tests.analyze.simulated_session import manifest, object_spec
from tests.mcap_writer import McapWriter
from tests.quick_archive import ANCHOR_NS, PERIOD_NS, body_of

IMAGE_SUFFIXES = {".bmp", ".pgm", ".png", ".tif", ".tiff"}
MOST_IMAGES = 300


@dataclass(frozen=True)
class FootageRow:
    """Sizes of one piece of footage; shares are of the raw images' size."""

    name: str
    shape: tuple[int, ...]
    images: int
    noise_sd: float
    """1 sigma of a pixel, by differences of images that follow on [grey]; NaN if nothing is recoded"""
    exact: float
    ms: float
    """processor time of copy and proof without loss, an image [ms]"""
    lossy: tuple[float, ...] = ()
    """near-lossless and cropped, by `INFORMATION_SHARES`"""


def grey_images(path: Path) -> Iterator[np.ndarray]:
    """Yield the images (h, w) of a video, or of a folder's image files in the order of their names."""
    if path.is_dir():
        for file in sorted(each for each in path.iterdir() if each.suffix.lower() in IMAGE_SUFFIXES):
            image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
            if image is not None:
                yield image
        return
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            yield frame.to_ndarray(format="gray")


def raw_recording(path: Path, images: Iterator[np.ndarray]) -> None:
    """Write images as a recording of raw images, those of the first one's size."""
    with McapWriter(path) as writer:
        known = manifest(object_spec(body_of(1)))
        writer.metadata(MANIFEST_NAME, manifest_entries(canonical_json(known)))
        topic, shape = writer.add_topic(topics.raw_image("main")), None
        for number, image in enumerate(images):
            shape = shape or image.shape
            if number == MOST_IMAGES or image.shape != shape:
                break
            at = ANCHOR_NS + PERIOD_NS * number
            encoder = RawImageEncoder("main", shape[1], shape[0])
            writer.write(topic, at, encoder.encode(at, np.ascontiguousarray(image)), sequence=number)
        writer.finish()


def row_of(source: Path) -> FootageRow:
    """Sizes of one piece of footage."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "footage.mcap"
        if source.suffix == ".mcap":
            shutil.copy(source, path)
        else:
            raw_recording(path, grey_images(source))
        size = path.stat().st_size
        with closing(open_finished(path)) as file:
            names = [each for each in file.topic_names() if file.schema_of(each) in {RAW, COMPRESSED}]
            images = sum(len(file.index(each).time_ns) for each in names)
            found = [lossy_size(file, names, share) for share in INFORMATION_SHARES] if images else []
        begun = time.process_time()
        [done] = compact(path, CompactOptions(), no_progress)
        ms = 1e3 * (time.process_time() - begun) / max(images, 1)
        shape = found[0][2] if found else ()
        lossy = tuple(coded / (images * math.prod(each)) for coded, _, each in found)
        noise = found[0][1] if found else math.nan
        return FootageRow(source.name, shape, images, noise, done.bytes_compact / size, ms, lossy)


def lossy_size(file, names: list[str], share: float) -> tuple[int, float, tuple[int, ...]]:
    """Size of near-lossless and cropped images [bytes], their noise [grey], and the shape of one."""
    codings, total, shape = lossy_codings(file, share, crop=True), 0, (0, 0)
    for name in names:
        schema, index = file.schema_of(name), file.index(name)
        for number in range(len(index.time_ns)):
            data, coding = (
                file.message(index, number).data,
                codings.coding_at(name, int(index.time_ns[number])),
            )
            recoded = recode(schema, data, coding)
            total += len(data if recoded is None else recoded)
            if recoded is not None and not is_recoded(schema, data, memoryview(recoded), coding):
                raise AssertionError(f"image {number} of {name} left the noise")
        shape = image_shape(schema, file.message(index, 0).data)
    return total, codings.noise_sd or math.nan, shape


def image_shape(schema: str, data: memoryview) -> tuple[int, ...]:
    """Height and width of a message's image [px]."""
    from analyze.reading.image_message import decode_image

    return decode_image(schema, data).shape


def print_footage(paths: tuple[Path, ...]) -> None:
    """Print the table of the footage."""
    table = Table(title="footage", title_justify="left")
    for heading in ("footage", "px", "images", "noise, grey", "without loss, %", "ms/image"):
        table.add_column(heading)
    for share in INFORMATION_SHARES:
        table.add_column(f"near-lossless + crop, {100 * share:.0f} % exact information, %")
    for path in paths:
        row = row_of(path)
        table.add_row(
            row.name, "x".join(map(str, reversed(row.shape))), str(row.images), f"{row.noise_sd:.2f}",
            f"{100 * row.exact:.1f}", f"{row.ms:.1f}", *(f"{100 * each:.1f}" for each in row.lossy),
        )  # fmt: skip
    Console(width=180, highlight=False).print(table)
