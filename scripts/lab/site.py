# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of the site of `make run`: chapter 5's points, who may log in, the board's MAC addresses.

python -m lab.site FOLDER: FOLDER/lab for `make image-debian SITE=`; FOLDER/key opens that board.
With --updates also FOLDER/field, a site that takes updates besides; FOLDER/update.key signs them.
"""

from __future__ import annotations

import argparse
import json
import subprocess
from pathlib import Path

from lab.board import configuration, macs_file


def write_site(folder: Path, *, updates: bool) -> None:
    """Writes what has changed, so that what is built of it is built again only then."""
    key = folder / "key"
    folder.mkdir(parents=True, exist_ok=True)
    if not key.exists():
        subprocess.run(
            ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "make run", "-f", key], check=True
        )
    settings = {
        "config.json": json.dumps(configuration(), indent=2) + "\n",
        "authorized_keys": key.with_suffix(".pub").read_text(),
        "macs": macs_file(),
    }
    write_changed(folder / "lab", settings)
    if updates:
        write_changed(folder / "field", settings | {"update.pem": certificate(folder)})


def write_changed(site: Path, settings: dict[str, str]) -> None:
    site.mkdir(exist_ok=True)
    for name, text in settings.items():
        file = site / name
        if not file.exists() or file.read_text() != text:
            file.write_text(text)


def certificate(folder: Path) -> str:
    """Of who signs updates."""
    key, signer = folder / "update.key", folder / "update.crt"
    if not signer.exists():
        make_certificate(key, signer, "make run")
    return signer.read_text()


def make_certificate(key: Path, certificate: Path, name: str) -> None:
    """A key and the certificate of who signs updates by it, as docs/update.md tells."""
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:3072", "-nodes", "-days", "7300", "-subj", f"/CN={name}",
         "-addext", "extendedKeyUsage=codeSigning", "-addext", "keyUsage=digitalSignature",
         "-keyout", key, "-out", certificate],
        check=True, capture_output=True,
    )  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="lab.site", description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--updates", action="store_true", help="also the site that takes updates")
    given = parser.parse_args()
    write_site(given.folder, updates=given.updates)
