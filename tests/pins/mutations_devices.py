# SPDX-License-Identifier: GPL-3.0-or-later
"""Mistakes with device nodes: addresses, interrupts, numbers, buses."""

from mutation import FMI_OFF, I2C0, OFF, QSPI0, SPI1, UART3_OFF, UART6_OFF, Mutation, led, on, root, spi_bus
from trees import device

PWM0 = device("pwm0", {"PWM00": "PG0"}) + "&pwm0 { #pwm-cells = <2>; };"


def fan(channel: int) -> str:
    return PWM0 + root(f'fan {{ compatible = "pwm-fan"; pwms = <&pwm0 {channel} 1000000>; }};')


# Against the chip.
DEVICE_MUTATIONS = [
    Mutation(
        "missing-property",
        "a lamp without a line",
        root('lamps { compatible = "gpio-leds"; red { label = "red"; }; };'),
        ("/lamps/red has no gpios or gpio",),
    ),
    Mutation(
        "missing-property",
        "a key without a code",
        root('buttons { compatible = "gpio-keys"; reset { gpios = <&gpio 6 1>; }; };'),
        ("/buttons/reset has no linux,code", "Set linux,code"),
    ),
    Mutation(
        "hog-without-direction",
        "neither in nor out",
        '&gpio { power-hog { gpio-hog; gpios = <6 0>; line-name = "power"; }; };',
        ("has none of input, output-low, output-high",),
    ),
    Mutation(
        "pwm-without-pin",
        "a channel that is not in the group",
        fan(2),
        ("/fan uses channel 2 of pwm0, which has no pin", "Add PWM02"),
    ),
    Mutation("pwm-without-pin", "a fifth channel", fan(4), ("pwm0, which has the channels 0, 1, 2, 3",)),
    Mutation(
        "wrong-address",
        "another UART's",
        "&uart1 { reg = <0xb0075000 0x1000>; };",
        ("where uart5 is", "<0xb0071000 0x1000>"),
    ),
    Mutation("wrong-address", "no block's", "&emac0 { reg = <0xb0099000 0x1000>; };", ("0xb0012000",)),
    Mutation("wrong-address", "none", "&uart1 { /delete-property/ reg; };", ("has no reg",)),
    Mutation("wrong-address", "the virtual one", "&uart1 { reg = <0xf0071000 0x1000>; };", ("0xf0071000",)),
    Mutation(
        "unit-address",
        "a device by the name of another's address",
        '/delete-node/ &wdt; / { apb { wdt@b0041000 { compatible = "nuvoton,nuc980-wdt";'
        "reg = <0xb0040000 0x100>; interrupts = <1 4 1>; }; }; };",
        ("the address of rtc", "wdt@b0040000"),
    ),
    Mutation(
        "unit-address",
        "device that the chip does not have",
        root('apb { fpga@b00c0000 { compatible = "acme,fpga"; reg = <0xb00d0000 0x100>; }; };'),
        ("fpga@b00d0000",),
    ),
    Mutation(
        "wrong-interrupt",
        "another device's",
        "&uart1 { interrupts = <38 4 1>; };",
        ("38 (UART2)", "37 (UART1)"),
    ),
    Mutation(
        "wrong-interrupt",
        "receiver before transmitter",
        "&emac0 { interrupts = <19 4 1>, <21 4 1>; };",
        ("<21 4 1>, <19 4 1>",),
    ),
    Mutation("wrong-interrupt", "one of two", "&emac0 { interrupts = <21 4 1>; };", ("19 (EMC0_RX)",)),
    Mutation("wrong-interrupt", "none", "&uart1 { /delete-property/ interrupts; };", ("no interrupts",)),
    Mutation("wrong-interrupt", "two cells", "&uart1 { interrupts = <37 4>; };", ("2 cells",)),
    Mutation("wrong-interrupt", "no source", "&uart1 { interrupts = <13 4 1>; };", ("13 (no source)",)),
    Mutation(
        "wrong-interrupt", "in a device that is off", "&uart5 { interrupts = <37 4 1>; };", ("44 (UART5)",)
    ),
    Mutation(
        "wrong-compatible",
        "standard UART",
        '&uart1 { compatible = "ns16550a"; };',
        ("'ns16550a'", '"nuvoton,nuc980-uart"'),
    ),
    Mutation(
        "wrong-compatible",
        "instance of another",
        '&emac0 { compatible = "nuvoton,nuc980-emac1"; };',
        ("has the address of emac0",),
    ),
    Mutation(
        "wrong-compatible",
        "other device of the chip",
        '&uart1 { compatible = "nuvoton,nuc980-scuart"; };',
        ("uart1",),
    ),
    Mutation("wrong-compatible", "empty", '&uart1 { compatible = ""; };', ("has the address of uart1",)),
    Mutation(
        "wrong-compatible",
        "device without a driver",
        on("crypto_raw"),
        ("crypto_raw is enabled", "no kernel of the vendor"),
    ),
    Mutation(
        "address-twice",
        "smart card and its UART",
        UART6_OFF
        + FMI_OFF
        + device(
            "sc0", {"SC0_CD": "PA2", "SC0_PWR": "PA3", "SC0_DAT": "PA4", "SC0_CLK": "PA5", "SC0_RST": "PA6"}
        )
        + device("scuart0", {"SC0_DAT": "PC13", "SC0_CLK": "PC12"}),
        ("/apb/sc@b0090000 and /apb/serial@b0090000",),
    ),
    Mutation(
        "address-twice",
        "two drivers for the converter",
        device("nadc", {"ADC_AIN0": "PB0"})
        + root(
            'apb { adc0@b0043000 { compatible = "nuvoton,nuc980-adc"; reg = <0xb0043000 0x100>;'
            ' interrupts = <18 4 1>; pinctrl-names = "default"; pinctrl-0 = <&adc>; }; };'
        )
        + "&pinctrl { adc { adc: adc { nuvoton,pins = <1 2 8 0>; }; }; };",
        ("adc0@b0043000", "nadc@b0043000"),
    ),
    Mutation(
        "stale-node",
        "old name",
        root(f"ahb {{ cap0@b0024000 {{ {OFF} }}; }};"),
        ("/ahb/ccap0@b0024000", "Rename the node to ccap0@b0024000"),
    ),
    Mutation(
        "stale-node",
        "wrong unit address",
        root('apb { serial@b0071001 { status = "okay"; }; };'),
        ("serial@b0071000",),
    ),
    Mutation(
        "stale-node", "letter for digit", root(f"ahb {{ sdh@b00180O0 {{ {OFF} }}; }};"), ("sdh@b0018000",)
    ),
    Mutation(
        "stale-node", "without unit address", root(f"ahb {{ crypto-prng {{ {OFF} }}; }};"), ("crypto_prng",)
    ),
    Mutation("stale-node", "like nothing", root(f"ahb {{ flux@0 {{ {OFF} }}; }};"), ("Delete /ahb/flux@0",)),
    Mutation(
        "bus-num-twice",
        "two SPI",
        spi_bus() + device("spi1", SPI1) + "&spi1 { bus_num = <1>; };",
        ("spi0 and spi1 are spi bus 1",),
    ),
    Mutation(
        "bus-num-twice",
        "SPI and quad SPI",
        UART3_OFF + spi_bus() + device("qspi0", QSPI0) + "&spi0 { bus_num = <0>; };",
        ("qspi0 and spi0",),
    ),
    Mutation(
        "bus-num-twice",
        "two I2C",
        device("i2c0", I2C0)
        + device("i2c3", {"I2C3_SDA": "PD15", "I2C3_SCL": "PD14"})
        + "&i2c3 { bus_num = <0>; };",
        ("i2c bus 0",),
    ),
    Mutation(
        "pdma-without-dma",
        "as the report sets it",
        on("uart1", "pdma-enable = <1>;"),
        ("uart1", "/ahb/dma@b0008000"),
    ),
    Mutation(
        "missing-property",
        "pdma-enable",
        "&uart1 { /delete-property/ pdma-enable; };",
        ("pdma-enable = <0>",),
    ),
    Mutation(
        "missing-property",
        "port-number",
        "&uart6 { /delete-property/ port-number; };",
        ("port-number = <6>",),
    ),
    Mutation(
        "missing-property",
        "cells of a bus",
        device("i2c3", {"I2C3_SDA": "PD15", "I2C3_SCL": "PD14"})
        + "&i2c3 { /delete-property/ #address-cells; /delete-property/ #size-cells;"
        ' eeprom@50 { compatible = "atmel,24c02"; reg = <0x50>; }; };',
        ("#address-cells = <1> and #size-cells = <0>", "i2c3"),
    ),
    Mutation(
        "wrong-interrupt",
        "through the GPIO controller",
        "&uart1 { interrupt-parent = <&gpio>; };",
        ("interrupts of 3 cells, not a multiple of 2",),
    ),
    Mutation(
        "wrong-interrupt",
        "a line of the GPIO controller",
        "&uart1 { interrupt-parent = <&gpio>; interrupts = <6 4>; };",
        ("interrupts of gpio, not of the AIC",),
    ),
    Mutation(
        "wrong-interrupt",
        "no controller at all",
        "/ { /delete-property/ interrupt-parent; };",
        ("uart1 has interrupts that belong to no interrupt controller",),
    ),
    Mutation(
        "wrong-interrupt",
        "another device's, in the longer property",
        "&uart1 { interrupts-extended = <&aic 38 4 1>; };",
        ("38 (UART2)",),
    ),
    Mutation(
        "wrong-interrupt",
        "controller of one cell",
        "&aic { #interrupt-cells = <1>; };",
        ("interrupts of 1 cells (#interrupt-cells of the AIC)",),
    ),
    Mutation("controller-off", "AIC", f"&aic {{ {OFF} }};", ("aic is disabled", "uart1", "emac1")),
    Mutation(
        "controller-off",
        "GPIO controller of a LED",
        led("&gpio 6 0") + f"&gpio {{ {OFF} }};",
        ("gpio is disabled, but /leds/led-0 uses it",),
    ),
    Mutation(
        "controller-off",
        "expander on a bus that is off",
        root(
            'k { compatible = "gpio-keys"; b { linux,code = <2>; interrupts-extended = <&expander 1 1>; }; };'
        )
        + '&i2c3 { expander: e@20 { compatible = "nxp,pca9555"; reg = <0x20>; interrupt-controller;'
        " #interrupt-cells = <2>; }; };",
        ("/k/b",),
    ),
    Mutation(
        "no-bus",
        "bus of another kind",
        root('apb { compatible = "acme,apb"; };'),
        ("/apb is not a simple-bus", "more"),
        also=("wrong-interrupt",),  # the AIC is there too
    ),
    Mutation(
        "no-bus", "without ranges", "/ { ahb { /delete-property/ ranges; }; };", ("/ahb has no ranges",)
    ),
    Mutation(
        "no-bus",
        "ranges that move",
        root("ahb { ranges = <0 0xb0000000 0x100000>; };"),
        ("translate addresses",),
    ),
    Mutation("no-bus", "wide addresses", root("ahb { #address-cells = <2>; };"), ("#address-cells = <2>",)),
    Mutation(
        "no-bus",
        "device in a node of no kind",
        root('soc { rtc@b0041000 { compatible = "nuvoton,nuc980-rtc"; reg = <0xb0041000 0x1000>; }; };'),
        ("/soc is not a simple-bus",),
    ),
    Mutation("unknown-status", "enabled", '&can0 { status = "enabled"; };', ('can0 is "enabled"',)),
    Mutation("unknown-status", "capital letter", '&can0 { status = "Okay"; };', ('"Okay"',)),
    Mutation("unknown-status", "two words", '&can0 { status = "okay", "ok"; };', ('"okay", "ok"',)),
    Mutation("unknown-status", "number", "&can0 { status = <1>; };", ("no string",)),
    Mutation("wrong-number", "port of another UART", on("uart1", "port-number = <2>;"), ("it must be 1",)),
    Mutation(
        "wrong-number",
        "registers of another UART",
        on("uart1", "map-addr = <0xf0072000>;"),
        ("map-addr = <0xf0072000>; it must be 0xf0071000",),
    ),
    Mutation(
        "wrong-number",
        "timer's",
        device("etimer1", {"TM1_TGL": "PG11"}) + "&etimer1 { port-number = <0>; };",
        ("etimer1", "it must be 1"),
    ),
    Mutation(
        "bus-num-twice",
        "by default",
        device("i2c0", I2C0)
        + device("i2c3", {"I2C3_SDA": "PD15", "I2C3_SCL": "PD14"})
        + "&i2c3 { /delete-property/ bus_num; };",
        ("i2c0 and i2c3 are i2c bus 0",),
    ),
    Mutation(
        "missing-property",
        "speed of an I2C bus",
        device("i2c3", {"I2C3_SDA": "PD15", "I2C3_SCL": "PD14"}) + "&i2c3 { /delete-property/ bus_freq; };",
        ("bus_freq",),
    ),
    Mutation("missing-property", "empty pdma-enable", "&uart1 { pdma-enable; };", ("no pdma-enable",)),
    Mutation(
        "missing-property",
        "over-current of the USB host",
        on("usbh_ehci", "/delete-property/ ov_active;"),
        ("ov_active",),
    ),
    Mutation(
        "missing-property",
        "number of a timer",
        on("etimer1", "/delete-property/ port-number;"),
        ("port-number = <1>",),
    ),
    Mutation(
        "wrong-address",
        "no size",
        "&uart1 { reg = <0xb0071000 0>; };",
        ("has a reg without a size; uart1 is at",),
    ),
    Mutation(
        "wrong-address",
        "second pin controller",
        root(
            'apb { pins { compatible = "nuvoton,nuc980-pinctrl"; a { a { nuvoton,pins = <0 6 0 0>; }; };'
            " }; };"
        ),
        ("/apb/pins has no reg",),
    ),
    Mutation(
        "reg-overlap",
        "a port with the registers of the next",
        "&uart1 { reg = <0xb0071000 0x2000>; };",
        ("uart1 covers 0xb0071000 to 0xb0072fff, and with it uart2 at 0xb0072000", "0x1000> in uart1"),
    ),
    Mutation(
        "reg-overlap",
        "a device of the board's own over one of the chip",
        root('apb { fpga@b0070800 { compatible = "acme,fpga"; reg = <0xb0070800 0x100>; }; };'),
        ("uart0 covers 0xb0070000", "Shorten reg in /apb/fpga@b0070800"),
    ),
    Mutation(
        "outside-bus",
        "at the root",
        "/delete-node/ &rtc;"
        + root(
            'rtc@b0041000 { compatible = "nuvoton,nuc980-rtc"; reg = <0xb0041000 0x1000>;'
            " interrupts = <15 4 1>; };"
        ),
        ("/rtc@b0041000 is rtc, which is on the bus /apb",),
    ),
    Mutation(
        "outside-bus",
        "a second node of a port, at the root",
        root(
            'serial@b0072000 { compatible = "nuvoton,nuc980-uart"; reg = <0xb0072000 0x1000>;'
            " interrupts = <38 4 1>; port-number = <2>; map-addr = <0xf0072000>; pdma-enable = <0>;"
            ' pinctrl-names = "default"; pinctrl-0 = <&pinctrl_uart2>; };'
        ),
        ("/serial@b0072000 is uart2", "or change &uart2"),
        also=("address-twice", "pin-conflict"),
    ),
    Mutation(
        "outside-bus",
        "on the other bus",
        "/delete-node/ &rtc;"
        + root(
            'ahb { rtc@b0041000 { compatible = "nuvoton,nuc980-rtc"; reg = <0xb0041000 0x1000>;'
            " interrupts = <15 4 1>; }; };"
        ),
        ("/ahb/rtc@b0041000 is rtc",),
    ),
    Mutation(
        "wrong-trigger",
        "rising edge",
        "&uart1 { interrupts = <37 1 1>; };",
        ("uart1 has interrupt 37 as a rising edge", "<37 4 1>"),
    ),
    Mutation(
        "wrong-trigger",
        "second of two, and a value of no meaning",
        "&emac0 { interrupts = <21 4 1>, <19 5 1>; };",
        ("interrupt 19 as trigger 5",),
    ),
    Mutation(
        "controller-off",
        "bus of the controller off",
        led("&gpio 6 0") + root(f"apb {{ {OFF} }};"),
        ("gpio is disabled, because /apb is, but /leds/led-0", 'status = "okay" in /apb'),
        also=("group-missing",),
    ),
]
