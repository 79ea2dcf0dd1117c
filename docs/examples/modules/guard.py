#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
from openrtu import Module

with Module() as module:
    for _ in module.scans():
        for request in module.requests():
            full = module["tank.level"].value > module.config["full"]
            module["pump-2"] = request.value and not full  # as good as the level
            request.refuse() if full and request.value else request.done()
