# SPDX-License-Identifier: GPL-3.0-or-later
"""The two U-Boots: what differs between the factory's 2016.11 and the board's own 2023.01."""

from __future__ import annotations

from dataclasses import dataclass

BOOTCMD = "nand read 0x7FC0 0x200000 0x500000; nand read 0xA00000 0x700000 0x100000; bootm 0x7Fc0 - 0xA00000"
OURS_PARTS = (
    "mtdparts=nand0:0x200000@0x0(u-boot),0x500000@0x200000(kernel),0x100000@0x700000(device-tree),"
    "0xe00000@0x800000(spare),0x6480000@0x1600000(rootfs)"
)


@dataclass(frozen=True)
class Variant:
    """A build.

    environment: the default one. found: how it says that the stored one is good.
    env_size: of the environment, beginning at 0x80000, in the first good blocks of four.
    line_end: what its UART driver makes of a line feed.
    reserved: blocks that hold bad-block tables and are called bad.
    cuts: how many of bootm's last characters are still in the UART when it takes the pins away: its FIFO's
    16, and the one on its way.
    """

    name: str
    version: str
    version_text: str
    head: str
    no_environment: str
    found: str
    line_end: bytes
    streams: str
    ports: tuple[str, ...]
    environment: dict[str, str]
    env_size: int
    mtdparts: str
    absent: frozenset[str]
    nand_info: str
    reserved: frozenset[int]
    unset_status: int
    tftp_port: bool
    trims: bool
    port_unreachable: bool
    guards_itself: bool
    xip: str
    working_fdt: bool
    cuts: int
    saving: str
    bdinfo: str


FACTORY = Variant(
    name="factory",
    version="U-Boot 2016.11 (Nov 20 2019 - 10:32:17 +0800)",
    version_text=(
        "\nU-Boot 2016.11 (Nov 20 2019 - 10:32:17 +0800)\n"
        "arm-linux-gcc (GCC) 4.8.4\nGNU ld (GNU Binutils) 2.24\n"
    ),
    head="CPU: NUC980\nBoard: NUC980\nDRAM:  64 MiB\nNAND:  128 MiB\n",
    no_environment="*** Warning - bad CRC, using default environment\n\n",
    found="",
    line_end=b"\n\r",
    streams="In:    serial\nOut:   serial\nErr:   serial\n",
    ports=("emac",),
    environment={"baudrate": "115200", "bootdelay": "3"},
    env_size=0x10000,
    mtdparts="mtdparts=nand0:0x200000@0x0(u-boot),0x1400000@0x200000(kernel),-(user)",
    absent=frozenset({"tftpput", "ping", "mii", "mdio", "dm", "net", "pinmux", "panic", "setexpr", "tftp"}),
    nand_info="  Page size       2048 b\n  OOB size          64 b\n  Erase size    131072 b\n"
    "  subpagesize     2048 b\n  options     0x       8\n  bbt options 0x    8000\n",
    reserved=frozenset(),
    unset_status=1,
    tftp_port=False,
    trims=False,
    port_unreachable=False,
    guards_itself=False,
    xip="   XIP Kernel Image ... OK\n",
    working_fdt=False,
    cuts=17,
    saving="Saving Environment to NAND...\nErasing NAND...\n",
    bdinfo=(
        "arch_number = 0x00000000\nboot_params = 0x00000100\n"
        "DRAM bank   = 0x00000000\n-> start    = 0x00000000\n-> size     = 0x04000000\n"
        "DRAM bank   = 0x00000001\n-> start    = 0x04000000\n-> size     = 0x00000000\n"
        "eth0name    = emac\nethaddr     = {ethaddr}\ncurrent eth = emac\nip_addr     = {ipaddr}\n"
        "baudrate    = 115200 bps\nrelocaddr   = 0x03F6F000\nreloc off   = 0x0316F000\n"
        "irq_sp      = 0x03E4EEE0\nsp start    = 0x03E4EED0\n"
    ),
)

