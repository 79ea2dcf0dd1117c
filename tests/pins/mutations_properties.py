# SPDX-License-Identifier: GPL-3.0-or-later
"""Mistakes in the names of properties, in references, and on serial buses."""

from mutation import I2C0, QSPI0, UART3_OFF, Mutation, led, on, root, spi_bus
from trees import device

I2C_BUS = device("i2c0", I2C0)
QUAD = QSPI0 | {"QSPI0_MOSI1": "PD6", "QSPI0_MISO1": "PD7"}


def chip(bus: str, name: str, more: str) -> str:
    return f'&{bus} {{ {name} {{ compatible = "acme,part"; {more} }}; }};'


LAMP = """/ {{ leds {{ compatible = "gpio-leds"; a {{ gpios = <&gpio 6 0>; {} }}; }}; }};"""
SUPPLY = """/ {{ supply {{ compatible = "regulator-fixed"; regulator-name = "x";
    regulator-min-microvolt = {}; regulator-max-microvolt = {}; }}; }};
"""
EXPANDER = """&i2c0 { ex: gpio@20 { compatible = "nxp,pca9535"; reg = <0x20>;
    gpio-controller; #gpio-cells = <2>; }; };
"""
LAMPS = """/ {{ leds {{ compatible = "gpio-leds";
    a {{ gpios = <&ex {} 0>; }}; b {{ gpios = <&ex {} 0>; }}; }}; }};
"""

