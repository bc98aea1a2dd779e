"""What is served under which path, and who may have it."""

from __future__ import annotations

import importlib.resources
import logging
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from aiohttp import hdrs, web

from tinyekf_py.outputs import signalk_delta
from tinyekf_py.outputs.feed import Feed
from tinyekf_py.outputs.web.access import COOKIE, SESSION_S, Access
from tinyekf_py.outputs.web.guard import Connections
from tinyekf_py.outputs.web.history import History
from tinyekf_py.outputs.web.metrics import CONTENT_TYPE, metrics_text
from tinyekf_py.outputs.web.streams import Stream
from tinyekf_py.outputs.web.wire import state_object, to_json

MAX_BODY = 1024  # bytes
_STATIC = {
    "/": ("index.html", "text/html"),
    "/page.css": ("page.css", "text/css"),
    "/icon.svg": ("icon.svg", "image/svg+xml"),
    **{
        f"/{name}.js": (f"{name}.js", "text/javascript")
        for name in ("page", "words", "rose", "tiles", "charts", "sound")
    },
}
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "geolocation=(), camera=(), microphone=(), usb=(), serial=(), payment=()",
    "Server": "tinyekf",
}
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self' ws://{host} wss://{host};"
    " base-uri 'none'; form-action 'none'; frame-ancestors 'none';"
    " require-trusted-types-for 'script'; trusted-types 'none'"
)

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

_log = logging.getLogger(__name__)


@dataclass
class Site:
    """What the handlers share."""

    feed: Feed
    access: Access
    rate_hz: float
    history: History = field(default_factory=History)
    connections: Connections = field(default_factory=Connections)
    page: Stream = field(default_factory=Stream)
    signalk: Stream = field(default_factory=Stream)

    def may_control(self, request: web.Request) -> bool:
        """Whether whoever sent `request` may start and stop tasks."""
        return self.access.may_control(*_credentials(request))

    def may_read(self, request: web.Request) -> bool:
        """Whether whoever sent `request` may see what the boat does."""
        return self.access.may_read(*_credentials(request))


def _credentials(request: web.Request) -> tuple[str | None, str | None, str]:
    return request.headers.get(hdrs.AUTHORIZATION), request.cookies.get(COOKIE), request.remote or ""


def make_application(site: Site) -> web.Application:
    """The application of one server."""
    api = _Api(site)
    application = web.Application(middlewares=[_protection(site)], client_max_size=MAX_BODY)
    for path, (name, content_type) in _STATIC.items():
        application.router.add_get(path, _static(name, content_type))
    application.add_routes(
        [
            web.get("/api/access", api.access),
            web.post("/api/login", api.login),
            web.post("/api/logout", api.logout),
            web.get("/api/state", api.read(api.state)),
            web.get("/api/history", api.read(api.history)),
            web.get("/api/stream", api.read(api.stream), allow_head=False),
            web.post("/api/tasks/{name:[a-z0-9-]{1,16}}/{verb:start|stop}", api.control(api.switch)),
            web.get("/signalk", api.signalk_endpoints),
            web.get("/signalk/v1/api/self", api.read(api.signalk_self)),
            web.get("/signalk/v1/stream", api.control(api.signalk_stream), allow_head=False),
            web.get("/metrics", api.read(api.metrics)),
            web.get("/healthz", api.read(api.health)),
        ]
    )
    return application


def _static(name: str, content_type: str) -> Handler:
    """A handler of one file of the package, read now: no request names a path."""
    body = (importlib.resources.files(__package__) / "static" / name).read_bytes()

    async def serve(_request: web.Request) -> web.StreamResponse:
        return web.Response(
            body=body, content_type=content_type, charset="utf-8", headers={"Cache-Control": "no-cache"}
        )

    return serve


def answer(body: object, status: int = 200, headers: Mapping[str, str] | None = None) -> web.Response:
    """`body` as JSON."""
    text = body if isinstance(body, str) else to_json(body)
    return web.Response(
        text=text,
        status=status,
        content_type="application/json",
        headers={"Cache-Control": "no-store", **(headers or {})},
    )


