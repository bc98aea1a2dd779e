"""The page in Chromium, on the live program reading the ptys of a simulator of its own, as on a boat."""

from __future__ import annotations

import json
import os
import re
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
from playwright.sync_api import Page, expect
from web_browser import DEADLINE_MS, SAYS_SO_WITHIN_MS, SCREENSHOTS, show_panel
from web_process import free_port

from acquisition.simulator.ptys import LINK_NAMES

THEMES = ("dusk", "day", "night")
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


def open_live(page: Page, url: str, theme: str = "dusk") -> None:
    page.add_init_script(f"localStorage.setItem('theme', '{theme}')")
    page.goto(url)
    page.wait_for_selector("html[data-link=live][data-heading=ok]")


def state_of(page: Page, sensor: str) -> str:
    return str(page.locator(f"[data-sensor={sensor}] .state").text_content())


def cut_off(page: Page) -> list[str]:
    """What has no room sideways, or stands out of its tile or button."""
    wide = page.evaluate(
        """() => [...document.querySelectorAll("body, header, main, .panel, .tile, #facts, .task")]
          .filter((e) => e.offsetParent && e.scrollWidth > e.clientWidth).map((e) => e.className || e.id)"""
    )
    beside = page.evaluate(
        """() => [...document.querySelectorAll(".tile *, .task *")].filter((e) => e.offsetParent
          && e.getBoundingClientRect().right > e.closest(".tile, .task").getBoundingClientRect().right)
          .map((e) => e.parentNode.textContent)"""
    )
    return [*wide, *beside]


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
        expect(page.locator("#lost-detail")).to_contain_text("nothing heard for")
        expect(page.locator("#heading")).to_have_text("---")
        expect(page.locator("[data-sensor=gps1] .state")).to_have_text("✕ unknown")
        page.screenshot(path=SCREENSHOTS / f"{size}-lost.png")
        assert cut_off(page) == []
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
        assert cut_off(page) == []


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
