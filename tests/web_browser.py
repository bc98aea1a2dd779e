"""What the tests of the page share: sizes of the window, where pictures go, how a panel is shown."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page

SCREENSHOTS = Path(__file__).resolve().parents[1] / "build" / "screenshots"
SIZES = {"lcd": (800, 480), "phone": (390, 844), "desktop": (1440, 900)}
DEADLINE_MS = 20_000
SAYS_SO_WITHIN_MS = 3_000  # what the page promises of a lost connection


def show_panel(page: Page, name: str) -> None:
    """Choose a panel, where there are tabs to choose by."""
    tab = page.locator(f"#tab-{name}")
    if tab.is_visible():
        tab.click()
