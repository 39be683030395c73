"""Sources, players and viewers of the live view, without a browser."""

from __future__ import annotations

import json
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

from eskin.golden.data import Recordings
from eskin.live.hub import Hub, Viewer
from eskin.live.player import Controls, Player, hello
from eskin.live.sources import Listener, ModelSource


def wait(condition: Callable[[], bool], seconds: float = 600.0) -> None:
    """Until ``condition()`` holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come to this"
        time.sleep(0.01)


class Stage:
    """A player with a hub and a viewer that takes everything; ``go`` plays to the end, ``start`` in a
    thread."""

    def __init__(
        self,
        source: ModelSource | Listener,
        recordings: Recordings | None,
        numbers: Sequence[int] | None = None,
        *,
        speed: float = math.inf,
        shape: Sequence[int] | None = None,
    ) -> None:
        config = source.config
        numbers = range(len(recordings) if recordings else 0) if numbers is None else numbers
        greeting = hello(
            config, recordings, numbers, source=source.kind, shape=list(shape or (1, config.sensor.taxels))
        )
        self.hub = Hub(greeting, config.sensor.sample_rate_hz, config.sensor.taxels)
        self.controls = Controls()
        self.controls.speed = speed
        self.messages: list[dict] = []
        self._texts: list[str] = []
        self.hub._messages = deque()  # all of them
        self.viewer = Viewer(self.hub)
        self.player = Player(source, recordings, numbers, self.hub, self.controls)
        self.thread = threading.Thread(target=self.player.run, daemon=True)
        self.viewer.take()

    def go(self) -> Stage:
        self.controls.wait = lambda seconds: self.controls.stop()  # the first wait comes after the last
        self.player.run()
        if self.player.error:
            raise self.player.error
        self._texts += self.viewer.take()
        self.messages = [json.loads(text) for text in self._texts]
        return self

    def start(self) -> Stage:
        self.thread.start()
        return self

    def seen(self, kind: str) -> list[dict]:
        """The messages of a kind so far."""
        self._texts += self.viewer.take()
        return [message for message in map(json.loads, self._texts) if message["k"] == kind]

    def until(self, condition: Callable[[], bool]) -> None:
        """Wait for ``condition()``."""
        wait(condition, 30.0)

    def stop(self) -> Stage:
        self.controls.stop()
        self.thread.join(10)
        assert not self.thread.is_alive()
        return self
