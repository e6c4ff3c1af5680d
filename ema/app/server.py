"""The workbench behind a page of this machine: a small server of its own, so that nothing is fetched from elsewhere."""

import json
import secrets
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from ipaddress import ip_address
from typing import Any
from urllib.parse import parse_qs, urlsplit

from ema.app import places, views
from ema.app.state import Workbench
from ema.errors import EmaError, FailureError, InputError, require
from ema.show.moving import script

LOCAL = "127.0.0.1"
_LARGEST = 1_000_000
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self'; font-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


@dataclass
class App:
    """A running server.

    ``token`` has to be part of the address where others than this machine can reach it.
    """

    bench: Workbench
    server: ThreadingHTTPServer
    token: str
    changed: threading.Condition = field(default_factory=threading.Condition)
    busy: str = ""
    stopped: bool = False

    @property
    def address(self) -> str:
        """What to open in a browser."""
        host, port = self.server.server_address[:2]
        told = str(host) if host not in ("0.0.0.0", "::") else _own_name()
        return f"http://{f'[{told}]' if ':' in told else told}:{port}/" + (f"?token={self.token}" if self.token else "")

    def run(self) -> None:
        """Serve until stopped."""
        self.server.serve_forever(poll_interval=0.1)

    def stop(self) -> None:
        """End ``run`` and give the port back."""
        with self.changed:
            self.stopped = True
            self.changed.notify_all()
        self.server.shutdown()
        self.server.server_close()

    def tell(self, busy: str = "") -> None:
        """Let every window know that something has changed."""
        with self.changed:
            self.busy = busy
            self.changed.notify_all()


def serve(bench: Workbench, host: str = LOCAL, port: int = 8080) -> App:
    """Open the port and return the server, which answers once ``run`` is called.

    Parameters
    ----------
    host : by default only this machine can reach it; any other address asks for a token that is part of the URL.
    port : 0 takes a free one.

    Raises
    ------
    MissingExtraError : plotly is not installed.
    FailureError : the port is in use or the address is not this machine's.
    """
    require("plotly", "app")
    try:
        server = _Server((host, port), _Handler)
    except OSError as error:
        raise FailureError(
            f"the page cannot be served: {error.strerror or error}", where=f"{host}:{port}",
            advice="choose another port with --port (0 takes a free one)",
        ) from error  # fmt: skip
    app = App(bench, server, "" if _local(host) else secrets.token_urlsafe(24))
    server.app = app
    return app


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True
    app: App


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


_STATIC: dict[str, tuple[str, Callable[[], bytes]]] = {
    "/plotly.js": ("text/javascript", _plotly),
    "/motion.js": ("text/javascript", lambda: script().encode()),
    "/app.js": ("text/javascript", lambda: _own("app.js")),
    "/app.css": ("text/css", lambda: _own("app.css")),
}


