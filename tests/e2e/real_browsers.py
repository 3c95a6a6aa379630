"""Three browsers as one participant uses them: tabs that show, hear keys and feel the mouse.

Chromium by Playwright; Debian's Firefox over WebDriver BiDi, spoken to it directly; and WebKitGTK,
Safari's engine, through its own driver, on a screen of its own (Xvfb).
"""

import json
import os
import re
import shutil
import subprocess
import warnings
from abc import ABC, abstractmethod
from contextlib import contextmanager
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.remote.websocket_connection import WebSocketConnection
from selenium.webdriver.webkitgtk.options import Options

from pourcast.observers.browser import chromium

WIDTH, HEIGHT = 1366, 768
"""A laptop's screen [points]."""

MINI_BROWSER = next(Path("/usr/lib").glob("*/webkit2gtk-4.1/MiniBrowser"), None)

KEYS = {
    "Enter": "\ue007", "Tab": "\ue004", "Space": " ", "ArrowLeft": "\ue012",
    "ArrowRight": "\ue014", "ArrowDown": "\ue015", "PageUp": "\ue00e",
}  # fmt: skip
"""Keys as WebDriver names them."""


class Tab(ABC):
    """A page in some browser."""

    @abstractmethod
    def run(self, function, *arguments):
        """What a JavaScript function of the page returns."""

    @abstractmethod
    def point(self, x, y, *, press=False):
        """Move the mouse, and press it."""

    @abstractmethod
    def key(self, name, *, held=1):
        """Press a key; held down for longer it says so again and again."""

    @abstractmethod
    def go(self, link):
        """Open a page."""

    @abstractmethod
    def beside(self, link):
        """Open a page in another tab."""

    def reload(self):
        self.go(self.run("() => location.href"))


class ChromiumTab(Tab):
    def __init__(self, page):
        self.page = page

    def run(self, function, *arguments):
        return self.page.evaluate(f"given => ({function})(...given)", list(arguments))

    def point(self, x, y, *, press=False):
        self.page.mouse.move(x, y)
        if press:
            self.page.mouse.click(x, y)

    def key(self, name, *, held=1):
        for _ in range(held):
            self.page.keyboard.down(name)
        self.page.keyboard.up(name)

    def go(self, link):
        self.page.goto(link)

    def beside(self, link):
        other = ChromiumTab(self.page.context.new_page())
        other.go(link)
        return other


class FirefoxTab(Tab):
    def __init__(self, connection, context):
        self.connection, self.context = connection, context

    def send(self, method, **parameters):
        answer = self.connection.send_cmd(method, {"context": self.context, **parameters})
        assert answer["type"] == "success", answer
        return answer["result"]

    def run(self, function, *arguments):
        answer = self.send(
            "script.callFunction",
            functionDeclaration=f"async given => JSON.stringify("
            f"await ({function})(...JSON.parse(given)) ?? null)",
            arguments=[{"type": "string", "value": json.dumps(arguments)}],
            awaitPromise=True,
            target={"context": self.context},
        )
        assert answer["type"] == "success", answer
        return json.loads(answer["result"]["value"])

    def act(self, kind, actions, **more):
        self.send(
            "input.performActions", actions=[{"type": kind, "id": kind, "actions": actions, **more}]
        )

    def point(self, x, y, *, press=False):
        moves = [{"type": "pointerMove", "x": round(x), "y": round(y)}]
        presses = [{"type": one, "button": 0} for one in ("pointerDown", "pointerUp") if press]
        self.act("pointer", [*moves, *presses], parameters={"pointerType": "mouse"})

    def key(self, name, *, held=1):
        down = [{"type": "keyDown", "value": KEYS[name]}] * held
        self.act("key", [*down, {"type": "keyUp", "value": KEYS[name]}])

    def go(self, link):
        self.send("browsingContext.navigate", url=link, wait="complete")

    def beside(self, link):
        context = self.send("browsingContext.create", type="tab")["context"]
        other = FirefoxTab(self.connection, context)
        other.go(link)
        return other


