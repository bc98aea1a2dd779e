"""Real ptys for the workers to read, waiting for what they do, servers of the page and real browsers for it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from web_browser import DEADLINE_MS, SCREENSHOTS, SIZES
from web_process import WebProcess

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

DEADLINE_S = 15.0
DEBIAN_PYTHON = "/usr/bin/python3"  # with the aiohttp of the boards' Debian, the oldest that is supported


class PtyDevice:
    """A device that can be unplugged: a pty behind a link of a constant name, as udev makes it."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.path = str(link)
        self._master = -1
        self.plug()

    def plug(self) -> None:
        """Appear, under whatever name the kernel gives."""
        self._master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self._master, False)
        new = self.link.with_suffix(".new")
        new.symlink_to(os.ttyname(slave))
        new.rename(self.link)
        os.close(slave)

    def unplug(self) -> None:
        """Vanish, with the link."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1
            self.link.unlink()

    def write(self, chunk: bytes) -> int:
        """Send; how many bytes the pty took: a reader that stopped reading makes it less."""
        try:
            return os.write(self._master, chunk)
        except BlockingIOError:
            return 0


@pytest.fixture
def new_device(tmp_path: Path) -> Iterator[Callable[[str], PtyDevice]]:
    """Makes a device of a name."""
    devices: list[PtyDevice] = []

    def make(name: str) -> PtyDevice:
        devices.append(PtyDevice(tmp_path / name))
        return devices[-1]

    yield make
    for device in devices:
        device.unplug()


@pytest.fixture
def wait_for() -> Callable[[Callable[[], object], str], None]:
    """Repeats a step (which itself waits a little) until it gives something true; fails at the deadline."""

    def wait(step: Callable[[], object], what: str) -> None:
        end = time.monotonic() + DEADLINE_S
        while not step():
            assert time.monotonic() < end, f"{what}: not within {DEADLINE_S:.0f} s"

    return wait


@pytest.fixture(scope="module", params=["newest aiohttp", "Debian's aiohttp"])
def start_web(request: pytest.FixtureRequest) -> Iterator[Callable[..., WebProcess]]:
    """Starts output processes, which run until the module's end."""
    started: list[WebProcess] = []

    def run(**settings: Any) -> WebProcess:
        started.append(WebProcess(**settings))
        return started[-1]

    with pytest.MonkeyPatch.context() as patch:
        if request.param == "Debian's aiohttp":
            if subprocess.run([DEBIAN_PYTHON, "-c", "import aiohttp"], capture_output=True).returncode:
                why = "no aiohttp for the system's Python: apt install python3-aiohttp"
                pytest.fail(why) if os.environ.get("CI") else pytest.skip(why)
            patch.setattr(sys, "executable", DEBIAN_PYTHON)
        yield run
    for web in started:
        web.close()


@pytest.fixture
def token_file(tmp_path: Path) -> Path:
    return tmp_path / "config" / "token"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        why = "no chromium: apt install chromium"
        pytest.fail(why) if os.environ.get("CI") else pytest.skip(why)
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(params=SIZES)
def size(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def page(browser: Browser, size: str) -> Iterator[Page]:
    """A page of the size, whose scripts must not complain."""
    width, height = SIZES[size]
    page = browser.new_page(viewport={"width": width, "height": height})
    page.set_default_timeout(DEADLINE_MS)
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.complaints = complaints  # type: ignore[attr-defined]
    yield page
    page.close()
    assert not [text for text in complaints if "ERR_CONNECTION" not in text and "WebSocket" not in text]
