"""Headless Chromium, driven through its DevTools over a pipe: no other packages, no ports."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-background-networking",
    "--window-size=1000,700",
    "--touch-events=enabled",
)


class Chromium:
    """One page in a browser of its own. Every network request of the page is kept in `requests`."""

    def __init__(self, profile: Path) -> None:
        program = shutil.which("chromium") or shutil.which("chromium-browser")
        assert program, "the browser's tests need Chromium: apt install chromium"
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()

        def move() -> None:
            # The browser reads from descriptor 3 and writes to 4. Duplicates first: the numbers may be taken.
            one, two = os.dup(to_browser), os.dup(from_browser)
            os.dup2(one, 3)
            os.dup2(two, 4)

        self._process = subprocess.Popen(
            [program, *FLAGS, f"--user-data-dir={profile}", "--remote-debugging-pipe", "about:blank"],
            preexec_fn=move,
            close_fds=False,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._buffer = b""
        self._count = 0
        self._session: str | None = None
        self.requests: list[str] = []
        self.errors: list[str] = []
        pages = self.send("Target.getTargets")["targetInfos"]
        target = next(page["targetId"] for page in pages if page["type"] == "page")
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")

    def close(self) -> None:
        """End the browser."""
        self._process.terminate()
        self._process.wait(timeout=20)
        os.close(self._out)
        os.close(self._in)

    def send(self, method: str, **parameters: Any) -> Any:
        """Call a method of the protocol and return its result."""
        self._count += 1
        message: dict[str, Any] = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == self._count:
                assert "error" not in answer, answer["error"]
                return answer["result"]
            self._keep(answer)

    def _read(self) -> Any:
        while b"\0" not in self._buffer:
            chunk = os.read(self._in, 1 << 16)
            assert chunk, "the browser has gone"
            self._buffer += chunk
        line, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(line)

    def _keep(self, event: Any) -> None:
        method, parameters = event.get("method"), event.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(parameters["exceptionDetails"])[:500])
        elif method == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.errors.append(parameters["entry"]["text"])

    def open(self, path: Path) -> None:
        """Open a file and wait until it is drawn."""
        self.send("Page.navigate", url=path.as_uri())
        for _ in range(100):
            if self.evaluate("document.readyState") == "complete":
                break
            time.sleep(0.05)
        self.settle()

    def settle(self) -> None:
        """Wait for two frames to be drawn."""
        self.evaluate(
            "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))"
        )

    def evaluate(self, expression: str) -> Any:
        """The value of an expression in the page; promises are awaited."""
        found = self.send("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def pixels(self, selector: str) -> str:
        """A canvas as the address of its data."""
        self.settle()
        return self.evaluate(f"document.querySelector({selector!r}).toDataURL()")

    def colours(self, selector: str) -> int:
        """How many different colours a canvas shows."""
        self.settle()
        return self.evaluate(
            f"""(() => {{
              const from = document.querySelector({selector!r}), to = document.createElement("canvas");
              to.width = from.width; to.height = from.height;
              const g = to.getContext("2d"); g.drawImage(from, 0, 0);
              const d = g.getImageData(0, 0, to.width, to.height).data, seen = new Set();
              for (let k = 0; k < d.length; k += 4) seen.add(d[k] + 256 * d[k + 1] + 65536 * d[k + 2]);
              return seen.size;
            }})()"""
        )

    def touch(self, kind: str, *points: tuple[float, float]) -> None:
        """Fingers on the screen: touchStart, touchMove, touchEnd."""
        places = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(points)]
        self.send("Input.dispatchTouchEvent", type=kind, touchPoints=places)

    def mouse(self, kind: str, x: float, y: float, pressed: bool = False) -> None:
        """The mouse: mousePressed, mouseMoved, mouseReleased."""
        button = "left" if pressed or kind != "mouseMoved" else "none"
        self.send(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, buttons=int(pressed), clickCount=1
        )