class WebKitTab(Tab):
    def __init__(self, driver):
        self.driver, self.handle = driver, driver.current_window_handle

    def run(self, function, *arguments):
        self.driver.switch_to.window(self.handle)
        return self.driver.execute_script(f"return ({function})(...arguments)", *arguments)

    def point(self, x, y, *, press=False):
        self.driver.switch_to.window(self.handle)
        chain = ActionChains(self.driver, duration=0)
        chain.w3c_actions.pointer_action.move_to_location(round(x), round(y))
        if press:
            chain.click()
        chain.perform()

    def key(self, name, *, held=1):
        self.driver.switch_to.window(self.handle)
        chain = ActionChains(self.driver, duration=0)
        for _ in range(held):
            chain.key_down(KEYS[name])
        chain.key_up(KEYS[name]).perform()

    def go(self, link):
        self.driver.switch_to.window(self.handle)
        self.driver.get(link)

    def beside(self, link):
        # A window, as a tab stays behind the one before, where no key or mouse reaches it.
        self.driver.switch_to.new_window("window")
        self.driver.set_window_rect(0, 0, WIDTH, HEIGHT)
        other = WebKitTab(self.driver)
        other.go(link)
        return other


@contextmanager
def chromium_tab(_folder):
    with chromium() as browser:
        viewport = {"width": WIDTH, "height": HEIGHT}
        yield ChromiumTab(browser.new_context(viewport=viewport).new_page())


@contextmanager
def firefox_tab(folder, **preferences):
    """A tab of a Firefox with a new profile and these preferences besides."""
    profile = folder / "profile"
    profile.mkdir()
    given = {"full-screen-api.warning.timeout": 0} | preferences
    lines = [
        f"user_pref({json.dumps(name)}, {json.dumps(value)});\n" for name, value in given.items()
    ]
    (profile / "user.js").write_text("".join(lines))
    # The size of its screen.
    size = {"MOZ_HEADLESS_WIDTH": str(WIDTH), "MOZ_HEADLESS_HEIGHT": str(HEIGHT)}
    process = subprocess.Popen(
        ["firefox-esr", "--headless", "--no-remote", "--profile", profile,
         "--remote-debugging-port", "0"],
        stderr=subprocess.PIPE, text=True, env=os.environ | size,
    )  # fmt: skip
    found = (re.search(r"BiDi listening on (ws://\S+)", line) for line in process.stderr)
    address = next(filter(None, found))[1]
    connection = WebSocketConnection(f"{address}/session", 60, 0.005)
    try:
        connection.send_cmd("session.new", {"capabilities": {}})
        # The tab that it begins with leaves the keys to the field for addresses.
        created = connection.send_cmd("browsingContext.create", {"type": "tab"})
        yield FirefoxTab(connection, created["result"]["context"])
    finally:
        process.kill()  # its profile is thrown away
        process.wait()
        connection.close()
        process.stderr.close()


@contextmanager
def screen():
    """An X server of our own; yields its name."""
    reading, writing = os.pipe()
    process = subprocess.Popen(
        ["Xvfb", "-displayfd", str(writing), "-screen", "0", f"{WIDTH}x{HEIGHT}x24"],
        pass_fds=[writing], stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(writing)
    with os.fdopen(reading) as number:
        name = f":{number.readline().strip()}"
    try:
        yield name
    finally:
        process.terminate()
        process.wait()


@contextmanager
def webkit_tab(_folder):
    options = Options()
    options.binary_location = str(MINI_BROWSER)
    options.add_argument("--automation")
    with screen() as display:
        environment = {"DISPLAY": display, "GDK_BACKEND": "x11"}
        if os.geteuid() == 0:  # as root it can't have its sandbox
            environment["WEBKIT_DISABLE_SANDBOX_THIS_IS_DANGEROUS"] = "1"
        service = webdriver.WebKitGTKService(env=os.environ | environment)
        with warnings.catch_warnings():  # Selenium warns of its own call
            warnings.simplefilter("ignore", DeprecationWarning)
            driver = webdriver.WebKitGTK(options=options, service=service)
        try:
            driver.set_window_rect(0, 0, WIDTH, HEIGHT)
            yield WebKitTab(driver)
        finally:
            driver.quit()


BROWSERS = {
    "chromium": (chromium_tab, shutil.which("chromium")),
    "firefox": (firefox_tab, shutil.which("firefox-esr")),
    "webkit": (
        webkit_tab,
        MINI_BROWSER and shutil.which("WebKitWebDriver") and shutil.which("Xvfb"),
    ),
}
"""How a tab is had in each, and whether it is there (Debian: firefox-esr; webkit2gtk-driver xvfb)."""
