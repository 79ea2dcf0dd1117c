#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""
An image of containers with one layer, as an archive that podman, buildah, skopeo and Docker read: the
layout of OCI's image specification, version 1. The same root gives the same bytes.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import io
import json
import shutil
import sys
import tarfile
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

MEDIA = "application/vnd.oci.image"
BLOCK = 1 << 20


@dataclass(frozen=True)
class Blob:
    media: str
    content: IO[bytes]
    digest: str
    size: int

    def described(self, **more: Any) -> dict[str, Any]:
        return {"mediaType": self.media, "digest": f"sha256:{self.digest}", "size": self.size, **more}


def blob(media: str, content: IO[bytes]) -> Blob:
    digest = digest_of(content)
    size = content.seek(0, io.SEEK_END)
    return Blob(media, content, digest, size)


def digest_of(content: IO[bytes]) -> str:
    content.seek(0)
    return hashlib.file_digest(content, "sha256").hexdigest()


def written(media: str, value: dict[str, Any]) -> Blob:
    return blob(media, io.BytesIO(json.dumps(value, sort_keys=True).encode()))


def layer_of(root: Path, packed: IO[bytes]) -> Blob:
    with root.open("rb") as source, gzip.GzipFile("", "wb", 6, packed, mtime=0) as out:
        shutil.copyfileobj(source, out, BLOCK)
    return blob(f"{MEDIA}.layer.v1.tar+gzip", packed)


def configuration(arguments: argparse.Namespace, layer: str) -> dict[str, Any]:
    """layer: the digest of what is unpacked."""
    created = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(arguments.created))
    config: dict[str, Any] = {
        "Entrypoint": arguments.command,
        "Env": ["PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL=C.UTF-8"],
        "ExposedPorts": {f"{port}/tcp": {} for port in arguments.port},
        "StopSignal": "SIGTERM",
        "WorkingDir": "/",
    }
    if arguments.user:
        config["User"] = arguments.user
    return {
        "created": created,
        "architecture": arguments.architecture,
        "os": "linux",
        "config": config,
        "rootfs": {"type": "layers", "diff_ids": [f"sha256:{layer}"]},
        "history": [{"created": created, "created_by": "make containers"}],
    }


def put(archive: tarfile.TarFile, name: str, content: IO[bytes], created: int) -> None:
    entry = tarfile.TarInfo(name)
    entry.size = content.seek(0, io.SEEK_END)
    entry.mtime = created
    content.seek(0)
    archive.addfile(entry, content)


def write(arguments: argparse.Namespace) -> None:
    with tempfile.TemporaryFile() as packed, arguments.root.open("rb") as root:
        layer = layer_of(arguments.root, packed)
        config = written(f"{MEDIA}.config.v1+json", configuration(arguments, digest_of(root)))
        manifest = written(
            f"{MEDIA}.manifest.v1+json",
            {
                "schemaVersion": 2,
                "mediaType": f"{MEDIA}.manifest.v1+json",
                "config": config.described(),
                "layers": [layer.described()],
            },
        )
        named = {"org.opencontainers.image.ref.name": arguments.name}
        index = {"schemaVersion": 2, "manifests": [manifest.described(annotations=named)]}
        with tarfile.open(arguments.out, "w", format=tarfile.PAX_FORMAT) as archive:
            files: dict[str, IO[bytes]] = {
                f"blobs/sha256/{each.digest}": each.content for each in (config, layer, manifest)
            }
            files["index.json"] = io.BytesIO(json.dumps(index, sort_keys=True).encode())
            files["oci-layout"] = io.BytesIO(b'{"imageLayoutVersion": "1.0.0"}')
            for name in sorted(files):
                put(archive, name, files[name], arguments.created)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("root", type=Path, help="the root file system, a tar")
    parser.add_argument("out", type=Path, help="the archive")
    parser.add_argument("--name", required=True, help="what an engine calls it: NAME:TAG")
    parser.add_argument("--architecture", required=True, help="as Go has it: amd64, arm64, arm")
    parser.add_argument("--created", type=int, required=True, help="seconds since 1970")
    parser.add_argument("--user", help="who runs the command [root]")
    parser.add_argument("--port", type=int, action="append", default=[], help="a TCP port that it serves")
    parser.add_argument("command", nargs="+", help="what a container runs")
    arguments = parser.parse_args()
    try:
        write(arguments)
    except OSError as error:
        print(f"oci-archive: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
