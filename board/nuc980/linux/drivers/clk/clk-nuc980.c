// SPDX-License-Identifier: GPL-2.0-only
/*
 * Nuvoton NUC980 clocks
 *
 * The boot loader has started the PLLs and chosen the system's clock. What is
 * left to the drivers are the gates and, of the UARTs, timers and watchdogs,
 * the sources. The device trees name no clocks: drivers find theirs by their
 * device's name.
 */

#include <linux/bitfield.h>
#include <linux/clk.h>
#include <linux/clk-provider.h>
#include <linux/clkdev.h>
#include <linux/io.h>
#include <linux/soc/nuvoton/nuc980.h>

#define NUC980_CLK_PHYS		0xb0000200
#define NUC980_CLK_SIZE		0x100

#define CLK_HCLKEN		0x10
#define CLK_PCLKEN0		0x18
#define CLK_DIV0		0x20
#define CLK_DIV0_SYS_SOURCE	3		/* two bits */
#define CLK_DIV0_SYS_DIVIDER	8		/* one bit */
#define CLK_DIV4		0x30		/* a byte for each UART, to DIV6 */
#define CLK_DIV4_SOURCE		3		/* two bits */
#define CLK_DIV4_DIVIDER	5		/* three bits */
#define CLK_DIV8		0x40
#define CLK_DIV8_MDC		0		/* eight bits */
#define CLK_DIV8_WDT		8		/* two bits */
#define CLK_DIV8_ETIMER(n)	(16 + 2 * (n))	/* two bits */
#define CLK_APLLCON		0x60
#define CLK_UPLLCON		0x64
#define CLK_PLLCON_N		GENMASK(6, 0)
#define CLK_PLLCON_M		GENMASK(12, 7)
#define CLK_PLLCON_P		GENMASK(15, 13)

#define XIN_HZ			12000000
#define X32K_HZ			32768

/*
 * Not MDIO's most, which is 2.5 MHz, but what the vendor's kernel runs the
 * board's PHYs with.
 */
#define MDC_HZ			1000000

static void __iomem *clk_base;
static DEFINE_SPINLOCK(clk_lock);

static const char * const system_sources[] = {
	"xin", "x32k", "apll", "upll"
};

static const char * const etimer_sources[] = {
	"xin", "pclk0", "pclk0_4096", "x32k"
};

static const char * const wdt_sources[] = {
	"xin", "xin_512", "pclk2_4096", "x32k"
};

struct nuc980_gate {
	const char *name;
	const char *parent;
	u8 reg;
	u8 bit;
	const char *device;
	const char *connection;
};

static const struct nuc980_gate gates[] = {
	{ "gpio", "hclk", CLK_HCLKEN, 11, "b0004000.gpio" },
	{ "pdma0", "hclk", CLK_HCLKEN, 12, "b0008000.dma" },
	{ "pdma1", "hclk", CLK_HCLKEN, 13, "b0008000.dma", "pdma1" },
	{ "emac0", "hclk", CLK_HCLKEN, 16, "b0012000.emac0" },
	{ "emac1", "hclk", CLK_HCLKEN, 17, "b0022000.emac1" },
	{ "fmi", "hclk", CLK_HCLKEN, 20, "b0019000.fmi" },
	{ "nand", "hclk", CLK_HCLKEN, 21, "b0019000.fmi", "nand" },
	{ "wdt", "wdt_source", CLK_PCLKEN0, 0, "b0040000.wdt" },
	{ "rtc", "x32k", CLK_PCLKEN0, 2, "b0041000.rtc" },
	{ "etimer4", "etimer4_source", CLK_PCLKEN0, 12, NULL, "etimer4" },
	{ "etimer5", "etimer5_source", CLK_PCLKEN0, 13, NULL, "etimer5" },
};

/*
 * A PLL runs at what the boot loader set: XIN * N / (M * P), each one more
 * than in its register.
 */
static void __init nuc980_register_pll(const char *name, u32 reg)
{
	u32 con = readl(clk_base + reg);
	unsigned int n = FIELD_GET(CLK_PLLCON_N, con) + 1;
	unsigned int m = FIELD_GET(CLK_PLLCON_M, con) + 1;
	unsigned int p = FIELD_GET(CLK_PLLCON_P, con) + 1;

	clk_hw_register_fixed_factor(NULL, name, "xin", 0, n, m * p);
}

