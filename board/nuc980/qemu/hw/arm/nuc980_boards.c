/*
 * Boards with the Nuvoton NUC980
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "chardev/char.h"
#include "exec/address-spaces.h"
#include "hw/arm/boot.h"
#include "hw/arm/nuc980.h"
#include "hw/arm/nuc980_bootrom.h"
#include "hw/block/flash.h"
#include "hw/boards.h"
#include "hw/loader.h"
#include "hw/qdev-properties.h"
#include "hw/qdev-properties-system.h"
#include "net/net.h"
#include "qapi/error.h"
#include "qemu/cutils.h"
#include "qemu/error-report.h"
#include "qemu/units.h"
#include "sysemu/block-backend.h"
#include "sysemu/blockdev.h"
#include "sysemu/qtest.h"
#include "sysemu/reset.h"
#include "sysemu/sysemu.h"

#define TYPE_NUC980_MACHINE MACHINE_TYPE_NAME("nuc980")
OBJECT_DECLARE_SIMPLE_TYPE(NUC980Machine, NUC980_MACHINE)

#define RAM_ALIAS           0x80000000
#define MAX_RAM_MIB         128         /* the SDRAM controller's largest */
#define LOADER_ADDR         0xe00000    /* U-Boot: CONFIG_SYS_TEXT_BASE */
#define LOADER_MAX_SIZE     (1 * MiB)
#define NAND_PAGES          65536       /* 128 MiB */
#define NAND_PAGE_SIZE      (2048 + 64) /* with the spare */
#define NAND_SIZE           (NAND_PAGES * NAND_PAGE_SIZE)

/* Whose characters take their time */
typedef enum {
    PACE_OFF,                           /* nobody's */
    PACE_ON,
    PACE_LINES,                         /* all but those of the debug UART */
} Pace;

static const char *const pace_names[] = { "off", "on", "lines", NULL };

struct NUC980Machine {
    MachineState parent_obj;

    NUC980State soc;
    MemoryRegion ram_alias;
    struct arm_boot_info boot;
    Pace pace;
    bool boot_nand;
    uint32_t board;
};

static void check_ram_size(MachineState *machine)
{
    uint64_t mib = machine->ram_size / MiB;

    if (machine->ram_size % MiB || !is_power_of_2(mib) || mib < 2 ||
        mib > MAX_RAM_MIB) {
        error_report("RAM of a NUC980 is 2, 4, 8, 16, 32, 64 or 128 MiB");
        exit(EXIT_FAILURE);
    }
}

/*
 * guess: the RAM is a second time at 0x80000000. The vendor's BSP gives EMACs
 * (eth0.c of its lwIP sample) and I2S (i2s.c) addresses with that bit set.
 */
static void map_ram(NUC980Machine *m)
{
    MemoryRegion *ram = MACHINE(m)->ram;

    memory_region_add_subregion(get_system_memory(), 0, ram);
    memory_region_init_alias(&m->ram_alias, OBJECT(m), "nuc980.ram-alias", ram,
                             0, memory_region_size(ram));
    memory_region_add_subregion(get_system_memory(), RAM_ALIAS, &m->ram_alias);
}

static bool uart_is_wired(NUC980Machine *m, int n)
{
    g_autofree char *rxd = g_strdup_printf("UART%d_RXD", n);

    return nuc980_pin_wires(&m->soc.pins, rxd);
}

/* UART0 is -serial; any other that the board wires takes -chardev id=uartN. */
static void connect_uarts(NUC980Machine *m)
{
    if (serial_hd(1)) {
        error_report("only UART0 is -serial; for UART1 and up name a chardev, "
                     "as in -chardev ...,id=uart1");
        exit(EXIT_FAILURE);
    }
    if (qemu_chr_find("uart0") && qemu_chr_find("uart0") != serial_hd(0)) {
        error_report("chardev uart0 needs -serial chardev:uart0");
        exit(EXIT_FAILURE);
    }
    for (int i = 0; i < NUC980_UARTS; i++) {
        DeviceState *uart = DEVICE(&m->soc.uart[i]);
        g_autofree char *id = g_strdup_printf("uart%d", i);
        Chardev *chr = i ? qemu_chr_find(id) : serial_hd(0);

        if (chr && !uart_is_wired(m, i)) {
            error_report("chardev %s: the board wires no pins to UART%d "
                         "(pins.yml of board %s)", id, i,
                         nuc980_board_name(m->soc.pins.board));
            exit(EXIT_FAILURE);
        }
        qdev_prop_set_chr(uart, "chardev", chr);
        qdev_prop_set_bit(uart, "pace", m->pace == PACE_ON ||
                                        (m->pace == PACE_LINES && i));
    }
}

