// SPDX-License-Identifier: GPL-2.0-only
/*
 * Nuvoton NUC980 real-time clock
 *
 * Most registers are writable only for 1024 periods of the 32 kHz crystal
 * after a key, and a write takes some of them. On a board without that crystal
 * none of this ever ends, so every wait is bounded.
 */

#include <linux/bcd.h>
#include <linux/bitfield.h>
#include <linux/clk.h>
#include <linux/interrupt.h>
#include <linux/io.h>
#include <linux/iopoll.h>
#include <linux/module.h>
#include <linux/of.h>
#include <linux/platform_device.h>
#include <linux/rtc.h>

#define RTC_INIT		0x00
#define RTC_INIT_ACTIVE		BIT(0)
#define RTC_INIT_KEY		0xa5eb1357
#define RTC_RWEN		0x04
#define RTC_RWEN_OPEN		BIT(16)
#define RTC_RWEN_KEY		0xa965
#define RTC_TIME		0x0c
#define RTC_CAL			0x10
#define RTC_TIMEFMT		0x14
#define RTC_TIMEFMT_24H		BIT(0)
#define RTC_WEEKDAY		0x18
#define RTC_TALM		0x1c
#define RTC_CALM		0x20
#define RTC_CALM_ANY_WEEKDAY	BIT(31)
#define RTC_INTEN		0x28
#define RTC_INTSTS		0x2c
#define RTC_INTSTS_BUSY		BIT(31)
#define RTC_INT_ALARM		BIT(0)		/* of INTEN and INTSTS */
#define RTC_PWRCTL		0x34
#define RTC_PWRCTL_ALARM	BIT(3)

/* BCD; of the time: hours, minutes, seconds; of the date: year, month, day */
#define RTC_HIGH		GENMASK(21, 16)
#define RTC_YEAR		GENMASK(23, 16)
#define RTC_MIDDLE		GENMASK(14, 8)
#define RTC_LOW			GENMASK(6, 0)

#define RTC_POLL_US		10
#define RTC_TIMEOUT_US		10000
#define RTC_TRIES		10

struct nuc980_rtc {
	struct rtc_device *rtc;
	void __iomem *base;
};

static u32 nuc980_rtc_pack_time(const struct rtc_time *tm)
{
	return FIELD_PREP(RTC_HIGH, bin2bcd(tm->tm_hour)) |
	       FIELD_PREP(RTC_MIDDLE, bin2bcd(tm->tm_min)) |
	       FIELD_PREP(RTC_LOW, bin2bcd(tm->tm_sec));
}

static u32 nuc980_rtc_pack_date(const struct rtc_time *tm)
{
	return FIELD_PREP(RTC_YEAR, bin2bcd(tm->tm_year - 100)) |
	       FIELD_PREP(RTC_MIDDLE, bin2bcd(tm->tm_mon + 1)) |
	       FIELD_PREP(RTC_LOW, bin2bcd(tm->tm_mday));
}

static void nuc980_rtc_unpack(u32 date, u32 time, struct rtc_time *tm)
{
	tm->tm_year = bcd2bin(FIELD_GET(RTC_YEAR, date)) + 100;
	tm->tm_mon = bcd2bin(FIELD_GET(RTC_MIDDLE, date)) - 1;
	tm->tm_mday = bcd2bin(FIELD_GET(RTC_LOW, date));
	tm->tm_hour = bcd2bin(FIELD_GET(RTC_HIGH, time));
	tm->tm_min = bcd2bin(FIELD_GET(RTC_MIDDLE, time));
	tm->tm_sec = bcd2bin(FIELD_GET(RTC_LOW, time));
}

/* Without sleep: on a busy system six of them can take longer than a key. */
static int nuc980_rtc_write(struct nuc980_rtc *nuc980, u32 reg, u32 value)
{
	u32 status;

	writel(value, nuc980->base + reg);
	return readl_poll_timeout_atomic(nuc980->base + RTC_INTSTS, status,
					 !(status & RTC_INTSTS_BUSY),
					 RTC_POLL_US, RTC_TIMEOUT_US);
}

static bool nuc980_rtc_is_open(struct nuc980_rtc *nuc980)
{
	return readl(nuc980->base + RTC_RWEN) & RTC_RWEN_OPEN;
}

