// SPDX-License-Identifier: GPL-2.0-or-later
/*
 * Nuvoton NUC980 UART, polled
 */

#include <common.h>
#include <dm.h>
#include <serial.h>
#include <asm/io.h>
#include <linux/bitops.h>
#include <linux/kernel.h>

#define UART_DAT	0x00
#define UART_IER	0x04
#define UART_FCR	0x08
#define UART_LCR	0x0c
#define UART_FSR	0x18
#define UART_BAUD	0x24
#define UART_FUNSEL	0x30

#define UART_FCR_RFR		BIT(1)	/* reset the receive FIFO */
#define UART_FCR_TFR		BIT(2)	/* and the transmit FIFO */
#define UART_LCR_8N1		0x3
#define UART_FSR_RX_EMPTY	BIT(14)
#define UART_FSR_TX_FULL	BIT(23)
#define UART_FSR_TE		BIT(28)	/* FIFO and shift register empty */
#define UART_BAUD_MODE2		GENMASK(29, 28)	/* clock / (divider + 2) */
#define UART_FUNSEL_UART	0

struct nuc980_uart {
	void __iomem *base;
	u32 clock;
};

static int nuc980_uart_setbrg(struct udevice *dev, int baudrate)
{
	struct nuc980_uart *priv = dev_get_priv(dev);

	writel(UART_BAUD_MODE2 | (DIV_ROUND_CLOSEST(priv->clock, baudrate) - 2),
	       priv->base + UART_BAUD);

	return 0;
}

static int nuc980_uart_getc(struct udevice *dev)
{
	struct nuc980_uart *priv = dev_get_priv(dev);

	if (readl(priv->base + UART_FSR) & UART_FSR_RX_EMPTY)
		return -EAGAIN;

	return readl(priv->base + UART_DAT) & 0xff;
}

static int nuc980_uart_putc(struct udevice *dev, const char ch)
{
	struct nuc980_uart *priv = dev_get_priv(dev);

	if (readl(priv->base + UART_FSR) & UART_FSR_TX_FULL)
		return -EAGAIN;

	writel(ch, priv->base + UART_DAT);

	return 0;
}

static int nuc980_uart_pending(struct udevice *dev, bool input)
{
	struct nuc980_uart *priv = dev_get_priv(dev);
	u32 none = input ? UART_FSR_RX_EMPTY : UART_FSR_TE;

	return !(readl(priv->base + UART_FSR) & none);
}

static int nuc980_uart_probe(struct udevice *dev)
{
	struct nuc980_uart *priv = dev_get_priv(dev);

	priv->base = dev_read_addr_ptr(dev);
	priv->clock = dev_read_u32_default(dev, "clock-frequency", 0);
	if (!priv->base || !priv->clock)
		return -EINVAL;

	writel(0, priv->base + UART_IER);
	writel(UART_FUNSEL_UART, priv->base + UART_FUNSEL);
	writel(UART_FCR_RFR | UART_FCR_TFR, priv->base + UART_FCR);
	writel(UART_LCR_8N1, priv->base + UART_LCR);

	return 0;
}

static const struct dm_serial_ops nuc980_uart_ops = {
	.putc = nuc980_uart_putc,
	.pending = nuc980_uart_pending,
	.getc = nuc980_uart_getc,
	.setbrg = nuc980_uart_setbrg,
};

static const struct udevice_id nuc980_uart_ids[] = {
	{ .compatible = "nuvoton,nuc980-uart" },
	{ }
};

U_BOOT_DRIVER(nuc980_uart) = {
	.name = "nuc980_uart",
	.id = UCLASS_SERIAL,
	.of_match = nuc980_uart_ids,
	.priv_auto = sizeof(struct nuc980_uart),
	.probe = nuc980_uart_probe,
	.ops = &nuc980_uart_ops,
};