def _protection(site: Site) -> Any:
    """The middleware that every request passes: whose name it uses, where it comes from, how the answer is marked."""
    access, refused = site.access, site.connections.refused

    async def respond(request: web.Request, handler: Handler) -> web.StreamResponse:
        local = request.transport.get_extra_info("sockname") if request.transport is not None else None
        host = request.headers.get(hdrs.HOST, "")
        if local is None or len(request.headers.getall(hdrs.HOST, [])) != 1 or not access.host_is_ours(host, local[0]):
            refused["host"] += 1
            return answer({"error": "this host name is not ours; add it to outputs.web.names"}, 421)
        is_navigation = request.method == "GET" and request.headers.get("Sec-Fetch-Mode") == "navigate"
        site_of = None if is_navigation else request.headers.get("Sec-Fetch-Site")
        if not access.origin_is_ours(request.headers.get(hdrs.ORIGIN), host, site_of):
            refused["origin"] += 1
            return answer({"error": "requests from other sites are refused"}, 403)
        try:
            return await handler(request)
        except web.HTTPException as error:
            if error.status >= 400:
                return answer({"error": error.reason.lower()}, error.status, _allowed(error))
            raise
        except Exception:
            # The outermost frame of a request: its fault must not show, and must not take others along.
            _log.exception("outputs.web: %s %s has failed", request.method, request.path)
            return answer({"error": "a fault, see the program's log"}, 500)

    @web.middleware
    async def protect(request: web.Request, handler: Handler) -> web.StreamResponse:
        response = await respond(request, handler)
        if not response.prepared:
            response.headers.update(_HEADERS)
            response.headers["Content-Security-Policy"] = _POLICY.format(host=_plain_host(request))
            response.force_close()  # one request a connection, see `guard`
        return response

    return protect


def _allowed(error: web.HTTPException) -> dict[str, str]:
    return {"Allow": error.headers["Allow"]} if "Allow" in error.headers else {}


def _plain_host(request: web.Request) -> str:
    """The Host header where it can stand in another header."""
    host = request.headers.get(hdrs.HOST, "")
    return host if all((c.isalnum() and c.isascii()) or c in ".-:[]" for c in host) else "localhost"