static int nuc980_rtc_open(struct nuc980_rtc *nuc980)
{
	u32 rwen;
	int ret;

	ret = nuc980_rtc_write(nuc980, RTC_RWEN, RTC_RWEN_KEY);
	if (ret)
		return ret;
	return readl_poll_timeout_atomic(nuc980->base + RTC_RWEN, rwen,
					 rwen & RTC_RWEN_OPEN, RTC_POLL_US,
					 RTC_TIMEOUT_US);
}

struct nuc980_rtc_setting {
	u32 reg;
	u32 value;
};

static int nuc980_rtc_try(struct nuc980_rtc *nuc980,
			  const struct nuc980_rtc_setting *settings,
			  unsigned int count)
{
	unsigned int i;
	int ret;

	ret = nuc980_rtc_open(nuc980);
	for (i = 0; i < count && !ret; i++)
		ret = nuc980_rtc_write(nuc980, settings[i].reg,
				       settings[i].value);
	if (!ret && !nuc980_rtc_is_open(nuc980))
		ret = -EIO;
	return ret;
}

/*
 * Whoever is preempted for 31 ms finds the registers closed, before the first
 * write even, and the writes lost: only a set that ends while they are open
 * still is known to be there.
 */
static int nuc980_rtc_set(struct nuc980_rtc *nuc980,
			  const struct nuc980_rtc_setting *settings,
			  unsigned int count)
{
	unsigned int tries = RTC_TRIES;
	int ret;

	do {
		ret = nuc980_rtc_try(nuc980, settings, count);
	} while (ret && --tries);
	return ret;
}

/* Not active: it has been without power, and nobody has set it since. */
static bool nuc980_rtc_is_set(struct nuc980_rtc *nuc980)
{
	return readl(nuc980->base + RTC_INIT) & RTC_INIT_ACTIVE &&
	       readl(nuc980->base + RTC_TIMEFMT) & RTC_TIMEFMT_24H;
}

static int nuc980_rtc_activate(struct nuc980_rtc *nuc980)
{
	u32 init;

	writel(RTC_INIT_KEY, nuc980->base + RTC_INIT);
	return readl_poll_timeout(nuc980->base + RTC_INIT, init,
				  init & RTC_INIT_ACTIVE, RTC_POLL_US,
				  RTC_TIMEOUT_US);
}

static int nuc980_rtc_read_time(struct device *dev, struct rtc_time *tm)
{
	struct nuc980_rtc *nuc980 = dev_get_drvdata(dev);
	u32 date, time;

	if (!nuc980_rtc_is_set(nuc980))
		return -EINVAL;
	do {
		date = readl(nuc980->base + RTC_CAL);
		time = readl(nuc980->base + RTC_TIME);
	} while (date != readl(nuc980->base + RTC_CAL));
	nuc980_rtc_unpack(date, time, tm);
	tm->tm_wday = readl(nuc980->base + RTC_WEEKDAY);
	return rtc_valid_tm(tm);
}

static int nuc980_rtc_set_time(struct device *dev, struct rtc_time *tm)
{
	struct nuc980_rtc *nuc980 = dev_get_drvdata(dev);
	/* From midnight on: the date does not change while it is written. */
	const struct nuc980_rtc_setting settings[] = {
		{ RTC_TIMEFMT, RTC_TIMEFMT_24H },
		{ RTC_TIME, 0 },
		{ RTC_CAL, nuc980_rtc_pack_date(tm) },
		{ RTC_WEEKDAY, tm->tm_wday },
		{ RTC_TIME, nuc980_rtc_pack_time(tm) },
	};
	int ret;

	ret = nuc980_rtc_activate(nuc980);
	if (ret)
		return ret;
	return nuc980_rtc_set(nuc980, settings, ARRAY_SIZE(settings));
}

static int nuc980_rtc_alarm_irq_enable(struct device *dev, unsigned int enabled)
{
	struct nuc980_rtc *nuc980 = dev_get_drvdata(dev);

	return nuc980_rtc_write(nuc980, RTC_INTEN,
				enabled ? RTC_INT_ALARM : 0);
}

static int nuc980_rtc_read_alarm(struct device *dev, struct rtc_wkalrm *alarm)
{
	struct nuc980_rtc *nuc980 = dev_get_drvdata(dev);

	nuc980_rtc_unpack(readl(nuc980->base + RTC_CALM),
			  readl(nuc980->base + RTC_TALM), &alarm->time);
	alarm->enabled = readl(nuc980->base + RTC_INTEN) & RTC_INT_ALARM;
	alarm->pending = readl(nuc980->base + RTC_INTSTS) & RTC_INT_ALARM;
	return 0;
}

