# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make fuzz`: libFuzzer on each target for some time, from the seeds in tests/fixtures/corpus.
Exit codes: 0 nothing found, 1 found something, 2 not built.
"""

import argparse
import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SEEDS = ROOT / "tests" / "fixtures" / "corpus"
SCHEMA = ROOT / "package" / "openrtu" / "src" / "rtud" / "config.schema.json"
TARGETS = {  # by the name of its corpus: the program
    "asdu": "iec104/fuzz_asdu",
    "controlling": "iec104/fuzz_controlling",
    "information": "iec104/fuzz_information",
    "outstation": "modules/fuzz_outstation",
    "session": "iec104/fuzz_session",
    "station": "iec104/fuzz_station",
    "line": "modbus/fuzz_line",
    "config": "rtud/fuzz_config",
    "centre": "centre/fuzz_centre",
    "journal": "journal/fuzz_journal",
    "goose": "goose/fuzz_goose",
    "nmea": "gps/fuzz_nmea",
    "gpsd": "gps/fuzz_gpsd",
    "logic": "logic/fuzz_logic",
    "synch": "synch/fuzz_synch",
    "requests": "map/fuzz_requests",
    "snmp": "modules/fuzz_snmp",
    "web": "web/fuzz_web",
    "ber": "ber/fuzz_ber",
    "mms-acse": "iec61850/fuzz_acse",
    "mms-association": "iec61850/fuzz_association",
    "mms-presentation": "iec61850/fuzz_presentation",
    "mms-service": "iec61850/fuzz_mms_service",
    "mms-session": "iec61850/fuzz_session",
    "mms-transport": "iec61850/fuzz_transport",
}
INPUT_MAX = 4096


def words_of(schema: object) -> set[str]:
    """The keys and choices that a configuration can have."""
    if isinstance(schema, list):
        return set().union(*map(words_of, schema))
    if not isinstance(schema, dict):
        return set()
    own = {*schema.get("properties", {}), *(word for word in schema.get("enum", []) if isinstance(word, str))}
    return own.union(*map(words_of, schema.values()))


def write_dictionary(folder: Path) -> Path:
    """For the configuration: chance alone does not find the names of its keys."""
    words = [json.dumps(word) for word in sorted(words_of(json.loads(SCHEMA.read_text())))]
    file = folder / "config.dict"
    file.write_text("".join(f"{json.dumps(word)}\n" for word in words))
    return file


def run(target: str, build: Path, work: Path, *limits: str) -> subprocess.CompletedProcess[str]:
    """Fuzzes within limits, options of libFuzzer; keeps new inputs below work, and what crashes."""
    corpus = work / "corpus" / target
    corpus.mkdir(parents=True, exist_ok=True)
    options = [f"-max_len={INPUT_MAX}", "-timeout=20", "-print_final_stats=1", *limits]
    options.append(f"-artifact_prefix={work}/{target}-")
    if target in ("config", "synch"):
        options.append(f"-dict={write_dictionary(work)}")
    fuzzer = [build / TARGETS[target], *options, corpus, SEEDS / target]
    # A shell between: libFuzzer bounds its peak memory (ru_maxrss), which vfork and exec hand on from a
    # parent, and pytest's is beyond the bound at times; a shell's fork begins anew.
    command = ["sh", "-c", '"$@"; exit $?', "fuzzer", *fuzzer]
    return subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)


def summary(output: str) -> str:
    """The inputs that were tried, and what they reached."""
    runs = re.search(r"number_of_executed_units: (\d+)", output)
    reached = re.findall(r"cov: (\d+) ft: (\d+)", output)
    covered = "{} edges, {} features".format(*reached[-1]) if reached else "nothing covered"
    return f"{runs[1] if runs else '?'} inputs, {covered}"


def main() -> int:
    parser = argparse.ArgumentParser(description="Runs the fuzzers one after the other.")
    parser.add_argument("--seconds", type=int, default=60, help="for each target")
    parser.add_argument("--build", type=Path, default=ROOT / "build" / "fuzz")
    parser.add_argument("--target", choices=TARGETS, help="that one only")
    arguments = parser.parse_args()
    found = False
    for target in [arguments.target] if arguments.target else TARGETS:
        if not (arguments.build / TARGETS[target]).exists():
            print(f"{arguments.build / TARGETS[target]} is not there: `make fuzz` builds it", file=sys.stderr)
            return 2
        done = run(target, arguments.build, arguments.build, f"-max_total_time={arguments.seconds}")
        print(f"{target}: {summary(done.stderr)}", flush=True)
        if done.returncode != 0:
            found = True
            print(done.stderr[-6000:], file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
