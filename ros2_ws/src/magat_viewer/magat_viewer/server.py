# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page's web server: a fixed list of files, and a WebSocket that streams a team to a browser. Free of ROS.

Only this machine reaches it, unless another address is given. Pages of other sites in the same browser do not: requests
must name this server as their host, and as the origin of a WebSocket.
"""

import asyncio
import json
import socket
import threading
from dataclasses import asdict, dataclass, field
from importlib.resources import files
from types import TracebackType
from typing import Any, Self
from urllib.parse import urlsplit

import psutil
from aiohttp import WSMsgType, web

from magat_node.plain import plain
from magat_node.text import shortened
from magat_viewer.address import HOST, listen
from magat_viewer.health import HealthReport
from magat_viewer.request_log import RequestLog
from magat_viewer.source import Source
from magat_viewer.theme import robot_colours
from magat_viewer.watched_episode import EpisodeResult

#: Seconds between two messages to a browser, between two details of the chosen robot (whose attention has to be
#: computed), and between two reports of the team's health.
PERIOD, DETAIL_PERIOD, HEALTH_PERIOD = 1 / 30, 0.2, 1.0
#: A file that is generated, see `magat_viewer.theme`.
_ROBOT_COLOURS = "robots.css"
#: The files of the page, and their types.
_FILES = {
    "index.html": "text/html",
    "style.css": "text/css",
    _ROBOT_COLOURS: "text/css",
    "icon.svg": "image/svg+xml",
    "main.js": "text/javascript",
    "team.js": "text/javascript",
    "player.js": "text/javascript",
    "connection.js": "text/javascript",
    "map.js": "text/javascript",
    "layers.js": "text/javascript",
    "panel.js": "text/javascript",
    "colours.js": "text/javascript",
}
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}


@dataclass(eq=False)
class _Browser:
    """What one browser shows, and what it has been sent."""

    chosen: int | None = None
    episode: int = 0
    tick: int = 0
    #: Number of the last scene, and tick of the last frame, that were sent.
    scene: int = -1
    frame: int = -1
    results: list[EpisodeResult] = field(default_factory=list)
    health: HealthReport | None = None
    health_at: float = float("-inf")
    detail: tuple[int, int, int] | None = None
    detail_at: float = float("-inf")


class PageServer:
    """Serves a team to browsers, in a ``with`` statement, from its own thread."""

    def __init__(self, source: Source, host: str = HOST, port: int | None = None) -> None:
        """Open a port.

        Args:
            source: the team. After this, only the thread of the server calls it.
            host: name or address to listen on.
            port: TCP port; the first free one from 8300 on if None.

        Raises:
            ServerError: the address is not this machine's, or the port is taken.
        """
        self._source, self._host = source, host
        self._socket = listen(host, port)
        #: TCP port.
        self.port = int(self._socket.getsockname()[1])
        self._browsers: set[_Browser] = set()
        self._started, self._ended = threading.Event(), asyncio.Event()
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{f'[{self._host}]' if ':' in self._host else self._host}:{self.port}/"

    def __enter__(self) -> Self:
        self._thread.start()
        self._started.wait()
        self.wait(0.0)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()

    def wait(self, seconds: float) -> None:
        """Wait for ``seconds``; if an error ends the server meanwhile, raise it."""
        self._thread.join(seconds)
        if self._failure is not None:
            raise self._failure

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:
            self._failure = error
        finally:
            self._started.set()

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        app = web.Application(middlewares=[self._guard])
        for name in ("", *_FILES):
            app.router.add_get(f"/{name}", self._file)
        app.router.add_get("/socket", self._follow)
        runner = web.AppRunner(app, access_log=None, logger=RequestLog().logger(), shutdown_timeout=0.5)
        await runner.setup()
        await web.SockSite(runner, self._socket).start()
        self._started.set()
        try:
            while not self._ended.is_set():
                self._source.poll({browser.chosen for browser in self._browsers if browser.chosen is not None})
                await _wait(self._ended, PERIOD)
        finally:
            await runner.cleanup()

    @web.middleware
    async def _guard(self, request: web.Request, handler: Any) -> web.StreamResponse:
        """Refuse requests of other sites: another origin, or another host name that resolves to this address."""
        if _hostname(request.host) not in self._names:
            return web.Response(status=403, text=f"this server has no name {shortened(request.host)}\n")
        origin = request.headers.get("Origin")
        if origin is not None and origin != f"http://{request.host}":
            return web.Response(status=403, text=f"requests from pages of {shortened(origin)} are refused\n")
        response = await handler(request)
        response.headers.update(_HEADERS)
        return response

    @property
    def _names(self) -> set[str]:
        """Names and addresses of this server."""
        if self._host in _LOOPBACK:
            return _LOOPBACK
        own = {one.address for addresses in psutil.net_if_addrs().values() for one in addresses}
        return _LOOPBACK | own | {self._host, socket.gethostname()}

    async def _file(self, request: web.Request) -> web.Response:
        name = request.path.removeprefix("/") or "index.html"
        if name == _ROBOT_COLOURS:
            body = robot_colours().encode()
        else:
            body = files("magat_viewer").joinpath("page", name).read_bytes()
        return web.Response(body=body, content_type=_FILES[name], charset="utf-8")

    # --- One browser ---

    async def _follow(self, request: web.Request) -> web.StreamResponse:
        if "Origin" not in request.headers:  # every browser sends it
            return web.Response(status=403, text="only the page of this server may connect\n")
        channel = web.WebSocketResponse(heartbeat=20.0, compress=False, max_msg_size=4096)
        await channel.prepare(request)
        browser = _Browser()
        self._browsers.add(browser)
        sending = asyncio.create_task(self._send(channel, browser))
        sending.add_done_callback(self._sent)
        try:
            async for message in channel:
                if message.type is not WSMsgType.TEXT or not _take(browser, message.data):
                    await channel.close(code=1003, message=b"unknown request")
        finally:
            self._browsers.discard(browser)
            sending.cancel()
        return channel

    async def _send(self, channel: web.WebSocketResponse, browser: _Browser) -> None:
        """Send news until the browser is gone. A slow browser gets the newest state, never a queue."""
        source = self._source
        await channel.send_str(_json("team", {"live": source.live, "title": source.title}))
        while not self._ended.is_set() and not channel.closed:
            for message in self._news(browser):
                await (channel.send_bytes(message) if isinstance(message, bytes) else channel.send_str(message))
            await _wait(self._ended, PERIOD)
        await channel.close(code=1001)

    def _sent(self, sending: asyncio.Task[None]) -> None:
        """End the server on any error but a lost connection."""
        error = None if sending.cancelled() else sending.exception()
        if error is not None and not isinstance(error, ConnectionError):
            self._failure = error
            self._ended.set()

    def _news(self, browser: _Browser) -> list[str | bytes]:
        """The messages that a browser is to be sent now: texts of JSON, and frames."""
        source, now = self._source, self._loop.time()
        news: list[str | bytes] = []
        if (results := source.results()) != browser.results:
            browser.results = results
            news.append(_json("results", {"episodes": [asdict(result) for result in results]}))
        episode = source.newest if source.live else min(browser.episode, source.newest)
        if episode < 0:
            return news
        if episode != browser.scene:
            browser.scene, browser.frame, browser.detail = episode, -1, None
            browser.health_at = float("-inf")
            news.append(_json("scene", asdict(source.scene(episode))))
        browser.frame, frames = source.frames(episode, browser.frame)
        if frames:
            news.append(frames)
        if now - browser.health_at >= HEALTH_PERIOD:
            browser.health_at = now
            if (health := source.health(episode)) != browser.health:
                browser.health = health
                news.append(_json("health", asdict(health)))
        if browser.chosen is not None and now - browser.detail_at >= DETAIL_PERIOD:
            request = (episode, browser.frame if source.live else browser.tick, browser.chosen)
            if request != browser.detail and (detail := source.detail(*request)) is not None:
                browser.detail, browser.detail_at = request, now
                news.append(_json("detail", asdict(detail) | {"episode": episode}))
        return news


def _json(kind: str, values: dict[str, Any]) -> str:
    """A message to a browser; numbers that JSON does not have become null."""
    return json.dumps({"kind": kind} | plain(values), allow_nan=False)


_LOOPBACK = {"127.0.0.1", "localhost", "::1"}


def _hostname(host: str) -> str | None:
    """``host`` without its port; None if it is not valid."""
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:
        return None


def _take(browser: _Browser, text: str) -> bool:
    """Take a request of a browser: the robot, episode or tick that it shows; False if it is not valid."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        return False
    if not isinstance(values, dict) or not values.keys() <= {"chosen", "episode", "tick"}:
        return False
    for name, value in values.items():
        number = type(value) is int and 0 <= value < 2**31
        if not number and not (name == "chosen" and value is None):
            return False
    for name, value in values.items():
        setattr(browser, name, value)
    if "chosen" in values:
        browser.detail = None
    return True


async def _wait(event: asyncio.Event, seconds: float) -> None:
    """Wait for ``event``, at most ``seconds``."""
    try:
        await asyncio.wait_for(event.wait(), seconds)
    except TimeoutError:
        return
