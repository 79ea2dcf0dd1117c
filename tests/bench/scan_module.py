# SPDX-License-Identifier: GPL-3.0-or-later
"""What scan_module.c does, in Python: 100 inputs, 20 outputs, and the processor time of a scan."""

import sys
import time

from openrtu import Module

BATCHES, SCANS = 9, 200
INPUTS = [f"in-{number}" for number in range(100)]
OUTPUTS = [f"out-{number}" for number in range(20)]

with Module() as module:
    begun, batches = time.process_time_ns(), 0
    for number, _ in enumerate(module.scans(), 1):
        total = sum(module[name].value for name in INPUTS)
        for place, name in enumerate(OUTPUTS):
            module[name] = total + place
        if number % SCANS == 0 and batches < BATCHES:
            now = time.process_time_ns()
            print("BENCH scan", (now - begun) // SCANS, file=sys.stderr)
            begun, batches = now, batches + 1
            if batches == BATCHES:
                print("BENCH end 0", file=sys.stderr)