# Against the chip.
PROPERTY_MUTATIONS = [
    Mutation(
        "unknown-property",
        "a letter too few",
        "&uart1 { pinctl-1 = <&pinctrl_uart1>; };",
        ("uart1 has pinctl-1, which nothing reads; it probably means pinctrl-1",),
    ),
    Mutation(
        "unknown-property",
        "the pins of a port",
        "&uart1 { /delete-property/ pinctrl-0; pinctl-0 = <&pinctrl_uart1>; };",
        ("it probably means pinctrl-0",),
        also=("no-pins",),
    ),
    Mutation("unknown-property", "another letter", on("uart1", "pdma_enable = <0>;"), ("pdma-enable",)),
    Mutation(
        "unknown-property",
        "two letters exchanged",
        led("&gpio 6 0") + root("leds { lable = [00]; };"),
        ("label",),
    ),
    Mutation(
        "unknown-property",
        "a letter too many",
        on("fmi", "nand-ecc-steps-size = <512>;"),
        ("nand-ecc-step-size",),
    ),
    Mutation(
        "unknown-property",
        "list of lines",
        on("emac0", "reset-gpois = <&gpio 7 1>;"),
        ("probably means reset-gpios",),
    ),
    Mutation(
        "wrong-reference",
        "clock of a port that is none",
        "&uart2 { clocks = <&uart0>; };",
        ("clocks of uart2 refers to uart0, which has no #clock-cells",),
    ),
    Mutation(
        "wrong-reference",
        "second clock",
        root('osc: osc { compatible = "fixed-clock"; #clock-cells = <0>; clock-frequency = <12000000>; };')
        + "&uart2 { clocks = <&osc>, <&aic 3>; };",
        ("refers to aic",),
    ),
    Mutation(
        "wrong-reference",
        "clock that is off",
        root('osc: osc { compatible = "fixed-clock"; #clock-cells = <0>; status = "disabled"; };')
        + "&uart2 { clocks = <&osc>; };",
        ("refers to osc, which is disabled",),
    ),
    Mutation(
        "wrong-reference",
        "node that is not there",
        "&uart2 { dmas = <77 1>; };",
        ("a node that does not exist",),
    ),
    Mutation(
        "chip-address",
        "I2C address with the read bit",
        I2C_BUS + chip("i2c0", "eeprom@a0", "reg = <0xa0>;"),
        ("has reg 0xa0", "without the read bit, 0x50"),
    ),
    Mutation(
        "chip-address",
        "two at one address",
        I2C_BUS + chip("i2c0", "codec@1a", "reg = <0x1a>;") + chip("i2c0", "eeprom@1a", "reg = <0x1a>;"),
        ("codec@1a and eeprom@1a are all at 0x1a on i2c0",),
    ),
    Mutation("chip-address", "no address", I2C_BUS + chip("i2c0", "eeprom", ""), ("has no reg",)),
    Mutation(
        "chip-address",
        "third chip select of two",
        spi_bus() + chip("spi0", "dac@2", "reg = <2>;"),
        ("has chip select 2, but the controller has only 2",),
    ),
    Mutation(
        "chip-address",
        "third of two lines",
        device("spi0", {"SPI0_CLK": "PD9", "SPI0_MOSI": "PD10", "SPI0_MISO": "PD11"})
        + on("spi0", "cs-gpios = <0>, <&gpio 6 1>;")
        + chip("spi0", "dac@2", "reg = <2>;"),
        ("the controller has only 2",),
    ),
    Mutation(
        "chip-address",
        "on a bus by GPIO",
        root(
            'i2c { compatible = "i2c-gpio"; sda-gpios = <&gpio 6 6>; scl-gpios = <&gpio 7 6>;'
            " #address-cells = <1>; #size-cells = <0>;"
            ' rtc@d0 { compatible = "acme,rtc"; reg = <0xd0>; }; };'
        ),
        ("/i2c/rtc@d0", "0x68"),
    ),
    Mutation(
        "unit-address",
        "of a device on a bus",
        I2C_BUS + chip("i2c0", "eeprom@50", "reg = <0x51>;"),
        ("the name of eeprom@50 says 50, but its reg says 51",),
    ),
    Mutation(
        "spi-too-fast",
        "a zero too many",
        spi_bus() + chip("spi0", "dac@0", "reg = <0>; spi-max-frequency = <300000000>;"),
        ("<300000000>", "150000000 Hz"),
    ),
    Mutation(
        "quad-without-lines",
        "four pins",
        UART3_OFF + device("qspi0", QSPI0) + chip("qspi0", "flash@0", "reg = <0>; spi-rx-bus-width = <4>;"),
        ("spi-rx-bus-width = <4>", "no QSPI0_MOSI1 and QSPI0_MISO1"),
    ),
    Mutation(
        "no-ecc",
        "strength left out",
        "&fmi { /delete-property/ nand-ecc-strength; };",
        ("fmi has a NAND but no nand-ecc-strength", "nand-ecc-strength = <8>"),
    ),
    Mutation(
        "no-ecc",
        "none",
        "&fmi { /delete-property/ nand-ecc-mode; /delete-property/ nand-ecc-strength;"
        " /delete-property/ nand-ecc-step-size; };",
        ("nand-ecc-mode, nand-ecc-strength and nand-ecc-step-size",),
    ),
    Mutation(
        "bad-mac",
        "a group's",
        on("emac0", "local-mac-address = [01 23 45 67 89 ab];"),
        ("01:23:45:67:89:ab, the address of a group",),
    ),
    Mutation(
        "wrong-unit",
        "a bus in kHz",
        I2C_BUS + "&i2c0 { bus_freq = <100>; };",
        ("bus_freq of i2c0 is 100 Hz; it was probably written in kHz", "<100000>"),
    ),
    Mutation(
        "wrong-unit",
        "a supply in millivolts",
        root(
            'supply { compatible = "regulator-fixed"; regulator-name = "3V3";'
            " regulator-min-microvolt = <3300>; regulator-max-microvolt = <3300000>; };"
        ),
        ("3300 microvolts; it was probably written in millivolts",),
    ),
    Mutation(
        "unknown-property",
        "the beginning of a name",
        spi_bus() + chip("spi0", "radio@0", "reg = <0>; spi-max-freq = <1000000>;"),
        ("it probably means spi-max-frequency",),
    ),
    Mutation("bad-mac", "five bytes", on("emac1", "mac-address = [02 00 00 00 01];"), ("not six bytes",)),
    Mutation(
        "bad-mac",
        "both ports one",
        on("emac0", "local-mac-address = [02 00 00 00 00 01];")
        + on("emac1", "local-mac-address = [02 00 00 00 00 01];"),
        ("emac0 and emac1 all have the MAC address 02:00:00:00:00:01",),
    ),
]

