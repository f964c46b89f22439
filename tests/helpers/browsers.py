"""A real browser, driven by the tests of pages."""

import io
import shlex
import shutil
from base64 import b64decode
from contextlib import contextmanager

import numpy as np
import pytest
from PIL import Image

webdriver = pytest.importorskip("selenium.webdriver")

CHROMIUM, DRIVER = (shutil.which(name) for name in ("chromium", "chromedriver"))
OPTIONS = (
    "--headless=new",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
)
needs_browser = pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="chromium and chromedriver are not installed")


class Browser:
    """A browser on a page."""

    def __init__(self, *, webgl: bool = True) -> None:
        options = webdriver.ChromeOptions()
        options.binary_location = CHROMIUM
        for option in (*OPTIONS, *(() if webgl else ("--disable-3d-apis",))):
            options.add_argument(option)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
        self.driver.set_script_timeout(24 * 3600)  # machines under load are slow
        self.driver.set_page_load_timeout(24 * 3600)
        self.sized(1200, 800)

    def close(self) -> None:
        """End the browser."""
        self.driver.quit()

    def sized(self, width: int, height: int, *, dark: bool = False) -> None:
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600},
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        motion = {"name": "prefers-reduced-motion", "value": "reduce"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme, motion]})

    def js(self, code: str, *arguments):
        return self.driver.execute_script(code, *arguments)

    def settle(self) -> None:
        """Wait until what was asked for has been drawn."""
        self.driver.execute_async_script(
            "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 60)));"
        )

    def address(self) -> str:
        """The view as the address holds it, which the page writes a moment after the view has changed."""
        self.driver.execute_async_script("setTimeout(arguments[0], 300)")  # the timer of the page ends before
        return self.js("return location.hash.slice(1)")

    def one(self, selector: str):
        return self.driver.find_element("css selector", selector)

    def button(self, text: str):
        buttons = self.driver.find_elements("css selector", "button")
        return next(button for button in buttons if button.text == text and button.is_displayed())

    def press_button(self, text: str) -> None:
        self.button(text).click()
        self.settle()

    @contextmanager
    def starting_with(self, script: str):
        """Run a script before those of each page that is opened in the block."""
        added = self.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": script})
        try:
            yield
        finally:
            self.driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)

    def copied_view(self) -> list[str]:
        """Copy the view as a command line, and return its words."""
        self.js("Object.defineProperty(navigator, 'clipboard', {value: undefined})")  # so that the page shows it
        self.press_button("Copy view as command line")
        return shlex.split(self.one(".panel code").text)

    def canvas(self) -> np.ndarray:
        """The pixels of the canvas with what lies over it, (height, width, 3)."""
        return self.pixels(".stage")

    def pixels(self, selector: str) -> np.ndarray:
        box = self.js(
            "const e = document.querySelector(arguments[0]); e.scrollIntoView({block: 'center'});"
            "const b = e.getBoundingClientRect(); return [b.x + scrollX, b.y + scrollY, b.width, b.height]",
            selector,
        )
        self.settle()
        clip = dict(zip(("x", "y", "width", "height"), box, strict=True), scale=1)
        shot = {"format": "png", "clip": clip, "captureBeyondViewport": True, "optimizeForSpeed": True}
        data = b64decode(self.driver.execute_cdp_cmd("Page.captureScreenshot", shot)["data"])
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)
