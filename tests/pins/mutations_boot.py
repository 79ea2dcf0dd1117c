# SPDX-License-Identifier: GPL-3.0-or-later
"""Mistakes in what a kernel is told at boot, and in the flash: memory, console, port names, partitions."""

from mutation import OFF, Mutation, root
from trees import gateway

from nuc980.pins.environment import Environment, FlashRead

BOOT = """
/ {
    aliases { serial0 = &uart0; ethernet0 = &emac0; ethernet1 = &emac1; };
    chosen { stdout-path = "serial0:115200n8"; };
    memory@0 { device_type = "memory"; reg = <0x0 0x4000000>; };
};
&fmi {
    partitions {
        compatible = "fixed-partitions"; #address-cells = <1>; #size-cells = <1>;
        boot: partition@0 { label = "u-boot"; reg = <0x0 0x200000>; read-only; };
        kernel: partition@200000 { label = "kernel"; reg = <0x200000 0x500000>; };
        tree: partition@700000 { label = "device-tree"; reg = <0x700000 0x100000>; };
        spare: partition@800000 { label = "spare"; reg = <0x800000 0xe00000>; };
        rootfs: partition@1600000 { label = "rootfs"; reg = <0x1600000 0x6480000>; };
    };
};
"""


def mistake(rule: str, name: str, more: str, *says: str, also: tuple[str, ...] = ()) -> Mutation:
    return Mutation(rule, name, more, says, also=also, good=gateway(BOOT))


def chosen(text: str) -> str:
    return root(f"chosen {{ {text} }};")


def reserved(region: str) -> str:
    return root(f"reserved-memory {{ #address-cells = <1>; #size-cells = <1>; ranges; {region} }};")