OURS = Variant(
    name="ours",
    version="U-Boot 2023.01+dfsg-2+deb12u3 (Jun 22 2026 - 08:38:07 +0000)",
    version_text=(
        "U-Boot 2023.01+dfsg-2+deb12u3 (Jun 22 2026 - 08:38:07 +0000)\n\n"
        "arm-linux-gnueabi-gcc (Debian 12.2.0-14) 12.2.0\nGNU ld (GNU Binutils for Debian) 2.40\n"
    ),
    head=(
        "CPU:   Nuvoton NUC980\nModel: BLIIoT gateway (OpenRTU)\nDRAM:  64 MiB\n"
        "Core:  35 devices, 8 uclasses, devicetree: separate\nNAND:  128 MiB\n"
        "Loading Environment from NAND... "
    ),
    no_environment="*** Warning - bad CRC, using default environment\n\n",
    found="OK\n",
    line_end=b"\r\n",
    streams="In:    serial@b0070000\nOut:   serial@b0070000\nErr:   serial@b0070000\n",
    ports=("emac0", "emac1"),
    environment={
        "baudrate": "115200",
        "bootcmd": BOOTCMD,
        "bootdelay": "3",
        "fdtcontroladdr": "3b67b90",
        "loadaddr": "0xe00000",
        "mtdids": "nand0=nand0",
        "mtdparts": OURS_PARTS,
        "stderr": "serial@b0070000",
        "stdin": "serial@b0070000",
        "stdout": "serial@b0070000",
    },
    env_size=0x10000,
    mtdparts=OURS_PARTS,
    absent=frozenset({"timer", "sf", "sspi"}),
    nand_info=(
        "  Page size         2048 b\n  OOB size            64 b\n  Erase size      131072 b\n"
        "  ecc strength         8 bits\n  ecc step size      512 b\n  subpagesize       2048 b\n"
        "  options       0x40100200\n  bbt options   0x00060000\n"
    ),
    reserved=frozenset(range(1020, 1024)),
    unset_status=0,
    tftp_port=True,
    trims=True,
    port_unreachable=True,
    guards_itself=True,
    xip="   XIP Kernel Image\n",
    working_fdt=True,
    cuts=0,
    saving="Saving Environment to NAND... Erasing NAND...\n",
    bdinfo=(
        "boot_params = 0x00000100\nDRAM bank   = 0x00000000\n-> start    = 0x00000000\n"
        "-> size     = 0x04000000\nflashstart  = 0x00000000\nflashsize   = 0x00000000\n"
        "flashoffset = 0x00000000\nbaudrate    = 115200 bps\nrelocaddr   = 0x03f7b000\n"
        "reloc off   = 0x0317b000\nBuild       = 32-bit\n{port}\nethaddr     = {ethaddr}\n"
        "IP addr     = {ipaddr}\nfdt_blob    = 0x03b67b90\nnew_fdt     = 0x03b67b90\n"
        "fdt_size    = 0x00003340\nlmb_dump_all:\n memory.cnt  = 0x1\n"
        " memory[0]\t[0x0-0x3ffffff], 0x04000000 bytes flags: 0\n reserved.cnt  = 0x1\n"
        " reserved[0]\t[0x3b63950-0x3ffffff], 0x0049c6b0 bytes flags: 0\ndevicetree  = separate\n"
        "arch_number = 0x00000000\nTLB addr    = 0x03ff0000\nirq_sp      = 0x03b67b80\n"
        "sp start    = 0x03b67b70\nEarly malloc usage: 344 / 2000\n"
    ),
)

VARIANTS = {"factory": FACTORY, "ours": OURS}

# What the factory has stored, whole (old_uboot_env.txt of the gateway's repository).
FACTORY_ENVIRONMENT = {
    "baudrate": "115200",
    "bootcmd": BOOTCMD,
    "bootdelay": "3",
    "ethact": "emac",
    "stderr": "serial",
    "stdin": "serial",
    "stdout": "serial",
}
