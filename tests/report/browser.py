"""A headless Chromium for tests, spoken to by the DevTools protocol over two pipes."""

import base64
import fcntl
import json
import os
import shutil
import signal
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

#: Names under which the browser is installed.
_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
#: Read from a pipe at once, bytes.
_CHUNK = 1 << 16


def chromium() -> str | None:
    """Path of the browser, None without one."""
    return next(filter(None, map(shutil.which, _NAMES)), None)


class Browser:
    """One page of a browser.

    Attributes:
        events: what the browser reported unasked, oldest first: method and parameters.
    """

    def __init__(self, folder: Path):
        """Start a browser that keeps its profile in a folder."""
        (theirs_in, ours_out), (ours_in, theirs_out) = os.pipe(), os.pipe()
        flags = [
            *("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run"),
            *("--disable-extensions", "--disable-background-networking", "--disable-component-update"),
            *("--disable-dev-shm-usage", f"--user-data-dir={folder}", "--remote-debugging-pipe"),
        ]
        # The browser reads from descriptor 3 and writes to 4; ours must be other ones.
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (theirs_in, theirs_out)]
        empty = [(os.POSIX_SPAWN_OPEN, number, os.devnull, os.O_RDWR, 0) for number in range(3)]
        self._process = os.posix_spawn(
            str(chromium()),
            ["chromium", *flags],
            os.environ,
            file_actions=[*empty, *((os.POSIX_SPAWN_DUP2, end, 3 + k) for k, end in enumerate(ends))],
        )
        for end in (theirs_in, theirs_out, *ends):
            os.close(end)
        self._in, self._out, self._rest, self._count = ours_in, ours_out, b"", 0
        self._session: str | None = None
        self.events: list[tuple[str, dict[str, Any]]] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):
            os.kill(self._process, signal.SIGTERM)
        os.waitpid(self._process, 0)
        os.close(self._in)
        os.close(self._out)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Give one command and return its result."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            stated = self._next()
            if stated.get("id") == self._count:
                if "error" in stated:
                    raise RuntimeError(f"{method}: {stated['error']}")
                return stated["result"]
            if "method" in stated:
                self.events.append((stated["method"], stated.get("params", {})))

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            part = os.read(self._in, _CHUNK)
            if not part:
                raise RuntimeError("the browser has ended")
            self._rest += part
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)

    def show(self, path: Path, width: int = 1280, height: int = 900, dark: bool = False) -> None:
        """Open a page from a file and wait until its figures are drawn."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.events.clear()
        self.call("Page.navigate", url=path.resolve().as_uri())
        self.run(
            "new Promise(done => { const ask = () => document.readyState === 'complete' ? done() :"
            " setTimeout(ask, 20); ask(); })"
        )
        self.frames()

    def run(self, code: str) -> Any:
        """Return the value of an expression on the page; of a promise what it comes to."""
        stated = self.call("Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in stated:
            raise RuntimeError(stated["exceptionDetails"].get("exception", {}).get("description", stated))
        return stated["result"].get("value")

    def frames(self, count: int = 3) -> None:
        """Wait for the page to be drawn so many times."""
        self.run(
            f"new Promise(done => {{ let left = {count};"
            " const next = () => left-- ? requestAnimationFrame(next) : done(); next(); })"
        )

    def press(self, key: str, code: str = "", text: str = "") -> None:
        """Press a key and let it go."""
        common = {"key": key, "code": code or key}
        self.call("Input.dispatchKeyEvent", type="keyDown", **common, **({"text": text} if text else {}))
        self.call("Input.dispatchKeyEvent", type="keyUp", **common)
        self.frames()

    def complaints(self) -> list[str]:
        """What the page has said on the console, thrown or been refused."""
        found = []
        for method, stated in self.events:
            if method == "Runtime.consoleAPICalled" and stated["type"] in ("error", "warning", "assert"):
                found.append(" ".join(str(part.get("value", part)) for part in stated["args"]))
            elif method == "Runtime.exceptionThrown":
                found.append(str(stated["exceptionDetails"]))
            elif method == "Log.entryAdded" and stated["entry"]["level"] in ("error", "warning"):
                found.append(stated["entry"]["text"])
        return found

    def requests(self) -> list[str]:
        """Addresses that the page has asked for, but for its own file and what lies within it."""
        asked = [
            stated["request"]["url"]
            for method, stated in self.events
            if method == "Network.requestWillBeSent"
        ]
        return [url for url in asked[1:] if not url.startswith(("data:", "blob:"))]

    def picture(self, path: Path, whole: bool = True) -> None:
        """Write a picture of the page."""
        stated = self.call("Page.captureScreenshot", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(stated["data"]))

    def pdf(self, path: Path) -> None:
        """Print the page."""
        stated = self.call("Page.printToPDF", printBackground=True, preferCSSPageSize=True)
        path.write_bytes(base64.b64decode(stated["data"]))
