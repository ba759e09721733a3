# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page's server: access, files, and that a slow browser gets the newest state, not a queue."""

import asyncio
import contextlib
import http.client
import json
import math
import socket
import time
from collections.abc import Callable, Iterator

import aiohttp
import pytest

from magat_viewer.address import PORT, ServerError, free_port
from magat_viewer.detail import RobotDetail
from magat_viewer.health import HealthReport
from magat_viewer.server import PageServer
from magat_viewer.watched_episode import EpisodeResult, Scene


class Counting:
    """A live team that only counts ticks; its frames are large."""

    live, title, newest = True, "counting", 0

    def __init__(self, size: int = 10) -> None:
        self.tick, self.size = 0, size
        self.chosen: set[int] = set()

    def poll(self, chosen: set[int]) -> None:
        self.tick += 1
        self.chosen = set(chosen)

    def results(self) -> list[EpisodeResult]:
        return []

    def scene(self, episode: int) -> Scene:
        return Scene(episode, ["alice"], 1, 1, "0", [[0, 0]], 9, 7.0, 4)

    def frames(self, episode: int, after: int) -> tuple[int, bytes]:
        return self.tick, self.tick.to_bytes(4, "little").ljust(self.size) if self.tick > after else b""

    def health(self, episode: int) -> HealthReport:
        return HealthReport({}, [])

    def detail(self, episode: int, tick: int, robot: int) -> RobotDetail:
        return RobotDetail(robot, tick, [], [math.nan], None, 0, None, [], "")


@pytest.fixture
def serve() -> Iterator[Callable[..., PageServer]]:
    with contextlib.ExitStack() as stack:
        yield lambda *arguments, **options: stack.enter_context(PageServer(*arguments, **options))


def get(page: PageServer, path: str, **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    return connection.getresponse()


def follow(page: PageServer, talk: Callable, **headers: str) -> object:
    """What ``talk`` returns of a WebSocket."""

    async def run() -> object:
        headers.setdefault("Origin", page.url.rstrip("/"))
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{page.url}socket", headers=headers) as channel,
        ):
            return await asyncio.wait_for(talk(channel), 20)

    return asyncio.run(run())


async def received(channel: aiohttp.ClientWebSocketResponse, kind: str) -> dict:
    while True:
        message = await channel.receive()
        assert message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY), message
        if message.type is aiohttp.WSMsgType.TEXT and json.loads(message.data)["kind"] == kind:
            return json.loads(message.data)


def test_the_page_and_its_parts_are_served_and_nothing_else(serve):
    page = serve(Counting())
    index = get(page, "/")
    text = index.read().decode()
    assert index.status == 200
    assert index.headers["Content-Security-Policy"].startswith("default-src 'self'")
    parts = ["style.css", "robots.css", "main.js", "icon.svg"]
    for part in parts:
        assert part in text
        assert get(page, f"/{part}").status == 200
    for path in (
        "/server.py",
        "/../server.py",
        "/..%2fserver.py",
        "/page/index.html",
        "//etc/passwd",
        "/index.html/..",
    ):
        assert get(page, path).status == 404, path


def test_every_part_that_a_part_imports_is_served(serve):
    page = serve(Counting())
    waiting, seen = ["main.js"], set()
    while waiting:
        name = waiting.pop()
        seen.add(name)
        answer = get(page, f"/{name}")
        assert (answer.status, answer.headers["Content-Type"]) == (200, "text/javascript; charset=utf-8"), name
        found = {line.split('"./')[1].split('"')[0] for line in answer.read().decode().splitlines() if '"./' in line}
        waiting += found - seen
    assert {"map.js", "layers.js", "player.js"} <= seen


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1.evil.example", "[", ""])
def test_other_host_names_are_refused(serve, host):
    page = serve(Counting())
    assert get(page, "/", Host=host.format(port=page.port)).status == 403
    assert get(page, "/", Host=f"localhost:{page.port}").status == 200


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1:{port}", ""]
)
def test_pages_of_other_sites_are_refused(serve, origin):
    page = serve(Counting())
    with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
        follow(page, lambda channel: channel.receive(), Origin=origin.format(port=page.port))


def test_a_request_without_an_origin_is_refused(serve):
    page = serve(Counting())
    upgrade = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13"}
    assert get(page, "/socket", **upgrade, **{"Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="}).status == 403


