"""The browser page and its messages over one port: HTTP for the page, a websocket for the rest.
Runs in a separate thread.

A viewer that does not take its messages loses the oldest of them. A ping finds a viewer that vanished.
"""

import asyncio
import contextlib
import errno
import http
import json
import math
import threading
from concurrent.futures import Future
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from eskin.golden.core import InputError
from eskin.live.hub import Hub, Viewer
from eskin.live.player import Controls
from eskin.live.recorder import MOST_LETTERS

SOCKET = "/events"
HOST, LOCAL = "127.0.0.1", ("127.0.0.1", "localhost", "::1")
"""The interface that serves the page, and its names."""
BATCH_S = 1 / 40
"""A viewer gets what waits for him at most so often."""
PING_S = 10.0
COMMAND_BYTES, COMMAND_S = 1000, 1 / 50
"""Length of a command, and the time that the commands of all viewers take, in turn."""
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; connect-src "
    "'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""The page brings all that it needs; a browser refuses whatever it would fetch elsewhere."""


class PageServer:
    """Serves ``page`` to this machine on ``port`` until ``close``.

    Parameters
    ----------
    port:
        0: any that is free; ``port`` and ``address`` then tell which.

    Raises
    ------
    InputError
        The port is taken, or may not be opened.
    """

    def __init__(self, page: bytes, hub: Hub, controls: Controls, *, port: int) -> None:
        self._page, self._hub, self._controls = page, hub, controls
        opened = Future[int]()
        serving = lambda: asyncio.run(self._serve(port, opened))
        self._thread = threading.Thread(target=serving, name="eskin-watch-page", daemon=True)
        self._thread.start()
        try:
            self.port = opened.result()
            self.address = f"http://{HOST}:{self.port}"
        except OSError as error:
            self._thread.join()
            why = f"cannot be opened ({error.strerror or error})"
            why = "another program uses it" if error.errno == errno.EADDRINUSE else why
            raise InputError(
                f"--host-port {port}: {why}; give another one, or 0 for any that is free"
            ) from None

    def close(self) -> None:
        """Take leave of every viewer and give the port back."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(timeout=5)

    async def _serve(self, port: int, opened: Future[int]) -> None:
        self._loop, self._stop, self._turn = asyncio.get_running_loop(), asyncio.Event(), asyncio.Lock()
        try:
            server = await serve(
                self._viewer,
                HOST,
                port,
                process_request=self._answer,
                ping_interval=PING_S,
                ping_timeout=PING_S,
                max_size=COMMAND_BYTES,
                compression=None,
                close_timeout=1,
            )
        except Exception as error:
            opened.set_exception(error)
            return
        opened.set_result(next(iter(server.sockets)).getsockname()[1])
        async with server:
            await self._stop.wait()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page, or None: the request is for the websocket."""
        try:
            path = urlsplit(request.path).path
            host = request.headers["Host"]
            origin = request.headers.get("Origin")
            named, port = urlsplit(f"//{host}").hostname or "", urlsplit(f"//{host}").port or 80
            site = None if origin is None else urlsplit(origin).netloc
        except (ValueError, LookupError):
            return connection.respond(
                http.HTTPStatus.BAD_REQUEST, "Host or Origin is missing, there twice, or damaged\n"
            )
        if "@" in host or not port or named not in LOCAL:  # another site's name may lead here
            sentence = f"this page is not at {host!r:.80}; open it as {self.address}\n"
            return connection.respond(http.HTTPStatus.FORBIDDEN, sentence)
        if path == SOCKET:
            if site not in (None, host):
                return connection.respond(http.HTTPStatus.FORBIDDEN, "another site's page may not watch\n")
            return None
        if path == "/favicon.ico":
            return connection.respond(http.HTTPStatus.NO_CONTENT, "")
        if path != "/":
            return connection.respond(http.HTTPStatus.NOT_FOUND, "there is one page here: /\n")
        headers = {
            "Content-Type": "text/html; charset=utf-8",
            "Content-Length": str(len(self._page)),
            "Content-Security-Policy": POLICY,
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store",
            "Connection": "close",
        }
        return Response(200, "OK", Headers(headers), self._page)

    async def _viewer(self, connection: ServerConnection) -> None:
        self._hub.viewers += 1
        tasks = [asyncio.create_task(each(connection)) for each in (self._send, self._listen)]
        try:
            # a viewer that left sends nothing any more
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._hub.viewers -= 1
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _send(self, connection: ServerConnection) -> None:
        """Send the waiting events to the viewer, one message at a time: JSON, a list. The next message is
        sent only when the browser can take it."""
        viewer = Viewer(self._hub)
        with contextlib.suppress(ConnectionClosed):
            while True:
                if texts := viewer.take():
                    note = f'{{"k":"mine","lost":{viewer.lost}}}'
                    await connection.send(f"[{','.join([*texts, note])}]")
                await asyncio.sleep(BATCH_S)

    async def _listen(self, connection: ServerConnection) -> None:
        with contextlib.suppress(ConnectionClosed):
            async for message in connection:
                async with self._turn:
                    with contextlib.suppress(ValueError, TypeError, KeyError, OverflowError, RecursionError):
                        obey(self._controls, json.loads(message))
                    await asyncio.sleep(COMMAND_S)


def obey(controls: Controls, command: dict) -> None:
    """Do what a viewer asks: ``{"do": "pause", "on": true}``, ``speed`` with ``times`` (0: as fast as
    possible), ``next``, ``class`` with ``index`` (-1: all), ``record`` with the ``name`` of a class (empty: stop), ``undo``. Other
    messages are ignored."""
    match command["do"]:
        case "pause":
            controls.change(paused=bool(command["on"]))
        case "speed":
            times = float(command["times"]) or math.inf
            controls.change(speed=min(max(times, 0.01), 1000.0) if math.isfinite(times) else math.inf)
        case "next":
            controls.change(skip=True)
        case "class":
            controls.change(label=int(command["index"]))
        case "record":
            name = str(command["name"]).strip()
            if name.isprintable():
                controls.change(name=name[:MOST_LETTERS].strip())
        case "undo":
            controls.change(undo=True)
