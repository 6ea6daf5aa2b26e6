"""The pages live on this computer: a server on the loopback that answers only who has its token."""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Callable
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

from symfive.errors import InputError
from symfive.history._history import History
from symfive.version import __version__

LOOPBACK, COOKIE = "127.0.0.1", "symfive-history"
SILENT_S = 10.0
"""A connection that says nothing for so long is closed."""


class Server:
    """Serves the history in `folder` on 127.0.0.1; `port` 0 takes a free one. `address` holds the token; `serve` blocks.

    The token comes once as `?token=`, then as a cookie that scripts cannot read and other sites do not send. Requests under
    another host name are refused (DNS rebinding). Raises `InputError` where the port is taken or there is no history.
    """

    def __init__(self, folder: Path, port: int = 0) -> None:
        with History(folder):
            pass
        self.token = secrets.token_urlsafe(24)
        try:
            self._server = ThreadingHTTPServer((LOOPBACK, port), _handler(folder, self.token))
        except OSError as error:
            remedy = "name another with --port, or leave it out"
            raise InputError(f"port {port} cannot be used ({error.strerror})", remedy=remedy) from None
        self._server.daemon_threads = True
        self.port = int(self._server.server_address[1])
        self.address = f"http://{LOOPBACK}:{self.port}/?token={self.token}"

    def serve(self) -> None:
        """Answer until `close`, or Ctrl-C."""
        try:
            self._server.serve_forever(poll_interval=0.2)
        finally:
            self._server.server_close()

    def close(self) -> None:
        """End `serve`, from another thread."""
        self._server.shutdown()


def _handler(folder: Path, token: str) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        server_version, sys_version, timeout = f"symfive/{__version__}", "", SILENT_S

        def do_GET(self) -> None:
            _answer(self, folder, token)

        def do_HEAD(self) -> None:
            _answer(self, folder, token)

        def log_message(self, format: str, *args: object) -> None:
            """The token must not stand in a log."""

    return Handler


def _answer(request: BaseHTTPRequestHandler, folder: Path, token: str) -> None:
    port = request.connection.getsockname()[1]
    if request.headers.get("Host") not in (f"{LOOPBACK}:{port}", f"localhost:{port}"):
        return _send(request, HTTPStatus.MISDIRECTED_REQUEST, "This server answers only on the loopback.")
    address = urlsplit(request.path)
    given = parse_qs(address.query).get("token", [""])[0]
    if given:
        if not _same(given, token):
            return _send(request, HTTPStatus.FORBIDDEN, "The token is wrong.")
        cookie = f"{COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/"
        place = address.path if address.path.startswith("/") and not address.path.startswith("//") else "/"
        return _send(request, HTTPStatus.SEE_OTHER, "", {"Location": place, "Set-Cookie": cookie})
    if not _same(_cookie(request), token):
        return _send(request, HTTPStatus.FORBIDDEN, "Open the address that symfive history serve printed.")
    try:
        with History(folder) as history:
            page = _page(history, address.path)
    except InputError as error:
        return _send(request, HTTPStatus.INTERNAL_SERVER_ERROR, str(error))
    if page is None:
        return _send(request, HTTPStatus.NOT_FOUND, "There is no such page.")
    return _send(request, HTTPStatus.OK, page, {"Content-Type": "text/html; charset=utf-8"})


def _page(history: History, path: str) -> str | None:
    """The fleet's page at the root, a machine's under its key."""
    pages: dict[str, Callable[[], str]] = {"/": history.fleet_page}
    for machine in history.machines():
        pages[f"/{machine.key}.html"] = lambda machine=machine: history.machine_page(machine)  # type: ignore[misc]
    return pages[path]() if path in pages else None


def _cookie(request: BaseHTTPRequestHandler) -> str:
    try:
        found = SimpleCookie(request.headers.get("Cookie", "")).get(COOKIE)
    except CookieError:
        return ""
    return found.value if found is not None else ""


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())


def _send(
    request: BaseHTTPRequestHandler, status: HTTPStatus, text: str, headers: dict[str, str] | None = None
) -> None:
    body = text.encode()
    request.send_response(status)
    every = {"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body)), "Cache-Control": "no-store",
             "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "X-Frame-Options": "DENY"}  # fmt: skip
    for name, value in {**every, **(headers or {})}.items():
        request.send_header(name, value)
    request.end_headers()
    if request.command != "HEAD":
        request.wfile.write(body)