def test_a_browser_gets_the_team_the_scene_and_every_new_tick(serve):
    page = serve(Counting())

    async def talk(channel):
        team, scene = await received(channel, "team"), await received(channel, "scene")
        frames = []
        while len(frames) < 5:
            message = await channel.receive()
            if message.type is aiohttp.WSMsgType.BINARY:
                frames.append(int.from_bytes(message.data[:4], "little"))
        return team, scene, frames

    team, scene, frames = follow(page, talk)
    assert (team["live"], team["title"], scene["episode"]) == (True, "counting", 0)
    assert frames == sorted(set(frames))


def test_the_source_knows_the_chosen_robots_of_all_browsers(serve):
    source = Counting()
    page = serve(source)

    async def talk(channel):
        await channel.send_json({"chosen": 3})
        detail = await received(channel, "detail")
        chosen = source.chosen
        await channel.send_json({"chosen": 5})
        while (await received(channel, "detail"))["robot"] != 5:
            pass
        return detail, chosen, source.chosen

    detail, *chosen = follow(page, talk)
    assert (detail["robot"], detail["episode"]) == (3, 0)
    assert detail["probabilities"] == [None], "JSON has no NaN"
    assert chosen == [{3}, {5}]
    deadline = time.monotonic() + 10
    while source.chosen:
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize(
    "said",
    [
        "no json",
        "[1]",
        '{"chosen": -1}',
        '{"chosen": "x"}',
        '{"scene": 1}',
        '{"tick": null}',
        '{"tick": true}',
        "[" * 4000,
        '{"tick": 1e400}',
        '{"tick": ' + "9" * 4000,
    ],
)
def test_an_invalid_request_ends_its_connection_only(serve, said):
    page = serve(Counting())

    async def talk(channel):
        await channel.send_str(said)
        while (message := await channel.receive()).type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY):
            pass
        return message.data

    assert follow(page, talk) == 1003
    assert get(page, "/").status == 200
    page.wait(0.0)


def test_malformed_requests_are_counted_and_make_no_noise(serve, capfd):
    page = serve(Counting())
    malformed = (
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: " + b"a" * 9000 + b"\r\n\r\n",
        b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: -1\r\n\r\n",
        b"GET http://[ HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
    )
    for request in malformed * 5:
        with socket.create_connection(("127.0.0.1", page.port)) as client:
            client.sendall(request)
            assert b" 400 " in client.recv(100)
    assert get(page, "/").status == 200
    said = capfd.readouterr().err
    assert said.count("\n") == 1
    assert "[viewer]: 1 requests to the page failed so far; the last one: Error handling request" in said
    assert len(said) < 500


def test_a_slow_browser_gets_the_newest_frames(serve):
    source = Counting(size=4_000_000)
    page = serve(source)

    async def talk(channel):
        await received(channel, "scene")
        before = source.tick
        await asyncio.sleep(1.0)  # some thirty ticks, of which it reads none
        passed, frames = source.tick - before, []
        while not frames or frames[-1] < before + passed:
            message = await channel.receive()
            if message.type is aiohttp.WSMsgType.BINARY:
                frames.append(int.from_bytes(message.data[:4], "little"))
        return passed, len(frames)

    passed, frames = follow(page, talk)
    assert passed > 10
    assert frames < passed / 2


def test_the_server_takes_the_next_free_port_or_the_given_one(serve):
    first = serve(Counting())
    assert first.port >= PORT
    second = serve(Counting())
    assert second.port > first.port
    assert free_port() not in (first.port, second.port)
    with pytest.raises(ServerError, match=f"the port {first.port} is in use"):
        PageServer(Counting(), port=first.port)


@pytest.mark.parametrize("host", ["192.0.2.1", "no.such.host.invalid"])
def test_an_address_that_is_not_this_machines_is_refused(host):
    with pytest.raises(ServerError, match=f"{host} is not an address of this machine"):
        PageServer(Counting(), host)


def test_the_server_listens_on_the_loopback_address_only(serve):
    page = serve(Counting())
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.2", page.port)) != 0


@pytest.mark.parametrize("method", ["poll", "scene"])
def test_an_error_that_ends_the_server_is_raised(method):
    def fail(*_: object) -> None:
        raise OSError("the disk is on fire")

    async def listen(channel: aiohttp.ClientWebSocketResponse) -> None:
        async for _ in channel:
            pass

    def serve() -> None:
        source = Counting()
        setattr(source, method, fail)
        with PageServer(source) as page:
            with contextlib.suppress(aiohttp.ClientError):  # it may have ended before
                follow(page, listen)
            page.wait(10.0)

    with pytest.raises(OSError, match="on fire"):
        serve()
