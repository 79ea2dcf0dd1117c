#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
from openrtu import Module

with Module() as module:
    on = False
    for _ in module.scans():
        level = module["tank.level"]
        on = level.value < module.config["high" if on else "low"] if level.good else on
        module["pump"] = on  # as good as the level that it was computed from
