"""The output process: `python -m tinyekf_py.outputs.process FD SETTINGS`, started by `outputs.launcher`.

FD is the datagram socket to the live program; SETTINGS is JSON: `{"outputs": {NAME: {KEY: VALUE}}, "parent_pid": N}`,
with a table for each output that is switched on. Each of them is a coroutine over the same `Feed`. One that fails (a
port taken by another program, a serial line that vanished) is tried again, while the others go on.
"""

from __future__ import annotations

import asyncio
import errno
import importlib
import json
import logging
import os
import socket
import sys
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any

from acquisition.child_process import end_with_parent
from tinyekf_py.outputs.feed import Feed, LinkLog

#: Output -> the module whose `serve(feed, settings)` it is; only what is switched on is imported.
MODULES = {
    "nmea_tcp": "tinyekf_py.outputs.nmea_tcp",
    "nmea_udp": "tinyekf_py.outputs.nmea_udp",
    "nmea_serial": "tinyekf_py.outputs.nmea_serial",
    "signalk": "tinyekf_py.outputs.signalk",
    "web": "tinyekf_py.outputs.web.server",
}
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 30.0
NICENESS = 5

Serve = Callable[[Feed, Mapping[str, Any]], Awaitable[None]]

_log = logging.getLogger(__name__)


class OutputError(RuntimeError):
    """An output that cannot work now: one line saying which, why and what to do."""


async def run_outputs(link: socket.socket, outputs: Mapping[str, Mapping[str, Any]]) -> None:
    """Serve `outputs` until the live program at the other end of `link` ends."""
    feed = Feed(link)
    tasks = [asyncio.create_task(_keep(name, feed, settings), name=name) for name, settings in outputs.items()]
    await feed.run()
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _keep(name: str, feed: Feed, settings: Mapping[str, Any]) -> None:
    """Serve one output for ever: tried again, with growing pauses, when it fails."""
    pause_s = FIRST_PAUSE_S
    while True:
        began_s = asyncio.get_running_loop().time()
        try:
            serve: Serve = importlib.import_module(MODULES[name]).serve
            await serve(feed, settings)
            return
        except ImportError as error:
            _log.error("outputs.%s: %s is not installed; install the extra [%s]", name, error.name, name)
            return
        except OSError as error:
            _log.warning("outputs.%s: %s; tried again in %.0f s", name, _reason(error, settings), pause_s)
        except OutputError as error:
            _log.warning("outputs.%s: %s", name, error)
        except Exception:
            # The outermost frame of this output: its fault must not take the others along.
            _log.exception("outputs.%s has failed", name)
        if asyncio.get_running_loop().time() - began_s > 60.0:
            pause_s = FIRST_PAUSE_S
        await asyncio.sleep(pause_s)
        pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)


def _reason(error: OSError, settings: Mapping[str, Any]) -> str:
    """What the system says, with the address or the line it is about, and for the usual causes what to do."""
    place = f"port {settings.get('port')}" + (f" of {settings['host']}" if "host" in settings else "")
    if error.errno == errno.EADDRINUSE:
        return f"{place} is used by another program; choose another port"
    if error.errno == errno.EACCES and "host" in settings:
        return f"{place} is not allowed to this user; choose one above 1023"
    return f"{place}: {os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror or error}"


def give_way() -> None:
    """Let the fusion and its workers have the processor first, also where they are run in real time: a process of
    SCHED_BATCH that a datagram wakes takes it from no other."""
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    os.nice(NICENESS)


def main(arguments: Sequence[str]) -> int:
    """Run the process; the exit status."""
    give_way()
    fd, settings = int(arguments[0]), json.loads(arguments[1])
    end_with_parent(settings["parent_pid"])
    link = socket.socket(fileno=fd)
    root = logging.getLogger()
    root.addHandler(LinkLog(link))
    root.setLevel(logging.INFO)
    asyncio.run(run_outputs(link, settings["outputs"]))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
