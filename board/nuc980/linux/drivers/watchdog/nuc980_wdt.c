// SPDX-License-Identifier: GPL-2.0-only
/*
 * Nuvoton NUC980 watchdog timer
 *
 * Counts up to an interval of 2^(4 + 2n) ticks, and resets the chip up to
 * 1026 ticks later. The delay is not counted on: time-outs are intervals.
 */

#include <linux/bitfield.h>
#include <linux/clk.h>
#include <linux/io.h>
#include <linux/math64.h>
#include <linux/module.h>
#include <linux/of.h>
#include <linux/platform_device.h>
#include <linux/soc/nuvoton/nuc980.h>
#include <linux/watchdog.h>

#define WDT_CTL			0x00
#define WDT_CTL_RSTEN		BIT(1)
#define WDT_CTL_RSTF		BIT(2)		/* write 1 to clear */
#define WDT_CTL_WDTEN		BIT(7)
#define WDT_CTL_TOUTSEL		GENMASK(10, 8)
#define WDT_RSTCNT		0x08
#define WDT_RSTCNT_KEY		0x5aa5

#define WDT_TOUTSEL_LONGEST	7
#define WDT_INTERVAL_SHIFT(n)	(4 + 2 * (n))

/*
 * XIN / 512, not the crystal of 32 kHz: a board need not have that one, and a
 * watchdog without a clock would be missed when it is too late.
 */
#define WDT_CLOCK_HZ		(12000000 / 512)

#define WDT_DEFAULT_TIMEOUT	30

struct nuc980_wdt {
	struct watchdog_device wdd;
	void __iomem *base;
	unsigned long rate;
};

static unsigned int heartbeat;
module_param(heartbeat, uint, 0);
MODULE_PARM_DESC(heartbeat, "Watchdog heartbeat in seconds (default="
		 __MODULE_STRING(WDT_DEFAULT_TIMEOUT) ")");

static bool nowayout = WATCHDOG_NOWAYOUT;
module_param(nowayout, bool, 0);
MODULE_PARM_DESC(nowayout, "Watchdog cannot be stopped once started (default="
		 __MODULE_STRING(WATCHDOG_NOWAYOUT) ")");

static struct nuc980_wdt *to_nuc980_wdt(struct watchdog_device *wdd)
{
	return container_of(wdd, struct nuc980_wdt, wdd);
}

static unsigned int nuc980_wdt_interval_ms(struct nuc980_wdt *wdt,
					   unsigned int toutsel)
{
	return div_u64((u64)MSEC_PER_SEC << WDT_INTERVAL_SHIFT(toutsel),
		       wdt->rate);
}

/* The first interval that is not shorter, or the longest there is. */
static unsigned int nuc980_wdt_toutsel(struct nuc980_wdt *wdt,
				       unsigned int timeout)
{
	unsigned int toutsel = 0;

	while (toutsel < WDT_TOUTSEL_LONGEST &&
	       nuc980_wdt_interval_ms(wdt, toutsel) < timeout * MSEC_PER_SEC)
		toutsel++;
	return toutsel;
}

static int nuc980_wdt_ping(struct watchdog_device *wdd)
{
	writel(WDT_RSTCNT_KEY, to_nuc980_wdt(wdd)->base + WDT_RSTCNT);
	return 0;
}

static int nuc980_wdt_start(struct watchdog_device *wdd)
{
	struct nuc980_wdt *wdt = to_nuc980_wdt(wdd);
	unsigned int toutsel = nuc980_wdt_toutsel(wdt, wdd->timeout);

	nuc980_protected_write(wdt->base + WDT_CTL,
			       FIELD_PREP(WDT_CTL_TOUTSEL, toutsel) |
			       WDT_CTL_WDTEN | WDT_CTL_RSTEN);
	return nuc980_wdt_ping(wdd);
}

static int nuc980_wdt_stop(struct watchdog_device *wdd)
{
	nuc980_protected_write(to_nuc980_wdt(wdd)->base + WDT_CTL, 0);
	return 0;
}

/*
 * Up to the longest interval, the time-out becomes what the interval is; above
 * it the core feeds the hardware, and every time-out is exact.
 */
static int nuc980_wdt_set_timeout(struct watchdog_device *wdd,
				  unsigned int timeout)
{
	struct nuc980_wdt *wdt = to_nuc980_wdt(wdd);
	unsigned int toutsel = nuc980_wdt_toutsel(wdt, timeout);
	unsigned int interval = nuc980_wdt_interval_ms(wdt, toutsel);

	wdd->timeout = max_t(unsigned int, timeout, interval / MSEC_PER_SEC);
	/* Running on from a boot loader, or since it was opened. */
	if (watchdog_hw_running(wdd) || watchdog_active(wdd))
		return nuc980_wdt_start(wdd);
	return 0;
}

