# SPDX-License-Identifier: GPL-3.0-or-later
"""Mistakes against the board's pin table."""

from mutation import OFF, QSPI0, Mutation, led, less, on, pins, root
from trees import GATEWAY_PINS, board, cells, device

# Devices and lines that the table has, or has not.
TABLE_MUTATIONS = [
    Mutation(
        "table-missing",
        "device off",
        f"&uart8 {{ {OFF} }};",
        ("uart8 (RS-485, /dev/ttyS8)", 'status = "okay"'),
    ),
    Mutation(
        "table-missing",
        "device never switched on",
        good=board(less(GATEWAY_PINS, "emac1")),
        says=("emac1", "Ethernet port 2"),
    ),
    Mutation(
        "table-missing",
        "device not there",
        "/delete-node/ &emac1;",
        ("not in the tree", "/ahb/emac1@b0022000"),
    ),
    Mutation(
        "table-missing",
        "bus off",
        f"&uart8 {{ {OFF} }}; / {{ ahb {{ {OFF} }}; }};",
        ("emac0", "is disabled, because /ahb is", 'status = "okay" in /ahb'),
    ),
    Mutation(
        "table-disagrees",
        "other pins",
        pins("uart2", "<3 7 2 0>, <3 6 2 0>"),
        ("UART2_RXD on PD7 instead of PA9", "<0 9 2 0 0 10 2 0>"),
    ),
    Mutation(
        "table-disagrees",
        "one other pin",
        pins("uart1", "<0 0 4 0>, <0 1 4 0>"),
        ("UART1_TXD on PA1 instead of PF10",),
    ),
    Mutation(
        "table-disagrees",
        "the vendor's group with RTS and CTS",
        pins("uart2", "<0 7 2 0>, <0 8 2 0>, <0 9 2 0>, <0 10 2 0>"),
        ("UART2_CTS on PA7 and UART2_RTS on PA8, which the pin table does not have",),
    ),
    Mutation(
        "table-disagrees",
        "a signal that the table has and the device can do without",
        "",
        ("no UART2_RTS on PA8",),
        table={"uart2": {"UART2_RTS": "PA8", "UART2_CTS": "PA7"}},
    ),
    Mutation(
        "table-disagrees",
        "SD card where the NAND is",
        pins("fmi", cells({"SD0_CMD": "PC5", "SD0_CLK": "PC6", "SD0_DATA0": "PC7"})),
        ("SD0_CMD",),
    ),
    Mutation(
        "left-on",
        "pins of unknown wiring",
        device("usbdev", {"USB0_VBUSVLD": "PE11"}),
        ("usbdev is enabled (by ", "PE11 of unknown wiring"),
    ),
    Mutation(
        "left-on",
        "pins of a device of the table",
        device("qspi0", QSPI0).replace('    status = "okay";\n', ""),
        ("soc.dtsi", "PD2 and PD3 of uart3 and PD4 and PD5 of unknown wiring"),
        soc=on("qspi0"),
        also=("pin-conflict",),
    ),
    Mutation(
        "left-on",
        "without status",
        device("nadc", {"ADC_AIN0": "PB0"}) + "&nadc { /delete-property/ status; };",
        ("it has no status",),
    ),
    Mutation(
        "left-on",
        "interrupt pin of the GPIO controller",
        device("gpio", {"EINT3": "PG15"}),
        ("Delete pinctrl-0 of gpio",),
    ),
    Mutation(
        "left-on",
        "camera, which is no peripheral",
        root('camera { compatible = "himax,hm1055"; pinctrl-names = "default"; pinctrl-0 = <&cam>; };')
        + "&pinctrl { cam { cam: cam { nuvoton,pins = <4 10 7 0>; }; }; };",
        ("/camera", "PE10"),
    ),
    Mutation(
        "table-gpio",
        "line that the table does not know",
        led("&gpio 197 0"),
        ("PG5 of unknown wiring", "under gpios in pins.yml"),
    ),
    Mutation("reserved-pin", "boot strap as a GPIO", led("&gpio 192 0"), ("PG0", "boot strap")),
    Mutation(
        "reserved-pin",
        "boot strap as a signal",
        pins("uart2", "<6 0 2 0>, <6 1 2 0>"),
        ("PG0 and PG1", "uart2"),
    ),
]
