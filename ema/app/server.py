"""A page of this machine: a small server of its own, so that nothing is fetched from elsewhere."""

import json
import math
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from importlib.resources import files
from io import BufferedIOBase, BytesIO
from ipaddress import ip_address
from typing import Any, NoReturn, Protocol, runtime_checkable
from urllib.parse import parse_qs, urlsplit

from ema.app.connections import Reply, Request, Server
from ema.app.state import Workbench
from ema.app.words import table, translated
from ema.app.workbench_page import WorkbenchPage
from ema.errors import EmaError, FailureError, require
from ema.messages import checked_language, preferred, speaking
from ema.show.moving import script

LOCAL = "127.0.0.1"
DEEPEST = 16
"""Levels of lists and tables in a body that are read. Our page sends one; Python's reader fails at some thousand."""

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self'; font-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


@runtime_checkable
class Page(Protocol):
    """What the server shows: a page of ours with its script, and its answers."""

    name: str
    """Of the files in the folder of pages, without their ends."""

    def view(self, name: str, query: dict[str, str]) -> dict[str, Any]:
        """Part of the page as numbers and texts."""

    def act(self, name: str, request: dict[str, Any], changed: Callable[[], None]) -> dict[str, Any]:
        """Do what the page asks for; ``changed`` tells all windows."""

    def export(self, kind: str) -> tuple[str, bytes]:
        """A file for other programs: its name and content."""

    def news(self) -> dict[str, Any]:
        """What the windows follow."""


@dataclass
class App:
    """A running server.

    ``language`` is that of its words, by default the first of those that the browser accepts. ``token`` has to be
    part of the address where others than this machine can reach it.
    """

    page: Page
    server: Server
    token: str
    language: str = ""

    @property
    def address(self) -> str:
        """What to open in a browser."""
        host, port = self.server.server_address[:2]
        shown = str(host) if host not in ("0.0.0.0", "::") else _own_name()
        return f"http://{f'[{shown}]' if ':' in shown else shown}:{port}/" + (
            f"?token={self.token}" if self.token else ""
        )

    def run(self) -> None:
        """Serve until stopped."""
        self.server.serve_forever()

    def stop(self) -> None:
        """End ``run`` and give the port back."""
        self.server.shutdown()
        self.server.server_close()

    def changed(self) -> None:
        """Let every window know that something has changed."""
        self.server.wake()


def serve(page: Page | Workbench, host: str = LOCAL, port: int = 8080, language: str = "") -> App:
    """Open the port and return the server, which answers once ``run`` is called.

    Parameters
    ----------
    page : Page or Workbench
        Study that is worked on, or another page of ours.
    host : str, optional
        Address; by default only this machine can reach it. Any other address requires a token that is part of the URL.
    port : int, default 8080
        Port; 0 takes a free one.
    language : str, optional
        Code of the language of the page; by default the first that exists of those that the browser accepts.

    Returns
    -------
    App
        The server.

    Raises
    ------
    MissingExtraError
        If plotly is not installed.
    InputError
        If there is no such language.
    FailureError
        If the port is in use, or the address is not this machine's.

    Examples
    --------
    >>> from pathlib import Path
    >>> from ema.examples import study_result
    >>> app = serve(Workbench(study_result(), Path("study.h5")), port=0)
    >>> app.stop()
    """
    require("plotly", "app")
    spoken = checked_language(language) if language else ""
    token = "" if _local(host) else secrets.token_urlsafe(24)
    apps: list[App] = []
    shown = WorkbenchPage(page) if isinstance(page, Workbench) else page
    try:
        server = Server((host, port), lambda request: _Handler(apps[0], request).reply, _refusal, shown.news)
    except OSError as error:
        raise FailureError(
            f"the page cannot be served: {error.strerror or error}",
            where=f"{host}:{port}",
            advice="choose another port with --port (0 takes a free one)",
        ) from error
    apps.append(App(shown, server, token, spoken))
    return apps[0]


def _local(host: str) -> bool:
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


def _own_name() -> str:
    import socket

    return socket.gethostname()


@cache
def _plotly() -> bytes:
    return (files("plotly") / "package_data" / "plotly.min.js").read_bytes()


def _own(name: str) -> bytes:
    return (files("ema.app") / "page" / name).read_bytes()


def _words() -> bytes:
    return table(*(_own(name).decode() for name in ("common.js", "app.js", "live.js"))).encode()


_STATIC: dict[str, tuple[str, Callable[[], bytes]]] = {
    "/plotly.js": ("text/javascript", _plotly),
    "/motion.js": ("text/javascript", lambda: script().encode()),
    "/words.js": ("text/javascript", _words),
    "/common.js": ("text/javascript", lambda: _own("common.js")),
    "/app.js": ("text/javascript", lambda: _own("app.js")),
    "/live.js": ("text/javascript", lambda: _own("live.js")),
    "/app.css": ("text/css", lambda: _own("app.css")),
}


_HEADERS = (
    ("Cache-Control", "no-store"),
    ("Content-Security-Policy", _POLICY),
    ("X-Content-Type-Options", "nosniff"),
    ("Referrer-Policy", "no-referrer"),
)


def _refusal(status: HTTPStatus, sentence: str) -> Reply:
    """The answer to a request that is not looked at any further."""
    content = json.dumps({"error": sentence}).encode()
    lines = [
        f"HTTP/1.1 {status.value} {status.phrase}",
        "Content-Type: application/json",
        f"Content-Length: {len(content)}",
        "Connection: close",
        *(f"{name}: {value}" for name, value in _HEADERS),
    ]
    return Reply(["\r\n".join([*lines, "", ""]).encode(), content])


