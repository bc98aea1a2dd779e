"""Signal K deltas as lines of JSON: to everybody who connects by TCP, and in datagrams."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from tinyekf_py.outputs.address import address_text
from tinyekf_py.outputs.broadcast import DatagramSender, listening
from tinyekf_py.outputs.feed import Feed
from tinyekf_py.outputs.signalk_delta import delta, hello, json_line

_log = logging.getLogger(__name__)


async def serve(feed: Feed, settings: Mapping[str, Any]) -> None:
    """Serve [outputs.signalk] until the program ends; OSError when an address cannot be had."""
    async with contextlib.AsyncExitStack() as stack:
        senders = []
        if settings["port"]:
            server = listening(settings["host"], settings["port"], greeting=lambda: json_line(hello(datetime.now(UTC))))
            senders.append((await stack.enter_async_context(server)).send)
            _log.info("Signal K at %s", address_text("tcp", settings))
        if settings["udp_host"]:
            datagrams = stack.enter_context(DatagramSender(settings["udp_host"], settings["udp_port"]))
            senders.append(datagrams.send)
        async for _ in feed.paced(settings["rate_hz"]):
            state = feed.state
            line = json_line(delta(state, feed.age_s, datetime.now(UTC), feed.alarms))
            local_only = state is not None and state.simulated and not settings["allow_simulated"]
            for send in senders:
                send(line, local_only=local_only)
