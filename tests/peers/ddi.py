# SPDX-License-Identifier: GPL-3.0-or-later
"""A server of updates: hawkBit's Direct Device Integration API over HTTPS, with a CA of its own, in a thread.

What its answers look like is from the API's description; hawkBit itself needs Java.
"""

from __future__ import annotations

import asyncio
import ssl
import subprocess
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from aiohttp import web

TOKEN = "GatewayToken d1d2d3"
BASE = "/DEFAULT/controller/v1"


@dataclass
class Authority:
    """Who signs servers' certificates: a CA for this test alone."""

    folder: Path
    name: str = "ca"

    @property
    def certificate(self) -> Path:
        return self.folder / f"{self.name}.pem"

    def __post_init__(self) -> None:
        self._make(
            "-subj", f"/CN={self.name}", "-keyout", str(self.folder / f"{self.name}.key"), "-out",
            str(self.certificate),
        )  # fmt: skip

    def server(self, *addresses: str) -> tuple[Path, Path]:
        """A certificate for a server at these addresses, and its key."""
        files = self.folder / f"{self.name}-server.pem", self.folder / f"{self.name}-server.key"
        key = str(self.folder / f"{self.name}.key")
        names = ",".join(f"IP:{address}" for address in addresses)
        self._make(
            "-subj", "/CN=updates", "-addext", f"subjectAltName={names}",
            "-addext", "basicConstraints=CA:FALSE", "-CA", str(self.certificate), "-CAkey", key,
            "-keyout", str(files[1]), "-out", str(files[0]),
        )  # fmt: skip
        return files

    @staticmethod
    def _make(*words: str) -> None:
        key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "3650")
        subprocess.run(["openssl", "req", "-x509", *key, *words], check=True, capture_output=True)


@dataclass
class UpdateServer:
    """Offers one action at a time. `seen` has what boards asked, `reports` what they reported."""

    files: tuple[Path, Path]
    host: str = "127.0.0.1"  # as boards call it
    port: int = 0
    action: str = ""  # its identity
    cancelled: str = ""  # an identity of an action that is to be cancelled
    content: bytes = b""
    update: str = "forced"
    filename: str = "image.swu"
    elsewhere: str = ""  # what the links begin with, instead of this server
    polling: str = "00:05:00"
    cuts: list[int] = field(default_factory=list)  # connections break off after so many bytes
    ranges: bool = True
    answer: dict[str, Any] | None = None  # instead of the right one
    gone: bool = False  # it no longer knows the actions that are reported on
    seen: list[str] = field(default_factory=list)
    reports: list[dict[str, Any]] = field(default_factory=list)
    attributes: dict[str, str] = field(default_factory=dict)

    @property
    def origin(self) -> str:
        return f"https://{self.host}:{self.port}"

    @property
    def settings(self) -> str:
        """What a site has in its `update-server`."""
        return f"url {self.origin}{BASE}\ntoken {TOKEN}\n"

    @property
    def results(self) -> list[tuple[str, str, str]]:
        """Of each report, identity, execution and result."""
        return [
            (report["id"], report["status"]["execution"], report["status"]["result"]["finished"])
            for report in self.reports
        ]

    def __enter__(self) -> Self:
        self._loop = asyncio.new_event_loop()
        started = threading.Event()
        self._thread = threading.Thread(target=self._serve, args=(started,))
        self._thread.start()
        assert started.wait(30)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    def _serve(self, started: threading.Event) -> None:
        asyncio.set_event_loop(self._loop)
        app = web.Application(middlewares=[self._admit])
        app.router.add_get(BASE + "/{board}", self._root)
        app.router.add_put(BASE + "/{board}/configData", self._config)
        app.router.add_get(BASE + "/{board}/{kind:deploymentBase|cancelAction}/{id}", self._action)
        app.router.add_post(BASE + "/{board}/{kind}/{id}/feedback", self._feedback)
        app.router.add_get("/file", self._file)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=0)
        self._loop.run_until_complete(runner.setup())
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(*self.files)
        site = web.TCPSite(runner, "127.0.0.1", self.port, ssl_context=context)
        self._loop.run_until_complete(site.start())
        self.port = runner.addresses[0][1]
        started.set()
        self._loop.run_forever()
        self._loop.run_until_complete(runner.cleanup())
        self._loop.close()

    @web.middleware
    async def _admit(self, request: web.Request, handler: Any) -> web.StreamResponse:
        self.seen.append(f"{request.method} {request.path}")
        if request.headers.get("Authorization") != TOKEN:
            raise web.HTTPUnauthorized
        return await handler(request)

    async def _root(self, request: web.Request) -> web.Response:
        if self.answer is not None:
            return web.json_response(self.answer)
        base = f"{self.elsewhere or self.origin}{request.path}"
        links = {"configData": {"href": f"{base}/configData"}}
        if self.action:
            links["deploymentBase"] = {"href": f"{base}/deploymentBase/{self.action}?c=-2129030598"}
        if self.cancelled:
            links["cancelAction"] = {"href": f"{base}/cancelAction/{self.cancelled}"}
        return web.json_response({"config": {"polling": {"sleep": self.polling}}, "_links": links})

    async def _config(self, request: web.Request) -> web.Response:
        self.attributes = (await request.json())["data"]
        return web.Response()

    async def _action(self, request: web.Request) -> web.Response:
        name = request.match_info["id"]
        if request.match_info["kind"] == "cancelAction":
            return web.json_response({"id": name, "cancelAction": {"stopId": name}})
        artifact = {
            "filename": self.filename,
            "size": len(self.content),
            "_links": {"download": {"href": f"{self.elsewhere or self.origin}/file"}},
        }
        chunks = [{"part": "os", "version": "1", "name": "image", "artifacts": [artifact]}]
        deployment = {"download": "forced", "update": self.update, "chunks": chunks}
        return web.json_response({"id": name, "deployment": deployment})

    async def _feedback(self, request: web.Request) -> web.Response:
        if self.gone:
            raise web.HTTPNotFound
        report = await request.json()
        assert report["id"] == request.match_info["id"]
        self.reports.append(report)
        if report["status"]["execution"] == "closed":
            self.action = self.cancelled = ""
        return web.Response()

    async def _file(self, request: web.Request) -> web.StreamResponse:
        first = request.http_range.start or 0 if self.ranges else 0
        self.seen[-1] += f" from {request.http_range.start or 0}"
        response = web.StreamResponse(status=206 if first else 200)
        rest = self.content[first:]
        response.content_length = len(rest)
        if first:
            whole = len(self.content)
            response.headers["Content-Range"] = f"bytes {first}-{whole - 1}/{whole}"
        await response.prepare(request)
        if self.cuts:
            await response.write(rest[: self.cuts.pop(0)])
            assert request.transport
            request.transport.close()
            return response
        await response.write(rest)
        return response
