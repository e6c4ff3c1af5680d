"""The server under clients that are idle, slow, greedy or no browsers: everyone who asks properly is answered."""

import json
import resource
import socket
import threading
import time
from collections.abc import Iterator
from http import HTTPStatus

import numpy as np
import pytest

from ema.app import connections
from ema.app.connections import BODY, CONNECTIONS, HEAD, Reply, Request, Server


def answer(request: Request) -> Reply:
    """The length of the body, after as long as the path says."""
    path = request.head.split()[1].decode()
    if path == "/fault":
        raise RuntimeError("a fault of ours")
    if path == "/events":
        return Reply([b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\n\r\n"], listen=True)
    time.sleep(float(path.lstrip("/") or 0))
    text = str(len(request.body)).encode()
    return Reply([b"HTTP/1.1 200 OK\r\nContent-Length: %d\r\n\r\n" % len(text), text], close=False)


def refusal(status: HTTPStatus, sentence: str) -> Reply:
    content = json.dumps({"error": sentence}).encode()
    return Reply(
        [b"HTTP/1.1 %d x\r\nConnection: close\r\nContent-Length: %d\r\n\r\n" % (status, len(content)), content]
    )


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    news = {"revision": 0}
    served = Server(("127.0.0.1", 0), answer, refusal, lambda: dict(news))
    served.news = news
    thread = threading.Thread(target=served.serve_forever, daemon=True)
    thread.start()
    yield served
    served.shutdown()
    served.server_close()
    thread.join(5)
    assert not thread.is_alive()


def client(server: Server, data: bytes = b"", timeout: float = 20.0) -> socket.socket:
    one = socket.create_connection(server.server_address, timeout=timeout)
    if data:
        one.sendall(data)
    return one


def told(one: socket.socket) -> tuple[int, bytes]:
    """Status and the rest of what comes until the connection ends or the answer is whole."""
    data = b""
    while b"\r\n\r\n" not in data or len(data.partition(b"\r\n\r\n")[2]) < length(data):
        try:
            block = one.recv(65536)
        except ConnectionError:
            break
        if not block:
            break
        data += block
    return (int(data.split()[1]) if data else 0), data.partition(b"\r\n\r\n")[2]


def length(data: bytes) -> int:
    head = data.partition(b"\r\n\r\n")[0].lower()
    return int(head.partition(b"content-length:")[2].split()[0]) if b"content-length:" in head else 0


GET = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"


def open_files(wanted: int) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(wanted, hard), hard))
    if min(wanted, hard) < wanted:
        pytest.skip(f"this system lets a process have {hard} files")


def resident() -> int:
    """Bytes of memory that this process holds now, or has held at most where the system does not tell."""
    try:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * resource.getpagesize()
    except FileNotFoundError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # bytes on macOS


def test_everyone_who_asks_is_answered_among_two_thousand_who_do_not(server: Server):
    """Half of the idle say nothing, half stop within their headers; none may cost a thread or the place of another."""
    open_files(6000)
    drawn, before, threads = np.random.default_rng(100), resident(), threading.active_count()
    started = b"GET / HTTP/1.1\r\nHost: x\r\nX-Slow: "
    idle = [client(server, started[: int(drawn.integers(0, len(started)))] if n % 2 else b"") for n in range(2000)]
    active = [client(server) for _ in range(200)]
    for one in active:
        one.sendall(GET)
    try:
        assert [told(one) for one in active] == [(200, b"0")] * 200
        for one in active:  # a connection that was answered may ask again
            one.sendall(b"POST /0.001 HTTP/1.1\r\nContent-Length: 3\r\n\r\nabc")
        assert [told(one) for one in active] == [(200, b"3")] * 200
        assert len(server._connections) <= CONNECTIONS
        assert threading.active_count() <= threads + connections.WORKERS
        assert resident() - before < 64 * 2**20
    finally:
        for one in (*idle, *active):
            one.close()


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        (b"\x16\x03\x01" + b"x" * HEAD, 431),
        (b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * HEAD, 431),
        (b"POST / HTTP/1.1\r\nContent-Length: %d\r\n\r\n" % (BODY + 1), 413),
        (b"POST / HTTP/1.1\r\nContent-Length: " + b"9" * 5000 + b"\r\n\r\n", 413),
        (b"POST / HTTP/1.1\r\nContent-Length: -1\r\n\r\n", 400),
        (b"POST / HTTP/1.1\r\nContent-Length: 1e3\r\n\r\n", 400),
        (b"POST / HTTP/1.1\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\nab", 400),
        (b"POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n", 501),
        (b"GET /fault HTTP/1.1\r\n\r\n", 500),
    ],
)
def test_what_is_too_long_or_no_request_gets_a_status(server: Server, request_: bytes, status: int):
    with client(server, request_) as one:
        assert told(one)[0] == status
        assert one.recv(1) == b"", "and the connection ends"


