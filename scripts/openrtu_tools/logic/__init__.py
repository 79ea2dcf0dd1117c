# SPDX-License-Identifier: GPL-3.0-or-later
"""`openrtu logic`: Structured Text (IEC 61131-3), compiled for the gateway. docs/logic.md."""