# Against the pin table, and the limits that it names.
BOOT_MUTATIONS = [
    mistake(
        "partition-overlap",
        "kernel over the device tree",
        "&kernel { reg = <0x200000 0x600000>; };",
        "kernel (0x200000 to 0x800000) reaches into device-tree (0x700000 to 0x800000)",
        "End kernel at 0x700000",
    ),
    mistake(
        "partition-label-twice",
        "two kernels",
        '&spare { label = "rootfs"; };',
        "partition@800000 (0x800000) and partition@1600000 (0x1600000) are all called rootfs",
        also=("partition-moved",),
    ),
    mistake(
        "partition-bounds",
        "beyond the chip",
        "&rootfs { reg = <0x1600000 0x6a80000>; };",
        "rootfs (0x1600000 to 0x8080000) ends beyond the flash, which has 0x8000000 bytes",
    ),
    mistake(
        "partition-bounds",
        "inside a block",
        "&spare { reg = <0x810000 0xdf0800>; };",
        "begins at 0x810000 and ends at 0x1600800, inside an erase block of 0x20000 bytes",
        also=("partition-overlap", "unit-address"),
    ),
    mistake(
        "partition-moved",
        "kernel off the place that the boot command reads",
        "&kernel { reg = <0x220000 0x4e0000>; };",
        "kernel (0x220000 to 0x700000) should begin at 0x200000 and have 0x500000 bytes",
        also=("unit-address",),
    ),
    mistake(
        "partition-moved",
        "device tree behind it",
        "&tree { reg = <0x720000 0xe0000>; };",
        "should begin at 0x700000 and have 0x100000 bytes",
        also=("unit-address",),
    ),
    mistake(
        "partition-moved",
        "another place for the root",
        "&rootfs { reg = <0x1800000 0x6280000>; };",
        "0x1600000",
        also=("unit-address",),
    ),
    mistake(
        "boot-writable",
        "without read-only",
        "&boot { /delete-property/ read-only; };",
        "u-boot (0x0 to 0x200000) is writable and contains the boot loader",
        "Add read-only; to u-boot",
    ),
    mistake(
        "boot-writable",
        "by a partition that begins too early",
        "&boot { reg = <0x0 0x100000>; }; &spare { reg = <0x100000 0x100000>; };",
        "spare (0x100000 to 0x200000)",
        also=("unit-address",),
    ),
    mistake(
        "unknown-property",
        "read-only mistyped",
        "&boot { /delete-property/ read-only; read-onyl; };",
        "it probably means read-only",
        also=("boot-writable",),
    ),
    mistake(
        "partition-missing",
        "a root of another name",
        '&rootfs { label = "user"; };',
        "fmi has no partition called rootfs (0x1600000)",
    ),
    mistake(
        "partition-missing",
        "none at all",
        "&fmi { /delete-node/ partitions; };",
        "kernel (0x200000) or device-tree (0x700000) or rootfs (0x1600000)",
    ),
    mistake("too-little-memory", "no unit", chosen('bootargs = "mem=64";'), "mem=64, which is 64 bytes"),
    mistake(
        "untyped-memory",
        "no device_type",
        "/ { memory@0 { /delete-property/ device_type; }; };",
        '/memory@0 has no device_type = "memory"',
    ),
    mistake(
        "reserved-unread",
        "a region alone",
        root("reserved-memory { log@3f00000 { reg = <0x3f00000 0x10000>; no-map; }; };"),
        "has no #address-cells = <1>, #size-cells = <1> and an empty ranges",
    ),
    mistake(
        "partitions-unread",
        "no compatible",
        "&fmi { partitions { /delete-property/ compatible; }; };",
        "/partitions has 5 partitions, and no compatible",
    ),
    mistake(
        "partitions-unread",
        "three cells",
        "&spare { reg = <0x800000 0xe00000 0>; };",
        "partition@800000 has 3 cells, not 2",
    ),
    mistake(
        "partitions-unread",
        "no size",
        "&rootfs { reg = <0x1600000 0>; };",
        "has size 0, which means up to the end of the flash",
        also=("partition-moved",),
    ),
    mistake(
        "unit-address",
        "of a partition",
        "&spare { reg = <0x820000 0xde0000>; };",
        "the name of partition@800000 says 800000, but its reg says 820000",
    ),
    mistake(
        "unknown-partition",
        "UBI on a label that is cut",
        chosen('bootargs = "ubi.mtd=rootf,2048 root=ubi0:rootfs";'),
        "ubi.mtd=rootf,2048; the partitions are u-boot, kernel, device-tree, spare and rootfs",
    ),
    mistake(
        "unknown-partition", "a number too great", chosen('bootargs = "root=/dev/mtdblock5";'), "mtdblock5"
    ),
    mistake(
        "bad-block-table",
        "of the vendor's tree",
        "&fmi { nand-on-flash-bbt; };",
        "fmi has nand-on-flash-bbt",
        "Delete nand-on-flash-bbt",
    ),
    mistake(
        "too-much-memory",
        "memory node",
        "/ { memory@0 { reg = <0x0 0x8000000>; }; };",
        "/memory@0 ends at 0x8000000; the board has 0x4000000 bytes (64 MiB)",
    ),
    mistake(
        "too-much-memory", "command line", chosen('bootargs = "mem=128M";'), "the command line has mem=128M"
    ),
    mistake(
        "reserved-over-boot",
        "over the kernel",
        reserved("fb@0 { reg = <0x0 0x100000>; no-map; };"),
        "reserves 0x0 to 0x100000; the kernel is at 0x7fc0 to 0x507fc0",
    ),
    mistake(
        "reserved-over-boot",
        "over the device tree",
        reserved("fb@a80000 { reg = <0xa80000 0x100000>; };"),
        "the device tree is at 0xa00000 to 0xb00000",
    ),
    mistake(
        "wrong-initrd",
        "ends before it begins",
        chosen("linux,initrd-start = <0x2000000>; linux,initrd-end = <0x1800000>;"),
        "linux,initrd-end (0x1800000) is not behind linux,initrd-start (0x2000000)",
    ),
    mistake(
        "wrong-initrd",
        "behind the memory",
        chosen("linux,initrd-start = <0x5000000>; linux,initrd-end = <0x5800000>;"),
        "it ends at 0x5800000; memory ends at 0x4000000",
    ),
    mistake("wrong-initrd", "no end", chosen("linux,initrd-start = <0x2000000>;"), "is there alone"),
    mistake(
        "unknown-node",
        "chosen misspelt",
        root('choosen { bootargs = "console=ttyS0"; };'),
        "/choosen is read by nothing; it probably means chosen",
    ),
    mistake(
        "mtdparts-moved",
        "the boot loader has less",
        chosen('bootargs = "mtdparts=nand0:1m(u-boot)ro,5m(kernel),-(rootfs)";'),
        "kernel from 0x100000 to 0x600000; it is from 0x200000 to 0x700000",
        "u-boot from 0x0 to 0x100000",
    ),
    Mutation(
        "wrong-boot-command",
        "more than the partition",
        says=(
            "printenv reads 0x600000 bytes at 0x200000; the partition kernel (",
            "ends before",
        ),
        good=gateway(BOOT),
        environment=Environment("printenv", reads=(FlashRead(0x200000, 0x600000),)),
    ),
    mistake(
        "unknown-parameter",
        "a letter too many",
        chosen('bootargs = "consoles=ttyS0,115200";'),
        "consoles=ttyS0,115200; it probably means console",
    ),
    mistake(
        "unknown-parameter", "no root", chosen('bootargs = "rot=/dev/mtdblock4";'), "probably means root"
    ),
    mistake(
        "unknown-partition",
        "UBI on the boot loader",
        chosen('bootargs = "ubi.mtd=u-boot root=ubi0:rootfs";'),
        "nothing of UBI is in u-boot",
        "Name one of spare, rootfs",
    ),
    mistake(
        "cut-command-line",
        "a list",
        chosen('bootargs = "console=ttyS0", "root=/dev/ram0";'),
        "bootargs is a list of 2 strings; the kernel reads the first",
    ),
    mistake("cut-command-line", "too long", chosen(f'bootargs = "{"x" * 1024}";'), "has 1024 bytes"),
    mistake("wrong-root", "no UBI", chosen('bootargs = "root=ubi0:rootfs rootfstype=ubifs";'), "no ubi.mtd="),
    mistake(
        "wrong-root",
        "a file system that UBI has not",
        chosen('bootargs = "ubi.mtd=rootfs root=ubi0:rootfs rootfstype=jffs2";'),
        "rootfstype=jffs2 is no file system of UBI",
    ),
    mistake(
        "wrong-root", "no card", chosen('bootargs = "root=/dev/mmcblk0p2 rootwait";'), "no SD host is enabled"
    ),
    mistake("wrong-root", "no address", chosen('bootargs = "root=/dev/nfs nfsroot=/srv";'), "no ip="),
    mistake(
        "wrong-root", "no stick", chosen('bootargs = "root=/dev/sda1 rootwait";'), "no USB host is enabled"
    ),
    mistake(
        "ecc-beyond-spare",
        "more than a page of 2 KiB has",
        "&fmi { nand-ecc-strength = <12>; };",
        "needs 92 bytes of a page's spare, which has 60",
    ),
    mistake(
        "ecc-beyond-spare",
        "less than U-Boot writes with",
        "&fmi { nand-ecc-strength = <4>; };",
        "U-Boot writes with 8, and our driver has no other",
    ),
    mistake(
        "ecc-beyond-spare",
        "a strength of others",
        "&fmi { nand-ecc-strength = <6>; };",
        "corrects 4, 8, 12, 15 and 24",
    ),
    mistake(
        "wrong-console",
        "another chip's",
        chosen('bootargs = "console=ttyAMA0,115200";'),
        "a port of another chip",
    ),
    mistake(
        "wrong-alias",
        "of no node",
        root('aliases { rtc0 = "/apb/rtc"; };'),
        "rtc0 is '/apb/rtc' (not a node)",
    ),
    mistake(
        "reserved-outside",
        "behind the memory",
        root(
            "reserved-memory { #address-cells = <1>; #size-cells = <1>; ranges;"
            " log@4000000 { reg = <0x4000000 0x10000>; no-map; }; };"
        ),
        "reserves up to 0x4010000; memory ends at 0x4000000",
    ),
    mistake(
        "wrong-console",
        "stdout-path on a port that is off",
        chosen('stdout-path = "/apb/serial@b0075000:115200n8";'),
        "is uart5, which is disabled",
        "console=ttyS0, and uart0 in stdout-path",
    ),
    mistake(
        "wrong-console",
        "stdout-path on an RS-485 port",
        root("aliases { serial1 = &uart1; };") + chosen('stdout-path = "serial1";'),
        "is uart1; the console of the board is uart0 (debug console on the USB serial connector)",
    ),
    mistake(
        "wrong-console",
        "alias that is not there",
        chosen('stdout-path = "serial9";'),
        "not an alias of this tree",
    ),
    mistake(
        "wrong-console",
        "path that is not there",
        chosen('stdout-path = "/apb/serial";'),
        "not a node of this tree",
    ),
    mistake("wrong-console", "no port", chosen('stdout-path = "/ahb/emac0@b0012000";'), "not a serial port"),
    mistake(
        "wrong-console", "console= of another port", chosen('bootargs = "console=ttyS1,115200";'), "is uart1;"
    ),
    mistake(
        "wrong-console",
        "the last of two",
        chosen('bootargs = "quiet console=ttyS0,115200 console=ttyS8";'),
        "console=ttyS8 is uart8",
    ),
    mistake("wrong-console", "tenth port", chosen('bootargs = "console=ttyS10";'), "not a port of this tree"),
    mistake(
        "wrong-console",
        "bus of the port off",
        root(f"apb {{ {OFF} }};"),
        "uart0, which is disabled, because /apb is",
        'Set status = "okay" in /apb',
        also=("table-missing", "controller-off", "group-missing"),
    ),
    mistake(
        "wrong-alias",
        "console moved",
        root("aliases { serial0 = &uart1; };"),
        "serial0 is uart1, not uart0",
        also=("wrong-console",),
    ),
    mistake(
        "wrong-alias",
        "Ethernet ports exchanged",
        root("aliases { ethernet0 = &emac1; ethernet1 = &emac0; };"),
        "ethernet0 is emac1, not emac0",
        "ethernet1 is emac0, not emac1",
    ),
    mistake(
        "wrong-alias",
        "a node that does not exist",
        root('aliases { ethernet1 = "/ahb/ethernet@b0022000"; };'),
        "'/ahb/ethernet@b0022000' (not a node)",
    ),
]

