"""A report in a browser, as users act on it."""

import time
from pathlib import Path
from urllib.parse import parse_qsl

import numpy as np
from browsers import Browser, webdriver
from shapes import icosphere, noisy

CLEAN = icosphere(3)
ROUGH = noisy(CLEAN, 0.2)
FACE_ON = "view=0,0,1,0,0,0,3.2"
"""A camera in front of the middle of the mesh."""


class ReportBrowser(Browser):
    """A browser on a report."""

    def open(self, report: Path, view: str = FACE_ON) -> None:
        """Open a report, and wait until its meshes can be turned."""
        self.driver.get("about:blank")
        self.driver.get(f"{report.as_uri()}#{view}")
        while not self.js("return document.getElementById('viewer').dataset.state"):
            time.sleep(0.02)
        self.settle()

    def click(self, x: int, y: int) -> dict[str, str]:
        """Click a point of the canvas; what is said of the face there."""
        canvas = self.one("canvas")
        self.js("arguments[0].scrollIntoView({block: 'center'})", canvas)
        box = canvas.rect
        action = webdriver.ActionChains(self.driver, duration=0)  # by default the pointer takes 250 ms
        action.move_to_element_with_offset(canvas, x - int(box["width"] / 2), y - int(box["height"] / 2)).click()
        action.perform()
        self.settle()
        return self.js(
            "return Object.fromEntries([...document.querySelectorAll('.figures dt')]"
            ".map(e => [e.textContent, e.nextSibling.textContent]))"
        )

    def press(self, keys: str) -> None:
        self.one("canvas").send_keys(keys)
        self.settle()

    def state(self) -> dict[str, str]:
        """The view as the address holds it."""
        return dict(parse_qsl(self.address(), keep_blank_values=True))


def same_pixels(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return (np.abs(first - second) <= 2).all(axis=2)