PROPERTY_MUTATIONS += [
    Mutation(
        "unknown-property",
        "two words misspelt",
        on("uart1", "interupt-parnt = <&aic>;"),
        ("it probably means interrupt-parent",),
    ),
    Mutation(
        "unknown-property", "other dashes", on("fmi", 'NAND_ECC_algo = "bch";'), ("means nand-ecc-algo",)
    ),
    Mutation(
        "wrong-reference",
        "supply that is off",
        SUPPLY.format("<1>", "<1>").replace("supply {", 'v: supply { status = "disabled";')
        + I2C_BUS
        + chip("i2c0", "adc@48", "reg = <0x48>; vdd-supply = <&v>;"),
        ("vdd-supply of /apb/i2c0@b0080000/adc@48 refers to v, which is disabled",),
    ),
    Mutation(
        "wrong-reference",
        "supply that is a port",
        I2C_BUS + chip("i2c0", "adc@48", "reg = <0x48>; vdd-supply = <&uart0>;"),
        ("uart0, which is no regulator",),
    ),
    Mutation(
        "wrong-value", "cells of the controller", on("gpio", "#gpio-cells = <1>;"), ("takes a line and its",)
    ),
    Mutation(
        "wrong-value", "of a lamp", LAMP.format('default-state = "enabled";'), ('one of "on", "off", "keep"',)
    ),
    Mutation("wrong-value", "of RMII", on("emac0", 'phy-mode = "rgmii";'), ("phy-mode of emac0 is rgmii",)),
    Mutation(
        "wrong-value",
        "a link too fast",
        on("emac1", "fixed-link { speed = <1000>; full-duplex; };"),
        ("is 1000; RMII has 100 Mbit/s",),
    ),
    Mutation("wrong-value", "sixteen data lines", on("fmi", "nand-bus-width = <16>;"), ("eight data lines",)),
    Mutation(
        "wrong-value",
        "least above most",
        SUPPLY.format("<5000000>", "<3300000>"),
        ("is 5000000, above regulator-max-microvolt, 3300000",),
    ),
    Mutation(
        "wrong-unit",
        "a key in microseconds",
        root(
            'k { compatible = "gpio-keys"; a { gpios = <&gpio 6 1>; linux,code = <28>;'
            " debounce-interval = <20000>; }; };"
        ),
        ("20000 milliseconds; it was probably written in microseconds", "<20>"),
    ),
    Mutation("wrong-unit", "a watchdog in ms", on("wdt", "timeout-sec = <60000>;"), ("<60>",)),
    Mutation(
        "missing-property",
        "a bus of one line",
        root(
            'i2c { compatible = "i2c-gpio"; sda-gpios = <&gpio 6 6>;'
            " #address-cells = <1>; #size-cells = <0>; };"
        ),
        ("/i2c has no scl-gpios or gpios",),
    ),
    Mutation(
        "wrong-compatible",
        "of lamps, a letter short",
        root('leds { compatible = "gpio-led"; a { gpios = <&gpio 6 0>; }; };'),
        ("/leds is 'gpio-led'; it probably means 'gpio-leds'",),
    ),
    Mutation(
        "expander-line",
        "two lamps on one",
        I2C_BUS + EXPANDER + LAMPS.format(3, 3),
        ("line 3 of ex is of /leds/a (gpios) and /leds/b (gpios)",),
    ),
    Mutation(
        "expander-line",
        "the seventeenth",
        I2C_BUS + EXPANDER + LAMPS.format(3, 16),
        ("/leds/b (gpios) wants line 16 of ex, which has 16",),
    ),
]

# What is right and looks like one of them.
RIGHT = {
    "quad": UART3_OFF
    + device("qspi0", QUAD)
    + chip("qspi0", "flash@0", "reg = <0>; spi-rx-bus-width = <4>; spi-max-frequency = <100000000>;"),
    "three lines": device("spi0", {"SPI0_CLK": "PD9", "SPI0_MOSI": "PD10", "SPI0_MISO": "PD11"})
    + on("spi0", "cs-gpios = <0>, <&gpio 6 1>, <&gpio 7 1>;")
    + chip("spi0", "dac@2", "reg = <2>;"),
    "open drain": root('i2c { compatible = "i2c-gpio"; sda-gpios = <&gpio 6 6>; scl-gpios = <&gpio 5 7>; };')
    + '&uart6 { status = "disabled"; };',
    "clock": root(
        'osc: osc { compatible = "fixed-clock"; #clock-cells = <0>; clock-frequency = <12000000>; };'
    )
    + "&uart2 { clocks = <&osc>; };",
    "zeros for U-Boot": on("emac0", "local-mac-address = [00 00 00 00 00 00];")
    + on("emac1", "local-mac-address = [00 00 00 00 00 00];"),
    "one part, two variants": I2C_BUS
    + chip("i2c0", "codec@1a", "reg = <0x1a>;")
    + chip("i2c0", "eeprom@1a", 'reg = <0x1a>; status = "disabled";'),
    "lines of an expander": I2C_BUS + EXPANDER + LAMPS.format(0, 15),
    "values": LAMP.format('default-state = "keep";')
    + on("emac0", 'phy-mode = "rmii"; fixed-link { speed = <100>; };'),
    "names of one's own": root("aliases { labels = &uart1; };") + on("uart1", "acme,pinctrl = <0>;"),
}