static int nuc980_rtc_set_alarm(struct device *dev, struct rtc_wkalrm *alarm)
{
	struct nuc980_rtc *nuc980 = dev_get_drvdata(dev);
	const struct nuc980_rtc_setting settings[] = {
		{ RTC_CALM, nuc980_rtc_pack_date(&alarm->time) |
			    RTC_CALM_ANY_WEEKDAY },
		{ RTC_TALM, nuc980_rtc_pack_time(&alarm->time) },
		{ RTC_PWRCTL, readl(nuc980->base + RTC_PWRCTL) |
			      RTC_PWRCTL_ALARM },
	};
	int ret;

	ret = nuc980_rtc_alarm_irq_enable(dev, 0);
	if (ret)
		return ret;
	ret = nuc980_rtc_set(nuc980, settings, ARRAY_SIZE(settings));
	if (ret)
		return ret;
	ret = nuc980_rtc_write(nuc980, RTC_INTSTS, RTC_INT_ALARM);
	if (ret)
		return ret;
	return nuc980_rtc_alarm_irq_enable(dev, alarm->enabled);
}

static const struct rtc_class_ops nuc980_rtc_ops = {
	.read_time = nuc980_rtc_read_time,
	.set_time = nuc980_rtc_set_time,
	.read_alarm = nuc980_rtc_read_alarm,
	.set_alarm = nuc980_rtc_set_alarm,
	.alarm_irq_enable = nuc980_rtc_alarm_irq_enable,
};

static irqreturn_t nuc980_rtc_interrupt(int irq, void *data)
{
	struct nuc980_rtc *nuc980 = data;
	bool alarm;

	rtc_lock(nuc980->rtc);
	alarm = readl(nuc980->base + RTC_INTSTS) & RTC_INT_ALARM;
	if (alarm)
		nuc980_rtc_write(nuc980, RTC_INTSTS, RTC_INT_ALARM);
	rtc_unlock(nuc980->rtc);
	if (!alarm)
		return IRQ_NONE;
	rtc_update_irq(nuc980->rtc, 1, RTC_AF | RTC_IRQF);
	return IRQ_HANDLED;
}

static int nuc980_rtc_probe(struct platform_device *pdev)
{
	struct device *dev = &pdev->dev;
	struct nuc980_rtc *nuc980;
	struct clk *clk;
	int irq, ret;

	nuc980 = devm_kzalloc(dev, sizeof(*nuc980), GFP_KERNEL);
	if (!nuc980)
		return -ENOMEM;
	platform_set_drvdata(pdev, nuc980);

	nuc980->base = devm_platform_ioremap_resource(pdev, 0);
	if (IS_ERR(nuc980->base))
		return PTR_ERR(nuc980->base);

	irq = platform_get_irq(pdev, 0);
	if (irq < 0)
		return irq;

	clk = devm_clk_get_enabled(dev, NULL);
	if (IS_ERR(clk))
		return dev_err_probe(dev, PTR_ERR(clk), "no clock\n");

	nuc980->rtc = devm_rtc_allocate_device(dev);
	if (IS_ERR(nuc980->rtc))
		return PTR_ERR(nuc980->rtc);
	nuc980->rtc->ops = &nuc980_rtc_ops;
	nuc980->rtc->range_min = RTC_TIMESTAMP_BEGIN_2000;
	nuc980->rtc->range_max = RTC_TIMESTAMP_END_2099;

	ret = devm_request_threaded_irq(dev, irq, NULL, nuc980_rtc_interrupt,
					IRQF_ONESHOT, dev_name(dev), nuc980);
	if (ret)
		return ret;

	return devm_rtc_register_device(nuc980->rtc);
}

static const struct of_device_id nuc980_rtc_of_match[] = {
	{ .compatible = "nuvoton,nuc980-rtc" },
	{ }
};
MODULE_DEVICE_TABLE(of, nuc980_rtc_of_match);

static struct platform_driver nuc980_rtc_driver = {
	.probe = nuc980_rtc_probe,
	.driver = {
		.name = "nuc980-rtc",
		.of_match_table = nuc980_rtc_of_match,
	},
};
module_platform_driver(nuc980_rtc_driver);

MODULE_AUTHOR("The OpenRTU authors <openrtu@localhost>");
MODULE_DESCRIPTION("Nuvoton NUC980 real-time clock");
MODULE_LICENSE("GPL");
