// SPDX-License-Identifier: GPL-2.0-or-later
/*
 * Nuvoton NUC980 Ethernet MAC, two of them, each with an MDIO bus of its own
 */

#include <common.h>
#include <dm.h>
#include <dm/device-internal.h>
#include <malloc.h>
#include <miiphy.h>
#include <net.h>
#include <phy.h>
#include <asm/cache.h>
#include <asm/io.h>
#include <linux/bitops.h>
#include <linux/delay.h>
#include <linux/dma-mapping.h>
#include <linux/iopoll.h>

#define EMAC_CAMCMR	0x00
#define EMAC_CAMEN	0x04
#define EMAC_CAM0M	0x08
#define EMAC_CAM0L	0x0c
#define EMAC_TXDLSA	0x88
#define EMAC_RXDLSA	0x8c
#define EMAC_MCMDR	0x90
#define EMAC_MIID	0x94
#define EMAC_MIIDA	0x98
#define EMAC_TSDR	0xa0
#define EMAC_RSDR	0xa4
#define EMAC_DMARFC	0xa8
#define EMAC_MIEN	0xac

#define EMAC_CAMCMR_ABP		BIT(2)	/* accept broadcasts */
#define EMAC_CAMCMR_ECMP	BIT(4)	/* compare with the CAM's addresses */
#define EMAC_CAMEN_0		BIT(0)
#define EMAC_MCMDR_RXON		BIT(0)
#define EMAC_MCMDR_SPCRC	BIT(5)	/* strip the CRC */
#define EMAC_MCMDR_TXON		BIT(8)
#define EMAC_MCMDR_FDUP		BIT(18)
#define EMAC_MCMDR_OPMOD	BIT(20)	/* 100 Mbit/s */
#define EMAC_MCMDR_SWR		BIT(24)
#define EMAC_MIIDA_WRITE	BIT(16)
#define EMAC_MIIDA_BUSY		BIT(17)
#define EMAC_MIIDA_MDCON	BIT(19)

#define EMAC_OWNER_DMA		BIT(31)
#define EMAC_RX_GOOD		BIT(20)
#define EMAC_RX_LENGTH		GENMASK(15, 0)
#define EMAC_TX_PAD		BIT(0)
#define EMAC_TX_CRC		BIT(1)

/* One would do, but the DMA may look at the next one before it is done. */
#define TX_DESCRIPTORS		2

/* For the MDIO bus, and for a reset */
#define TIMEOUT_US		10000

/*
 * The DMA follows the links from one descriptor to the next: each may have a
 * cache line of its own.
 */
struct emac_descriptor {
	u32 control;	/* receive: owner, status, length; transmit: owner, what to do */
	u32 buffer;
	u32 length;	/* transmit only: status, length */
	u32 next;
} __aligned(ARCH_DMA_MINALIGN);

struct nuc980_emac {
	struct emac_descriptor rx[PKTBUFSRX];
	struct emac_descriptor tx[TX_DESCRIPTORS];
	int rx_next;
	int tx_next;
	void __iomem *base;
	struct mii_dev *bus;
	struct phy_device *phy;
};

static void to_device(struct emac_descriptor *descriptor)
{
	dma_map_single(descriptor, sizeof(*descriptor), DMA_TO_DEVICE);
}

static void from_device(struct emac_descriptor *descriptor)
{
	dma_unmap_single((dma_addr_t)descriptor, sizeof(*descriptor),
			 DMA_FROM_DEVICE);
}

static int emac_mdio(struct mii_dev *bus, int addr, int reg, u32 command)
{
	struct nuc980_emac *priv = bus->priv;
	u32 value;

	writel(addr << 8 | reg | command | EMAC_MIIDA_BUSY | EMAC_MIIDA_MDCON,
	       priv->base + EMAC_MIIDA);

	return readl_poll_timeout(priv->base + EMAC_MIIDA, value,
				  !(value & EMAC_MIIDA_BUSY), TIMEOUT_US);
}

static int emac_mdio_read(struct mii_dev *bus, int addr, int devad, int reg)
{
	struct nuc980_emac *priv = bus->priv;
	int ret = emac_mdio(bus, addr, reg, 0);

	return ret ? ret : readl(priv->base + EMAC_MIID) & 0xffff;
}

static int emac_mdio_write(struct mii_dev *bus, int addr, int devad, int reg,
			   u16 value)
{
	struct nuc980_emac *priv = bus->priv;

	writel(value, priv->base + EMAC_MIID);

	return emac_mdio(bus, addr, reg, EMAC_MIIDA_WRITE);
}

