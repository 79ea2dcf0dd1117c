# SPDX-License-Identifier: GPL-3.0-or-later
"""The centre serves HTTPS by itself, and says what is wrong with its certificate."""

import json
import ssl
import subprocess
import sys
from pathlib import Path

import pytest

from control_room import ROOT, free_port, until
from lab.centre_client import AnswerError, Client
from openrtu_tools.centre import settings
from openrtu_tools.centre.certificate import tls_context
from openrtu_tools.centre.errors import CentreError


def make_pair(folder: Path) -> None:
    """A certificate for 127.0.0.1."""
    command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"]
    command += ["-keyout", "key.pem", "-out", "certificate.pem", "-days", "2", "-subj", "/CN=centre"]
    command += ["-addext", "subjectAltName=IP:127.0.0.1"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The centre's, with a certificate."""
    make_pair(tmp_path)
    tls = {"certificate": "certificate.pem", "key": "key.pem"}
    made = tmp_path / "centre.json"
    made.write_text(json.dumps({"stations": [], "centre": {"port": free_port(), "tls": tls}}))
    return made


def status(port: int, context: ssl.SSLContext) -> int:
    try:
        Client(port, tls=context).get("/api/me")
    except AnswerError as refused:
        return refused.status
    except ConnectionError:
        return 0
    return 200


@pytest.mark.slow
def test_https_by_a_file(file: Path) -> None:
    what = settings.load(file)
    assert what.secure  # the cookie
    log = file.with_suffix(".log")
    serving = [sys.executable, "-m", "openrtu_tools", "centre", file, "serve"]
    with log.open("w") as errors, subprocess.Popen(serving, cwd=ROOT / "scripts", stderr=errors) as centre:
        try:
            ours = ssl.create_default_context(cafile=file.parent / "certificate.pem")
            until(lambda: status(what.port, ours) == 401, "it answers")
            with pytest.raises(ssl.SSLCertVerificationError):
                status(what.port, ssl.create_default_context())

            def shown() -> str:
                return ssl.get_server_certificate(("127.0.0.1", what.port))

            make_pair(file.parent)
            second = (file.parent / "certificate.pem").read_text()
            until(lambda: shown() == second, "another certificate")
            (file.parent / "key.pem").write_text("nothing")
            until(lambda: "not in force" in log.read_text(), "a key that is none")
            assert shown() == second
        finally:
            centre.terminate()


@pytest.mark.parametrize("wrong", ["certificate", "key"])
def test_files_that_are_none(file: Path, wrong: str) -> None:
    (file.parent / f"{wrong}.pem").write_text("nothing")
    with pytest.raises(CentreError, match=rf"tls: .*{wrong}\.pem.*in PEM and a pair\?"):
        tls = settings.load(file).tls
        assert tls
        tls_context(tls)


def test_key_that_others_may_read(file: Path) -> None:
    key = file.parent / "key.pem"
    tls = settings.load(file).tls
    assert tls
    key.chmod(0o644)
    with pytest.raises(CentreError, match=rf"tls: {key}: others may read it.*: chmod o= {key}"):
        tls_context(tls)
    key.chmod(0o640)
    tls_context(tls)
