"""`acquire recover` on recordings that are cut, or have one wrong byte, at any place.

Rows of docs/reference/faults.md (`make bench-faults`).
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

from acquire.cli import main as acquire
from schemas.mcap import records as container
from schemas.mcap.walk import walk
from tests import small_recording as small
from tests.system.fault_rig import add_row

CASES = 150
EARLY, EARLY_BYTES = 10, 400
"""number of damaged files that are cut or wrong in the first bytes, where nothing can be saved yet; number of
these bytes"""
LOST, REFUSED = 3, 1
"""exit codes of `acquire recover`: data lost; nothing to save"""
CHUNK_END = 256
"""number of bytes behind an image's last pixel up to which its record may reach"""
OTHER_IMAGES = 1
"""largest number of images lost to a wrong byte beside the one that it lies in: a wrong length swallows the
next"""


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "a.mcap"
    small.write_recording(path)
    return path.read_bytes()


def recovered(data: bytes, folder: Path) -> tuple[int, list[int], dict]:
    """Recover `data`: exit code, numbers of the saved images, and the report.

    Each saved image is compared with the original.
    """
    source, output = folder / "bad.mcap", folder / "good.mcap"
    source.write_bytes(data)
    output.unlink(missing_ok=True)
    result = CliRunner().invoke(acquire, ["recover", str(source), "-o", str(output), "--json"])
    if result.exit_code == REFUSED:
        assert result.stderr.count("\n") == 1, result.stderr
        assert [path.name for path in folder.iterdir()] == ["bad.mcap"]
        return REFUSED, [], {}
    assert result.exit_code in {0, LOST}, result.output
    report = json.loads(result.stdout)
    assert report["anything_lost"] == (result.exit_code == LOST)
    numbers = []
    with output.open("rb") as file:
        for _, _, message in make_reader(file, validate_crcs=True).iter_messages(
            topics=["/camera/main/image"]
        ):
            assert small.image(message.sequence).tobytes() in message.data
            numbers.append(message.sequence)
    assert source.read_bytes() == data
    return result.exit_code, numbers, report


def ends(data: bytes) -> np.ndarray:
    """Offsets at which the pixels of each image end in a file."""
    pixels = [small.image(number).tobytes() for number in range(small.FRAMES)]
    return np.array([data.find(each) + len(each) for each in pixels])


def test_a_file_cut_anywhere(whole: bytes, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    places = np.concatenate([rng.integers(1, len(whole), CASES - EARLY), rng.integers(1, EARLY_BYTES, EARLY)])
    image_ends, refused, harmless = ends(whole), 0, 0
    (data_end,) = (
        at for opcode, at, _ in walk(memoryview(whole), len(container.MAGIC)) if opcode == container.DATA_END
    )
    data_end += container.RECORD_HEAD + 4
    for place in places.tolist():
        code, numbers, report = recovered(whole[:place], tmp_path)
        refused += code == REFUSED
        harmless += place >= data_end
        if place >= data_end:
            assert code == 0
            assert report["topics"]["/session/strike"] == 1
        elif code != REFUSED:
            assert code == LOST
        surely, perhaps = int(np.sum(image_ends + CHUNK_END <= place)), int(np.sum(image_ends <= place))
        assert surely <= len(numbers) <= perhaps
        assert numbers == list(range(len(numbers)))
        if code == REFUSED:
            assert place < image_ends[0] + CHUNK_END
    add_row(
        f"a recording cut at any of {CASES} places, into `acquire recover`",
        "the record at the cut and everything later; the report gives the time at which the file ends; every "
        f"image before it is recovered byte for byte; {harmless} cuts were after the data (index, summary): "
        f"nothing lost; {refused} left nothing to save: refused in one line",
        "at once; exit code 3, 0 where nothing is lost",
    )


def test_a_wrong_byte_anywhere(whole: bytes, tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    places = rng.integers(8, len(whole), CASES)
    image_ends, most, unnoticed = ends(whole), 0, 0
    for place in places.tolist():
        data = bytearray(whole)
        data[place] ^= int(rng.integers(1, 256))
        code, numbers, report = recovered(bytes(data), tmp_path)
        lost = small.FRAMES - len(numbers)
        most = max(most, lost)
        assert lost <= 1 + OTHER_IMAGES, place
        inside = np.any((image_ends - small.WIDTH * small.HEIGHT <= place) & (place < image_ends))
        if lost or inside:
            assert code == LOST
        if code == 0:
            # What is written anew at the end (indexes, summary), or the seal's own text.
            unnoticed += 1
            assert report["topics"]["/striker/sample"] == small.SAMPLES
    add_row(
        f"one byte wrong at any of {CASES} places, into `acquire recover`",
        f"the record that holds it, at most {most} image; {unnoticed} were in parts that are rebuilt (index, "
        "summary): nothing lost",
        "at once; exit code 3 where something is lost",
    )
