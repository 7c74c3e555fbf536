"""Web application of the console: static pages, the API's routes, and the gate before them."""

from __future__ import annotations

import mimetypes
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from acquire.console.web.gate import Gate
from acquire.console.web.refusal import Refusal
from acquire.console.web.routes import ROUTES, ApiRoute, Site, respond
from acquire.errors import AcquireError

STATIC = Path(__file__).with_name("static")
"""folder of the pages"""
MEDIA_TYPES = {
    ".js": "text/javascript",
    ".mjs": "text/javascript",
    ".webmanifest": "application/manifest+json",
}


def make_app(site: Site, port: int, monotonic_s: Callable[[], float] = time.monotonic) -> Gate:
    """ASGI application of the console.

    Args:
        site: the rig, and the register of browsers.
        port: port on which it is served.
        monotonic_s: function that returns a monotonic time [s].
    """
    routes = [Route(route.path, _endpoint(route, site), methods=[route.method]) for route in ROUTES]
    pages = [
        Route("/", _page, methods=["GET"]),
        Route("/static/{name:path}", _page, methods=["GET"]),
        Route("/{name:path}", _page, methods=["GET"]),
    ]
    handlers = {
        Refusal: _refused,
        AcquireError: _failed,
        404: _unknown,
        405: _wrong_method,
    }
    app = Starlette(routes=[*routes, *pages], exception_handlers=handlers)  # pyright: ignore[reportArgumentType]
    return Gate(app, site.visitors, port, monotonic_s)


def _endpoint(route: ApiRoute, site: Site) -> Callable[[Request], Awaitable[Response]]:
    async def endpoint(request: Request) -> Response:
        return await respond(route, site, request)

    return endpoint


async def _page(request: Request) -> Response:
    """Answer with a file of the folder of pages; the name is looked up in the folder's listing."""
    name = request.path_params.get("name", "") or "index.html"
    found = await run_in_threadpool(_static_files)
    path = found.get(name)
    if path is None:
        raise Refusal(404, "Unknown", "there is no such page")
    suffix = path.suffix.lower()
    media_type = MEDIA_TYPES.get(suffix) or mimetypes.types_map.get(suffix, "application/octet-stream")
    return Response(await run_in_threadpool(path.read_bytes), media_type=media_type)


def _static_files() -> dict[str, Path]:
    return {
        path.relative_to(STATIC).as_posix(): path
        for path in STATIC.rglob("*")
        if path.is_file() and not path.is_symlink()
    }


async def _refused(_: Request, error: Exception) -> Response:
    assert isinstance(error, Refusal)  # noqa: S101 - registered for this class
    return JSONResponse(error.body(), error.status)


async def _failed(_: Request, error: Exception) -> Response:
    assert isinstance(error, AcquireError)  # noqa: S101 - registered for this class
    refusal = Refusal.from_error(error)
    return JSONResponse(refusal.body(), refusal.status)


async def _unknown(_: Request, __: Exception) -> Response:
    return JSONResponse(Refusal(404, "Unknown", "there is no such address").body(), 404)


async def _wrong_method(_: Request, __: Exception) -> Response:
    return JSONResponse(Refusal(405, "WrongMethod", "this address is used by the other method").body(), 405)