static void connect_nics(NUC980Machine *m)
{
    for (int i = 0; i < NUC980_EMACS; i++) {
        if (nd_table[i].used) {
            qemu_check_nic_model(&nd_table[i], TYPE_NUC980_EMAC);
            qdev_set_nic_properties(DEVICE(&m->soc.emac[i]), &nd_table[i]);
        }
    }
}

static bool nand_page_is_zero(BlockBackend *blk, int64_t page)
{
    uint8_t data[NAND_PAGE_SIZE];

    return blk_pread(blk, page * sizeof(data), sizeof(data), data, 0) >= 0 &&
           buffer_is_zero(data, sizeof(data));
}

static void check_nand_image(BlockBackend *blk)
{
    int64_t size = blk_getlength(blk);

    if (size != NAND_SIZE) {
        error_report("the NAND's image has %" PRId64 " bytes instead of %d, "
                     "which are %d pages of 2048 bytes and 64 spare ones",
                     size, NAND_SIZE, NAND_PAGES);
        exit(EXIT_FAILURE);
    }
    if (nand_page_is_zero(blk, 0) && nand_page_is_zero(blk, NAND_PAGES - 1)) {
        error_report("the NAND's image is full of zeros: an erased NAND is "
                     "full of 0xff, as from "
                     "head -c %d /dev/zero | tr '\\0' '\\377'", NAND_SIZE);
        exit(EXIT_FAILURE);
    }
}

/* The board's flash has the size and pages of a Winbond W29N01HV: assumed. */
static void connect_nand(NUC980Machine *m, DriveInfo *drive)
{
    BlockBackend *blk;

    if (!drive) {
        return;
    }
    blk = blk_by_legacy_dinfo(drive);
    object_property_set_link(OBJECT(&m->soc.fmi), "nand",
                             OBJECT(nand_init(blk, 0xef, 0xf1)), &error_abort);
    check_nand_image(blk);
}

/* What starts: the image of -kernel or -bios, or what the NAND has. */
static void check_boot_source(NUC980Machine *m, DriveInfo *nand)
{
    MachineState *machine = MACHINE(m);

    if (m->boot_nand && (machine->kernel_filename || machine->firmware)) {
        error_report("boot-source=nand starts what the NAND has: it cannot go "
                     "with -kernel or -bios");
        exit(EXIT_FAILURE);
    }
    if (machine->kernel_filename && machine->firmware) {
        error_report("-kernel cannot go with -bios: one of them starts");
        exit(EXIT_FAILURE);
    }
    if (!m->boot_nand && !machine->kernel_filename && !machine->firmware &&
        !qtest_enabled()) {
        warn_report("nothing to start: "
                    "give -kernel, -bios or boot-source=nand");
    }
    if (m->boot_nand && !nand) {
        error_report("boot-source=nand needs a NAND image: "
                     "-drive if=mtd,format=raw,file=...");
        exit(EXIT_FAILURE);
    }
}

static void start_loader(void *opaque)
{
    ARMCPU *cpu = opaque;

    cpu_reset(CPU(cpu));
    cpu_set_pc(CPU(cpu), LOADER_ADDR);
}

/* What the boot ROM and the SPL do: U-Boot is in RAM, and runs. */
static void load_loader(NUC980Machine *m, const char *file)
{
    if (MACHINE(m)->ram_size < LOADER_ADDR + LOADER_MAX_SIZE) {
        error_report("a boot loader lies at 14 MiB: it needs -m 16M at least");
        exit(EXIT_FAILURE);
    }
    if (load_image_targphys(file, LOADER_ADDR, LOADER_MAX_SIZE) < 0) {
        error_report("cannot load %s, a boot loader of at most 1 MiB", file);
        exit(EXIT_FAILURE);
    }
    qemu_register_reset(start_loader, &m->soc.cpu);
}

