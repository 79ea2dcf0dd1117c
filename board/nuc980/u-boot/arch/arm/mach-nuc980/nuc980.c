// SPDX-License-Identifier: GPL-2.0-or-later
/*
 * Nuvoton NUC980: what belongs to no driver
 *
 * The boot ROM or an SPL has set up the DRAM, the PLLs and the CPU clock. It
 * opens no more clock gates than it needs itself, so all others are opened
 * here: the chip's device tree names no clocks that a driver could ask for.
 */

#include <common.h>
#include <cpu_func.h>
#include <init.h>
#include <asm/global_data.h>
#include <asm/io.h>
#include <linux/bitops.h>
#include <linux/sizes.h>

DECLARE_GLOBAL_DATA_PTR;

#define SYS_AHBIPRST		0xb0000060
#define SYS_AHBIPRST_CHIP	BIT(0)
#define SYS_RSTDEBCTL		0xb000010c
#define SYS_RSTDEBCTL_EN	BIT(31)
#define SYS_WRPRTR		0xb00001fc

#define CLK_HCLKEN		0xb0000210
#define CLK_HCLKEN_GPIO		BIT(11)
#define CLK_HCLKEN_EMAC0	BIT(16)
#define CLK_HCLKEN_EMAC1	BIT(17)
#define CLK_HCLKEN_FMI		BIT(20)
#define CLK_HCLKEN_NAND		BIT(21)
#define CLK_PCLKEN0		0xb0000218
#define CLK_PCLKEN0_TIMER0	BIT(8)
#define CLK_PCLKEN0_UART0	BIT(16)
#define CLK_DIV4		0xb0000230
#define CLK_DIV4_UART0		GENMASK(7, 3)
#define CLK_DIV8		0xb0000240
#define CLK_DIV8_MDC		GENMASK(7, 0)
#define CLK_DIV8_TIMER0		GENMASK(17, 16)

#define SDIC_SIZE0		0xb0002010
#define SDIC_SIZE1		0xb0002014
#define SDIC_SIZE_BASE		GENMASK(28, 21)
#define SDIC_SIZE_CODE		GENMASK(2, 0)

#define GPIOF_PUSEL		0xb0004170
#define GPIOF_PUSEL_PF11	GENMASK(23, 22)
#define GPIOF_PUSEL_PF11_UP	BIT(22)

static void sys_unlock(void)
{
	do {
		writel(0x59, SYS_WRPRTR);
		writel(0x16, SYS_WRPRTR);
		writel(0x88, SYS_WRPRTR);
	} while (!(readl(SYS_WRPRTR) & 1));
}

static void sys_lock(void)
{
	writel(0, SYS_WRPRTR);
}

/* Code 0 is no bank, 1 is 2 MiB, each further one twice as much. */
static phys_size_t bank_size(u32 sdic_size)
{
	u32 code = sdic_size & SDIC_SIZE_CODE;

	return code ? SZ_1M << code : 0;
}

int dram_init(void)
{
	gd->ram_size = bank_size(readl(SDIC_SIZE0)) +
		       bank_size(readl(SDIC_SIZE1));

	return 0;
}

int dram_init_banksize(void)
{
	u32 bank[CONFIG_NR_DRAM_BANKS] = {
		readl(SDIC_SIZE0), readl(SDIC_SIZE1)
	};
	int i;

	for (i = 0; i < CONFIG_NR_DRAM_BANKS; i++) {
		gd->bd->bi_dram[i].size = bank_size(bank[i]);
		gd->bd->bi_dram[i].start = gd->bd->bi_dram[i].size ?
					   bank[i] & SDIC_SIZE_BASE : 0;
	}

	return 0;
}

int board_early_init_f(void)
{
	setbits_le32(CLK_HCLKEN, CLK_HCLKEN_GPIO | CLK_HCLKEN_EMAC0 |
		     CLK_HCLKEN_EMAC1 | CLK_HCLKEN_FMI | CLK_HCLKEN_NAND);
	setbits_le32(CLK_PCLKEN0, CLK_PCLKEN0_TIMER0 | CLK_PCLKEN0_UART0);

	/* Console and timer run on the crystal of 12 MHz, undivided. */
	clrbits_le32(CLK_DIV4, CLK_DIV4_UART0);

	/* MDC of both Ethernet ports: HCLK is 150 MHz at most, this is 1 MHz. */
	clrsetbits_le32(CLK_DIV8, CLK_DIV8_TIMER0 | CLK_DIV8_MDC, 150 - 1);

	/* Without a cable the console's receive pin must not stop autoboot. */
	clrsetbits_le32(GPIOF_PUSEL, GPIOF_PUSEL_PF11, GPIOF_PUSEL_PF11_UP);

	return 0;
}

int board_init(void)
{
	gd->bd->bi_boot_params = CONFIG_SYS_SDRAM_BASE + 0x100;

	/* The reset pin is debounced for 0xfff clocks, as the vendor has it. */
	sys_unlock();
	writel(SYS_RSTDEBCTL_EN | 0xfff, SYS_RSTDEBCTL);
	sys_lock();

	return 0;
}

void reset_cpu(void)
{
	sys_unlock();
	writel(SYS_AHBIPRST_CHIP, SYS_AHBIPRST);
	for (;;)
		;
}

int print_cpuinfo(void)
{
	puts("CPU:   Nuvoton NUC980\n");

	return 0;
}
