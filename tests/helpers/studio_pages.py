"""The page of a studio in a browser, as users act on it."""

import re
import time
from base64 import b64encode

from browsers import Browser, webdriver

LONGEST_WAIT_S = 300.0
"""Limit of a wait, for what never comes, such as the answer to a lost event. `.ci/run` ends a test after three times as
long, and then nobody learns what the page showed."""
DROP = """
const data = new DataTransfer();
for (const [name, text] of arguments[0]) {
  data.items.add(new File([Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0))], name));
}
document.body.dispatchEvent(new DragEvent('drop', {dataTransfer: data, bubbles: true, cancelable: true}));
"""


class Page(Browser):
    """A browser on the page of a studio."""

    answers = 0

    def at(self, studio):
        self.studio = studio
        self.driver.get("about:blank")
        self.driver.get(studio.address)
        return self

    def wait(self, state="shown", *, more=False):
        """Wait until the page is in a state and has drawn it; with `more`, with another answer than the last."""
        found = (
            "const {state, answers} = document.getElementById('studio').dataset; return [state, Number(answers ?? 0)]"
        )

        def told():
            shown, answers = self.js(found)
            return [answers] if shown == state and not (more and answers <= self.answers) else None

        aim = f"the state {state}, with more than {self.answers} answers" if more else f"the state {state}"
        self.answers = self.until(told, aim, running=state != "ended")[0]
        self.settle()

    def until(self, reached, aim, *, running=True):
        """Return the first true result of a function; fail if the studio ends before, unless it may, or at a limit."""
        limit = time.monotonic() + LONGEST_WAIT_S
        while not (found := reached()):
            assert not running or self.studio.process.poll() is None, (f"the studio ended before {aim}", self.text())
            assert time.monotonic() < limit, (f"the page did not reach {aim}", self.text())
            time.sleep(0.02)
        return found

    def text(self):
        """What the page shows."""
        return self.one("#studio").text

    def begun(self):
        """Wait until the answer to a change is shown."""
        self.wait(more=True)

    def drop(self, *files, replacing=False):
        """Drop files; with `replacing`, agree that what is not saved is lost."""
        self.js(DROP, [[file.name, b64encode(file.read_bytes()).decode()] for file in files])
        if replacing:
            self.press_button(f"Open {files[0].name}")

    def fill(self, selector, value):
        """Change a field as a user does who leaves it then."""
        self.js(
            "const e = document.querySelector(arguments[0]); e.value = arguments[1];"
            "for (const kind of ['input', 'change']) e.dispatchEvent(new Event(kind, {bubbles: true}))",
            selector,
            value,
        )

    def said(self, selector, pattern):
        """Wait until a text is there."""
        text = "return document.querySelector(arguments[0]).innerText"
        return self.until(lambda: re.search(pattern, self.js(text, selector)), f"the text {pattern}")[0]

    def drag(self, start, *steps):
        """Press at a place of the canvas, in pixels from its middle, and drag along steps."""
        self.settle()  # a screenshot resizes the page for a moment, and with it the canvas
        action = webdriver.ActionChains(self.driver, duration=60)
        action.move_to_element_with_offset(self.one("canvas"), *start).click_and_hold()
        for step in steps:
            action.move_by_offset(*step)
        action.release().perform()
        self.settle()
