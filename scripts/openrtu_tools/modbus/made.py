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
IDENTIFICATION = (
    "vendor_name",
    "product_code",
    "revision",
    "vendor_url",
    "product_name",
    "model_name",
    "application_name",
)
FORMATS = (
    "int16",
    "uint16",
    "int32",
    "uint32",
    "int48",
    "uint48",
    "int64",
    "uint64",
    "float32",
    "float64",
    "fixed24_8",
    "bcd16",
    "bcd32",
    "bcd48",
    "bcd64",
    "mod10_32",
    "mod10_48",
    "mod10_64",
    "string",
    "string16",
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