static void __init nuc980_register_buses(void)
{
	clk_hw_register_mux(NULL, "system_source", system_sources,
			    ARRAY_SIZE(system_sources), 0, clk_base + CLK_DIV0,
			    CLK_DIV0_SYS_SOURCE, 2, CLK_MUX_READ_ONLY,
			    &clk_lock);
	clk_hw_register_divider(NULL, "system", "system_source", 0,
				clk_base + CLK_DIV0, CLK_DIV0_SYS_DIVIDER, 1,
				CLK_DIVIDER_READ_ONLY, &clk_lock);
	clk_hw_register_fixed_factor(NULL, "hclk", "system", 0, 1, 2);
	clk_hw_register_fixed_factor(NULL, "pclk0", "hclk", 0, 1, 1);
	clk_hw_register_fixed_factor(NULL, "pclk0_4096", "pclk0", 0, 1, 4096);
	clk_hw_register_fixed_factor(NULL, "pclk2_4096", "hclk", 0, 1,
				     2 * 4096);
	clk_hw_register_fixed_factor(NULL, "xin_512", "xin", 0, 1, 512);
}

static void __init nuc980_register_mux(const char *name,
				       const char * const *sources, u8 shift)
{
	clk_hw_register_mux(NULL, name, sources, 4, 0, clk_base + CLK_DIV8,
			    shift, 2, 0, &clk_lock);
}

static void __init nuc980_register_gate(const char *name, const char *parent,
					u8 reg, u8 bit, const char *device,
					const char *connection)
{
	struct clk_hw *hw =
		clk_hw_register_gate(NULL, name, parent, CLK_SET_RATE_PARENT,
				     clk_base + reg, bit, 0, &clk_lock);

	if (IS_ERR(hw) || clk_hw_register_clkdev(hw, connection, device))
		pr_err("clock %s: cannot be registered\n", name);
}

/* A source, a divider by 1 to 8, a gate. */
static void __init nuc980_register_uart(unsigned int n)
{
	char source[16], divider[16], gate[16], device[16];
	void __iomem *reg = clk_base + CLK_DIV4 + n / 4 * 4;
	u8 shift = n % 4 * 8;

	snprintf(source, sizeof(source), "uart%u_source", n);
	snprintf(divider, sizeof(divider), "uart%u_divider", n);
	snprintf(gate, sizeof(gate), "uart%u", n);
	snprintf(device, sizeof(device), "b007%u000.serial", n);
	clk_hw_register_mux(NULL, source, system_sources,
			    ARRAY_SIZE(system_sources), 0, reg,
			    shift + CLK_DIV4_SOURCE, 2, 0, &clk_lock);
	clk_hw_register_divider(NULL, divider, source, CLK_SET_RATE_PARENT, reg,
				shift + CLK_DIV4_DIVIDER, 3, 0, &clk_lock);
	nuc980_register_gate(gate, divider, CLK_PCLKEN0, 16 + n, device, NULL);
}

/* One divider gives both EMACs the clock of their MDIO buses. */
static void __init nuc980_register_mdc(void)
{
	struct clk_hw *mdc = clk_hw_register_divider(NULL, "mdc", "hclk", 0,
						     clk_base + CLK_DIV8,
						     CLK_DIV8_MDC, 8, 0,
						     &clk_lock);

	clk_set_rate(mdc->clk, MDC_HZ);
	clk_hw_register_clkdev(mdc, "mdc", "b0012000.emac0");
	clk_hw_register_clkdev(mdc, "mdc", "b0022000.emac1");
}

void __init nuc980_clk_init(void)
{
	unsigned int n;

	clk_base = ioremap(NUC980_CLK_PHYS, NUC980_CLK_SIZE);
	clk_hw_register_fixed_rate(NULL, "xin", NULL, 0, XIN_HZ);
	clk_hw_register_fixed_rate(NULL, "x32k", NULL, 0, X32K_HZ);
	nuc980_register_pll("apll", CLK_APLLCON);
	nuc980_register_pll("upll", CLK_UPLLCON);
	nuc980_register_buses();
	nuc980_register_mdc();

	nuc980_register_mux("wdt_source", wdt_sources, CLK_DIV8_WDT);
	nuc980_register_mux("etimer4_source", etimer_sources,
			    CLK_DIV8_ETIMER(4));
	nuc980_register_mux("etimer5_source", etimer_sources,
			    CLK_DIV8_ETIMER(5));
	for (n = 0; n < ARRAY_SIZE(gates); n++)
		nuc980_register_gate(gates[n].name, gates[n].parent,
				     gates[n].reg, gates[n].bit,
				     gates[n].device, gates[n].connection);
	for (n = 0; n < 10; n++)
		nuc980_register_uart(n);
}
