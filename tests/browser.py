"""A browser for tests: Debian's chromium, driven by Playwright."""

import os
import shutil
import tempfile
from contextlib import contextmanager
from pathlib import Path

CHROMIUM = shutil.which("chromium")
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
LOADING = 90e3  # ms for the page on a busy machine without a graphics card


@contextmanager
def opened(address, width=1400, height=900, *, button="Launch a ball", dark=False):
    """Open a page, and wait for a button of it; yield it with the list of its console errors. A failure tells of a picture of the page."""
    from playwright.sync_api import sync_playwright

    environment = {k: v for k, v in os.environ.items() if not k.lower().endswith("_proxy")}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS, env=environment)
        try:
            page, errors = browser.new_page(viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light"), []
            page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
            page.on("pageerror", lambda error: errors.append(str(error)))
            page.set_default_timeout(LOADING)
            page.goto(address, wait_until="commit")
            page.get_by_role("button", name=button).wait_for()
            try:
                yield page, errors
            except BaseException as error:
                picture = Path(tempfile.mkdtemp()) / "page.png"
                page.screenshot(path=picture)
                error.add_note(f"the page then: {picture}")
                raise
        finally:
            browser.close()
