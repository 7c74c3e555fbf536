"""Routes of the console: one table, from which both the application and its OpenAPI document are made."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response

from acquire.console.web import orders, streams
from acquire.console.web.backend import Backend, Viewer
from acquire.console.web.body import read_body
from acquire.console.web.refusal import Refusal
from acquire.console.web.report_wait import ReportWait
from acquire.console.web.snapshot import Snapshot
from acquire.console.web.visitors import Visitor, Visitors
from schemas.document import Document

DRAWING_POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'"
"""Content-Security-Policy of a drawing (SVG): shown as an image, it runs no script"""
PREVIEW_TRIES: Final = 6
"""tries to get an image, ten a second"""
MAX_ID = 80
"""greatest length of an id in an address"""


@dataclass(frozen=True)
class Site:
    """Objects that the routes work with."""

    backend: Backend
    visitors: Visitors
    address: str
    """address of the console, as `http://127.0.0.1:8765`"""
    ended: threading.Event = field(default_factory=threading.Event)
    """set when the console ends: event streams and live images then end too"""
    stopping: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(4, "console-stop"))
    """threads that only stop the striker: other orders may wait for the rig"""
    reports: ReportWait = field(default_factory=ReportWait)

    def viewer(self, visitor: Visitor) -> Viewer:
        """Role of a visitor, and who else looks on."""
        role = "operator" if self.visitors.is_operator(visitor) else "watcher"
        return Viewer(role, self.visitors.operator_present, self.visitors.watchers)


Handler = Callable[[Site, Request, Any], Awaitable[Response | Document | dict[str, Any] | list[Any] | None]]


@dataclass(frozen=True)
class ApiRoute:
    """One address of the API."""

    method: str
    path: str
    summary: str
    """what it does, one sentence"""
    handler: Handler
    body: type[Document] | None = None
    """document of the request's body; None for a GET"""
    answer: type[Document] | str = orders.Done
    """document of the answer, or its media type"""
    many: bool = False
    """True if the answer is a list of such documents"""
    anyone: bool = False
    """True if a watcher may do it too"""


async def respond(route: ApiRoute, site: Site, request: Request) -> Response:
    """Carry out a request, and make the answer.

    Raises:
        Refusal: the request is refused.
        AcquireError: the rig refuses.
    """
    visitor: Visitor = request.scope["visitor"]
    if route.method == "POST" and not route.anyone and not site.visitors.is_operator(visitor):
        raise Refusal(
            403, "Watcher", "this browser only watches: another one is the operator", "take over first"
        )
    body = None if route.body is None else await read_body(request, route.body)
    answer = await route.handler(site, request, body)
    if isinstance(answer, Response):
        return answer
    if answer is None:
        answer = orders.Done()
    if isinstance(answer, Document):
        return Response(answer.model_dump_json(), media_type="application/json")
    return JSONResponse(
        [each.model_dump(mode="json") if isinstance(each, Document) else each for each in answer]
        if isinstance(answer, list)
        else answer
    )


def _order(method: Callable[[Backend, Any], Any]) -> Handler:
    """Handler that calls a method of the rig in a thread."""

    async def handler(site: Site, _: Request, body: Any) -> Any:
        return await run_in_threadpool(method, site.backend, body)

    return handler


def _by_id(method: Callable[[Backend, str], Any], name: str) -> Handler:
    """Handler that calls a method of the rig, in a thread, with an id from the address."""

    async def handler(site: Site, request: Request, _: Any) -> Any:
        return await run_in_threadpool(method, site.backend, _given_id(request, name))

    return handler


def _given_id(request: Request, name: str) -> str:
    """Id in the address.

    Raises:
        Refusal: it is too long to be one.
    """
    given = str(request.path_params[name])
    if len(given) > MAX_ID:
        raise Refusal(404, "Unknown", "there is no such entry")
    return given


async def _state(site: Site, request: Request, _: Any) -> Snapshot:
    return site.backend.snapshot(site.viewer(request.scope["visitor"]))


async def _stop(site: Site, _: Request, __: Any) -> Document:
    return await asyncio.get_running_loop().run_in_executor(site.stopping, site.backend.stop)


async def _take_over(site: Site, request: Request, _: Any) -> None:
    site.visitors.take_over(request.scope["visitor"])


async def _invite(site: Site, _: Request, __: Any) -> orders.Invitation:
    return orders.Invitation(url=f"{site.address}/?token={site.visitors.new_token()}")


async def _events(site: Site, request: Request, _: Any) -> Response:
    return streams.events(
        site.backend, site.visitors, request.scope["visitor"], site.viewer, site.ended.is_set
    )


async def _preview_stream(site: Site, _: Request, __: Any) -> Response:
    return streams.preview(site.backend, site.ended.is_set)


async def _preview(site: Site, _: Request, __: Any) -> Response:
    image = await run_in_threadpool(site.backend.preview)
    for _try in range(PREVIEW_TRIES):
        if image is not None:
            break
        await asyncio.sleep(streams.IMAGE_S)  # the first request makes the images come
        image = await run_in_threadpool(site.backend.preview)
    if image is None:
        raise Refusal(404, "NoImage", "the camera has sent no image yet")
    return Response(image[1], media_type="image/jpeg")


