"""A real signalk-server, installed by npm into build/ and run on a port of this machine."""

from __future__ import annotations

import json
import os
import platform
import select
import shutil
import subprocess
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from live_boat import free_port

DEADLINE_S = 120.0  # it starts in 3 s on an idle machine
ROOT = Path(__file__).resolve().parents[2]
HOME = ROOT / "build" / "signalk-server"
#: It wants Node.js 22 or later; the package of node@22 for this machine brings just the program.
_MACHINE = {"x86_64": "x64", "aarch64": "arm64"}.get(platform.machine(), platform.machine())
NODE = f"node-linux-{_MACHINE}"
PACKAGES = ("signalk-server@2.23.0", f"{NODE}@22.23.3")
#: What has nothing to do with data coming in and being asked for.
INTERFACES_OFF = ("plugins", "appstore", "webapps", "tcp", "nmea-tcp", "logfiles", "playground", "admin")


def install() -> Path:
    """The folder with the packages, installed where they are not yet, without running any of their scripts."""
    stamp = HOME / "installed"
    wanted = "\n".join(PACKAGES)
    if not stamp.exists() or stamp.read_text() != wanted:
        shutil.rmtree(HOME, ignore_errors=True)
        HOME.mkdir(parents=True)
        (HOME / "package.json").write_text('{"private": true}\n')
        options = ["--ignore-scripts", "--omit=optional", "--no-audit", "--no-fund", "--no-package-lock"]
        done = subprocess.run(["npm", "install", *options, *PACKAGES], cwd=HOME, capture_output=True, text=True)
        assert done.returncode == 0, f"npm install has failed:\n{done.stderr[-3000:]}"
        stamp.write_text(wanted)
    return HOME / "node_modules"


class SignalKServer:
    """The server, connected to `source_port` of this machine for `data_type`, "NMEA0183" or "SignalK".

    `by` is "tcp", or "ws" for a WebSocket.
    """

    def __init__(self, folder: Path, data_type: str, source_port: int, by: str = "tcp") -> None:
        modules = install()
        folder.mkdir()
        provider = {"type": by, "host": "127.0.0.1", "port": source_port, "validateChecksum": True}
        provider |= {"useDiscovery": False, "selfHandling": "useRemoteSelf"}  # by WebSocket
        simple = {"type": "providers/simple", "options": {"type": data_type, "subOptions": provider}}
        settings = {
            "interfaces": dict.fromkeys(INTERFACES_OFF, False),
            "mdns": False,
            "ssl": False,
            "pipedProviders": [{"id": "boat", "enabled": True, "pipeElements": [simple]}],
        }
        (folder / "settings.json").write_text(json.dumps(settings))
        self.port = free_port()
        self.log = folder / "server.log"
        command = [modules / NODE / "bin" / "node", modules / "signalk-server" / "bin" / "signalk-server", "-c", folder]
        # It asks nobody for a newer version.
        environment = {**os.environ, "PORT": str(self.port), "SIGNALK_DISABLE_SERVER_UPDATES": "1"}
        with self.log.open("wb") as log:
            self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=environment)

    def get(self, path: str) -> Any:
        """What its REST interface says of the boat's own `path`; None where it knows nothing."""
        address = f"http://127.0.0.1:{self.port}/signalk/v1/api/vessels/self/{path}"
        try:
            with urllib.request.urlopen(address, timeout=DEADLINE_S) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            if error.code == 404:
                return None
            raise

    def until(self, path: str, found: Any, what: str) -> Any:
        """Ask for `path` until `found` is true of it; that answer."""
        end = time.monotonic() + DEADLINE_S
        answer = None
        while True:
            assert self._process.poll() is None, f"the server has ended: {self.log.read_text()}"
            try:
                answer = self.get(path)
                if answer is not None and found(answer):
                    return answer
            except (ConnectionError, urllib.error.URLError):
                pass  # it is still starting
            assert time.monotonic() < end, (
                f"{what}: not within {DEADLINE_S} s: {answer}\n{self.log.read_text()[-2000:]}"
            )
            select.select([], [], [], 0.05)

    def close(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(DEADLINE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
