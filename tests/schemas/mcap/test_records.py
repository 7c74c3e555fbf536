"""Records of MCAP as writers other than ours make them."""

from __future__ import annotations

import pytest

from schemas.mcap import records as container

FIELDS_OF_ANOTHER_WRITER = b"\x01\x02\x03"


def _attachment(behind: bytes) -> memoryview:
    body = container.pack_attachment("notes.txt", "text/plain", b"hello", 7)[container.RECORD_HEAD :]
    return memoryview(body + behind)


@pytest.mark.parametrize("behind", [b"", FIELDS_OF_ANOTHER_WRITER])
def test_an_attachments_crc_covers_the_fields_before_it(behind: bytes) -> None:
    assert container.parse_attachment(_attachment(behind)) == container.AttachmentRecord(
        "notes.txt", "text/plain", 7, b"hello"
    )


@pytest.mark.parametrize("behind", [b"", FIELDS_OF_ANOTHER_WRITER])
def test_an_attachment_with_a_wrong_byte_is_damaged(behind: bytes) -> None:
    bad = bytearray(_attachment(behind))
    bad[bad.index(b"hello")] ^= 1
    with pytest.raises(container.ContainerError, match=r"'notes\.txt' is damaged"):
        container.parse_attachment(memoryview(bytes(bad)))
