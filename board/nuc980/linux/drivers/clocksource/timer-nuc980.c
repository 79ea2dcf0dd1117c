// SPDX-License-Identifier: GPL-2.0-only
/*
 * Nuvoton NUC980 timers 4 and 5: clock events and clock source
 *
 * The chip has six 24-bit timers that count up. The device trees have nodes for
 * timers 0 to 3; these two are the kernel's. Both count the crystal of 12 MHz,
 * so time has steps of 83 ns and the counter comes round in 1.4 s.
 */

#include <linux/bits.h>
#include <linux/clk.h>
#include <linux/clockchips.h>
#include <linux/clocksource.h>
#include <linux/delay.h>
#include <linux/interrupt.h>
#include <linux/io.h>
#include <linux/irq.h>
#include <linux/of.h>
#include <linux/of_irq.h>
#include <linux/sched_clock.h>
#include <linux/soc/nuvoton/nuc980.h>

#define ETIMER4_PHYS		0xb0052000
#define ETIMER5_PHYS		0xb0052100
#define ETIMER_SIZE		0x100
#define ETIMER4_SOURCE		32		/* of the interrupt controller */

#define ETMR_CTL		0x00
#define ETMR_CTL_ONESHOT	(0 << 4)
#define ETMR_CTL_CONTINUOUS	(3 << 4)
#define ETMR_CTL_CNTEN		BIT(0)
#define ETMR_PRECNT		0x04
#define ETMR_CMPR		0x08
#define ETMR_IER		0x0c
#define ETMR_ISR		0x10
#define ETMR_TIMEOUT		BIT(0)		/* in IER and ISR */
#define ETMR_DR			0x14

#define ETMR_BITS		24
#define ETMR_MAX		GENMASK(ETMR_BITS - 1, 0)
#define ETMR_MIN		12		/* 1 us; the chip allows 2 */

static void __iomem *event_base;
static void __iomem *source_base;

static u32 notrace nuc980_count(void)
{
	return readl_relaxed(source_base + ETMR_DR);
}

static u64 notrace nuc980_sched_clock(void)
{
	return nuc980_count();
}

/*
 * Delays are differences of 32 bits: with the counter in the upper ones they
 * are right when it comes round.
 */
static unsigned long nuc980_delay_count(void)
{
	return nuc980_count() << (32 - ETMR_BITS);
}

static struct delay_timer nuc980_delay_timer = {
	.read_current_timer	= nuc980_delay_count,
};

static int nuc980_stop(struct clock_event_device *event)
{
	writel_relaxed(0, event_base + ETMR_CTL);
	return 0;
}

/*
 * A compare value clears the stopped counter, some of the timer's own clocks
 * later. Started before, it could be beyond the value already and match only
 * when it has come round.
 */
static int nuc980_set_next_event(unsigned long ticks, struct clock_event_device *event)
{
	int reads = 100;

	writel_relaxed(0, event_base + ETMR_CTL);
	writel_relaxed(ticks, event_base + ETMR_CMPR);
	while (readl_relaxed(event_base + ETMR_DR) && --reads)
		cpu_relax();
	writel_relaxed(ETMR_CTL_ONESHOT | ETMR_CTL_CNTEN, event_base + ETMR_CTL);
	return reads ? 0 : -ETIME;
}

static struct clock_event_device nuc980_event = {
	.name			= "nuc980-etimer4",
	.features		= CLOCK_EVT_FEAT_ONESHOT,
	.rating			= 300,
	.set_next_event		= nuc980_set_next_event,
	.set_state_shutdown	= nuc980_stop,
	.set_state_oneshot	= nuc980_stop,
};

static irqreturn_t nuc980_event_interrupt(int irq, void *data)
{
	struct clock_event_device *event = data;

	writel_relaxed(ETMR_TIMEOUT, event_base + ETMR_ISR);
	event->event_handler(event);
	return IRQ_HANDLED;
}

/*
 * No node describes these interrupts, but the controller that they go to has
 * one.
 */
static unsigned int __init nuc980_event_irq(void)
{
	struct of_phandle_args source = {
		.args_count = 2,
		.args = { ETIMER4_SOURCE, IRQ_TYPE_LEVEL_HIGH },
	};
	unsigned int irq;

	source.np = of_find_compatible_node(NULL, NULL, "nuvoton,nuc980-aic");
	irq = irq_create_of_mapping(&source);
	of_node_put(source.np);
	return irq;
}

static unsigned long __init nuc980_start_clock(const char *name)
{
	struct clk *clk = clk_get_sys(NULL, name);

	if (IS_ERR(clk) || clk_prepare_enable(clk))
		panic("%s: no clock\n", name);
	return clk_get_rate(clk);
}

static void __init nuc980_source_init(void)
{
	unsigned long rate = nuc980_start_clock("etimer5");

	source_base = ioremap(ETIMER5_PHYS, ETIMER_SIZE);
	writel_relaxed(0, source_base + ETMR_CTL);
	writel_relaxed(0, source_base + ETMR_IER);
	writel_relaxed(0, source_base + ETMR_PRECNT);
	writel_relaxed(ETMR_MAX, source_base + ETMR_CMPR);
	writel_relaxed(ETMR_CTL_CONTINUOUS | ETMR_CTL_CNTEN, source_base + ETMR_CTL);

	sched_clock_register(nuc980_sched_clock, ETMR_BITS, rate);
	clocksource_mmio_init(source_base + ETMR_DR, "nuc980-etimer5", rate, 300, ETMR_BITS,
			      clocksource_mmio_readl_up);
	nuc980_delay_timer.freq = rate << (32 - ETMR_BITS);
	register_current_timer_delay(&nuc980_delay_timer);
}

static void __init nuc980_event_init(void)
{
	unsigned long rate = nuc980_start_clock("etimer4");
	unsigned int irq = nuc980_event_irq();

	event_base = ioremap(ETIMER4_PHYS, ETIMER_SIZE);
	writel_relaxed(0, event_base + ETMR_CTL);
	writel_relaxed(0, event_base + ETMR_PRECNT);
	writel_relaxed(ETMR_TIMEOUT, event_base + ETMR_ISR);
	writel_relaxed(ETMR_TIMEOUT, event_base + ETMR_IER);

	if (!irq || request_irq(irq, nuc980_event_interrupt,
				IRQF_TIMER | IRQF_IRQPOLL, nuc980_event.name,
				&nuc980_event))
		panic("%s: no interrupt\n", nuc980_event.name);
	nuc980_event.cpumask = cpumask_of(0);
	clockevents_config_and_register(&nuc980_event, rate, ETMR_MIN, ETMR_MAX);
}

void __init nuc980_timer_init(void)
{
	nuc980_source_init();
	nuc980_event_init();
}
