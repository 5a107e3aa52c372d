"""A real browser, and a page without ROS behind it."""

import io
from pathlib import Path

import numpy as np
import pytest

CHROMIUM = Path('/usr/bin/chromium')
# Software rendering, and nothing that Chromium does on its own account.
_FLAGS = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--use-gl=angle',
    '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--no-first-run',
)


@pytest.fixture(scope='module')  # two of Playwright's at once in one thread are refused
def browser():
    playwright = pytest.importorskip('playwright.sync_api', reason='playwright is not installed')
    if not CHROMIUM.exists():
        pytest.skip(f'no {CHROMIUM}; on Debian: apt install chromium')
    with playwright.sync_playwright() as p:
        chromium = p.chromium.launch(executable_path=str(CHROMIUM), args=_FLAGS)
        yield chromium
        chromium.close()


class Tab:
    """A page in the browser; whatever it asks the network for is noted."""

    def __init__(self, browser):
        self.page = browser.new_page(viewport={'width': 1100, 'height': 800})
        self.page.set_default_timeout(60_000)
        self.asked = []
        self.page.on('request', lambda request: self.asked.append(request.url))
        self.page.on('websocket', lambda socket: self.asked.append(socket.url))

    def open(self, address):
        self.page.goto(address)
        self.page.locator('canvas').first.wait_for()

    def picture(self):
        """What is on the screen, (height, width, 3), uint8; the panel on the right is left out."""
        from PIL import Image

        shot = Image.open(io.BytesIO(self.page.screenshot(timeout=120_000))).convert('RGB')
        return np.asarray(shot)[:, :690]

    def where(self, is_colour):
        """Middle of the pixels of a colour, (x, y), and their number."""
        rgb = self.picture().astype(int)
        y, x = np.nonzero(is_colour(rgb[..., 0], rgb[..., 1], rgb[..., 2]))
        return (x.mean(), y.mean(), len(x)) if len(x) else (np.nan, np.nan, 0)

    def until(self, condition, what, tries=150):
        for _ in range(tries):
            if result := condition():
                return result
            self.page.wait_for_timeout(100)
        raise AssertionError(f'waited in vain: {what}')

    def field(self, label):
        """The input beside a label; viser does not tie the two together."""
        name = self.page.locator('label').get_by_text(label, exact=True)
        row = self.page.locator('.mantine-Flex-root').filter(has=name)
        return row.locator('input').filter(visible=True).first

    def choose(self, label, option):
        self.field(label).click()
        self.page.get_by_role('option', name=option, exact=True).click()

    def press(self, button):
        self.page.get_by_role('button', name=button, exact=True).click()

    def go_to(self, tab):
        self.page.get_by_role('tab', name=tab, exact=True).click()


@pytest.fixture
def tab(browser):
    one = Tab(browser)
    yield one
    one.page.close()
