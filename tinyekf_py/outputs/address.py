"""Where a client finds an output, in words for the log and the console."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def address_text(scheme: str, settings: Mapping[str, Any]) -> str:
    """Where a client finds what listens at the host and port of `settings`: http://127.0.0.1:8080."""
    host, port = settings["host"], settings["port"]
    if host in ("0.0.0.0", "::", ""):
        return f"{scheme}://127.0.0.1:{port} and all other addresses of this machine"
    return f"{scheme}://[{host}]:{port}" if ":" in host else f"{scheme}://{host}:{port}"
