"""HTTP: the page's files, the table of methods, the values, and calls."""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Awaitable, Callable
from importlib.resources import files
from typing import Any

from aiohttp import web

from zeromethod.errors import InputError, MeasurementError
from zeromethod.page.access import Access, Right
from zeromethod.page.hub import Hub
from zeromethod.page.message import asked_of
from zeromethod.page.viewers import Viewer

HUB: web.AppKey[Hub] = web.AppKey("hub", Hub)
ACCESS: web.AppKey[Access] = web.AppKey("access", Access)

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}
_SAFE = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' blob: data:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
_REFUSED_PAGE = (
    "This page needs the address that the terminal printed, with its token: "
    "view: http://HOST:PORT/?token=...\n"
)
MOST_BODY_BYTES = 1 << 16

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def static_files() -> dict[str, tuple[bytes, str]]:
    """Path on the server to compressed content and type: all that a browser loads."""
    found = {}
    for folder in ("static", "vendor"):
        for one in files("zeromethod.page").joinpath(folder).iterdir():
            suffix = "." + one.name.rpartition(".")[2]
            if suffix in _TYPES:
                found[f"/{folder}/{one.name}"] = gzip.compress(one.read_bytes(), 6, mtime=0), _TYPES[suffix]
    return found


def page_app(hub: Hub, access: Access) -> web.Application:
    """The application."""
    app = web.Application(middlewares=[_guarded], client_max_size=MOST_BODY_BYTES)
    app[HUB], app[ACCESS] = hub, access
    content = static_files()
    tags = {path: f'"{hashlib.sha256(data).hexdigest()[:16]}"' for path, (data, _) in content.items()}

    async def file(request: web.Request) -> web.Response:
        path = request.path if request.path != "/" else "/static/index.html"
        if path not in content:
            raise web.HTTPNotFound(text="there is no such file\n")
        if request.path == "/" and _right(request) is Right.NONE:
            raise web.HTTPForbidden(text=_REFUSED_PAGE)
        data, kind = content[path]
        headers = {"ETag": tags[path], "Cache-Control": "no-cache"}
        if request.headers.get("If-None-Match") == tags[path]:
            return web.Response(status=304, headers=headers)
        headers |= {"Content-Type": kind, "Content-Encoding": "gzip"}
        return web.Response(body=data, headers=headers)

    app.router.add_get("/", file)
    app.router.add_get("/static/{name}", file)
    app.router.add_get("/vendor/{name}", file)
    app.router.add_get("/api", _api)
    app.router.add_get("/api/state", _state)
    app.router.add_post("/api/{method}", _call)
    app.router.add_get("/live", _live)
    return app


@web.middleware
async def _guarded(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Serve only requests to this machine that come from this page or from no page."""
    access, host = request.app[ACCESS], request.headers.get("Host")
    if not access.serves_host(host):
        return web.Response(status=421, text=f"this server is not {host!r}\n", headers=_SAFE)
    if not access.own_origin(request.headers.get("Origin"), host):
        return web.Response(status=403, text="requests of other pages are refused\n", headers=_SAFE)
    try:
        response = await handler(request)
    except web.HTTPException as error:
        error.headers.update(_SAFE)
        raise
    if not response.prepared:
        response.headers.update(_SAFE)
    return response


def _right(request: web.Request) -> Right:
    """What the token of a request allows; it is in the URL, or in the header Authorization."""
    given = request.headers.get("Authorization", "")
    token = given.removeprefix("Bearer ") if given.startswith("Bearer ") else request.query.get("token", "")
    return request.app[ACCESS].right_of(token)


def _needs(request: web.Request, right: Right) -> Hub:
    """The hub, for a request that has this right. Raises HTTPForbidden."""
    given = _right(request)
    if given.value < right.value:
        words = "this token may only view" if given is Right.VIEW else "no valid token"
        raise web.HTTPForbidden(text=json.dumps({"error": words}) + "\n", content_type="application/json")
    return request.app[HUB]


def _json(value: Any, status: int = 200) -> web.Response:
    return web.Response(
        text=json.dumps(value, allow_nan=False) + "\n",
        content_type="application/json",
        status=status,
        headers={"Cache-Control": "no-store"},
    )


async def _api(request: web.Request) -> web.Response:
    return _json(_needs(request, Right.VIEW).setting.table)


async def _state(request: web.Request) -> web.Response:
    return _json(_needs(request, Right.VIEW).values)


async def _call(request: web.Request) -> web.Response:
    hub = _needs(request, Right.CONTROL)
    try:
        body = await request.read()
        arguments = asked_of(body) if body.strip() else {}
        result = await hub.call(request.match_info["method"], arguments, "http")
    except (InputError, MeasurementError) as error:
        return _json({"error": str(error)}, 400)
    except web.RequestPayloadError:
        return _json({"error": "the body: not as its Content-Encoding says"}, 400)
    return _json({"result": result})


async def _live(request: web.Request) -> web.StreamResponse:
    hub = _needs(request, Right.VIEW)
    return await Viewer(hub, _right(request), request.remote or "?").serve(request)