# What is right and looks like one of them.
RIGHT = {
    "as it is": "",
    "command line": chosen('bootargs = "console=tty0 console=ttyS0,115200n8 mem=0x4000000 mem=64M@0";'),
    "parameters of others": chosen(
        'bootargs = "boot=live ethaddr0=02:00:00:00:00:01 ethaddr1=02:00:00:00:00:02 panic=-1";'
    ),
    "base 8": chosen('bootargs = "mem=0400000000";'),
    "less memory": "/ { memory@0 { reg = <0x0 0x2000000>; }; };",
    "reserved": root(
        "reserved-memory { #address-cells = <1>; #size-cells = <1>; ranges;"
        " log@3ff0000 { reg = <0x3ff0000 0x10000>; no-map; }; };"
    ),
    "partitions that are there": chosen('bootargs = "ubi.mtd=rootfs ubi.mtd=3,2048 root=/dev/mtdblock4";'),
    "partitions of the command line": chosen('bootargs = "mtdparts=nand0:1m(a) ubi.mtd=a";'),
    "an initial RAM disk": chosen(
        'bootargs = "root=/dev/ram0"; linux,initrd-start = <0x1000000>; linux,initrd-end = <0x1400000>;'
    ),
    "root by NFS": chosen('bootargs = "root=/dev/nfs ip=dhcp nfsroot=10.0.0.1:/srv,v3 console=tty0";'),
    "block of UBI": chosen(
        'bootargs = "ubi.mtd=rootfs ubi.block=0,0 root=/dev/ubiblock0_0 rootfstype=squashfs";'
    ),
    "mtdparts of the tree": chosen(
        'bootargs = "mtdparts=nand0:2m(u-boot)ro,5m(kernel),1m(device-tree),14m(spare),0x6480000(rootfs)";'
    ),
    "a node of one's own": root("memo { };"),
    "no console named": root("chosen { /delete-property/ stdout-path; };"),
    "other aliases": root("aliases { serial4 = &uart4; spi1 = &spi0; };"),
    "kernel in two": "&tree { reg = <0x700000 0x100000>; }; &spare { reg = <0x800000 0x20000>; };",
}