class _Handler(BaseHTTPRequestHandler):
    """Answers one window. Every fault reaches the page as a sentence."""

    server: _Server
    protocol_version = "HTTP/1.1"

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: the page shows what went wrong."""

    def do_GET(self) -> None:
        """Answer with the page, its parts, a view as JSON, or an export."""
        url = urlsplit(self.path)
        query = {name: values[0] for name, values in parse_qs(url.query).items()}
        if not self._welcome(query.get("token", "")):
            return
        if url.path == "/":
            self._send(200, "text/html", _own("app.html"))
        elif url.path in _STATIC:
            kind, content = _STATIC[url.path]
            self._send(200, kind, content())
        elif url.path == "/events":
            self._events()
        elif url.path == "/export":
            self._export(query.get("kind", ""))
        elif url.path.startswith("/api/"):
            self._answer(lambda: self._view(url.path.removeprefix("/api/"), query))
        else:
            self._send(404, "application/json", b'{"error": "there is no such page"}')

    def do_POST(self) -> None:
        """Do what the page asks for, if our page asks, and answer with the overview."""
        url = urlsplit(self.path)
        query = {name: values[0] for name, values in parse_qs(url.query).items()}
        try:
            length = int(self.headers.get("Content-Length") or 0)
        except ValueError:
            length = _LARGEST + 1
        if not 0 <= length <= _LARGEST:
            self.close_connection = True
            self._send(413, "application/json", b'{"error": "too much at once"}')
            return
        body = self.rfile.read(length)
        if not self._welcome(query.get("token", "")):
            return
        # a form of another page cannot set this header without asking first, and nobody answers that question
        if self.headers.get("X-Ema") != "1":
            self._send(403, "application/json", b'{"error": "this request did not come from our page"}')
            return
        self._answer(lambda: self._act(url.path.removeprefix("/api/"), json.loads(body or b"{}")))

    def _welcome(self, token: str) -> bool:
        app = self.server.app
        host = urlsplit(f"//{self.headers.get('Host', '')}").hostname or ""
        if app.token:
            fine = secrets.compare_digest(token.encode(), app.token.encode()) or urlsplit(self.path).path in _STATIC
        else:
            # a name that somebody else points to this machine is not ours
            fine = _local(host)
        if not fine:
            text = "open the address that `ema app` has printed: it ends with a token"
            self._send(403, "application/json", json.dumps({"error": text}).encode())
        return fine

    def _view(self, name: str, query: dict[str, str]) -> dict[str, Any]:
        bench = self.server.app.bench
        match name:
            case "overview":
                return views.overview(bench) | {"busy": self.server.app.busy}
            case "poles":
                return views.poles(bench)
            case "frf":
                return views.frf(bench, int(query.get("output", 0)), int(query.get("input", 0)))
            case "matrix":
                return views.matrix(bench)
            case "motion":
                return views.motion(bench)
            case "hits":
                return views.hits(bench)
            case "pulse":
                return views.pulse(bench, int(query.get("hit", 0)))
            case "chart":
                return views.chart(bench, int(query.get("map", 0)))
            case "point":
                return views.point(bench, *(int(query.get(name, 0)) for name in ("map", "level", "force")))
            case "placement":
                return places.placement_view(bench, int(query.get("number", 0)))
            case "place":
                return places.place_view(bench, int(query.get("number", 0)), int(query.get("candidate", 0)))
        raise InputError("there is no such view", got=name)

    def _act(self, name: str, told: dict[str, Any]) -> dict[str, Any]:
        app, bench = self.server.app, self.server.app.bench
        actions: dict[str, Callable[[], Any]] = {
            "run": lambda: bench.choose(str(told["run"])),
            "pick": lambda: bench.pick(int(told["row"])),
            "near": lambda: bench.pick_near(float(told["frequency"])),
            "drop": lambda: bench.drop(int(told["mode"])),
            "undo": bench.undo,
            "save": bench.save,
            "exclude": lambda: bench.exclude(int(told["hit"]), str(told["why"]), str(told["who"])),
            "behind": lambda: bench.choose(bench.behind(int(told["map"]), int(told["level"]), int(told["force"]))),
        }
        if name not in actions:
            raise InputError("there is no such action", got=name)
        app.tell(busy=name)
        try:
            done = actions[name]()
        finally:
            app.tell()
        return views.overview(bench) | {"busy": "", "done": str(done or "")}

    def _answer(self, work: Callable[[], dict[str, Any]]) -> None:
        try:
            status, content = 200, work()
        except EmaError as error:
            status, content = 400, {"error": str(error)}
        except (KeyError, ValueError, TypeError) as error:
            status, content = 400, {"error": f"this request is not understood: {error}"}
        except Exception as error:
            status, content = 500, {"error": f"a fault in ema itself: {type(error).__name__}: {error}"}
        self._send(status, "application/json", json.dumps(content, allow_nan=False).encode())

    def _export(self, kind: str) -> None:
        try:
            name, content = views.export(self.server.app.bench, kind)
        except EmaError as error:
            self._send(400, "application/json", json.dumps({"error": str(error)}).encode())
            return
        self._send(200, "application/octet-stream", content, name)

    def _events(self) -> None:
        """A line for every change, so that all windows show the same."""
        app = self.server.app
        self.send_response(200)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        try:
            told: object = None
            while not app.stopped:
                with app.changed:
                    now = (app.bench.revision, app.busy, app.bench.saved)
                    if now == told:
                        app.changed.wait(2.0)
                now = (app.bench.revision, app.busy, app.bench.saved)
                message = (
                    f"data: {json.dumps({'revision': now[0], 'busy': now[1]})}\n\n" if now != told else ": here\n\n"
                )
                told = now
                self.wfile.write(message.encode())
                self.wfile.flush()
        except OSError:
            return  # the window was closed

    def _send(self, status: int, kind: str, content: bytes, name: str = "") -> None:
        self.send_response(status)
        self.send_header("Content-Type", f"{kind}; charset=utf-8" if kind.startswith("text") else kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        if name:
            letters = "".join(
                letter if (letter.isascii() and letter.isalnum()) or letter in "._-" else "_" for letter in name
            )
            self.send_header("Content-Disposition", f'attachment; filename="{letters}"')
        self.end_headers()
        try:
            self.wfile.write(content)
        except OSError:
            self.close_connection = True  # the window was closed
