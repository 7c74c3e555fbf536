"""The generated messages match the .proto file, and every topic's schema is self-contained."""

from __future__ import annotations

import subprocess
import sys

import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool

from schemas import topics
from tests.places import ROOT

ALL = [value for value in vars(topics).values() if isinstance(value, topics.Topic)] + [
    topics.raw_image("main"),
    topics.compressed_image("main"),
    topics.compressed_video("main"),
    topics.frame_meta("main"),
    topics.camera_calibration("main"),
]


@pytest.mark.parametrize("topic", ALL, ids=lambda topic: topic.schema_name)
def test_schema_of_each_topic_is_self_contained(topic):
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(topic.schema_data()).file:
        pool.Add(file)
    assert pool.FindMessageTypeByName(topic.schema_name).full_name == topic.schema_name


def test_every_topic_is_documented():
    text = (ROOT / "schemas" / "README.md").read_text(encoding="utf-8")
    for topic in ALL:
        name = topic.name.replace("/main/", "/<name>/")
        assert name in text, f"{name} is not in schemas/README.md"


def test_the_checked_in_messages_are_generated_from_the_proto(tmp_path):
    subprocess.run(
        [
            sys.executable,
            "-m",
            "grpc_tools.protoc",
            f"-I{ROOT / 'schemas/proto'}",
            f"--python_out={tmp_path}",
            f"--pyi_out={tmp_path}",
            "percuss.proto",
        ],
        check=True,
        cwd=ROOT,
    )
    for name in ("percuss_pb2.py", "percuss_pb2.pyi"):
        assert (tmp_path / name).read_text(encoding="utf-8") == (ROOT / "schemas/proto" / name).read_text(
            encoding="utf-8"
        )
