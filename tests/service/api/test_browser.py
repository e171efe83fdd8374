"""The page in a real browser; skips, saying so, where playwright or Debian's chromium is absent."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import uvicorn

from service.store.model_records import ExplanationEnd
from service.store.records import StepParameters
from tests.service.api.house import NOON, House, run_map, run_products
from tests.service.api.test_models import FINDING, proposed

CHROMIUM = Path("/usr/bin/chromium")


@pytest.fixture
def playwright() -> Any:
    """Ask for the browser before anything is served."""
    if not CHROMIUM.exists():
        pytest.skip(f"no browser: {CHROMIUM} is absent")
    return pytest.importorskip("playwright.sync_api", reason="playwright is not installed")


@pytest.fixture
def address(playwright: Any, nights: House) -> Iterator[str]:
    """Serve the application on a free port of the loopback."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = uvicorn.Server(uvicorn.Config(nights.client.app, port=port, log_level="error"))
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.05)
    yield f"http://127.0.0.1:{port}/"
    server.should_exit = True
    thread.join()


@pytest.fixture
def page(playwright: Any, address: str) -> Iterator[Any]:
    """Open the page and wait until it shows the axes."""
    with playwright.sync_playwright() as driver:
        flags = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync"]
        browser = driver.chromium.launch(executable_path=str(CHROMIUM), args=flags)
        opened = browser.new_page(viewport={"width": 400, "height": 800})
        asked: list[str] = []
        opened.on("request", lambda request: asked.append(request.url))
        opened.goto(address)
        opened.wait_for_selector(".card")
        yield opened
        assert [url for url in asked if not url.removeprefix("blob:").startswith(address)] == []
        browser.close()


def test_a_technician_checks_and_acknowledges_by_keyboard(page: Any, nights: House) -> None:
    page.get_by_role("button", name="Acknowledge").focus()
    page.keyboard.press("Enter")
    page.keyboard.type("A. Smith")
    page.keyboard.press("Enter")
    page.wait_for_selector("text=Seen by A. Smith")
    page.get_by_role("button", name="Check Y now").focus()
    page.keyboard.press("Enter")
    page.keyboard.press("Enter")
    assert nights.repository.unfinished_run() is None, "Enter in the warning before a move must cancel"
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Move and measure").click()
    page.wait_for_selector("text=waiting")
    assert nights.repository.unfinished_run() is not None


def test_a_technician_reads_a_finding_and_accepts_it(page: Any, nights: House, tmp_path: Path) -> None:
    revision = proposed(nights)
    page.wait_for_selector("text=The model lacks a time lag")
    page.screenshot(path=str(tmp_path / "proposal.png"), full_page=True)
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    assert page.get_by_role("link", name="Show why").first.get_attribute("href").endswith("/report")
    page.get_by_role("button", name="Accept").click()
    page.get_by_label("Your name").last.fill("A. Smith")
    page.get_by_role("button", name="Decide").click()
    page.wait_for_selector("text=accepted by A. Smith")
    assert nights.repository.models.revision(revision).decided_by == "A. Smith"


def test_a_technician_makes_the_move_that_tells_two_effects_apart(page: Any, nights: House) -> None:
    move = {"length_m": 0.008, "jerk_m_s3": 50.0, "direction": -1, "position": "as before", "why": "slower"}
    alike = FINDING | {"indistinguishable": [["sensor_latency", "speed_filter"]], "separating_move": move}
    number = nights.loop.explain(21, ())
    nights.repository.models.finish(ExplanationEnd(number, "done", NOON, None, {"axes": [alike]}))
    page.get_by_role("button", name="Make the move that tells them apart").click()
    page.wait_for_selector("text=steps of 8.0 mm with a jerk of 50 m/s³")
    page.get_by_role("button", name="Move", exact=True).click()
    page.wait_for_selector("text=separating move, no measurement")
    run = nights.repository.unfinished_run()
    assert run is not None
    assert run.steps == StepParameters(0.008, 50.0, -1)


def test_the_page_fits_a_narrow_screen_and_opens_a_run(page: Any) -> None:
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    page.locator(".run-head").first.click()
    page.wait_for_selector(".run-body table")
    assert page.locator(".run-body tbody tr").count() == 10
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


def test_a_technician_sees_where_the_rack_is_worn(page: Any, nights: House, tmp_path: Path) -> None:
    run_map(nights.repository, 30)
    map_of_y = page.get_by_role("img", name="Y along the rack")
    map_of_y.wait_for()
    assert "at 0.00 m 47.0 (45.0 to 48.0) µm" in map_of_y.get_attribute("aria-label")
    assert "at 0.60 m no value" in map_of_y.get_attribute("aria-label")
    page.screenshot(path=str(tmp_path / "map.png"), full_page=True)
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


def test_a_planner_opens_the_trends_beside_the_backlash(page: Any, nights: House, tmp_path: Path) -> None:
    for day in range(30, 60):
        run_products(nights.repository, day, 7e5 * (1.0 - 0.005 * (day - 55)))
    summary = page.get_by_text("Stiffness and friction: contact stiffness falling 15 % a month")
    summary.click()
    assert page.locator(".products li").count() == 3
    page.screenshot(path=str(tmp_path / "products.png"), full_page=True)
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    run_map(nights.repository, 61)
    page.get_by_role("img", name="Y along the rack").wait_for()
    assert page.locator(".products[open]").count() == 1, "open tables stay open when the card is drawn anew"
