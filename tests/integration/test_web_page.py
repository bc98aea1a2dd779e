"""The page in Chromium, on the live program reading the ptys of a simulator of its own, as on a boat."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect, sync_playwright
from web_process import WebProcess, free_port

from acquisition.simulator.ptys import LINK_NAMES

ROOT = Path(__file__).resolve().parents[2]
SCREENSHOTS = ROOT / "build" / "screenshots"
SIZES = {"lcd": (800, 480), "phone": (390, 844), "desktop": (1440, 900)}
THEMES = ("dusk", "day", "night")
DEADLINE_MS = 20_000
SAYS_SO_WITHIN_MS = 3_000  # what the page promises of a lost connection
TASKS = (
    *("gps1", "gps2", "gps3", "compass", "imu"),
    *("cnw-s1", "cnw-s2", "ekf1", "ekf2", "ekf3", "cnw-s3"),
)


class Boat:
    """A simulator on ptys and the live program with --web, which can be killed and started again."""

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self._folder = folder
        self._simulator = subprocess.Popen(
            [sys.executable, "-m", "tinyekf_py.cli", "simulate", "--ptys", "--links", str(folder)],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        ports = "".join(f'[sensors.{name}]\nport = "{folder / link}"\n' for name, link in LINK_NAMES.items())
        (folder / "tinyekf.toml").write_text(f"{ports}[outputs.web]\nport = {self.port}\n")
        self._program: subprocess.Popen[bytes] | None = None
        self.start()

    def start(self) -> None:
        """Start the program, and wait for its heading."""
        with (self._folder / "run.log").open("ab") as log:
            self._program = subprocess.Popen(
                [sys.executable, "-m", "tinyekf_py.run", "--config", str(self._folder / "tinyekf.toml"), "--web"],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log,
                env={**os.environ, "XDG_RUNTIME_DIR": str(self._folder)},
            )  # fmt: skip
        end = time.monotonic() + DEADLINE_MS / 1000
        while True:
            try:
                if self.state()["estimate"]["mode"] == "ok":
                    return
            except OSError:
                pass
            assert self._program.poll() is None, (self._folder / "run.log").read_text()
            assert time.monotonic() < end, "no heading"
            time.sleep(0.1)  # a poll of something that tells nobody when it is ready

    def state(self) -> Any:
        """What /api/state says."""
        with urllib.request.urlopen(f"{self.url}/api/state", timeout=5) as answer:
            return json.load(answer)

    def kill(self) -> None:
        """The program is gone at once, with its processes."""
        assert self._program is not None
        self._program.send_signal(signal.SIGKILL)
        self._program.wait()

    def close(self) -> None:
        self.kill()
        self._simulator.terminate()
        self._simulator.wait()


@pytest.fixture(scope="module")
def boat(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Boat]:
    boat = Boat(tmp_path_factory.mktemp("boat"))
    yield boat
    boat.close()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
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


def open_live(page: Page, url: str, theme: str = "dusk") -> None:
    page.add_init_script(f"localStorage.setItem('theme', '{theme}')")
    page.goto(url)
    page.wait_for_selector("html[data-link=live][data-heading=ok]")


def show_panel(page: Page, name: str) -> None:
    tab = page.locator(f"#tab-{name}")
    if tab.is_visible():
        tab.click()


def state_of(page: Page, sensor: str) -> str:
    return str(page.locator(f"[data-sensor={sensor}] .state").text_content())


def test_the_heading_is_that_of_the_api(page: Page, boat: Boat) -> None:
    """Message for message; and /api/state gives the same object."""
    page.add_init_script(
        """window.seen = [];
        const Real = WebSocket;
        window.WebSocket = class extends Real {
          constructor(...all) {
            super(...all);
            this.addEventListener("message", (event) => {
              const { state } = JSON.parse(event.data);
              if (state) queueMicrotask(() => window.seen.push([state.estimate.heading_deg, state.elapsed_s]));
            });
          }
        };"""
    )
    open_live(page, boat.url)
    shown = page.evaluate(
        """() => new Promise((done) => {
          const pairs = [];
          const timer = setInterval(() => {
            const last = window.seen.at(-1);
            if (last) pairs.push([document.getElementById("heading").textContent, last[0], last[1]]);
            if (pairs.length >= 40) { clearInterval(timer); done(pairs); }
          }, 50);
        })"""
    )
    assert len({text for text, _, _ in shown}) > 3  # it moves
    for text, heading_deg, _ in shown:
        assert text == f"{round(heading_deg * 10) / 10 % 360:05.1f}" or abs(float(text) - heading_deg) <= 0.0501
    api = boat.state()
    assert abs((api["estimate"]["heading_deg"] - float(page.inner_text("#heading")) + 180) % 360 - 180) < 15
    assert api["elapsed_s"] >= shown[-1][2]


def test_stopping_gps2_in_the_page_changes_tile_and_weights(page: Page, boat: Boat, size: str) -> None:
    open_live(page, boat.url)
    expect(page.locator("[data-sensor=gps2] .state")).to_have_text("● open")
    show_panel(page, "tasks")
    page.locator("[data-task=gps2]").click()
    expect(page.locator("[data-task=gps2]")).to_contain_text("stopped")
    show_panel(page, "sensors")
    expect(page.locator("[data-sensor=gps2] .state")).to_have_text("■ stopped")
    expect(page.locator("[data-sensor=gps2] .weight i.on")).to_have_count(0)
    expect(page.locator("#mode-word")).to_have_text("DEGRADED")
    expect(page.locator("#alarms")).to_contain_text("gps2 stopped")
    page.screenshot(path=SCREENSHOTS / f"{size}-gps2-stopped.png")
    assert boat.state()["estimate"]["weights"][1] == 0
    show_panel(page, "tasks")
    page.locator("[data-task=gps2]").click()
    show_panel(page, "sensors")
    expect(page.locator("[data-sensor=gps2] .state")).to_have_text("● open")
    expect(page.locator("[data-sensor=gps2] .weight i.on")).not_to_have_count(0)
    expect(page.locator("#mode-word")).to_have_text("OK")


def test_each_task_and_all_of_them_have_a_button(page: Page, boat: Boat) -> None:
    open_live(page, boat.url)
    show_panel(page, "tasks")
    expect(page.locator("#task-buttons button")).to_have_count(len(TASKS))
    for name in TASKS:
        button = page.locator(f"[data-task={name}]")
        button.click()
        expect(button).to_have_attribute("aria-pressed", "false")
    assert not any(task["running"] for task in boat.state()["tasks"])
    expect(page.locator("#mode-word")).to_have_text("NO HEADING")
    expect(page.locator("#heading")).to_have_text("---")
    page.click("#start-all")
    for name in TASKS:
        expect(page.locator(f"[data-task={name}]")).to_have_attribute("aria-pressed", "true")
    expect(page.locator("#mode-word")).to_have_text("OK")
    page.click("#stop-all")  # asks first
    expect(page.locator("#stop-all")).to_contain_text("Sure?")
    assert all(task["running"] for task in boat.state()["tasks"])


def test_everything_can_be_done_by_keyboard(page: Page, boat: Boat) -> None:
    open_live(page, boat.url)
    show_panel(page, "sensors")
    page.keyboard.press("2")
    expect(page.locator("[data-sensor=gps2] .state")).to_have_text("■ stopped")
    page.keyboard.press("2")
    expect(page.locator("[data-sensor=gps2] .state")).to_have_text("● open")
    for theme in ("day", "night", "dusk"):
        page.keyboard.press("n")
        expect(page.locator("html")).to_have_attribute("data-theme", theme)
    page.keyboard.press("?")
    expect(page.locator("#keys")).to_be_visible()
    expect(page.locator("#key-list")).to_contain_text("start or stop gps2")
    page.keyboard.press("2")  # nothing behind a dialog
    page.keyboard.press("Escape")
    expect(page.locator("#keys")).to_be_hidden()
    assert all(task["running"] for task in boat.state()["tasks"])
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.dataset.task || ''"))
    assert {"sound", "theme", "help"} <= reached
    if page.locator("#tab-sensors").is_visible():
        page.locator("#tab-sensors").focus()
        for name in ("charts", "track", "tasks"):
            page.keyboard.press("ArrowRight")
            expect(page.locator(f"#{name}")).to_be_visible()
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.dataset.task || ''"))
    assert "gps1" in reached


def test_a_killed_server_is_told_of_at_once_and_comes_back_by_itself(page: Page, boat: Boat, size: str) -> None:
    open_live(page, boat.url)
    boat.kill()
    try:
        expect(page.locator("#lost-title")).to_have_text("✕ CONNECTION LOST", timeout=SAYS_SO_WITHIN_MS)
        expect(page.locator("#lost")).to_be_visible()
        expect(page.locator("#heading")).to_have_text("---")
        expect(page.locator("[data-sensor=gps1] .state")).to_have_text("✕ unknown")
        page.screenshot(path=SCREENSHOTS / f"{size}-lost.png")
    finally:
        boat.start()
    page.wait_for_selector("html[data-link=live][data-heading=ok]")
    expect(page.locator("#lost")).to_be_hidden()
    expect(page.locator("#heading")).to_have_text(re.compile(r"^\d{3}\.\d$"))


@pytest.mark.parametrize("theme", THEMES)
def test_axe_finds_no_serious_fault(page: Page, boat: Boat, size: str, theme: str) -> None:
    open_live(page, boat.url, theme)
    page.wait_for_timeout(1000)  # so that the picture has something in its charts
    page.screenshot(path=SCREENSHOTS / f"{size}-{theme}.png")
    for panel in ("sensors", "charts", "track", "tasks"):
        show_panel(page, panel)
        if theme == "dusk" and size != "desktop":
            page.screenshot(path=SCREENSHOTS / f"{size}-{panel}.png")
        found = Axe().run(page).response
        assert len(found["passes"]) > 15
        faults = found["violations"]
        serious = [
            (v["id"], v["nodes"][0]["html"], v["help"]) for v in faults if v["impact"] in ("serious", "critical")
        ]
        assert not serious


def test_nothing_is_cut_off_sideways(page: Page, boat: Boat) -> None:
    open_live(page, boat.url)
    for panel in ("sensors", "charts", "track", "tasks"):
        show_panel(page, panel)
        wide = page.evaluate(
            """() => [...document.querySelectorAll("body, header, main, .panel, .tile, #facts, .task")]
              .filter((e) => e.offsetParent && e.scrollWidth > e.clientWidth + 1).map((e) => e.className || e.id)"""
        )
        assert wide == []
        beside = page.evaluate(
            """() => [...document.querySelectorAll(".tile *, .task *")].filter((e) => e.offsetParent
              && e.getBoundingClientRect().right > e.closest(".tile, .task").getBoundingClientRect().right)
              .map((e) => e.parentNode.textContent)"""
        )
        assert beside == []


def test_a_course_is_never_called_a_heading(page: Page, boat: Boat) -> None:
    open_live(page, boat.url)
    show_panel(page, "sensors")
    for name in ("gps1", "gps2", "gps3"):
        expect(page.locator(f"[data-sensor={name}] .own small").first).to_have_text("COG")
    expect(page.locator("[data-sensor=compass] .own small").first).to_have_text("HDG")
    expect(page.locator("#facts")).to_contain_text("COG")
    assert page.locator(".needle.course").count() == 3
    assert page.locator(".needle:not(.course)").count() == 1


def test_the_page_is_small_and_from_here_alone(page: Page, boat: Boat) -> None:
    weights: dict[str, int] = {}
    page.on("response", lambda response: weights.update({response.url: len(response.body())}))
    open_live(page, boat.url)
    assert len(weights) >= 9
    assert sum(weights.values()) <= 150_000
    assert all(url.startswith(boat.url) for url in weights)


@pytest.fixture
def made_up(size: str) -> Iterator[WebProcess]:
    web = WebProcess()
    yield web
    web.close()


def test_what_devices_say_is_text(page: Page, made_up: WebProcess) -> None:
    page.goto(f"http://127.0.0.1:{made_up.port}")
    page.wait_for_selector("html[data-link=live]")
    expect(page.locator("[data-sensor=gps2] .why")).to_contain_text("<img src=x onerror=")
    assert page.locator("img").count() == 0
    assert "owned" not in page.title()


def test_a_program_that_falls_silent_is_told_of(page: Page, made_up: WebProcess) -> None:
    """The web server lives, the fusion does not."""
    page.goto(f"http://127.0.0.1:{made_up.port}")
    page.wait_for_selector("html[data-link=live][data-heading=ok]")
    made_up.silent.set()
    expect(page.locator("#mode-word")).to_have_text("NO HEADING", timeout=SAYS_SO_WITHIN_MS)
    expect(page.locator("#heading")).to_have_text("---")
    made_up.silent.clear()
    expect(page.locator("#heading")).to_have_text("123.4")


def test_a_page_opened_late_shows_five_minutes_at_once(page: Page, made_up: WebProcess) -> None:
    made_up.sail_quickly(10_000.0, 420.0)
    page.goto(f"http://127.0.0.1:{made_up.port}")
    expect(page.locator("#charts")).to_have_attribute("data-seconds", re.compile(r"^(29[5-9]|300)$"))


def test_a_page_that_may_not_read_asks_for_the_token(page: Page, tmp_path: Path) -> None:
    token_file = tmp_path / "token"
    web = WebProcess(read_token=True, token_file=str(token_file))
    try:
        page.goto(f"http://127.0.0.1:{web.port}")
        expect(page.locator("#login")).to_be_visible()
        page.click("#login-cancel")
        expect(page.locator("#lost-title")).to_have_text("✕ LOCKED")
        expect(page.locator("#heading")).to_have_text("---")
        page.click("#unlock")
        page.fill("#token", token_file.read_text())
        page.keyboard.press("Enter")
        expect(page.locator("#heading")).to_have_text("123.4")
        page.goto("about:blank")
        page.context.clear_cookies()
        page.goto(f"http://127.0.0.1:{web.port}/#token={token_file.read_text().strip()}")
        expect(page.locator("#heading")).to_have_text("123.4")
        assert page.url == f"http://127.0.0.1:{web.port}/"
    finally:
        web.close()


def test_the_token_is_entered_once(page: Page, tmp_path: Path) -> None:
    token_file = tmp_path / "token"
    web = WebProcess(names=["boat.local"], token_file=str(token_file))
    try:
        page.goto(f"http://127.0.0.1:{web.port}")
        page.wait_for_selector("html[data-link=live]")
        show_panel(page, "tasks")
        expect(page.locator("[data-task=gps2]")).to_be_disabled()
        page.click("#unlock")
        page.fill("#token", "wrong")
        page.keyboard.press("Enter")
        expect(page.locator("#login-error")).to_have_text("the token is wrong")
        page.fill("#token", token_file.read_text().strip())
        page.keyboard.press("Enter")
        expect(page.locator("#login")).to_be_hidden()
        page.locator("[data-task=gps2]").click()
        expect(page.locator("[data-task=gps2]")).to_contain_text("stopped")
        page.reload()
        page.wait_for_selector("html[data-link=live]")
        show_panel(page, "tasks")
        expect(page.locator("[data-task=gps2]")).to_be_enabled()
        assert page.evaluate("document.cookie + JSON.stringify({...localStorage, ...sessionStorage})").count("-") == 0
        page.complaints.clear()  # type: ignore[attr-defined]  # the 401 of the wrong token
    finally:
        web.close()