static void nuc980_machine_init(MachineState *machine)
{
    NUC980Machine *m = NUC980_MACHINE(machine);
    DriveInfo *nand = drive_get(IF_MTD, 0, 0);

    check_ram_size(machine);
    check_boot_source(m, nand);
    map_ram(m);

    object_initialize_child(OBJECT(machine), "soc", &m->soc, TYPE_NUC980);
    object_property_set_uint(OBJECT(&m->soc), "ram-mib",
                             machine->ram_size / MiB, &error_abort);
    object_property_set_bool(OBJECT(&m->soc), "booted",
                             machine->kernel_filename || machine->firmware ||
                             m->boot_nand, &error_abort);
    qdev_prop_set_uint32(DEVICE(&m->soc.pins), "board", m->board);
    connect_uarts(m);
    connect_nics(m);
    connect_nand(m, nand);
    qdev_realize(DEVICE(&m->soc), NULL, &error_fatal);

    if (m->boot_nand) {
        nuc980_boot_from_nand(&m->soc.cpu, blk_by_legacy_dinfo(nand));
    } else if (machine->firmware) {
        load_loader(m, machine->firmware);
    } else {
        m->boot.ram_size = machine->ram_size;
        m->boot.board_id = -1;          /* device tree only */
        arm_load_kernel(&m->soc.cpu, machine, &m->boot);
    }
}

static char *machine_get_pace(Object *obj, Error **errp)
{
    return g_strdup(pace_names[NUC980_MACHINE(obj)->pace]);
}

static void machine_set_pace(Object *obj, const char *value, Error **errp)
{
    for (unsigned i = 0; pace_names[i]; i++) {
        if (!strcmp(value, pace_names[i])) {
            NUC980_MACHINE(obj)->pace = i;
            return;
        }
    }
    error_setg(errp, "pace is on, off or lines, not %s", value);
}

static char *machine_get_boot_source(Object *obj, Error **errp)
{
    return g_strdup(NUC980_MACHINE(obj)->boot_nand ? "nand" : "none");
}

static void machine_set_boot_source(Object *obj, const char *value,
                                    Error **errp)
{
    if (strcmp(value, "nand") && strcmp(value, "none")) {
        error_setg(errp, "boot-source is nand or none, not %s", value);
        return;
    }
    NUC980_MACHINE(obj)->boot_nand = !strcmp(value, "nand");
}

static char *machine_get_board(Object *obj, Error **errp)
{
    return g_strdup(nuc980_board_name(NUC980_MACHINE(obj)->board));
}

static void machine_set_board(Object *obj, const char *value, Error **errp)
{
    ERRP_GUARD();
    int number = nuc980_board_number(value);

    if (number < 0) {
        error_setg(errp, "there is no board %s", value);
        for (unsigned i = 0; nuc980_board_name(i); i++) {
            error_append_hint(errp, "board=%s\n", nuc980_board_name(i));
        }
        return;
    }
    NUC980_MACHINE(obj)->board = number;
}

static void nuc980_machine_instance_init(Object *obj)
{
    NUC980_MACHINE(obj)->pace = PACE_ON;
}

static void nuc980_machine_class_init(ObjectClass *klass, void *data)
{
    static const char *const cpu_types[] = {
        ARM_CPU_TYPE_NAME("arm926"), NULL
    };
    MachineClass *mc = MACHINE_CLASS(klass);

    mc->desc = "Board with the Nuvoton NUC980 (ARM926EJ-S)";
    mc->init = nuc980_machine_init;
    mc->default_cpu_type = cpu_types[0];
    mc->valid_cpu_types = (const char **)cpu_types;
    mc->default_ram_size = 64 * MiB;
    mc->default_ram_id = "nuc980.ram";
    /* Reason: the vendor's kernel probes blocks that are not modelled */
    mc->ignore_memory_transaction_failures = true;
    object_class_property_add_str(klass, "pace", machine_get_pace,
                                  machine_set_pace);
    object_class_property_set_description(klass, "pace",
        "UARTs move characters at the programmed speed: on, off; "
        "lines: all but the debug UART (default: on)");
    object_class_property_add_str(klass, "boot-source", machine_get_boot_source,
                                  machine_set_boot_source);
    object_class_property_set_description(klass, "boot-source",
        "nand: what the boot ROM finds in the NAND; none: -kernel or -bios");
    object_class_property_add_str(klass, "board", machine_get_board,
                                  machine_set_board);
    object_class_property_set_description(klass, "board",
        "whose wiring the pins have (default: gateway)");
}

static const TypeInfo nuc980_machine_types[] = {
    {
        .name = TYPE_NUC980_MACHINE,
        .parent = TYPE_MACHINE,
        .instance_size = sizeof(NUC980Machine),
        .instance_init = nuc980_machine_instance_init,
        .class_init = nuc980_machine_class_init,
    },
};

DEFINE_TYPES(nuc980_machine_types)
