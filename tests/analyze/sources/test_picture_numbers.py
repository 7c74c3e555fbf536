"""Pictures stored as coded: their order, their messages, their chunks."""

from __future__ import annotations

import errno

import av
import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from mcap.reader import make_reader

from analyze.errors import ImportRefused
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.write_recording import write_recording
from analyze.reading.annex_b import VideoFormat, write_start_codes
from analyze.reading.recording import open_recording
from analyze.reading.verify import refuse_changed_content
from analyze.sources.frame_timing import MissingFrames
from analyze.sources.image_messages import VideoMessages, put_video_heads, video_room
from analyze.sources.jpeg import jpeg_file
from analyze.sources.picture_numbers import CodedPictures, number_pictures
from analyze.sources.video import VideoSource
from schemas.mcap import records as container
from schemas.mcap.walk import walk
from schemas.output_file import OutputError
from tests.analyze.importing.tip_videos import HEIGHT, RATE, WIDTH, setting, tip, write_video


def _group(times) -> CodedPictures:
    return CodedPictures(
        np.array(times, np.int64),
        np.zeros(len(times), np.bool_),
        [memoryview(str(time).encode()) for time in times],
    )


@pytest.mark.parametrize("together", [1, 7, 40, 300])
def test_pictures_are_numbered_by_their_times_and_keep_their_order(together):
    random = np.random.default_rng(together)
    late = np.arange(300) + random.integers(0, 16, 300)  # each is coded up to 16 pictures ahead of its time
    times = np.argsort(late, kind="stable") * 10
    groups = [_group(times[at : at + together]) for at in range(0, 300, together)]
    found = list(number_pictures(groups, "a.mp4"))
    assert np.concatenate([each.pictures.times_ns for each in found]).tolist() == times.tolist()
    assert np.concatenate([each.numbers for each in found]).tolist() == (times // 10).tolist()
    assert np.concatenate([each.in_order_ns for each in found]).tolist() == (10 * np.arange(300)).tolist()
    assert b"".join(data for each in found for data in each.pictures.data) == b"".join(
        str(time).encode() for time in times
    )


def test_two_pictures_with_the_same_time_are_refused():
    with pytest.raises(ImportRefused, match=r"do not increase at 0\.000 s"):
        list(number_pictures([_group(range(40)), _group([39, 41])], "a.mp4"))


def test_missing_frames_in_blocks_equal_those_one_by_one():
    gaps = np.random.default_rng(2).integers(950, 1050, 200)
    gaps[[30, 31, 120]] = 3000, 2000, 9000
    times = np.cumsum(gaps)
    one, all_at_once = MissingFrames(1000), MissingFrames(1000)
    expected = [one.before(int(time)) for time in times]
    assert sum(expected) == 11
    found = np.concatenate([all_at_once.before_each(part) for part in np.array_split(times, 9)])
    assert found.tolist() == expected
    assert all_at_once == one


def test_packed_heads_are_valid_messages():
    times = np.array([5, 946_684_800_000_000_000, 1_763_000_000_123_456_789], np.int64)
    sizes = np.array([1, 200, 70_000], np.int64)
    records = [memoryview(bytearray(video_room("main", VideoFormat.H265) + size)) for size in sizes.tolist()]
    put_video_heads(
        "main", VideoFormat.H265, 3, VideoMessages(times, np.array([0, 1, 2**32 + 5]), sizes), records
    )
    for record, time, size, sequence in zip(records, times.tolist(), sizes.tolist(), (0, 1, 5), strict=True):
        [(opcode, _, body)] = walk(record)
        found = container.parse_message(body)
        assert (opcode, found.channel_id, found.sequence, found.log_time_ns) == (
            container.MESSAGE,
            3,
            sequence,
            time,
        )
        message = CompressedVideo.FromString(bytes(found.data))
        assert message.timestamp.ToNanoseconds() == time
        assert (message.frame_id, message.format, len(message.data)) == ("main", "h265", size)


def test_lengths_are_replaced_by_start_codes_where_they_add_up():
    whole = [b"\0\0\0\2\x06\x01\0\0\0\3\x41ab", b"\0\0\0\1\x41"]
    left_alone = [
        b"\0\0\0\3\x65ab",
        b"\0\0\0\2\x06\x01\0\0\0\2\x65a",
        b"\0\0\0\2\x06\x01\0\0\0\4\x41ab",
        b"\0\0\0",
        bytes(90),
    ]
    units = [*left_alone[:2], whole[0], *left_alone[2:], whole[1]]
    data = bytearray(b"".join(b"--" + unit for unit in units))
    ends = np.cumsum([len(unit) + 2 for unit in units])
    starts = ends - [len(unit) for unit in units]
    marked = write_start_codes(VideoFormat.H264, data, starts, ends)
    assert marked.tolist() == [unit in whole for unit in units]
    turned = [bytes(data[start:end]) for start, end, good in zip(starts, ends, marked, strict=True) if good]
    assert turned == [b"\0\0\0\1\x06\x01\0\0\0\1\x41ab", b"\0\0\0\1\x41"]


@pytest.mark.parametrize("b_frames", ["0", "3"])
def test_small_pictures_are_stored_with_little_overhead(tmp_path, b_frames):
    path = write_video(tmp_path / "a.mp4", tip() * 3, crf="28", bf=b_frames, preset="veryfast", g="60")
    output = tmp_path / "o.mcap"
    with prepare(ImportOptions((path,), *setting(tmp_path), whole=True)) as prepared:
        expected = [(frame.time_ns, frame.image.copy()) for frame in prepared.sources[0].frames()]
        written = write_recording(prepared, output)
    head = 22_000  # schemas, manifest and attachments, whatever the video shows
    assert path.stat().st_size / written.images < 150
    assert written.size - head - path.stat().st_size < 30 * written.images
    refuse_changed_content(output)
    with open_recording(output) as recording:
        images = list(recording.images())
        start = images[0].time_ns
        assert [image.time_ns - start for image in images] == [time for time, _ in expected]
        assert all(
            np.array_equal(image.image, other) for image, (_, other) in zip(images, expected, strict=True)
        )
        assert [
            image.sequence
            for image in recording.images(start_ns=images[130].time_ns, end_ns=images[150].time_ns)
        ] == [*range(130, 151)]
    with output.open("rb") as file:  # mcap's own reader, which looks at the checksums
        reader = make_reader(file, validate_crcs=True)
        times = [message.log_time for _, _, message in reader.iter_messages(["/camera/main/image"])]
    assert times == [image.time_ns for image in images]


def test_every_frame_has_metadata_though_few_are_stored(tmp_path):
    step = 10**6 // RATE
    lost = {40: 7, 70: 1}
    kept = [number for number in range(len(tip())) if not 40 <= number < 47 and number != 77]
    path = write_video(
        tmp_path / "a.mp4",
        [tip()[number] for number in kept],
        [number * step for number in kept],
        bf="3",
        g="30",
    )
    with prepare(ImportOptions((path, path), *setting(tmp_path, ("s1", "s2")), whole=True)) as prepared:
        write_recording(prepared, tmp_path / "o.mcap")
    with open_recording(tmp_path / "o.mcap") as recording:
        counts = {topic.name: topic.count for topic in recording.topics()}
        assert counts["/camera/main/meta"] < 20 < counts["/camera/main/image"]
        metas = list(recording.timed_frame_meta())
        images = list(recording.images())
        assert [(time_ns, meta.sequence) for time_ns, meta in metas] == [
            (image.time_ns, image.sequence) for image in images
        ]
        anchor_ns = recording.manifest.wall_anchor_ns
        assert all(
            meta.mid_exposure_host_ns == meta.host_time_ns == time_ns - anchor_ns for time_ns, meta in metas
        )
        assert [meta.device_time_ns for _, meta in metas[: len(kept)]] == [
            1000 * number * step for number in kept
        ]
        assert [meta.device_time_ns for _, meta in metas[len(kept) :]] == [
            1000 * number * step for number in kept
        ]
        second = {len(kept) + number: count for number, count in lost.items()}
        assert {
            meta.sequence: meta.frames_lost_before for _, meta in metas if meta.frames_lost_before
        } == lost | second
        some = list(recording.frame_meta(start_ns=images[41].time_ns, end_ns=images[44].time_ns))
        assert [meta.sequence for meta in some] == [41, 42, 43, 44]
        assert {(meta.image_recorded, meta.width, meta.height) for meta in some} == {(True, WIDTH, HEIGHT)}


def test_motion_jpeg_is_stored_as_coded(tmp_path):
    path = write_video(
        tmp_path / "a.mov", [*[tip()[0]] * 90, *tip()], codec="mjpeg", pixels="yuvj420p", qmin="2", qmax="2"
    )
    with prepare(ImportOptions((path,), *setting(tmp_path))) as prepared:
        assert prepared.formats == "PNG or JPEG files unchanged, of the strikes' windows"
        [window] = prepared.windows
        decoded = [
            (frame.time_ns, frame.image.copy())
            for frame in prepared.sources[0].frames(window.start_ns, window.end_ns)
        ]
        write_recording(prepared, tmp_path / "o.mcap")
    assert (tmp_path / "o.mcap").stat().st_size < path.stat().st_size
    with open_recording(tmp_path / "o.mcap") as recording:
        assert recording.topics()[1].schema == "foxglove.CompressedImage"
        images = list(recording.images())
    start_ns = images[0].time_ns - decoded[0][0]
    assert [image.time_ns - start_ns for image in images] == [time for time, _ in decoded]
    # Two decoders of one picture round differently.
    assert (
        max(
            np.abs(image.image.astype(int) - other).max()
            for image, (_, other) in zip(images, decoded, strict=True)
        )
        <= 2
    )


def test_jpeg_without_huffman_tables_gets_the_standard_ones(tmp_path):
    path = write_video(tmp_path / "a.avi", tip()[:3], codec="mjpeg", pixels="yuvj420p", huffman="default")
    with av.open(str(path)) as video:
        whole = bytes(next(video.demux(video=0)))
    assert jpeg_file(whole) == (whole, WIDTH, HEIGHT)
    at = whole.index(b"\xff\xc4")
    bare = whole[:at] + whole[at + 2 + int.from_bytes(whole[at + 2 : at + 4], "big") :]
    made = jpeg_file(bare)
    assert made is not None
    images = [
        cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) for data in (whole, bytes(made[0]))
    ]
    assert np.array_equal(*images)
    for damaged in (whole[:100], b"", b"no picture at all", whole[2:]):
        assert jpeg_file(damaged) is None