class _Parts(BufferedIOBase):
    """Takes the parts of an answer as they are, without a copy of the large ones."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []

    def write(self, data: Any) -> int:
        """Keep ``data``."""
        self.parts.append(bytes(data))
        return len(data)


class _Handler(BaseHTTPRequestHandler):
    """Answers one request that has arrived whole. Every fault reaches the page as a sentence with a status."""

    protocol_version = "HTTP/1.1"
    default_request_version = "HTTP/1.0"  # a line that is no request gets a status too

    def __init__(self, app: App, request: Request) -> None:
        self.app, self.body = app, request.body
        self.rfile, self._parts = BytesIO(request.head), _Parts()
        self.client_address, self.requestline, self.command = ("", 0), "", ""
        self.close_connection, self.listens = True, False
        self.wfile = self._parts
        self.handle_one_request()

    @property
    def reply(self) -> Reply:
        """The answer."""
        return Reply(self._parts.parts, self.close_connection, self.listens)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: the page shows what went wrong."""

    def handle_expect_100(self) -> bool:
        """The body is here already."""
        return True

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Refuse what is no request of ours, as a sentence."""
        self.close_connection = True
        self._refuse(code, message or HTTPStatus(code).phrase)

    def do_GET(self) -> None:
        """Answer with the page, its parts, a view as JSON, or an export."""
        self._answered(self._get)

    def do_POST(self) -> None:
        """Do what the page asks for, if our page asks, and answer with the overview."""
        self._answered(self._post)

    def _get(self, path: str, query: dict[str, str]) -> dict[str, Any] | None:
        if path == "/":
            self._send(200, "text/html", translated(_own(f"{self.app.page.name}.html").decode()).encode())
        elif path in _STATIC:
            kind, read = _STATIC[path]
            self._send(200, kind, read())
        elif path == "/events":
            self._events()
        elif path == "/export":
            name, content = self.app.page.export(query.get("kind", ""))
            self._send(200, "application/octet-stream", content, name)
        elif path.startswith("/api/"):
            return self.app.page.view(path.removeprefix("/api/"), query)
        else:
            self._refuse(404, "there is no such page")
        return None

    def _post(self, path: str, query: dict[str, str]) -> dict[str, Any] | None:
        # a form of another page cannot set this header without asking first, and nobody answers that question
        if self.headers.get("X-Ema") != "1":
            self._refuse(403, "this request did not come from our page")
            return None
        return self.app.page.act(path.removeprefix("/api/"), _read(self.body), self.app.changed)

    def _answered(self, work: Callable[[str, dict[str, str]], dict[str, Any] | None]) -> None:
        try:
            url = urlsplit(self.path)
            query = {name: values[0] for name, values in parse_qs(url.query, max_num_fields=20).items()}
            if not self._welcome(url.path, query.get("token", "")):
                self._refuse(403, "open the address that `ema app` has printed: it ends with a token")
                return
            with speaking(self.app.language or preferred(self.headers.get("Accept-Language", ""))):
                content = work(url.path, query)
            answer = None if content is None else json.dumps(content, allow_nan=False).encode()
        except EmaError as error:
            self._refuse(400, str(error))
        except (KeyError, ValueError, TypeError, IndexError, OverflowError, RecursionError) as error:
            self._refuse(400, f"this request is not understood: {error}")
        except Exception as error:
            self._refuse(500, f"a fault in ema itself: {type(error).__name__}: {error}")
        else:
            if answer is not None:
                self._send(200, "application/json", answer)

    def _refuse(self, status: int, sentence: str) -> None:
        self._send(status, "application/json", json.dumps({"error": sentence}).encode())

    def _welcome(self, path: str, token: str) -> bool:
        if self.app.token:
            return secrets.compare_digest(token.encode(), self.app.token.encode()) or path in _STATIC
        # a name that somebody else points to this machine is not ours; one name alone, and nothing but a port with it
        hosts = self.headers.get_all("Host") or [""]
        url = urlsplit(f"//{hosts[0]}")
        alone = len(hosts) == 1 and url.netloc == hosts[0] and url.username is None
        return alone and (url.port is None or url.port > 0) and _local(url.hostname or "")

    def _events(self) -> None:
        """The head of a stream with a line for every change, so that all windows show the same."""
        self.send_response(200)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Connection", "close")
        for name, value in _HEADERS:
            self.send_header(name, value)
        self.end_headers()
        self.listens = True

    def _send(self, status: int, kind: str, content: bytes, name: str = "") -> None:
        self.send_response(status)
        self.send_header("Content-Type", f"{kind}; charset=utf-8" if kind.startswith("text") else kind)
        self.send_header("Content-Length", str(len(content)))
        for header, value in _HEADERS:
            self.send_header(header, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        if name:
            letters = "".join(
                letter if (letter.isascii() and letter.isalnum()) or letter in "._-" else "_" for letter in name
            )
            self.send_header("Content-Disposition", f'attachment; filename="{letters}"')
        self.end_headers()
        self.wfile.write(content)


def _read(body: bytes) -> dict[str, Any]:
    """The table in a body.

    Raises
    ------
    ValueError : it is none, nested too deeply, or holds a number that is none.
    """
    depth = 0
    for letter in body:
        depth += (letter in b"[{") - (letter in b"]}")
        if depth > DEEPEST:
            raise ValueError(f"more than {DEEPEST} levels")
    content = json.loads(body or b"{}", parse_float=_finite, parse_constant=_no_number)
    if not isinstance(content, dict):
        raise ValueError("a table is expected")
    return content


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:20]} is too large a number")
    return value


def _no_number(text: str) -> NoReturn:
    raise ValueError(f"{text} is no number")
