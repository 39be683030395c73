"""eskin/live/server.py: the page, its messages, commands that are not understood, viewers that stall or
vanish, ports that are taken."""

import json
import math
import socket
import urllib.error
import urllib.request

import numpy as np
import pytest
from websockets.sync.client import connect

from eskin.live.feed import Begin
from eskin.live.hub import Hub
from eskin.live.player import Controls
from eskin.live.server import PageServer
from eskin.verbs.watch import PAGE
from tests.support.live_case import wait


@pytest.fixture
def served():
    hub, controls = Hub({"name": "made"}, 1000.0, 160), Controls()
    server = PageServer(PAGE.read_bytes(), hub, controls, port=0)
    yield server, hub, controls
    server.close()


def test_the_page_brings_all_that_it_needs(served):
    server, _, _ = served
    with urllib.request.urlopen(server.address) as answer:
        body, policy = answer.read(), answer.headers["Content-Security-Policy"]
    assert body == PAGE.read_bytes()
    assert b"<script src" not in body
    assert b"url(" not in body
    assert b"//" not in body.split(b"</style>")[0]
    assert policy.startswith("default-src 'none';") and "http" not in policy
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(server.address + "/etc/passwd")
    request = urllib.request.Request(server.address, headers={"Host": "elsewhere.example"})
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(request)


def test_messages_come_and_commands_are_obeyed(served):
    server, hub, controls = served
    with connect(server.address.replace("http", "ws") + "/events") as viewer:
        first = json.loads(viewer.recv(timeout=600))
        assert [message["k"] for message in first] == ["hello", "mine"] and first[0]["name"] == "made"
        hub.publish(Begin(3, 1, 0, np.zeros(160)))
        assert json.loads(viewer.recv(timeout=600))[0]["number"] == 3
        for command in (
            {"do": "pause", "on": True},
            {"do": "speed", "times": 2.5},
            {"do": "class", "index": 2},
            {"do": "next"},
        ):
            viewer.send(json.dumps(command))
        wait(lambda: controls.skip)
        assert (controls.paused, controls.speed, controls.label) == (True, 2.5, 2)
        for strange in (
            "no JSON",
            "[]",
            "7",
            '{"do": 5}',
            '{"do": "speed", "times": "fast"}',
            '{"do": "class"}',
            '{"do": "stop"}',
            "[" * 900,
        ):
            viewer.send(strange)
        viewer.send(json.dumps({"do": "speed", "times": 0}))
        wait(lambda: math.isinf(controls.speed))
        assert not controls.stopped and controls.label == 2
    wait(lambda: hub.viewers == 0)


KEY = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
OTHERS = "192.168.0.7 evil.example 127.0.0.1.evil.example evil.example@localhost"
BY_NAME = dict.fromkeys(("localhost", "127.0.0.1:9", "[::1]:9"), 101)
BY_NAME |= dict.fromkeys((socket.gethostname(), "", *OTHERS.split()), 403)
BY_NAME |= dict.fromkeys(("[", "localhost:x", "localhost:99999"), 400)


def test_only_names_of_this_machine_are_answered(capfd):
    """Another site's name that was made to lead here reads nothing; what cannot be read is one sentence."""
    server = PageServer(PAGE.read_bytes(), Hub({}, 1000.0, 4), Controls(), port=0)
    try:
        for name, status in BY_NAME.items():
            assert answer(server.port, f"Host: {name}\r\nOrigin: http://{name}\r\n{KEY}") == status, name
        for headers in (
            "",
            "Host: localhost\r\nHost: localhost\r\n",
            "Host: localhost\r\nOrigin: http://[\r\n",
        ):
            assert answer(server.port, headers + KEY) == 400
        for origin in ("null", "", "http://evil.example", "http://localhost:1"):
            assert answer(server.port, f"Host: localhost\r\nOrigin: {origin}\r\n{KEY}") == 403
        assert answer(server.port, "Host: localhost\r\n", "//[") == 400
    finally:
        server.close()
    assert capfd.readouterr().err == ""


def answer(port: int, headers: str, path: str = "/events") -> int:
    with socket.create_connection(("127.0.0.1", port), timeout=600) as line:
        line.sendall(f"GET {path} HTTP/1.1\r\n{headers}\r\n".encode())
        head = line.recv(4000).decode("latin1")  # frames may follow
    assert head.startswith("HTTP/1.1 ")
    return int(head.split()[1])
