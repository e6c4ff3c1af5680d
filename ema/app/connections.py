"""Many connections on one thread, their requests on a few: what is slow or idle costs a socket, never a thread.

A request reaches a worker when all of it has arrived. Until then it is bytes in a bounded buffer with a deadline; what
is too long, too slow or no HTTP is refused with a status before anything of it is parsed further.
"""

import json
import re
import selectors
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from queue import SimpleQueue
from typing import Literal, NamedTuple

CONNECTIONS = 480
"""Most connections that are open at a time; for a new one the longest idle one goes. A page has about eight; ``select``
on Windows takes 512. Halved, 200 clients at once still fit; doubled, Windows does not serve."""

WORKERS = 8
"""Threads that answer. A request is short or one user's fit. Halved, four fits at once hold up the rest; doubled,
nothing is gained on common machines."""

LISTENERS = 64
"""Most windows that follow the changes; each holds a connection as long as it is open."""

HEAD = 16_384
"""Most bytes of a request line with its headers. Browsers send about 1 kB; other servers allow 8 to 64 kB."""

BODY = 65_536
"""Most bytes of a body. The longest that our page sends is a reason written by hand."""

WAITING = 64 * 2**20
"""Bytes of answers not yet taken by their clients above which no further request is begun."""

PATIENCE = {"reading": 10.0, "idle": 60.0, "writing": 20.0, "lingering": 1.0}
"""Seconds: for a whole request from its first byte; for the first byte; for progress of an answer; for a refused client
to stop sending. Halved, slow lines over half the world may fail; doubled, slow clients hold their places longer."""

LONGEST_ANSWER = 300.0
"""Seconds for a whole answer: 5 MB at 140 kbit/s."""

BEAT = 2.0
"""Seconds between signs of life to the listeners."""

_TICK = 0.25
"""Seconds between looks at what has to end, where nothing arrives."""
_BLOCK = 65_536
"""Bytes that are read or sent at a time."""
_END = re.compile(rb"\r?\n\r?\n")


class Request(NamedTuple):
    """A request as it came: request line with headers, and the body."""

    head: bytes
    body: bytes


@dataclass
class Reply:
    """The bytes of an answer, in parts that are sent as they are; ``listen`` keeps the connection for changes."""

    parts: list[bytes] = field(default_factory=list)
    close: bool = True
    listen: bool = False


class _Refused(Exception):
    """A request that no worker is to see."""

    def __init__(self, status: HTTPStatus, sentence: str) -> None:
        super().__init__(sentence)
        self.status, self.sentence = status, sentence


@dataclass(eq=False)
class _Connection:
    """One client; ``since`` is when its state began, ``progress`` when it last took or gave a byte."""

    socket: socket.socket
    state: Literal["reading", "working", "writing", "listening", "lingering", "closed"] = "reading"
    buffer: bytearray = field(default_factory=bytearray)
    out: deque[memoryview] = field(default_factory=deque)
    since: float = field(default_factory=time.monotonic)
    progress: float = field(default_factory=time.monotonic)
    close: bool = False
    listen: bool = False
    invited: bool = False

    @property
    def unsent(self) -> int:
        """Bytes of the answer that the client has not taken."""
        return sum(len(part) for part in self.out)


