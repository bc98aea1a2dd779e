"""The page in Chromium on a made-up boat: devices that lie, a program that falls silent, a token to be entered."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from web_browser import SAYS_SO_WITHIN_MS, show_panel
from web_process import WebProcess


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
