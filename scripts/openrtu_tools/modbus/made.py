# SPDX-License-Identifier: GPL-3.0-or-later
"""What the configuration says of Modbus objects.

Made by `make keys` from its rules; do not edit.
"""

TABLES = (
    "coils",
    "discrete_inputs",
    "input_registers",
    "holding_registers",
)
FORMATS = (
    "int16",
    "uint16",
    "int32",
    "uint32",
    "int64",
    "uint64",
    "float32",
    "float64",
)
WORD_ORDERS = (
    "big",
    "little",
)
BYTE_ORDERS = (
    "big",
    "little",
)
NUMBER_DIGITS = "0134"  # the first of a manual's number, by table
ADDRESS_LAST = 65535