class Server:
    """Serves requests by ``answer``, and changes by ``news`` to those who listen.

    Parameters
    ----------
    address : host and port; 0 takes a free port.
    answer : called in a worker's thread with a whole request.
    refusal : makes the reply to a request that is refused unseen, of its status and a sentence.
    news : the state that listeners are sent as JSON whenever it has changed.

    Raises
    ------
    OSError : the port is in use, or the address is not this machine's.
    """

    def __init__(
        self,
        address: tuple[str, int],
        answer: Callable[[Request], Reply],
        refusal: Callable[[HTTPStatus, str], Reply],
        news: Callable[[], object],
    ) -> None:
        self._answer, self._refusal, self._news = answer, refusal, news
        self._listening = _bound(address)
        self.server_address = self._listening.getsockname()
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listening, selectors.EVENT_READ)
        self._waker, self._woken = socket.socketpair()
        for end in (self._waker, self._woken):
            end.setblocking(False)
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._connections: set[_Connection] = set()
        self._ready: deque[tuple[_Connection, Request]] = deque()
        self._work: SimpleQueue[tuple[_Connection, Request] | None] = SimpleQueue()
        self._done: deque[tuple[_Connection, Reply]] = deque()
        self._busy = 0
        self._told: object = None
        self._beat = time.monotonic()
        self._stopping = threading.Event()
        self._ended = threading.Event()
        self._ended.set()
        self._most = min(CONNECTIONS, _descriptors() // 2)

    def serve_forever(self) -> None:
        """Serve until ``shutdown``."""
        self._ended.clear()
        workers = [threading.Thread(target=self._worker, daemon=True, name="ema app") for _ in range(WORKERS)]
        for worker in workers:
            worker.start()
        try:
            while not self._stopping.is_set():
                for key, _ in self._selector.select(_TICK):
                    self._turn(key.fileobj, key.data)
                self._deliver()
                self._dispatch()
                self._spread()
                self._expire()
        finally:
            for _ in workers:
                self._work.put(None)
            self._ended.set()

    def shutdown(self) -> None:
        """End ``serve_forever`` and wait for it."""
        self._stopping.set()
        self.wake()
        self._ended.wait(5.0)

    def server_close(self) -> None:
        """Give the port and every connection back."""
        self._stopping.set()
        for connection in list(self._connections):
            self._drop(connection)
        for each in (self._listening, self._waker, self._woken):
            each.close()
        self._selector.close()

    def wake(self) -> None:
        """Look at once whether there is news."""
        with suppress(OSError):
            self._waker.send(b".")  # a full pipe wakes as well

    def _worker(self) -> None:
        while (task := self._work.get()) is not None:
            connection, request = task
            try:
                reply = self._answer(request)
            except Exception as error:
                reply = self._refusal(
                    HTTPStatus.INTERNAL_SERVER_ERROR, f"a fault in ema itself: {type(error).__name__}: {error}"
                )
            self._done.append((connection, reply))
            self.wake()

    def _turn(self, source: object, connection: _Connection | None) -> None:
        if source is self._listening:
            self._accept()
        elif source is self._woken:
            with suppress(OSError):
                while self._woken.recv(4096):
                    pass
        elif connection is not None and connection.state != "closed":
            try:
                if connection.state == "writing" or connection.out:
                    self._write(connection)
                else:
                    self._read(connection)
            except OSError:
                self._drop(connection)

    def _accept(self) -> None:
        for _ in range(64):
            try:
                client, _ = self._listening.accept()
            except BlockingIOError:
                return
            except OSError:  # out of descriptors, or the client has left already
                self._evict()
                return
            client.setblocking(False)
            with suppress(OSError):
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection = _Connection(client)
            full = len(self._connections) >= self._most and not self._evict()
            self._connections.add(connection)
            self._selector.register(client, selectors.EVENT_READ, connection)
            if full:
                self._refuse(connection, HTTPStatus.SERVICE_UNAVAILABLE, "too many connections at once")

    def _evict(self) -> bool:
        """Make room: the connection goes that has waited longest without a whole request, or for its client."""
        idle = [one for one in self._connections if one.state in ("reading", "lingering")]
        idle = idle or [one for one in self._connections if one.state == "writing"]
        if not idle:
            return False
        self._drop(min(idle, key=lambda one: one.progress))
        return True

    def _read(self, connection: _Connection) -> None:
        data = connection.socket.recv(_BLOCK)
        if not data:
            self._drop(connection)
            return
        if connection.state == "lingering" or connection.state == "listening":
            return  # what a refused or listening client sends is not kept
        now = time.monotonic()
        if not connection.buffer:
            connection.since = now
        connection.progress = now
        connection.buffer += data
        if connection.state == "reading":
            self._advance(connection)
        elif len(connection.buffer) > HEAD + BODY:  # sent ahead while a request is being answered
            self._drop(connection)

    def _advance(self, connection: _Connection) -> None:
        """Hand over a request that is whole."""
        try:
            request = self._whole(connection)
        except _Refused as refused:
            self._refuse(connection, refused.status, refused.sentence)
            return
        if request is not None:
            connection.state, connection.since, connection.invited = "working", time.monotonic(), False
            self._ready.append((connection, request))

    def _whole(self, connection: _Connection) -> Request | None:
        buffer = connection.buffer
        while buffer and buffer[0] in b"\r\n":
            del buffer[:1]
        found = _END.search(buffer, 0, HEAD + 4)
        if found is None:
            if len(buffer) > HEAD:
                raise _Refused(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, f"more than {HEAD} bytes of headers")
            return None
        head = bytes(buffer[: found.end()])
        length = _length(head)
        if len(buffer) < found.end() + length:
            if b"100-continue" in head.lower() and not connection.invited:
                connection.invited = True
                connection.socket.send(b"HTTP/1.1 100 Continue\r\n\r\n")
            return None
        body = bytes(buffer[found.end() : found.end() + length])
        del buffer[: found.end() + length]
        return Request(head, body)

    def _dispatch(self) -> None:
        """Give requests to the workers, as long as the answers under way fit into memory."""
        waiting = sum(one.unsent for one in self._connections if one.state == "writing") if self._ready else 0
        while self._ready and self._busy < WORKERS and waiting < WAITING:
            connection, request = self._ready.popleft()
            if connection.state == "working":
                self._busy += 1
                self._work.put((connection, request))

    def _deliver(self) -> None:
        while self._done:
            connection, reply = self._done.popleft()
            self._busy -= 1
            if connection.state == "working":
                self._reply(connection, reply)

    def _reply(self, connection: _Connection, reply: Reply) -> None:
        if reply.listen and sum(one.listen for one in self._connections) >= LISTENERS:
            reply = self._refusal(HTTPStatus.SERVICE_UNAVAILABLE, "too many windows")
        connection.state, connection.close, connection.listen = "writing", reply.close, reply.listen
        connection.since = connection.progress = time.monotonic()
        connection.out.extend(memoryview(part) for part in reply.parts if part)
        self._try_to_write(connection)

    def _refuse(self, connection: _Connection, status: HTTPStatus, sentence: str) -> None:
        connection.buffer.clear()
        self._reply(connection, self._refusal(status, sentence))

    def _try_to_write(self, connection: _Connection) -> None:
        try:
            self._write(connection)
        except OSError:
            self._drop(connection)

    def _write(self, connection: _Connection) -> None:
        while connection.out:
            try:
                sent = connection.socket.send(connection.out[0][:_BLOCK])
            except BlockingIOError:
                self._selector.modify(connection.socket, selectors.EVENT_WRITE, connection)
                return
            connection.progress = time.monotonic()
            rest = connection.out[0][sent:]
            if len(rest):
                connection.out[0] = rest
            else:
                connection.out.popleft()
        self._selector.modify(connection.socket, selectors.EVENT_READ, connection)
        if connection.state == "writing":
            self._written(connection)

    def _written(self, connection: _Connection) -> None:
        connection.since = connection.progress = time.monotonic()
        if connection.listen:
            connection.state = "listening"
            connection.buffer.clear()
            self._tell(connection, self._told)
        elif connection.close:
            # closed at once, what the client still sends would wipe out the answer on its way
            connection.state = "lingering"
            connection.socket.shutdown(socket.SHUT_WR)
        else:
            connection.state = "reading"
            if connection.buffer:
                self._advance(connection)

    def _spread(self) -> None:
        """Send news to the listeners, or now and then a sign of life."""
        listeners = [one for one in self._connections if one.state == "listening"]
        news, now = self._news(), time.monotonic()
        changed = news != self._told
        self._told = news
        if not changed and now - self._beat < BEAT:
            return
        self._beat = now
        for connection in listeners:
            self._tell(connection, news if changed else None)

    def _tell(self, connection: _Connection, news: object) -> None:
        if connection.unsent > _BLOCK:
            self._drop(connection)  # it has not taken anything for a long time
            return
        text = ": here\n\n" if news is None else f"data: {json.dumps(news)}\n\n"
        connection.out.append(memoryview(text.encode()))
        self._try_to_write(connection)

    def _expire(self) -> None:
        now = time.monotonic()
        for connection in list(self._connections):
            age, still = now - connection.since, now - connection.progress
            match connection.state:
                case "reading" if connection.buffer and age > PATIENCE["reading"]:
                    self._refuse(connection, HTTPStatus.REQUEST_TIMEOUT, "the request did not come to its end in time")
                case "reading" if not connection.buffer and age > PATIENCE["idle"]:
                    self._drop(connection)
                case "writing" if still > PATIENCE["writing"] or age > LONGEST_ANSWER:
                    self._drop(connection)
                case "lingering" if age > PATIENCE["lingering"]:
                    self._drop(connection)

    def _drop(self, connection: _Connection) -> None:
        if connection.state == "closed":
            return
        connection.state = "closed"
        self._connections.discard(connection)
        connection.out.clear()
        connection.buffer.clear()
        with suppress(KeyError, ValueError):
            self._selector.unregister(connection.socket)
        connection.socket.close()


def _length(head: bytes) -> int:
    """Bytes of the body that a head announces.

    Raises
    ------
    _Refused : too many, several different numbers, no number, or a coding that has no length.
    """
    lengths: set[bytes] = set()
    for line in head.splitlines()[1:]:
        name, _, value = line.partition(b":")
        if name.strip().lower() == b"transfer-encoding":
            raise _Refused(HTTPStatus.NOT_IMPLEMENTED, "a body comes with its length here, not in chunks")
        if name.strip().lower() == b"content-length":
            lengths.add(value.strip())
    if not lengths:
        return 0
    if len(lengths) > 1 or not re.fullmatch(rb"[0-9]+", (text := lengths.pop())):
        raise _Refused(HTTPStatus.BAD_REQUEST, "the length of the body is not one number")
    if len(text.lstrip(b"0")) > len(str(BODY)) or int(text) > BODY:
        raise _Refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"more than {BODY} bytes at once")
    return int(text)


def _bound(address: tuple[str, int]) -> socket.socket:
    family, kind, protocol, _, place = _first(
        socket.getaddrinfo(*address, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    )
    listening = socket.socket(family, kind, protocol)
    try:
        if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows, where another program could take the port over
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(place)
        listening.listen(1024)
        listening.setblocking(False)
    except BaseException:
        listening.close()
        raise
    return listening


def _first(found: Iterable[tuple]) -> tuple:  # type: ignore[type-arg]
    """The first address, IPv4 where there is one."""
    return sorted(found, key=lambda each: each[0] != socket.AF_INET)[0]


def _descriptors() -> int:
    """Files and sockets that the system lets this process have."""
    try:
        import resource
    except ImportError:  # Windows
        return 2 * CONNECTIONS
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return 2 * CONNECTIONS if soft in (resource.RLIM_INFINITY, -1) else int(soft)
