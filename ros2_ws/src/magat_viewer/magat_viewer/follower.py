# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A client of the page's WebSocket that draws nothing, for tests and the bench."""

import asyncio
import json
import threading
from collections import Counter
from types import TracebackType
from typing import Any, Self

import aiohttp

#: Seconds between two attempts to connect.
_RETRY = 0.2


class Follower:
    """Receives the messages of a server, in a ``with`` statement, in its own thread."""

    def __init__(self, url: str, chosen: int | None = None) -> None:
        """Connect to the page at ``url``, with the robot of number ``chosen`` if that is given."""
        self._url, self._chosen = url, chosen
        #: Number of messages by kind; the kind of frames is ``frames``.
        self.counts: Counter[str] = Counter()
        #: The last message of each kind.
        self.last: dict[str, Any] = {}
        self._loop = asyncio.new_event_loop()
        self._task = self._loop.create_task(self._follow())
        self._thread = threading.Thread(target=self._run, name="follower", daemon=True)

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._task)
        except asyncio.CancelledError:
            return
        finally:
            self._loop.close()

    async def _follow(self) -> None:
        headers = {"Origin": self._url.rstrip("/")}
        async with aiohttp.ClientSession() as session:
            while True:
                try:
                    async with session.ws_connect(f"{self._url}socket", headers=headers) as channel:
                        await channel.send_json({"chosen": self._chosen})
                        async for message in channel:
                            self._take(message)
                except aiohttp.ClientError:
                    pass
                await asyncio.sleep(_RETRY)

    def _take(self, message: aiohttp.WSMessage) -> None:
        if message.type is aiohttp.WSMsgType.BINARY:
            kind, content = "frames", message.data
        else:
            content = json.loads(message.data)
            kind = content["kind"]
        self.last[kind] = content
        self.counts[kind] += 1

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._loop.call_soon_threadsafe(self._task.cancel)
        self._thread.join()
