# SPDX-License-Identifier: GPL-3.0-or-later
"""A certification authority, by the commands of docs/telecontrol.md."""

from __future__ import annotations

import os
import re
import subprocess
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

EC = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1"
BOOK = """\
[ca]
default_ca = ca
database = index.txt
default_md = sha256
new_certs_dir = .
rand_serial = yes
policy = policy
[policy]
commonName = supplied
"""
DATE = "%Y%m%d%H%M%SZ"
STATION_USER = 61201  # rtud's user for rtu-iec104, when it runs as root
OUTSTATIONS_USER = 61214  # the same for rtu-104m
IEC61850_USER = 61217  # the same for rtu-iec61850


def openssl(*arguments: str | Path, folder: Path | None = None) -> str:
    run = subprocess.run(["openssl", *arguments], cwd=folder, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return run.stdout


def give_to_station(key: Path, user: int = STATION_USER) -> None:
    """The station alone may read it, or another module."""
    key.chmod(0o400)
    if os.geteuid() == 0:
        os.chown(key, user, user)


@dataclass(frozen=True)
class Identity:
    """A certificate and its key."""

    certificate: Path
    key: Path

    @property
    def fingerprint(self) -> str:
        output = openssl("x509", "-in", self.certificate, "-noout", "-fingerprint", "-sha256")
        return output.strip().partition("=")[2]


PAGE = Path(__file__).resolve().parents[2] / "docs" / "telecontrol.md"
ON_THE_BOARD = "/data/"  # in commands that are for it
ANSWERS = """set -eu
openssl() { printf '%s\\n' passphrase passphrase y y | command openssl "$@"; }
"""


def documented_commands(kind: str) -> str:
    """How the page makes certificates, as a script; of its kinds of keys the one of that name."""
    section = PAGE.read_text().partition("### Make the certificates")[2].partition("\n### ")[0]
    blocks = re.findall(r"```sh\n(.*?)```", section, re.DOTALL)
    kinds = [block for block in blocks if "key=" in block]
    [chosen] = [block for block in kinds if f"key={kind}:" in block]
    elsewhere = [block for block in blocks if ON_THE_BOARD in block or "s_client" in block]
    return "".join([ANSWERS, chosen, *(block for block in blocks if block not in kinds + elsewhere)])


class Authority:
    """Makes certificates in a folder, and a list of those that are revoked."""

    def __init__(self, folder: Path, name: str = "Test CA", above: Authority | None = None) -> None:
        self.folder = folder
        folder.mkdir()
        self.certificate, self._key = folder / "ca.pem", folder / "ca.key"
        asked = ["-nodes", "-subj", f"/CN={name}", *EC.split(), "-keyout", self._key]
        if above:
            request, extensions = folder / "ca.csr", folder / "ca-extensions.cnf"
            extensions.write_text("basicConstraints = critical, CA:true\n")
            openssl("req", "-new", *asked, "-out", request)
            by = ["-CA", above.certificate, "-CAkey", above._key, "-CAcreateserial", "-days", "30"]
            openssl("x509", "-req", *by, "-in", request, "-extfile", extensions, "-out", self.certificate)
        else:
            openssl("req", "-x509", "-days", "30", *asked, "-out", self.certificate)

    def issue(
        self,
        name: str,
        days: int = 30,
        key: str = EC,
        usage: str = "clientAuth",
        since: datetime | None = None,
        until: datetime | None = None,
        names: str = "",
    ) -> Identity:
        """
        A certificate with that common name; its days begin now, and with days < 0 are over. names: of its
        hosts, as subjectAltName has them.
        """
        place = self.folder / name.replace(" ", "-")
        made = Identity(place.with_suffix(".pem"), place.with_suffix(".key"))
        request, extensions = place.with_suffix(".csr"), place.with_suffix(".cnf")
        lines = ["basicConstraints = critical, CA:false", f"extendedKeyUsage = {usage}"]
        lines += [f"subjectAltName = {names}"] if names else []
        extensions.write_text("\n".join(lines) + "\n")
        made.key.unlink(missing_ok=True)  # one of mode 0400 only root may write over
        asked = ["-new", "-nodes", *key.split(), "-subj", f"/CN={name}", "-keyout", made.key]
        openssl("req", *asked, "-out", request)
        signed = ["-in", request, "-extfile", extensions, "-out", made.certificate]
        if since or until or days < 0:  # "x509 -days -1" ends with OpenSSL 3.5 in an error
            end = until or datetime.now(UTC) + timedelta(days=days)
            begin = since or min(datetime.now(UTC), end - timedelta(days=1))
            dates = ["-startdate", begin.strftime(DATE), "-enddate", end.strftime(DATE)]
            self._act("-batch", "-notext", *dates, *signed)
        else:
            by = ["-CA", self.certificate, "-CAkey", self._key, "-CAcreateserial", "-days", str(days)]
            openssl("x509", "-req", *by, *signed)
        return made

    def issue_for_station(self, name: str = "substation 7", days: int = 30, key: str = EC) -> Identity:
        """One whose key the station alone may read."""
        made = self.issue(name, days, key, usage="serverAuth")
        give_to_station(made.key)
        return made

    def revoke(self, *identities: Identity, seconds: int = 30 * 86400) -> Path:
        """The list of these and of those before, good for so long."""
        for identity in identities:
            self._act("-revoke", identity.certificate)
        revoked = self.folder / "crl.pem"
        self._act("-gencrl", "-crlsec", str(seconds), "-out", revoked)
        return revoked

    def _act(self, *arguments: str | Path) -> None:
        """What goes into the authority's book."""
        (self.folder / "index.txt").touch()
        settings = self.folder / "ca.cnf"
        settings.write_text(BOOK)
        by = ["-config", settings, "-cert", self.certificate, "-keyfile", self._key]
        openssl("ca", *by, *arguments, folder=self.folder)


class DocumentedAuthority(Authority):
    """Made by the commands of the page: with a station, a controlling station, which is then revoked."""

    def __init__(self, folder: Path, kind: str) -> None:
        self.folder = folder
        folder.mkdir()
        self.certificate, self._key = folder / "ca.pem", folder / "ca.key"
        command = ["sh", "-c", documented_commands(kind)]
        # a session of its own has no terminal, which would be asked for the passphrase
        run = subprocess.run(
            command, cwd=folder, start_new_session=True, capture_output=True, text=True, check=False
        )
        assert run.returncode == 0, run.stderr
        self.station = Identity(folder / "station.pem", folder / "station.key")
        self.centre = Identity(folder / "centre.pem", folder / "centre.key")
        give_to_station(self.station.key)