class _Api:
    """The handlers."""

    def __init__(self, site: Site) -> None:
        self._site = site

    def read(self, handler: Handler) -> Handler:
        """`handler` for those who may read."""
        return self._only(self._site.may_read, handler)

    def control(self, handler: Handler) -> Handler:
        """`handler` for those who may control."""
        return self._only(self._site.may_control, handler)

    def _only(self, may: Callable[[web.Request], bool], handler: Handler) -> Handler:
        async def check(request: web.Request) -> web.StreamResponse:
            if not may(request):
                return self._refusal(request)
            return await handler(request)

        return check

    def _refusal(self, request: web.Request, why: str = "the token is needed") -> web.Response:
        self._site.connections.refused["token"] += 1
        wait_s = self._site.access.wait_s(request.remote or "")
        if wait_s > 0.0:
            headers = {"Retry-After": str(int(wait_s) + 1)}
            return answer({"error": f"too many wrong tokens; wait {wait_s:.0f} s"}, 429, headers)
        return answer({"error": why}, 401, {"WWW-Authenticate": "Bearer"})

    async def access(self, request: web.Request) -> web.StreamResponse:
        """What the client may do, for the page to ask the token of its user."""
        site = self._site
        may_control = site.may_control(request)
        return answer({"read": may_control or site.may_read(request), "control": may_control})

    async def login(self, request: web.Request) -> web.StreamResponse:
        """A session for whoever sends {"token": TOKEN}, in a cookie that no script and no other site can use."""
        if request.content_type != "application/json":
            return answer({"error": "send application/json"}, 415)
        try:
            body = await request.json()
        except (ValueError, RecursionError):
            body = None
        token = body.get("token") if isinstance(body, dict) else None
        if not isinstance(token, str):
            return answer({"error": 'send {"token": "..."}'}, 400)
        access = self._site.access
        if access.needs_token and not access.token_is_right(token, request.remote or ""):
            return self._refusal(request, "the token is wrong")
        response = answer({"control": True})
        if access.needs_token:
            response.set_cookie(COOKIE, access.session(), max_age=SESSION_S, path="/", httponly=True, samesite="Strict")
        return response

    async def logout(self, _request: web.Request) -> web.StreamResponse:
        """Have the browser forget its session."""
        response = answer({"control": False})
        response.del_cookie(COOKIE, path="/")
        return response

    async def state(self, _request: web.Request) -> web.StreamResponse:
        """The view state."""
        return answer(state_object(self._site.feed))

    async def history(self, _request: web.Request) -> web.StreamResponse:
        """The last five minutes."""
        return answer(self._site.history.json())

    async def stream(self, request: web.Request) -> web.StreamResponse:
        """The page's WebSocket: a greeting, the last five minutes, then a view state `rate_hz` times a second."""
        site = self._site
        greeting = to_json({"hello": {"control": site.may_control(request), "rate_hz": site.rate_hz}})
        return await site.page.serve(
            request,
            lambda: [
                greeting,
                f'{{"history":{site.history.json()}}}',
                f'{{"state":{to_json(state_object(site.feed))}}}',
            ],
        )

    async def signalk_endpoints(self, request: web.Request) -> web.StreamResponse:
        """Where Signal K is found here."""
        paths = {
            "signalk-http": f"http://{request.host}/signalk/v1/api/",
            "signalk-ws": f"ws://{request.host}/signalk/v1/stream",
        }
        endpoints = {"v1": {"version": signalk_delta.VERSION, **paths}}
        return answer({"endpoints": endpoints, "server": {"id": "tinyekf", "version": signalk_delta.VERSION}})

    async def signalk_self(self, _request: web.Request) -> web.StreamResponse:
        """The context of the stream's deltas: which a Signal K server takes for its own boat's."""
        return answer(to_json(signalk_delta.vessel_context()))

    async def signalk_stream(self, request: web.Request) -> web.StreamResponse:
        """Signal K deltas: a greeting, then one with every view state."""
        return await self._site.signalk.serve(request, lambda: [to_json(signalk_delta.hello(datetime.now(UTC)))])

    async def switch(self, request: web.Request) -> web.StreamResponse:
        """Start or stop a task, or all."""
        words = request.match_info["verb"], request.match_info["name"]
        result = await self._site.feed.ask(*words)
        if "error" not in result:
            return answer({"tasks": result["tasks"]})
        return answer({"error": result["error"]}, 404 if str(result["error"]).startswith("no task") else 503)

    async def metrics(self, _request: web.Request) -> web.StreamResponse:
        """Prometheus text."""
        site = self._site
        streams = {"page": site.page, "signalk": site.signalk}
        text = metrics_text(
            site.feed,
            {
                "tinyekf_web_clients": [({"stream": name}, len(stream)) for name, stream in streams.items()],
                "tinyekf_web_frames_total": [({"stream": name}, stream.sent) for name, stream in streams.items()],
                "tinyekf_web_frames_lost_total": [({"stream": name}, stream.lost) for name, stream in streams.items()],
                "tinyekf_web_refused_total": [({"reason": why}, n) for why, n in site.connections.refused.items()],
            },
        )
        return web.Response(body=text.encode(), headers={"Content-Type": CONTENT_TYPE, "Cache-Control": "no-store"})

    async def health(self, _request: web.Request) -> web.StreamResponse:
        """200 while there is a valid heading, else 503."""
        mode = self._site.feed.estimate.mode
        return answer({"heading": mode}, 503 if mode == "invalid" else 200)
