// SPDX-License-Identifier: GPL-2.0-only
/*
 * Nuvoton NUC980
 *
 * The chip's device trees have no nodes for the clock controller and for the
 * two timers that keep the time, so both are started from here.
 */

#include <linux/io.h>
#include <linux/reboot.h>
#include <linux/soc/nuvoton/nuc980.h>
#include <linux/spinlock.h>

#include <asm/mach/arch.h>
#include <asm/mach/map.h>

#define NUC980_SYS_PHYS		0xb0000000
#define NUC980_SYS_SIZE		0x200

#define SYS_AHBIPRST		0x060
#define SYS_AHBIPRST_CHIP	BIT(0)
#define SYS_REGWPCTL		0x1fc

static DEFINE_RAW_SPINLOCK(nuc980_protection_lock);
static void __iomem *nuc980_sys;

void nuc980_protected_write(void __iomem *reg, u32 value)
{
	unsigned long flags;

	raw_spin_lock_irqsave(&nuc980_protection_lock, flags);
	writel(0x59, nuc980_sys + SYS_REGWPCTL);
	writel(0x16, nuc980_sys + SYS_REGWPCTL);
	writel(0x88, nuc980_sys + SYS_REGWPCTL);
	writel(value, reg);
	writel(0, nuc980_sys + SYS_REGWPCTL);
	raw_spin_unlock_irqrestore(&nuc980_protection_lock, flags);
}
EXPORT_SYMBOL_GPL(nuc980_protected_write);

static void nuc980_restart(enum reboot_mode mode, const char *cmd)
{
	nuc980_protected_write(nuc980_sys + SYS_AHBIPRST, SYS_AHBIPRST_CHIP);
}

static void __init nuc980_init_time(void)
{
	nuc980_sys = ioremap(NUC980_SYS_PHYS, NUC980_SYS_SIZE);
	nuc980_clk_init();
	nuc980_timer_init();
}

static const char * const nuc980_dt_compat[] __initconst = {
	"nuvoton,nuc980",
	NULL
};

DT_MACHINE_START(NUC980_DT, "Nuvoton NUC980 (device tree)")
	.dt_compat	= nuc980_dt_compat,
	.init_time	= nuc980_init_time,
	.restart	= nuc980_restart,
MACHINE_END
