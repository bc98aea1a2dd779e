"""The web output: `serve` runs it within the output process."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import logging
import os
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from aiohttp import web

from tinyekf_py.outputs import signalk_delta
from tinyekf_py.outputs.address import address_text
from tinyekf_py.outputs.feed import Feed
from tinyekf_py.outputs.process import OutputError
from tinyekf_py.outputs.web.access import Access, TokenFileError, token_in, token_path
from tinyekf_py.outputs.web.guard import Guard
from tinyekf_py.outputs.web.history import PERIOD_S
from tinyekf_py.outputs.web.routes import Site, make_application
from tinyekf_py.outputs.web.streams import text_frame
from tinyekf_py.outputs.web.wire import state_object, to_json

_END_PATIENCE_S = 2.0
_MAX_LINE = 4096  # bytes, of the request line and of each header

_log = logging.getLogger(__name__)
#: What aiohttp says of malformed requests: a stranger could fill the journal with it.
_silent = logging.getLogger(f"{__name__}.requests")
_silent.addHandler(logging.NullHandler())
_silent.propagate = False


async def serve(feed: Feed, settings: Mapping[str, Any]) -> None:
    """Serve the page, its API and the streams until cancelled."""
    loop = asyncio.get_running_loop()
    site = Site(feed, _access(settings), settings["rate_hz"])
    runner = web.AppRunner(
        make_application(site),
        access_log=None, logger=_silent, max_line_size=_MAX_LINE, max_field_size=_MAX_LINE, lingering_time=0.0,
    )  # fmt: skip
    await runner.setup()
    inner = runner.server
    assert inner is not None
    server = await loop.create_server(
        lambda: Guard(site.connections, inner), settings["host"], settings["port"], reuse_address=True
    )
    _log.info("page at %s", address_text("http", settings))
    try:
        async with server:
            sending = _send_frames(site, settings["rate_hz"], allow_simulated=settings["allow_simulated"])
            await asyncio.gather(_remember(site), sending)
    finally:
        site.connections.abort()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(runner.cleanup(), _END_PATIENCE_S)


def _access(settings: Mapping[str, Any]) -> Access:
    """The rules; a token is made where others than this machine could connect."""
    names = settings["names"]
    if _is_loopback(settings["host"]) and not names and not settings["read_token"]:
        return Access(None)
    path = token_path(settings["token_file"], os.environ)
    try:
        token, is_new = token_in(path)
    except TokenFileError as error:
        raise OutputError(str(error)) from error
    if is_new:
        # Not logged: log lines are shown to everybody who may read.
        print(f"outputs.web: the token is {token} (kept in {path}; told this once)", file=sys.stderr, flush=True)
    _log.info("outputs.web: control needs the token kept in %s", path)
    return Access(token, names, read_token=settings["read_token"])


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


async def _remember(site: Site) -> None:
    """Give the history its points."""
    async for _ in site.feed.frames(PERIOD_S):
        site.history.add(site.feed)


async def _send_frames(site: Site, rate_hz: float, *, allow_simulated: bool) -> None:
    """Give each new view state, encoded once, to all who watch."""
    feed = site.feed
    async for _ in feed.paced(rate_hz):
        if len(site.page):
            site.page.send(text_frame(f'{{"state":{to_json(state_object(feed))}}}'))
        if len(site.signalk):
            now_utc, vessel = datetime.now(UTC), signalk_delta.vessel_context()
            delta = signalk_delta.delta(feed.state, feed.age_s, now_utc, feed.alarms, context=vessel)
            is_simulated = feed.state is not None and feed.state.simulated  # which the format cannot mark
            site.signalk.send(text_frame(to_json(delta)), local_only=is_simulated and not allow_simulated)