static const struct watchdog_info nuc980_wdt_info = {
	.identity = "NUC980 watchdog",
	.options = WDIOF_SETTIMEOUT | WDIOF_KEEPALIVEPING | WDIOF_MAGICCLOSE |
		   WDIOF_CARDRESET,
};

static const struct watchdog_ops nuc980_wdt_ops = {
	.owner = THIS_MODULE,
	.start = nuc980_wdt_start,
	.stop = nuc980_wdt_stop,
	.ping = nuc980_wdt_ping,
	.set_timeout = nuc980_wdt_set_timeout,
};

/*
 * The flag is the watchdog's own, and cleared: it shall not speak of this
 * reset after the next one. SYS_RSTSTS, which says the same, is left alone.
 */
static void nuc980_wdt_read_bootstatus(struct nuc980_wdt *wdt)
{
	u32 ctl = readl(wdt->base + WDT_CTL);

	if (!(ctl & WDT_CTL_RSTF))
		return;
	wdt->wdd.bootstatus = WDIOF_CARDRESET;
	nuc980_protected_write(wdt->base + WDT_CTL, ctl);
}

static void nuc980_wdt_take_over(struct nuc980_wdt *wdt)
{
	if (!(readl(wdt->base + WDT_CTL) & WDT_CTL_WDTEN))
		return;
	nuc980_wdt_start(&wdt->wdd);
	set_bit(WDOG_HW_RUNNING, &wdt->wdd.status);
}

static int nuc980_wdt_init_clock(struct nuc980_wdt *wdt, struct device *dev)
{
	struct clk *clk = devm_clk_get_enabled(dev, NULL);
	int ret;

	if (IS_ERR(clk))
		return dev_err_probe(dev, PTR_ERR(clk), "no clock\n");
	ret = clk_set_rate(clk, WDT_CLOCK_HZ);
	if (ret)
		return dev_err_probe(dev, ret, "clock cannot be set\n");
	wdt->rate = clk_get_rate(clk);
	return 0;
}

static int nuc980_wdt_probe(struct platform_device *pdev)
{
	struct device *dev = &pdev->dev;
	struct watchdog_device *wdd;
	struct nuc980_wdt *wdt;
	int ret;

	wdt = devm_kzalloc(dev, sizeof(*wdt), GFP_KERNEL);
	if (!wdt)
		return -ENOMEM;

	wdt->base = devm_platform_ioremap_resource(pdev, 0);
	if (IS_ERR(wdt->base))
		return PTR_ERR(wdt->base);

	ret = nuc980_wdt_init_clock(wdt, dev);
	if (ret)
		return ret;

	wdd = &wdt->wdd;
	wdd->info = &nuc980_wdt_info;
	wdd->ops = &nuc980_wdt_ops;
	wdd->parent = dev;
	wdd->min_timeout = 1;
	wdd->max_hw_heartbeat_ms =
		nuc980_wdt_interval_ms(wdt, WDT_TOUTSEL_LONGEST);
	wdd->timeout = WDT_DEFAULT_TIMEOUT;
	watchdog_init_timeout(wdd, heartbeat, dev);
	nuc980_wdt_set_timeout(wdd, wdd->timeout);
	watchdog_set_nowayout(wdd, nowayout);
	watchdog_stop_on_unregister(wdd);

	nuc980_wdt_read_bootstatus(wdt);
	nuc980_wdt_take_over(wdt);

	return devm_watchdog_register_device(dev, wdd);
}

static const struct of_device_id nuc980_wdt_of_match[] = {
	{ .compatible = "nuvoton,nuc980-wdt" },
	{ }
};
MODULE_DEVICE_TABLE(of, nuc980_wdt_of_match);

static struct platform_driver nuc980_wdt_driver = {
	.probe = nuc980_wdt_probe,
	.driver = {
		.name = "nuc980-wdt",
		.of_match_table = nuc980_wdt_of_match,
	},
};
module_platform_driver(nuc980_wdt_driver);

MODULE_AUTHOR("The OpenRTU authors <openrtu@localhost>");
MODULE_DESCRIPTION("Nuvoton NUC980 watchdog timer");
MODULE_LICENSE("GPL");
