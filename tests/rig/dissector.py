# SPDX-License-Identifier: GPL-3.0-or-later
"""The position of type 201 as tshark reads it with the dissector in Lua."""

import subprocess
from pathlib import Path

from rig.capture import PCAP_HEAD, PORT, packet_of, record_of

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "package" / "openrtu" / "src" / "iec104" / "asdu201.lua"
BITS = ["invalid", "not_topical", "substituted", "blocked", "overflow"]
FIELDS = ["latitude", "longitude", "altitude", "fix", "satellites", *BITS, "time", "time_invalid"]


def dissected(segment: bytes, folder: Path, *options: str) -> list[list[str]]:
    """Of a TCP segment each field, as often as there is one."""
    pcap = folder / "position.pcap"
    pcap.write_bytes(PCAP_HEAD + record_of(packet_of(True, 0, 1, 1, segment), 0))
    names = ["ioa", *FIELDS, "wrong_size"]
    fields = [word for name in names for word in ("-e", f"asdu201.{name}")]
    command = ["tshark", "-X", f"lua_script:{SCRIPT}", "-r", pcap, "-d", f"tcp.port=={PORT},iec60870_104"]
    command += [*options, "-T", "fields", *fields]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "Lua" not in done.stderr, done.stderr
    output = done.stdout.replace("False", "0").replace("True", "1")  # so tshark 4.4 writes a bit
    return [line.split("\t") for line in output.splitlines()]