def test_a_request_in_pieces_and_two_at_once_are_answered(server: Server):
    whole = b"\r\nPOST / HTTP/1.1\r\nContent-Length: 5\r\n\r\nhello" + GET
    with client(server) as one:
        for n in range(len(whole)):
            one.sendall(whole[n : n + 1])
        assert told(one) == (200, b"5") and told(one) == (200, b"0")
    with client(server, b"POST / HTTP/1.1\r\nExpect: 100-continue\r\nContent-Length: 2\r\n\r\n") as one:
        assert one.recv(100).startswith(b"HTTP/1.1 100")
        one.sendall(b"hi")
        assert told(one) == (200, b"2")


def test_who_never_ends_a_request_is_told_so(server: Server, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(connections.PATIENCE, "reading", 0.5)
    monkeypatch.setitem(connections.PATIENCE, "idle", 0.5)
    with client(server, b"GET / HT") as slow, client(server) as idle:
        start = time.monotonic()
        for _ in range(8):  # a byte now and then does not help
            time.sleep(0.15)
            try:
                slow.sendall(b"T")
            except OSError:
                break
        assert told(slow)[0] == 408 and idle.recv(1) == b"" and time.monotonic() - start < 10


def test_a_busy_pool_makes_requests_wait_and_loses_none(server: Server):
    many = [client(server, b"GET /0.05 HTTP/1.1\r\n\r\n") for _ in range(60)]
    assert [told(one) for one in many] == [(200, b"0")] * 60
    for one in many:
        one.close()


def test_a_full_house_says_so(server: Server, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(server, "_most", 4)
    many = [client(server, b"GET /1 HTTP/1.1\r\n\r\n") for _ in range(4)]
    time.sleep(0.3)
    with client(server) as one:
        assert told(one)[0] == 503
    assert [told(one)[0] for one in many] == [200] * 4
    for one in many:
        one.close()


def test_listeners_follow_the_changes_without_a_thread_each(server: Server):
    threads = threading.active_count()
    listeners = [client(server, b"GET /events HTTP/1.1\r\n\r\n") for _ in range(40)]
    for one in listeners:
        assert told(one)[0] == 200
    server.news["revision"] = 7
    server.wake()
    for one in listeners:
        data = b""
        while b'"revision": 7' not in data:
            data += one.recv(4096)
        one.close()
    assert threading.active_count() <= threads + connections.WORKERS
    more = [client(server, b"GET /events HTTP/1.1\r\n\r\n") for _ in range(connections.LISTENERS + 1)]
    assert sorted({told(one)[0] for one in more}) == [200, 503]
    for one in more:
        one.close()


def test_who_does_not_take_his_answer_holds_up_nobody(server: Server, monkeypatch: pytest.MonkeyPatch):
    large = b"x" * (4 * 2**20)
    monkeypatch.setattr(connections, "WAITING", 8 * 2**20)
    monkeypatch.setitem(connections.PATIENCE, "writing", 0.5)
    monkeypatch.setattr(
        server,
        "_answer",
        lambda request: Reply([b"HTTP/1.1 200 OK\r\nContent-Length: %d\r\n\r\n" % len(large), large], close=False),
    )
    deaf = [client(server, GET) for _ in range(12)]
    with client(server, GET) as one:
        status, content = told(one)
    assert status == 200 and len(content) == len(large)
    for one in deaf:
        one.close()
