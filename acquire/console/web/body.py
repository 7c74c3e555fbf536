"""Body of a request: read within a time and size limit, and validated."""

from __future__ import annotations

import asyncio
import json
from typing import TypeVar

from starlette.requests import ClientDisconnect, Request

from acquire.console.web.refusal import Refusal
from schemas.document import Document, DocumentError, validate

MAX_BODY_BYTES = 16 << 10
BODY_S = 5.0
"""longest time in which a body must arrive [s]"""

D = TypeVar("D", bound=Document)


async def read_body(request: Request, model: type[D]) -> D:
    """Read and validate the JSON body of a request.

    Raises:
        Refusal: it is too long, too slow, not JSON, or not what the order needs.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip()
    if kind != "application/json":
        raise Refusal(415, "WrongType", "an order needs the header Content-Type: application/json")
    try:
        async with asyncio.timeout(BODY_S):
            data = await _bytes(request)
    except TimeoutError:
        raise Refusal(408, "TooSlow", f"the body did not arrive within {BODY_S:g} s") from None
    except ClientDisconnect:
        raise Refusal(400, "Incomplete", "the body did not arrive") from None
    try:
        return validate(model, json.loads(data or b"{}"), "order")
    except DocumentError as error:
        raise Refusal(422, "WrongOrder", str(error)) from None
    except (ValueError, RecursionError):
        raise Refusal(400, "NotJson", "the body is not JSON") from None


async def _bytes(request: Request) -> bytes:
    data = bytearray()
    async for chunk in request.stream():
        data += chunk
        if len(data) > MAX_BODY_BYTES:
            raise Refusal(413, "TooLong", f"a body has at most {MAX_BODY_BYTES} bytes")
    return bytes(data)
