"""Images that are PNG or JPEG files are stored unchanged, and read back with the same pixels."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from analyze.errors import ImportRefused
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.write_recording import write_recording
from analyze.reading.image_message import decode_image_file
from analyze.reading.recording import open_recording
from analyze.reading.verify import refuse_changed_content
from analyze.sources.image_file import image_file
from analyze.sources.image_folder import ImageFolder
from tests.analyze.importing.foreign_files import write_bag, write_foxglove
from tests.analyze.importing.tip_videos import HEIGHT, RATE, WIDTH, setting, tip, write_video


def coded(image, suffix=".png"):
    return cv2.imencode(suffix, image)[1].tobytes()


def held_upright(jpeg: bytes) -> bytes:
    """JPEG file with a phone's tag that the image is to be displayed rotated by 90 degrees."""
    exif = b"Exif\0\0II*\0\x08\0\0\0" + struct.pack("<HHHIIi", 1, 0x0112, 3, 1, 6, 0)
    return jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + jpeg[2:]


def folder(path: Path, files: dict[str, bytes]) -> Path:
    path.mkdir()
    rows = [f"{name},{number / RATE:.6f}" for number, name in enumerate(files)]
    (path / "times.csv").write_text("\n".join(["name,time_s", *rows]))
    for name, data in files.items():
        (path / name).write_bytes(data)
    return path


def stored(tmp_path: Path, source: Path) -> tuple[list[bytes], list[str], list[np.ndarray]]:
    """Bytes and format of each image in a recording of `source`, and the images read back from it."""
    output = tmp_path / "o.mcap"
    with prepare(ImportOptions((source,), *setting(tmp_path), whole=True)) as prepared:
        write_recording(prepared, output)
    refuse_changed_content(output)
    with open_recording(output) as recording:
        messages = [
            CompressedImage.FromString(bytes(each.data)) for each in recording.messages("/camera/main/image")
        ]
        return (
            [each.data for each in messages],
            [each.format for each in messages],
            [frame.image for frame in recording.images()],
        )


def test_image_files_are_stored_unchanged_and_read_back(tmp_path):
    image = tip()[40]
    colour = np.dstack([image, np.roll(image, 9, axis=1), 255 - image])
    deep = image.astype(np.uint16) * 256 + 200
    files = {
        "grey.png": coded(image),
        "colour.png": coded(colour),
        "deep.PNG": coded(deep),
        "clear.png": coded(np.dstack([colour, image])),
        "grey.jpg": coded(image, ".jpg"),
        "colour.jpeg": coded(colour, ".jpg"),
        "upright.jpg": held_upright(coded(colour, ".jpg")),
    }
    source = folder(tmp_path / "images", files)
    images = ImageFolder(source)
    seen = [frame.image for frame in images.frames()]
    data, formats, read = stored(tmp_path, source)
    assert data == list(files.values())
    assert formats == ["png"] * 4 + ["jpeg"] * 3
    assert all(np.array_equal(one, other) for one, other in zip(read, seen, strict=True))
    assert np.array_equal(read[0], image)
    assert np.array_equal(read[2], image)
    assert read[6].shape == (HEIGHT, WIDTH)


def test_file_named_png_of_another_format_becomes_png(tmp_path):
    data, formats, read = stored(
        tmp_path, folder(tmp_path / "images", {"a.png": coded(tip()[0], ".bmp"), "b.png": coded(tip()[1])})
    )
    assert formats == ["png", "png"]
    assert data[1] == coded(tip()[1])
    assert all(np.array_equal(one, other) for one, other in zip(read, tip(), strict=False))


def test_other_formats_are_stored_decoded(tmp_path):
    source = folder(tmp_path / "images", {"a.bmp": coded(tip()[0], ".bmp"), "b.png": coded(tip()[1])})
    with prepare(ImportOptions((source,), *setting(tmp_path), whole=True)) as prepared:
        assert not prepared.are_files


@pytest.mark.parametrize(
    ("second", "said"),
    [
        (b"", "b.png: not a readable image"),
        (coded(tip()[0][:200]), "b.png: has 320 x 200, the first 320 x 240"),
    ],
)
def test_wrong_file_is_named(tmp_path, second, said):
    with pytest.raises(ImportRefused, match=said):
        stored(tmp_path, folder(tmp_path / "images", {"a.png": coded(tip()[0]), "b.png": second}))


@pytest.mark.parametrize("kind", ["png", "jpeg"])
@pytest.mark.parametrize("of", ["foxglove", "ros"])
def test_messages_with_image_files(tmp_path, of, kind):
    frames = list(tip()[30:40])
    source = (
        write_foxglove(tmp_path / "a.mcap", frames, kind)
        if of == "foxglove"
        else write_bag(tmp_path / "bag", frames, kind)
    )
    data, formats, read = stored(tmp_path, source)
    assert data == [coded(frame, f".{kind}") for frame in frames]
    assert set(formats) == {kind}
    assert all(
        np.array_equal(image, grey)
        for image, grey in zip(read, map(decode_image_file, data), strict=True)
        if grey is not None
    )


def test_a_video_of_png_pictures(tmp_path):
    source = write_video(tmp_path / "a.mov", tip()[:6], codec="png", pixels="gray")
    data, formats, read = stored(tmp_path, source)
    assert set(formats) == {"png"}
    assert sum(map(len, data)) < source.stat().st_size
    assert all(np.array_equal(one, other) for one, other in zip(read, tip(), strict=False))


def test_damaged_image_files_give_none():
    png, jpeg = coded(tip()[0]), coded(tip()[0], ".jpg")
    for damaged in (b"", b"x", png[:20], jpeg[:20], b"\xff\xd8", png[:8]):
        assert image_file(damaged) is None


def test_a_png_with_a_false_end_is_no_image(capfd):
    png = coded(tip()[0])
    false_length = png[:-12] + b"\x01" + png[-11:]
    for damaged in (false_length, png[:-4] + b"abcd" + png[-12:], png[:-2]):
        assert decode_image_file(damaged) is None
    assert image_file(false_length) is None
    assert capfd.readouterr().err == ""