async def _card(site: Site, request: Request, _: Any) -> Response:
    drawing = await run_in_threadpool(site.backend.card, _given_id(request, "strike_id"))
    headers = {"content-security-policy": DRAWING_POLICY}
    return Response(drawing, media_type="image/svg+xml", headers=headers)


async def _report(site: Site, request: Request, _: Any) -> Response:
    return await site.reports.answer(_given_id(request, "recording_id"), site.backend.report)


async def _download(site: Site, request: Request, _: Any) -> Response:
    path = await run_in_threadpool(site.backend.recording, _given_id(request, "recording_id"))
    return FileResponse(path, media_type="application/octet-stream", filename=path.name)


async def _openapi(_: Site, __: Request, ___: Any) -> dict[str, Any]:
    from acquire.console.web.openapi import openapi_document

    return openapi_document(ROUTES)


ROUTES: Final = (
    ApiRoute("GET", "/api/state", "State of the rig, the session and this browser.", _state, None, Snapshot),
    ApiRoute(
        "GET",
        "/api/events",
        "Server-sent events: `state` with the whole state on every change, a comment every second.",
        _events,
        None,
        "text/event-stream",
    ),
    ApiRoute("POST", "/api/stop", "Stop the striker.", _stop, orders.NoBody, orders.StopDone, anyone=True),
    ApiRoute(
        "POST",
        "/api/stop/clear",
        "Home the striker again after a stop.",
        _order(lambda backend, _: backend.clear_stop()),
        orders.ClearStop,
    ),
    ApiRoute("POST", "/api/operator/take", "Become the operator.", _take_over, orders.NoBody, anyone=True),
    ApiRoute(
        "POST",
        "/api/invite",
        "Address that lets a further browser in, once.",
        _invite,
        orders.NoBody,
        orders.Invitation,
    ),
    ApiRoute(
        "POST",
        "/api/daemon/start",
        "Start the daemon of the rig.",
        _order(lambda backend, _: backend.start_daemon()),
        orders.NoBody,
    ),
    ApiRoute(
        "POST",
        "/api/check",
        "Start the preflight check; its lines appear in the state.",
        _order(lambda backend, _: backend.start_check()),
        orders.NoBody,
    ),
    ApiRoute(
        "POST",
        "/api/session/start",
        "Start a session.",
        _order(lambda backend, body: backend.start_session(body)),
        orders.StartSession,
    ),
    ApiRoute(
        "POST",
        "/api/session/pause",
        "Pause before the next arming.",
        _order(lambda backend, body: backend.pause(body.when)),
        orders.PauseSession,
    ),
    ApiRoute(
        "POST",
        "/api/session/resume",
        "Go on after a pause.",
        _order(lambda backend, _: backend.resume()),
        orders.NoBody,
    ),
    ApiRoute(
        "POST",
        "/api/session/abort",
        "Stop the striker and end the session; the recording is kept.",
        _order(lambda backend, _: backend.abort()),
        orders.NoBody,
    ),
    ApiRoute(
        "POST",
        "/api/prompt/answer",
        "Answer a prompt.",
        _order(lambda backend, body: backend.answer(body)),
        orders.Answer,
    ),
    ApiRoute(
        "GET",
        "/api/cards/{strike_id}",
        "Drawing of a strike's placement card.",
        _card,
        None,
        "image/svg+xml",
    ),
    ApiRoute(
        "GET",
        "/api/strikes/{strike_id}/curve",
        "Tipping angle over time of a strike, measured and fitted.",
        _by_id(lambda backend, given: backend.curve(given), "strike_id"),
        None,
        orders.Curve,
    ),
    ApiRoute(
        "GET",
        "/api/preview.mjpeg",
        "Live images, at most 10 per second.",
        _preview_stream,
        None,
        "multipart/x-mixed-replace",
    ),
    ApiRoute("GET", "/api/preview.jpg", "Newest live image.", _preview, None, "image/jpeg"),
    ApiRoute(
        "GET",
        "/api/archive",
        "Recordings in the folder of recordings.",
        _order(lambda backend, _: backend.archive()),
        None,
        orders.ArchiveEntry,
        many=True,
    ),
    ApiRoute(
        "GET",
        "/api/archive/{recording_id}/report",
        "Report on a recording; status 202 and a page that waits while it is being made.",
        _report,
        None,
        "text/html",
    ),
    ApiRoute(
        "POST",
        "/api/archive/{recording_id}/estimate",
        "Estimate a recording again.",
        _by_id(lambda backend, given: backend.estimate(given), "recording_id"),
        orders.NoBody,
        "application/json",
    ),
    ApiRoute(
        "GET",
        "/api/archive/{recording_id}/download",
        "The recording itself (MCAP).",
        _download,
        None,
        "application/octet-stream",
    ),
    ApiRoute("GET", "/api/openapi.json", "This interface, as OpenAPI.", _openapi, None, "application/json"),
)
"""all addresses of the API"""
