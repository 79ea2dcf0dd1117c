# SPDX-License-Identifier: GPL-3.0-or-later
"""The centre serves HTTPS by itself, and says what is wrong with its certificate."""

import json
import ssl
import subprocess
import sys
from pathlib import Path

import pytest

from centre import settings
from centre.__main__ import tls_context
from centre.errors import CentreError
from control_room import ROOT, free_port, until
from lab.centre_client import AnswerError, Client


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The centre's, with a certificate for 127.0.0.1."""
    command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"]
    command += ["-keyout", "key.pem", "-out", "certificate.pem", "-days", "2", "-subj", "/CN=centre"]
    command += ["-addext", "subjectAltName=IP:127.0.0.1"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
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
    with subprocess.Popen([sys.executable, "-m", "centre", file, "serve"], cwd=ROOT) as centre:
        try:
            ours = ssl.create_default_context(cafile=file.parent / "certificate.pem")
            until(lambda: status(what.port, ours) == 401, "it answers")
            with pytest.raises(ssl.SSLCertVerificationError):
                status(what.port, ssl.create_default_context())
        finally:
            centre.terminate()


@pytest.mark.parametrize("wrong", ["certificate", "key"])
def test_files_that_are_none(file: Path, wrong: str) -> None:
    (file.parent / f"{wrong}.pem").write_text("nothing")
    with pytest.raises(CentreError, match=rf"tls: .*{wrong}\.pem.*in PEM and a pair\?"):
        tls_context(settings.load(file))