def test_damaged_pictures_are_left_out_and_counted(tmp_path):
    path = write_video(tmp_path / "a.mp4", tip()[:30], bf="0", g="100")
    with av.open(str(path)) as video:
        place, size = next(
            (packet.pos, packet.size) for number, packet in enumerate(video.demux(video=0)) if number == 10
        )
    data = bytearray(path.read_bytes())
    assert size > 8
    data[place : place + 4] = b"\xff\xff\xff\xff"
    path.write_bytes(data)
    source = VideoSource(path)
    assert sum(len(group.data) for group in source.coded()) == 29
    assert any("left out: 1 frame that cannot be decoded" in remark for remark in source.remarks)


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "ts"])
def test_pictures_and_key_pictures_agree_with_ffmpeg(tmp_path, suffix):
    path = write_video(tmp_path / f"a.{suffix}", tip()[:40], bf="3", g="15", preset="veryfast")
    with av.open(str(path)) as video:  # its parser looks into every packet
        found = [(packet.pts, packet.is_keyframe) for packet in video.demux(video=0) if packet.size]
    source = VideoSource(path)
    groups = list(source.coded(room=3))
    assert np.concatenate([group.times_ns for group in groups]).tolist() == [
        source.timing.time_ns(stamp) for stamp, _ in found
    ]
    assert np.concatenate([group.keys for group in groups]).tolist() == [key for _, key in found]
    units = [bytes(unit) for group in groups for unit in group.data]
    assert {unit[:3] for unit in units} == {bytes(3)}
    decoder = av.CodecContext.create("h264", "r")
    images = [image for unit in units for image in decoder.decode(av.Packet(unit[3:]))] + decoder.decode(None)
    assert len(images) == 40


def test_full_disk_is_reported_and_leaves_no_file(tmp_path, monkeypatch):
    path = write_video(tmp_path / "a.mp4", tip()[:5])

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with prepare(ImportOptions((path,), *setting(tmp_path), whole=True)) as prepared:
        monkeypatch.setattr("analyze.importing.writer.os.writev", full)
        with pytest.raises(OutputError, match=r"o\.mcap: cannot be written: No space"):
            write_recording(prepared, tmp_path / "o.mcap")
    assert not list(tmp_path.glob("o.mcap*"))