static void emac_init_rx(struct nuc980_emac *priv)
{
	int i;

	for (i = 0; i < PKTBUFSRX; i++) {
		priv->rx[i].buffer = dma_map_single(net_rx_packets[i],
						    PKTSIZE_ALIGN,
						    DMA_FROM_DEVICE);
		priv->rx[i].next = (u32)&priv->rx[(i + 1) % PKTBUFSRX];
		priv->rx[i].control = EMAC_OWNER_DMA;
		to_device(&priv->rx[i]);
	}

	priv->rx_next = 0;
	writel((u32)priv->rx, priv->base + EMAC_RXDLSA);
}

static void emac_init_tx(struct nuc980_emac *priv)
{
	int i;

	for (i = 0; i < TX_DESCRIPTORS; i++) {
		priv->tx[i].next = (u32)&priv->tx[(i + 1) % TX_DESCRIPTORS];
		priv->tx[i].control = 0;
		to_device(&priv->tx[i]);
	}

	priv->tx_next = 0;
	writel((u32)priv->tx, priv->base + EMAC_TXDLSA);
}

static int emac_write_hwaddr(struct udevice *dev)
{
	struct nuc980_emac *priv = dev_get_priv(dev);
	u8 *mac = ((struct eth_pdata *)dev_get_plat(dev))->enetaddr;

	writel(mac[0] << 24 | mac[1] << 16 | mac[2] << 8 | mac[3],
	       priv->base + EMAC_CAM0M);
	writel(mac[4] << 24 | mac[5] << 16, priv->base + EMAC_CAM0L);
	writel(EMAC_CAMEN_0, priv->base + EMAC_CAMEN);

	return 0;
}

static int emac_start(struct udevice *dev)
{
	struct nuc980_emac *priv = dev_get_priv(dev);
	u32 mode = EMAC_MCMDR_SPCRC | EMAC_MCMDR_RXON | EMAC_MCMDR_TXON;
	u32 value;
	int ret;

	ret = phy_startup(priv->phy);
	if (ret)
		return ret;
	if (!priv->phy->link) {
		printf("%s: no link\n", dev->name);
		return -ENOLINK;
	}
	if (priv->phy->speed == SPEED_100)
		mode |= EMAC_MCMDR_OPMOD;
	if (priv->phy->duplex == DUPLEX_FULL)
		mode |= EMAC_MCMDR_FDUP;

	writel(EMAC_MCMDR_SWR, priv->base + EMAC_MCMDR);
	ret = readl_poll_timeout(priv->base + EMAC_MCMDR, value,
				 !(value & EMAC_MCMDR_SWR), TIMEOUT_US);
	if (ret)
		return ret;

	/* The reset forgets the address and all else. */
	emac_write_hwaddr(dev);
	writel(EMAC_CAMCMR_ECMP | EMAC_CAMCMR_ABP, priv->base + EMAC_CAMCMR);
	writel(PKTSIZE_ALIGN, priv->base + EMAC_DMARFC);
	writel(0, priv->base + EMAC_MIEN);
	emac_init_rx(priv);
	emac_init_tx(priv);

	writel(mode, priv->base + EMAC_MCMDR);
	writel(0, priv->base + EMAC_RSDR);

	return 0;
}

static void emac_stop(struct udevice *dev)
{
	struct nuc980_emac *priv = dev_get_priv(dev);

	clrbits_le32(priv->base + EMAC_MCMDR,
		     EMAC_MCMDR_RXON | EMAC_MCMDR_TXON);
	phy_shutdown(priv->phy);
}

static int emac_send(struct udevice *dev, void *packet, int length)
{
	struct nuc980_emac *priv = dev_get_priv(dev);
	struct emac_descriptor *tx = &priv->tx[priv->tx_next];
	ulong start;
	bool late;

	tx->buffer = dma_map_single(packet, length, DMA_TO_DEVICE);
	tx->length = length;
	tx->control = EMAC_OWNER_DMA | EMAC_TX_CRC | EMAC_TX_PAD;
	to_device(tx);
	writel(0, priv->base + EMAC_TSDR);
	priv->tx_next = (priv->tx_next + 1) % TX_DESCRIPTORS;

	/* The look comes last: what was done in time is never called late. */
	start = get_timer(0);
	do {
		late = get_timer(start) >= 100;
		from_device(tx);
		if (!(READ_ONCE(tx->control) & EMAC_OWNER_DMA))
			return 0;
	} while (!late);

	return -ETIMEDOUT;
}

