# SPDX-License-Identifier: GPL-3.0-or-later
"""Mistakes with pins, pin groups, and the pins of a device together."""

from mutation import (
    CAMERA,
    EBI,
    EMAC1_OFF,
    FMI_OFF,
    I2C0,
    I2S,
    OFF,
    QSPI0,
    SDH,
    SPI1,
    UART3_OFF,
    UART6_OFF,
    Mutation,
    led,
    less,
    on,
    pins,
    root,
    spi_bus,
    without,
)
from trees import device

# Against the chip, and what its LQFP128 brings out.
PIN_MUTATIONS = [
    Mutation(
        "pin-conflict",
        "SD host on the second Ethernet port",
        device("sdh", SDH),
        ("PF0 to PF6", "emac1", "sdh"),
    ),
    Mutation(
        "pin-conflict",
        "SPI flash left on by the SoC file",
        device("qspi0", QSPI0).replace('    status = "okay";\n', ""),
        ("PD2 and PD3", "qspi0 is enabled only by default, ", "soc.dtsi:"),
        soc=on("qspi0"),
    ),
    Mutation(
        "pin-conflict", "CAN on a UART", device("can2", {"CAN2_RXD": "PD12", "CAN2_TXD": "PD13"}), ("uart4",)
    ),
    Mutation(
        "pin-conflict",
        "three on one pin",
        device("i2c0", {"I2C0_SDA": "PA0", "I2C0_SCL": "PA1"})
        + device("can3", {"CAN3_RXD": "PA0", "CAN3_TXD": "PA1"}),
        ("uart1, can3 and i2c0 all have PA0",),
    ),
    Mutation(
        "pin-conflict",
        "external bus on the NAND",
        device("ebi", EBI) + f"&uart2 {{ {OFF} }};",
        ("PC1 to PC7", "NAND_ALE", "EBI_DATA3"),
    ),
    Mutation(
        "pin-conflict",
        "smart card UART on a UART",
        device("scuart0", {"SC0_DAT": "PA4", "SC0_CLK": "PA5"}),
        ("scuart0", "SC0_DAT", "uart6"),
    ),
    Mutation(
        "pin-conflict",
        "sleep state of a device on another's pin",
        "&pinctrl { uart1 { uart1_sleep: uart1-sleep { nuvoton,pins = <0 9 0 0>; }; }; };"
        '&uart1 { pinctrl-names = "default", "sleep"; pinctrl-1 = <&uart1_sleep>; };',
        ("PA9", "pinctrl-1", "uart2"),
    ),
    Mutation(
        "pin-conflict",
        "one group for two USB hosts",
        device("usbh_ehci", {"USBH_PWREN": "PE12", "USB_OVC": "PE10"}, "usbh")
        + on("usbh_ohci", 'pinctrl-names = "default"; pinctrl-0 = <&pinctrl_usbh>;'),
        ("usbh_ehci and usbh_ohci both",),
    ),
    Mutation(
        "pin-conflict",
        "two nodes that both switch a pin to GPIO",
        "&pinctrl { lamps { lamps: lamps { nuvoton,pins = <0 6 0 0>; }; }; };"
        + root('a { compatible = "gpio-leds"; pinctrl-names = "default"; pinctrl-0 = <&lamps>; };')
        + root('b { compatible = "gpio-leds"; pinctrl-names = "default"; pinctrl-0 = <&lamps>; };'),
        ("/a and /b both have PA6",),
    ),
    Mutation(
        "pin-conflict",
        "a pin that the pin controller takes for itself",
        '&pinctrl { pinctrl-names = "default"; pinctrl-0 = <&pinctrl_uart1>; };',
        ("pinctrl", "uart1", "PA0 and PF10"),
    ),
    Mutation(
        "mux-and-gpio",
        "PHY reset on a pin of its own MAC",
        on("emac0", "reset-gpios = <&gpio 128 1>;"),
        ("PE0",),
    ),
    Mutation("mux-and-gpio", "LED on a UART", led("&gpio 9 0"), ("/leds/led-0", "PA9", "UART2_RXD")),
    Mutation(
        "mux-and-gpio",
        "key on the console",
        root('buttons { compatible = "gpio-keys"; reset { gpios = <&gpio 172 1>; linux,code = <1>; }; };'),
        ("/buttons/reset", "PF12", "uart0"),
    ),
    Mutation(
        "mux-and-gpio",
        "row of the vendor's keys",
        on("keys", "key-matrix = <1 1>; gpio-keys-rows = <11>; key-code = <1>;"),
        ("PA11", "gpio-keys-rows", "UART8_RXD"),
    ),
    Mutation(
        "mux-and-gpio",
        "column of the vendor's keys",
        on("keys", "key-matrix = <1 2>; gpio-keys-rows = <6>; gpio-keys-cols = <7 12>; key-code = <1 2>;"),
        ("PA12", "gpio-keys-cols"),
    ),
    Mutation(
        "mux-and-gpio",
        "hog",
        "&gpio { hold { gpio-hog; gpios = <5 0>; output-high; }; };",
        ("PA5", "/hold", "uart6"),
    ),
    Mutation(
        "mux-and-gpio",
        "regulator: the power of a SIM card",
        root('sim { compatible = "regulator-fixed"; regulator-name = "s"; gpio = <&gpio 99 0>; };'),
        ("PD3", "gpio of /sim"),
    ),
    Mutation(
        "mux-and-gpio",
        "I2C by GPIO",
        root('i2c-9 { compatible = "i2c-gpio"; sda-gpios = <&gpio 4 6>; scl-gpios = <&gpio 6 6>; };'),
        ("PA4", "sda-gpios"),
    ),
    Mutation(
        "mux-and-gpio",
        "chip select as signal and as GPIO",
        spi_bus() + on("spi0", "cs-gpios = <&gpio 104 1>;"),
        ("PD8", "SPI0_SS0"),
    ),
    Mutation(
        "mux-and-gpio",
        "device on an SPI bus",
        spi_bus()
        + '&spi0 { lcd@0 { compatible = "ilitek,ili9341"; reg = <0>; dc-gpios = <&gpio 169 0>; }; };',
        ("lcd@0", "PF9", "RMII1_MDC"),
    ),
    Mutation(
        "mux-and-gpio",
        "interrupt of a device on an I2C bus",
        device("i2c0", I2C0)
        + '&i2c0 { rtc@68 { compatible = "maxim,ds3231"; reg = <0x68>; interrupt-parent = <&gpio>;'
        " interrupts = <65 2>; }; };",
        ("rtc@68", "PC1", "its interrupts", "NAND_nCS0"),
    ),
    Mutation(
        "mux-and-gpio",
        "second of two lines",
        spi_bus(less({"SPI0_CLK": "PD9", "SPI0_MOSI": "PD10", "SPI0_MISO": "PD11", "SPI0_SS0": "PD8"}))
        + on("spi0", "cs-gpios = <0>, <&gpio 6 1>, <&gpio 10 1>;"),
        ("PA10",),
    ),
    Mutation(
        "gpio-conflict",
        "two LEDs",
        root('leds { compatible = "gpio-leds"; a { gpios = <&gpio 6 0>; }; b { gpios = <&gpio 6 1>; }; };'),
        ("PA6", "/leds/a (gpios)", "/leds/b (gpios)"),
    ),
    Mutation(
        "gpio-conflict",
        "LED and hog",
        led("&gpio 6 0") + "&gpio { hold { gpio-hog; gpios = <6 0>; input; }; };",
        ("hold", "led-0"),
    ),
    Mutation(
        "gpio-conflict",
        "vendor's keys and a PHY reset",
        on("keys", "key-matrix = <2 1>; gpio-keys-rows = <6 7>; key-code = <1 2>;")
        + on("emac0", "reset-gpios = <&gpio 7 1>;"),
        ("PA7", "keys (gpio-keys-rows)", "emac0 (reset-gpios)"),
    ),
    Mutation(
        "gpio-conflict",
        "one device, two purposes",
        on("emac0", "reset-gpios = <&gpio 7 1>; enable-gpios = <&gpio 7 0>;"),
        ("emac0 (reset-gpios) and emac0 (enable-gpios)",),
    ),
    Mutation(
        "no-such-pin", "bank B beyond PB13", pins("uart2", "<0 9 2 0>, <1 14 2 0>"), ("PB14", "uart2-pins")
    ),
    Mutation("no-such-pin", "eighth bank", pins("uart2", "<0 9 2 0>, <7 0 2 0>"), ("P7.0",)),
    Mutation("no-such-pin", "pin 16", pins("uart2", "<0 9 2 0>, <0 16 2 0>"), ("P0.16",)),
    Mutation("no-such-pin", "LED on PE13", led("&gpio 141 0"), ("PE13", "32 * bank + pin")),
    Mutation("no-such-pin", "GPIO counted with 16 a bank", led("&gpio 26 0"), ("P0.26",)),
    Mutation("no-such-pin", "GPIO number beyond all banks", led("&gpio 224 0"), ("P7.0",)),
    Mutation(
        "no-such-function",
        "value between others",
        pins("uart1", "<0 0 4 0>, <5 10 1 0>"),
        ("PF10", "2 UART1_TXD"),
    ),
    Mutation(
        "no-such-function",
        "value above all",
        pins("uart1", "<0 0 15 0>, <5 10 2 0>"),
        ("function 15 of PA0",),
    ),
    Mutation(
        "no-such-function",
        "value wider than the field",
        pins("uart1", "<0 0 20 0>, <5 10 2 0>"),
        ("function 20",),
    ),
    Mutation(
        "no-such-function",
        "second and third cell exchanged",
        pins("uart2", "<0 9 2 0>, <0 2 10 0>"),
        ("function 10 of PA2",),
    ),
    Mutation(
        "foreign-function",
        "another UART's signals",
        pins("uart3", "<6 6 2 0>, <6 7 2 0>"),
        ("PG6 as UART5_RXD", "PG6 has no signal of uart3"),
    ),
    Mutation(
        "foreign-function",
        "another kind of device",
        pins("uart1", "<0 0 3 0>, <5 10 2 0>"),
        ("I2C0_SDA", "<0 0 4 0> for UART1_RXD"),
    ),
    Mutation(
        "foreign-function",
        "a group of another device",
        device("uart5", {"UART5_RXD": "PG6", "UART5_TXD": "PG7"})
        + f"&uart5 {{ {OFF} }}; &uart3 {{ pinctrl-0 = <&pinctrl_uart5>; }};",
        ("UART5_TXD", "uart3 takes"),
    ),
    Mutation(
        "pin-twice",
        "in one group",
        pins("uart1", "<0 0 4 0>, <5 10 2 0>, <0 0 3 0>"),
        ("PA0 as UART1_RXD (4) and I2C0_SDA (3)",),
    ),
    Mutation(
        "pin-twice",
        "in two groups of one state",
        "&pinctrl { more { more: more { nuvoton,pins = <0 0 0 0>; }; }; };"
        "&uart1 { pinctrl-0 = <&pinctrl_uart1>, <&more>; };",
        ("GPIO (0)", "uart1-pins and more"),
    ),
    Mutation(
        "signal-twice",
        "one output on two pins",
        pins("uart1", "<0 0 4 0>, <5 10 2 0>, <0 1 4 0>"),
        ("UART1_TXD on PA1 and PF10",),
    ),
    Mutation(
        "signal-twice",
        "two RTS, no CTS",
        pins("uart2", "<0 9 2 0>, <0 10 2 0>, <0 8 2 0>, <6 3 2 0>"),
        ("UART2_RTS on PA8 and PG3",),
        also=("half-set",),
    ),
    Mutation(
        "half-set",
        "RTS without CTS",
        pins("uart2", "<0 9 2 0>, <0 10 2 0>, <0 8 2 0>"),
        ("UART2_RTS without UART2_CTS", "add rs485-rts-active-high"),
    ),
    Mutation(
        "half-set",
        "CTS without RTS, said to be RS-485",
        pins("uart2", "<0 9 2 0>, <0 10 2 0>, <0 7 2 0>") + on("uart2", "rs485-rts-active-high;"),
        ("UART2_CTS",),
        also=("no-rts",),
    ),
    Mutation(
        "half-set",
        "three wires of quad SPI",
        UART3_OFF + device("qspi0", QSPI0 | {"QSPI0_MOSI1": "PD6"}),
        ("QSPI0_MISO1",),
    ),
    Mutation(
        "half-set",
        "SD card with two data lines",
        EMAC1_OFF + device("sdh", less(SDH, "SD1_DATA2", "SD1_DATA3")),
        ("SD1_DATA2 and SD1_DATA3",),
    ),
    Mutation("incomplete-set", "UART that cannot send", without("uart1", "UART1_TXD"), ("PF10 <5 10 2 0>",)),
    Mutation(
        "incomplete-set", "UART that cannot receive", without("uart1", "UART1_RXD"), ("UART1_RXD", "PC6")
    ),
    Mutation("incomplete-set", "Ethernet without clock", without("emac0", "RMII0_REFCLK"), ("RMII0_REFCLK",)),
    Mutation(
        "incomplete-set",
        "Ethernet without its PHY's registers",
        without("emac0", "RMII0_MDC", "RMII0_MDIO"),
        ("RMII0_MDIO and RMII0_MDC",),
    ),
    Mutation("incomplete-set", "NAND that is never ready", without("fmi", "NAND_RDY0"), ("NAND_RDY0",)),
    Mutation("incomplete-set", "NAND with seven data lines", without("fmi", "NAND_DATA7"), ("NAND_DATA7",)),
    Mutation("incomplete-set", "CAN that only listens", device("can0", {"CAN0_RXD": "PG11"}), ("CAN0_TXD",)),
    Mutation(
        "incomplete-set", "I2C without clock", device("i2c0", less(I2C0, "I2C0_SCL")), ("I2C0_SCL", "PE12")
    ),
    Mutation(
        "incomplete-set",
        "SPI without chip select",
        device("spi1", less(SPI1, "SPI1_SS0")),
        ("one of SPI1_SS0, SPI1_SS1",),
    ),
    Mutation("incomplete-set", "SPI without clock", device("spi1", less(SPI1, "SPI1_CLK")), ("SPI1_CLK",)),
    Mutation(
        "incomplete-set",
        "QSPI without data",
        UART3_OFF + device("qspi0", less(QSPI0, "QSPI0_MISO0")),
        ("QSPI0_MISO0",),
    ),
    Mutation(
        "incomplete-set",
        "SD card without command line",
        EMAC1_OFF + device("sdh", less(SDH, "SD1_CMD")),
        ("SD1_CMD",),
    ),
    Mutation(
        "incomplete-set",
        "sound without master clock",
        UART6_OFF + device("i2s", less(I2S, "I2S_MCLK")),
        ("I2S_MCLK",),
    ),
    Mutation(
        "incomplete-set",
        "sound without data",
        UART6_OFF + device("i2s", less(I2S, "I2S_DI", "I2S_DO")),
        ("one of I2S_DI, I2S_DO",),
    ),
    Mutation(
        "incomplete-set", "USB port with one wire", device("usbh_lite0", {"USBHL0_DP": "PB4"}), ("USBHL0_DM",)
    ),
    Mutation(
        "incomplete-set",
        "smart card without reset",
        UART6_OFF + device("sc0", {"SC0_CD": "PA2", "SC0_PWR": "PA3", "SC0_DAT": "PA4", "SC0_CLK": "PA5"}),
        ("SC0_RST",),
    ),
    Mutation(
        "incomplete-set",
        "camera without pixel clock",
        FMI_OFF + device("ccap0", less(CAMERA, "VCAP0_PCLK")),
        ("VCAP0_PCLK",),
    ),
    Mutation(
        "incomplete-set",
        "external bus without chip select",
        FMI_OFF + device("ebi", less(EBI, "EBI_nCS0")),
        ("one of EBI_nCS0",),
    ),
    Mutation(
        "not-bonded",
        "UART on pins without a leg",
        device("uart5", {"UART5_TXD": "PD0", "UART5_RXD": "PD1"}),
        ("PD0 and PD1", "LQFP128", "PG6"),
    ),
    Mutation("not-bonded", "LED on a pin without a leg", led("&gpio 194 0"), ("PG2",)),
    Mutation(
        "cell-count",
        "three cells a pin",
        pins("uart1", "<0 0 4>, <5 10 2>"),
        ("6 cells", "bank, pin, function, 0"),
    ),
    Mutation("cell-count", "bytes", pins("uart1", "[00 01 02 03 04 05]"), ("6 bytes",)),
    Mutation(
        "cell-count",
        "in a group that nobody uses",
        "&pinctrl { idle { idle { nuvoton,pins = <0 0 4 0 0>; }; }; };",
        ("5 cells",),
    ),
    Mutation("cell-count", "GPIO without flags", led("&gpio 6"), ("/leds/led-0", "needs 2 cells")),
    Mutation(
        "cell-count",
        "GPIO with bank and pin",
        led("&gpio 2 6 1"),
        ("a cell that should refer to a GPIO controller",),
    ),
    Mutation("cell-count", "GPIO without controller", led("6 0"), ("GPIO controller",)),
    Mutation(
        "cell-count",
        "hog with controller",
        "&gpio { hold { gpio-hog; gpios = <&gpio 6 0>; input; }; };",
        ("hold",),
    ),
    Mutation(
        "cell-count",
        "GPIO list of bytes",
        root('leds { compatible = "gpio-leds"; a { gpios = [01 02 03]; }; };'),
        ("four bytes",),
    ),
    Mutation(
        "group-name-twice",
        "in two functions",
        "&pinctrl { uart5 { uart1-pins { nuvoton,pins = <6 6 2 0>, <6 7 2 0>; }; }; };",
        ("2 groups are called uart1-pins", "/apb/pinctrl@b0000000/uart5/uart1-pins"),
    ),
    Mutation(
        "group-name-twice",
        "apart by unit addresses",
        "&pinctrl { uart5 { pins@0 { nuvoton,pins = <6 6 2 0>; };pins@1 { nuvoton,pins = <6 7 2 0>; }; }; };",
        ("2 groups are called pins", "pins@1"),
    ),
    Mutation(
        "group-name-twice",
        "two functions",
        "&pinctrl { f@0 { a { nuvoton,pins = <6 6 2 0>; }; }; f@1 { b { nuvoton,pins = <6 7 2 0>; }; }; };",
        ("2 functions are called f",),
    ),
    Mutation(
        "group-missing",
        "reference to no node",
        "&uart1 { pinctrl-0 = <77>; };",
        ("a node that does not exist", "uart1"),
    ),
    Mutation(
        "group-missing",
        "label that does not exist",
        "&uart1 { pinctrl-0 = <&pinctrl_uart1_PA>; };",
        ("a node that does not exist",),
    ),
    Mutation(
        "group-missing",
        "reference to a device",
        "&uart1 { pinctrl-0 = <&uart2>; };",
        ("serial@b0072000, which is not a pin group",),
    ),
    Mutation(
        "group-missing",
        "reference to a function",
        "&pinctrl { all: uart1 { }; }; &uart1 { pinctrl-0 = <&all>; };",
        ("/apb/pinctrl@b0000000/uart1, which is not a pin group",),
    ),
    Mutation(
        "group-missing",
        "one of two references",
        "&uart1 { pinctrl-0 = <&pinctrl_uart1>, <77>; };",
        ("pinctrl-0 of uart1",),
    ),
    Mutation(
        "group-missing",
        "group without pins",
        "&pinctrl { idle { idle { }; }; };",
        ("the group idle has no nuvoton,pins",),
    ),
    Mutation(
        "group-missing",
        "group of no cells",
        "&pinctrl { idle { idle { nuvoton,pins = <>; }; }; };",
        ("the group idle",),
    ),
    Mutation(
        "group-missing",
        "function without groups",
        "&pinctrl { idle { }; };",
        ("the function idle has no groups",),
    ),
    Mutation(
        "group-missing",
        "pin controller off",
        f"&pinctrl {{ {OFF} }};",
        ("/apb/pinctrl@b0000000, which is disabled",),
    ),
    Mutation(
        "no-default-state",
        "states without names",
        "&uart1 { /delete-property/ pinctrl-names; };",
        ("no pinctrl-names",),
    ),
    Mutation("no-default-state", "another name", '&uart1 { pinctrl-names = "sleep"; };', ("only sleep",)),
    Mutation(
        "no-pins",
        "no state",
        "&uart1 { /delete-property/ pinctrl-0; };",
        ("uart1 is enabled but has no pins", "UART1_"),
    ),
    Mutation("no-pins", "empty state", "&uart1 { pinctrl-0 = <>; };", ("uart1",)),
    Mutation("no-pins", "switched on, no more", on("can0"), ("can0", "CAN0_")),
    Mutation(
        "no-pins",
        "counted from one",
        "&uart1 { /delete-property/ pinctrl-0; pinctrl-1 = <&pinctrl_uart1>; };",
        ("uart1",),
    ),
    Mutation("eint", "on without its pin", on("gpio", "eint3-config = <1 2 1>;"), ("PG15", "<6 15 4 0>")),
    Mutation(
        "eint",
        "on for another pin",
        device("gpio", {"EINT3": "PE12"}) + on("gpio", "eint3-config = <1 2 1>;"),
        ("PG15", "PE12 as EINT3"),
    ),
    Mutation(
        "eint",
        "unknown pin",
        device("gpio", {"EINT3": "PG15"}) + on("gpio", "eint3-config = <1 3 1>;"),
        ("names pin 3", "takes PG15"),
    ),
    Mutation("eint", "two cells", on("gpio", "eint0-config = <0 0>;"), ("eint0-config has 2 cells",)),
    Mutation(
        "eint",
        "pin for an interrupt that another has",
        device("gpio", {"EINT3": "PE12"}),
        ("PE12", "<1 1 TRIGGER>"),
    ),
    Mutation(
        "eint",
        "two pins",
        device("gpio", {"EINT3": "PG15"})
        + pins("gpio", "<6 15 4 0>, <4 12 5 0>")
        + on("gpio", "eint3-config = <1 2 1>;"),
        ("makes PE12 EINT3",),
        also=("signal-twice",),
    ),
    Mutation(
        "eint",
        "pin without any setting",
        device("gpio", {"EINT3": "PG15"}) + "&gpio { /delete-property/ eint3-config; };",
        ("PG15",),
    ),
    Mutation(
        "mux-and-gpio",
        "interrupt line in the longer property",
        root('touch { compatible = "acme"; interrupts-extended = <&gpio 9 1>; };'),
        ("/touch", "PA9", "its interrupts"),
    ),
    Mutation(
        "mux-and-gpio",
        "interrupt line of a node under the controller",
        '&gpio { wake { compatible = "acme"; interrupts = <9 1>; }; };',
        ("PA9", "its interrupts"),
    ),
    Mutation(
        "mux-and-gpio",
        "old names of a bit-banged SPI",
        root('spi { compatible = "spi-gpio"; gpio-sck = <&gpio 9 0>; gpio-mosi = <&gpio 10 0>; };'),
        ("gpio-sck", "PA9"),
    ),
    Mutation(
        "cell-count",
        "interrupt line without flags",
        root('touch { compatible = "acme"; interrupt-parent = <&gpio>; interrupts = <6>; };'),
        ("/touch has interrupts of 1 cells, not a multiple of 2",),
    ),
    Mutation(
        "cell-count",
        "interrupt of a node that is no controller",
        root('touch { compatible = "acme"; interrupts-extended = <0x7777 6 1>; };'),
        ("belong to no interrupt controller",),
    ),
    Mutation(
        "cell-count",
        "fewer rows than the key matrix has",
        on("keys", "key-matrix = <3 1>; gpio-keys-rows = <6 7>; key-code = <1 2 3>;"),
        ("gpio-keys-rows with 3 cells",),
    ),
    Mutation(
        "cell-count",
        "keys without codes",
        on("keys", "key-matrix = <2 1>; gpio-keys-rows = <6 7>;"),
        ("key-code with 2 cells",),
    ),
    Mutation(
        "cell-count",
        "keys without matrix",
        on("keys", "gpio-keys-rows = <6>; key-code = <1>;"),
        ("key-matrix",),
    ),
    Mutation(
        "cell-count",
        "nine rows of keys",
        on(
            "keys",
            "key-matrix = <9 1>; gpio-keys-rows = <6 197 198 199 200 201 37 38 39>;"
            " key-code = <1 2 3 4 5 6 7 8 9>;",
        ),
        ("at most 8",),
    ),
    Mutation(
        "gpio-conflict",
        "supply and LED",
        led("&gpio 6 0")
        + root('supply { compatible = "regulator-fixed"; regulator-name = "s"; gpio = <&gpio 6 0>; };'),
        ("/leds/led-0 (gpios) and /supply (gpio)",),
    ),
    Mutation(
        "no-pins",
        "all of them GPIO",
        pins("uart1", "<0 0 0 0>, <5 10 0 0>"),
        ("uart1 is enabled but has no pins",),
    ),
    Mutation("no-pins", "USB device without its VBUS", on("usbdev"), ("usbdev", "USB0_")),
    Mutation(
        "eint",
        "settings that the driver never reaches",
        device("gpio", {"EINT3": "PG15"})
        + on("gpio", "eint3-config = <1 2 1>; /delete-property/ eint0-config;"),
        ("eint3-config is never read, because eint0-config",),
    ),
    Mutation(
        "eint",
        "trigger that does not exist",
        device("gpio", {"EINT3": "PG15"}) + on("gpio", "eint3-config = <1 2 5>;"),
        ("trigger 5",),
    ),
    Mutation(
        "label-misleads",
        "name of another group",
        "&pinctrl { uart5 { uart1_pins: uart5-pins { nuvoton,pins = <6 6 2 0>; }; }; };",
        ("names the group uart1-pins",),
    ),
    Mutation(
        "label-misleads",
        "another port",
        "&pinctrl { uart5 { pinctrl_uart5_PD: uart5-PG { nuvoton,pins = <6 6 2 0>; }; }; };",
        ("names port D", "on G"),
    ),
    Mutation(
        "pin-twice",
        "a line that was copied",
        pins("uart1", "<0 0 4 0>, <5 10 2 0>, <5 10 2 0>"),
        ("PF10 as UART1_TXD (2) and UART1_TXD (2)",),
    ),
    Mutation(
        "cell-count",
        "GPIO with bank, pin and flags that a line can have",
        led("&gpio 2 6 1"),
        ("NUMBER is 32 * bank + pin",),
    ),
    Mutation(
        "bank-and-pin",
        "LED on PE11",
        led("&gpio 4 11"),
        ("line 4 (PA4) with flags 11", "it probably means PE11", "For PE11 write 139", "32 * 4 + 11"),
    ),
    Mutation(
        "bank-and-pin",
        "bank, pin and flags, the last a line that is not there",
        led("&gpio 1 10 0"),
        ("it probably means PB10", "write 42"),
    ),
    Mutation(
        "bank-and-pin",
        "interrupt line",
        root('touch { compatible = "acme"; interrupt-parent = <&gpio>; interrupts = <4 11>; };'),
        ("interrupts of /touch", "write 139"),
    ),
    Mutation(
        "no-rts",
        "RS-485 on a port with two pins",
        on("uart4", "linux,rs485-enabled-at-boot-time; rs485-rts-delay = <0 0>;"),
        ("no pin for UART4_RTS", "PD14", "switches its direction itself"),
    ),
    Mutation(
        "no-rts",
        "flow control on a port with two pins",
        on("uart1", "uart-has-rtscts;"),
        ("no pin for UART1_RTS and UART1_CTS",),
    ),
    Mutation(
        "no-rts",
        "RS-485 on the debug port, which has no RTS anywhere",
        on("uart0", "rs485-rts-active-high;"),
        ("no pin for UART0_RTS", "Delete rs485-rts-active-high", "this chip has no UART0_RTS"),
    ),
]