static int emac_recv(struct udevice *dev, int flags, uchar **packet)
{
	struct nuc980_emac *priv = dev_get_priv(dev);
	struct emac_descriptor *rx = &priv->rx[priv->rx_next];
	u32 control;

	from_device(rx);
	control = READ_ONCE(rx->control);
	if (control & EMAC_OWNER_DMA)
		return -EAGAIN;
	if (!(control & EMAC_RX_GOOD))
		return 0;

	dma_unmap_single(rx->buffer, PKTSIZE_ALIGN, DMA_FROM_DEVICE);
	*packet = (uchar *)rx->buffer;

	return control & EMAC_RX_LENGTH;
}

static int emac_free_pkt(struct udevice *dev, uchar *packet, int length)
{
	struct nuc980_emac *priv = dev_get_priv(dev);
	struct emac_descriptor *rx = &priv->rx[priv->rx_next];

	dma_map_single((void *)rx->buffer, PKTSIZE_ALIGN, DMA_FROM_DEVICE);
	rx->control = EMAC_OWNER_DMA;
	to_device(rx);
	priv->rx_next = (priv->rx_next + 1) % PKTBUFSRX;

	/* It stops when it meets a descriptor that is not its own. */
	writel(0, priv->base + EMAC_RSDR);

	return 0;
}

/* "emac0" for emac0@b0012000: one types it, and the factory's is "emac" */
static int emac_bind(struct udevice *dev)
{
	char name[8];

	strlcpy(name, dev->name, min((size_t)(strchrnul(dev->name, '@') -
					      dev->name + 1), sizeof(name)));

	return device_set_name(dev, name);
}

static int emac_of_to_plat(struct udevice *dev)
{
	struct eth_pdata *plat = dev_get_plat(dev);

	plat->iobase = dev_read_addr(dev);

	return plat->iobase == FDT_ADDR_T_NONE ? -EINVAL : 0;
}

static int emac_remove(struct udevice *dev)
{
	struct nuc980_emac *priv = dev_get_priv(dev);

	free(priv->phy);
	mdio_unregister(priv->bus);
	mdio_free(priv->bus);

	return 0;
}

static int emac_probe(struct udevice *dev)
{
	struct nuc980_emac *priv = dev_get_priv(dev);
	struct eth_pdata *plat = dev_get_plat(dev);
	int ret;

	priv->base = (void __iomem *)plat->iobase;
	priv->bus = mdio_alloc();
	if (!priv->bus)
		return -ENOMEM;

	priv->bus->read = emac_mdio_read;
	priv->bus->write = emac_mdio_write;
	priv->bus->priv = priv;
	strlcpy(priv->bus->name, dev->name, MDIO_NAME_LEN);
	ret = mdio_register(priv->bus);
	if (ret) {
		mdio_free(priv->bus);
		return ret;
	}

	/* The first address that answers: the board's are known to nobody. */
	priv->phy = phy_connect(priv->bus, -1, dev, PHY_INTERFACE_MODE_RMII);
	if (!priv->phy) {
		emac_remove(dev);
		return -ENODEV;
	}
	priv->phy->supported &= PHY_BASIC_FEATURES;
	priv->phy->advertising = priv->phy->supported;

	return phy_config(priv->phy);
}

static const struct eth_ops emac_ops = {
	.start = emac_start,
	.send = emac_send,
	.recv = emac_recv,
	.free_pkt = emac_free_pkt,
	.stop = emac_stop,
	.write_hwaddr = emac_write_hwaddr,
};

static const struct udevice_id emac_ids[] = {
	{ .compatible = "nuvoton,nuc980-emac0" },
	{ .compatible = "nuvoton,nuc980-emac1" },
	{ }
};

U_BOOT_DRIVER(nuc980_emac) = {
	.name = "nuc980_emac",
	.id = UCLASS_ETH,
	.of_match = emac_ids,
	.bind = emac_bind,
	.of_to_plat = emac_of_to_plat,
	.probe = emac_probe,
	.remove = emac_remove,
	.ops = &emac_ops,
	.priv_auto = sizeof(struct nuc980_emac),
	.plat_auto = sizeof(struct eth_pdata),
	.flags = DM_FLAG_ALLOC_PRIV_DMA | DM_FLAG_ACTIVE_DMA,
};
