// SPDX-License-Identifier: GPL-2.0-only
/*
 * Nuvoton NUC980 Ethernet MAC
 *
 * The chip has two. Each has an MDIO bus of its own; its PHY is the first one
 * that answers there. Two things are done for the sake of the serial lines,
 * whose FIFOs overrun within 1.4 ms at 115200 baud on this one core:
 *
 * - The interrupt handler only masks the MAC's interrupts and starts NAPI,
 *   which polls in a thread of its own, an ordinary one. However much comes
 *   in, the interrupts' threads and real-time processes go first.
 * - NAPI gets by with a small budget, as whoever waits for the bottom halves
 *   on PREEMPT_RT waits for the end of a poll.
 */

#include <linux/bitfield.h>
#include <linux/clk.h>
#include <linux/devm-helpers.h>
#include <linux/dma-mapping.h>
#include <linux/etherdevice.h>
#include <linux/ethtool.h>
#include <linux/if_vlan.h>
#include <linux/interrupt.h>
#include <linux/io.h>
#include <linux/iopoll.h>
#include <linux/module.h>
#include <linux/mutex.h>
#include <linux/net_tstamp.h>
#include <linux/netdevice.h>
#include <linux/of_net.h>
#include <linux/phy.h>
#include <linux/platform_device.h>
#include <linux/rtnetlink.h>
#include <linux/skbuff.h>
#include <linux/workqueue.h>
#include <asm/unaligned.h>

#define EMAC_CAMCMR		0x00
#define EMAC_CAMCMR_AUP		BIT(0)	/* accept all unicasts */
#define EMAC_CAMCMR_AMP		BIT(1)	/* accept all multicasts */
#define EMAC_CAMCMR_ABP		BIT(2)	/* accept broadcasts */
#define EMAC_CAMCMR_ECMP	BIT(4)	/* accept the CAM's addresses */
#define EMAC_CAMEN		0x04
#define EMAC_CAM_HIGH(n)	(0x08 + 8 * (n))
#define EMAC_CAM_LOW(n)		(0x0c + 8 * (n))
#define EMAC_TXDLSA		0x88
#define EMAC_RXDLSA		0x8c
#define EMAC_MCMDR		0x90
#define EMAC_MCMDR_RXON		BIT(0)
#define EMAC_MCMDR_ALP		BIT(1)	/* accept more than 1518 bytes */
#define EMAC_MCMDR_SPCRC	BIT(5)	/* strip the CRC */
#define EMAC_MCMDR_TXON		BIT(8)
#define EMAC_MCMDR_FDUP		BIT(18)
#define EMAC_MCMDR_OPMOD	BIT(20)	/* 100 Mbit/s */
#define EMAC_MCMDR_SWR		BIT(24)
#define EMAC_MIID		0x94
#define EMAC_MIIDA		0x98
#define EMAC_MIIDA_REG		GENMASK(4, 0)
#define EMAC_MIIDA_PHY		GENMASK(12, 8)
#define EMAC_MIIDA_WRITE	BIT(16)
#define EMAC_MIIDA_BUSY		BIT(17)
#define EMAC_MIIDA_MDCON	BIT(19)
#define EMAC_TSDR		0xa0
#define EMAC_RSDR		0xa4
#define EMAC_DMARFC		0xa8
#define EMAC_MIEN		0xac
#define EMAC_MISTA		0xb0
#define EMAC_RXINTR		BIT(0)
#define EMAC_RXGD		BIT(4)
#define EMAC_RDU		BIT(10)	/* out of receive descriptors */
#define EMAC_RXBERR		BIT(11)	/* bus error */
#define EMAC_TXINTR		BIT(16)
#define EMAC_TXCP		BIT(18)
#define EMAC_EXDEF		BIT(19)	/* deferred for too long */
#define EMAC_TXABT		BIT(21)	/* too many collisions */
#define EMAC_TXBERR		BIT(24)	/* bus error */
#define EMAC_MPCNT		0xb8	/* frames missed since last read */

#define EMAC_BUS_ERRORS		(EMAC_RXBERR | EMAC_TXBERR)
#define EMAC_INTERRUPTS		(EMAC_RXINTR | EMAC_RXGD | EMAC_RDU |	\
				 EMAC_TXINTR | EMAC_TXCP | EMAC_EXDEF |	\
				 EMAC_TXABT | EMAC_BUS_ERRORS)

/* Entries 13 to 15 of the CAM are for pause frames to be sent. */
#define EMAC_CAM_ADDRESSES	13

/* In a descriptor's first word */
#define EMAC_OWNER_DMA		BIT(31)
#define EMAC_RX_LENGTH		GENMASK(15, 0)
#define EMAC_RX_CRC_ERROR	BIT(17)
#define EMAC_RX_LONG		BIT(19)
#define EMAC_RX_GOOD		BIT(20)
#define EMAC_RX_ALIGN_ERROR	BIT(21)
#define EMAC_RX_RUNT		BIT(22)
#define EMAC_TX_PAD		BIT(0)
#define EMAC_TX_CRC		BIT(1)
#define EMAC_TX_INTERRUPT	BIT(2)
/* In its third */
#define EMAC_TX_COMPLETE	BIT(19)

#define EMAC_RING_SIZE		32
#define EMAC_POLL_WEIGHT	16

/* The longest frame that the MAC is to store, with its CRC. The vendor's
 * drivers have the same limit, so VLAN tags are known to fit.
 */
#define EMAC_RX_SIZE		1536

/* Up to this length a frame is copied and its buffer stays in the ring: that
 * touches at most 16 cache lines, where a new buffer means 49 to invalidate
 * and 2 KiB that a short frame occupies until it is read. What is longer is
 * handed up as it is: the processor reads it for the checksum, and copying
 * would have it fetch and write back each line once more.
 */
#define EMAC_COPY_LENGTH	256

struct emac_descriptor {
	__le32 control;	/* owner; receive: status and length; transmit: what to do */
	__le32 buffer;
	__le32 status;	/* transmit only: status and length */
	__le32 next;
};

struct emac_rings {
	struct emac_descriptor rx[EMAC_RING_SIZE];
	struct emac_descriptor tx[EMAC_RING_SIZE];
};

struct emac_buffer {
	struct sk_buff *skb;
	dma_addr_t dma;
};

/**
 * struct nuc980_emac - one port
 * @ndev: the network device
 * @dev: the platform device
 * @base: the registers
 * @bus: the MDIO bus
 * @napi: polls both directions
 * @recover: starts the MAC anew after an error that stops it
 * @lock: the MII registers and MCMDR, as a reset of the MAC means all of them
 * @link_mode: speed and duplex of the link, as in MCMDR
 * @rings: the descriptors
 * @rings_dma: their address for the MAC
 * @rx: the frames to be received, in the order of the descriptors
 * @rx_next: the descriptor to look at next
 * @tx: the frames on their way
 * @tx_head: how many frames have been given to the MAC; by the transmit lock
 * @tx_tail: how many have come back; by the transmit lock
 */
struct nuc980_emac {
	struct net_device *ndev;
	struct device *dev;
	void __iomem *base;
	struct mii_bus *bus;
	struct napi_struct napi;
	struct work_struct recover;
	struct mutex lock;	/* see above */
	u32 link_mode;
	struct emac_rings *rings;
	dma_addr_t rings_dma;
	struct emac_buffer rx[EMAC_RING_SIZE];
	unsigned int rx_next;
	struct emac_buffer tx[EMAC_RING_SIZE];
	unsigned int tx_head;
	unsigned int tx_tail;
};

/* ---- MDIO bus and link ---- */

static int emac_mdio(struct nuc980_emac *priv, int phy, int reg, u32 command)
{
	u32 value;

	writel(FIELD_PREP(EMAC_MIIDA_PHY, phy) | FIELD_PREP(EMAC_MIIDA_REG, reg) |
	       EMAC_MIIDA_BUSY | EMAC_MIIDA_MDCON | command, priv->base + EMAC_MIIDA);

	/* It takes 64 cycles of MDC. */
	return readl_poll_timeout(priv->base + EMAC_MIIDA, value,
				  !(value & EMAC_MIIDA_BUSY), 50, 1000);
}

static int emac_mdio_read(struct mii_bus *bus, int phy, int reg)
{
	struct nuc980_emac *priv = bus->priv;
	int ret;

	mutex_lock(&priv->lock);
	ret = emac_mdio(priv, phy, reg, 0);
	if (!ret)
		ret = readl(priv->base + EMAC_MIID) & 0xffff;
	mutex_unlock(&priv->lock);

	return ret;
}

static int emac_mdio_write(struct mii_bus *bus, int phy, int reg, u16 value)
{
	struct nuc980_emac *priv = bus->priv;
	int ret;

	mutex_lock(&priv->lock);
	writel(value, priv->base + EMAC_MIID);
	ret = emac_mdio(priv, phy, reg, EMAC_MIIDA_WRITE);
	mutex_unlock(&priv->lock);

	return ret;
}

static void emac_adjust_link(struct net_device *ndev)
{
	struct nuc980_emac *priv = netdev_priv(ndev);
	struct phy_device *phy = ndev->phydev;
	u32 mcmdr;

	if (phy->link) {
		mutex_lock(&priv->lock);
		priv->link_mode = 0;
		if (phy->speed == SPEED_100)
			priv->link_mode |= EMAC_MCMDR_OPMOD;
		if (phy->duplex == DUPLEX_FULL)
			priv->link_mode |= EMAC_MCMDR_FDUP;
		mcmdr = readl(priv->base + EMAC_MCMDR);
		mcmdr &= ~(EMAC_MCMDR_OPMOD | EMAC_MCMDR_FDUP);
		writel(mcmdr | priv->link_mode, priv->base + EMAC_MCMDR);
		mutex_unlock(&priv->lock);
	}

	phy_print_status(phy);
}

static int emac_connect_phy(struct nuc980_emac *priv)
{
	struct phy_device *phy = phy_find_first(priv->bus);
	int ret;

	if (!phy) {
		netdev_err(priv->ndev, "no PHY answers on the MDIO bus\n");
		return -ENODEV;
	}

	ret = phy_connect_direct(priv->ndev, phy, emac_adjust_link,
				 PHY_INTERFACE_MODE_RMII);
	if (ret) {
		netdev_err(priv->ndev, "cannot connect to the PHY: %d\n", ret);
		return ret;
	}

	phy_set_max_speed(phy, SPEED_100);

	return 0;
}

/* ---- addresses ---- */

static void emac_write_cam(struct nuc980_emac *priv, int entry, const u8 *address)
{
	writel(get_unaligned_be32(address), priv->base + EMAC_CAM_HIGH(entry));
	writel(get_unaligned_be16(address + 4) << 16, priv->base + EMAC_CAM_LOW(entry));
}

/* Entry 0 is the port's own address; what does not fit lets all pass. */
static void emac_set_rx_mode(struct net_device *ndev)
{
	struct nuc980_emac *priv = netdev_priv(ndev);
	u32 camcmr = EMAC_CAMCMR_ECMP | EMAC_CAMCMR_ABP;
	struct netdev_hw_addr *address;
	int entries = 1;

	writel(BIT(0), priv->base + EMAC_CAMEN);

	if (ndev->flags & IFF_PROMISC ||
	    entries + netdev_uc_count(ndev) > EMAC_CAM_ADDRESSES) {
		camcmr |= EMAC_CAMCMR_AUP | EMAC_CAMCMR_AMP;
	} else {
		netdev_for_each_uc_addr(address, ndev)
			emac_write_cam(priv, entries++, address->addr);
	}

	if (ndev->flags & IFF_ALLMULTI ||
	    entries + netdev_mc_count(ndev) > EMAC_CAM_ADDRESSES) {
		camcmr |= EMAC_CAMCMR_AMP;
	} else {
		netdev_for_each_mc_addr(address, ndev)
			emac_write_cam(priv, entries++, address->addr);
	}

	writel(GENMASK(entries - 1, 0), priv->base + EMAC_CAMEN);
	writel(camcmr, priv->base + EMAC_CAMCMR);
}

static int emac_set_mac_address(struct net_device *ndev, void *address)
{
	int ret = eth_mac_addr(ndev, address);

	if (!ret)
		emac_write_cam(netdev_priv(ndev), 0, ndev->dev_addr);

	return ret;
}

/* ---- receive ---- */

static bool emac_new_rx_buffer(struct nuc980_emac *priv, struct emac_buffer *buffer)
{
	struct sk_buff *skb = netdev_alloc_skb_ip_align(priv->ndev, EMAC_RX_SIZE);
	dma_addr_t dma;

	if (!skb)
		return false;

	dma = dma_map_single(priv->dev, skb->data, EMAC_RX_SIZE, DMA_FROM_DEVICE);
	if (dma_mapping_error(priv->dev, dma)) {
		dev_kfree_skb_any(skb);
		return false;
	}

	buffer->skb = skb;
	buffer->dma = dma;

	return true;
}

static void emac_free_rx_buffers(struct nuc980_emac *priv)
{
	struct emac_buffer *buffer;

	for (buffer = priv->rx; buffer < priv->rx + EMAC_RING_SIZE && buffer->skb; buffer++) {
		dma_unmap_single(priv->dev, buffer->dma, EMAC_RX_SIZE, DMA_FROM_DEVICE);
		dev_kfree_skb_any(buffer->skb);
		buffer->skb = NULL;
	}
}

static int emac_alloc_rx_buffers(struct nuc980_emac *priv)
{
	int i;

	for (i = 0; i < EMAC_RING_SIZE; i++) {
		if (!emac_new_rx_buffer(priv, &priv->rx[i])) {
			emac_free_rx_buffers(priv);
			return -ENOMEM;
		}
	}

	return 0;
}

static struct sk_buff *emac_copy_frame(struct nuc980_emac *priv,
				       struct emac_buffer *buffer, unsigned int length)
{
	struct sk_buff *skb = napi_alloc_skb(&priv->napi, length);

	if (!skb)
		return NULL;

	dma_sync_single_for_cpu(priv->dev, buffer->dma, length, DMA_FROM_DEVICE);
	skb_put_data(skb, buffer->skb->data, length);
	dma_sync_single_for_device(priv->dev, buffer->dma, length, DMA_FROM_DEVICE);

	return skb;
}

/* The frame in its own buffer; a new one takes its place. */
static struct sk_buff *emac_take_frame(struct nuc980_emac *priv,
				       struct emac_buffer *buffer, unsigned int length)
{
	struct emac_buffer full = *buffer;

	if (!emac_new_rx_buffer(priv, buffer))
		return NULL;

	dma_unmap_single(priv->dev, full.dma, EMAC_RX_SIZE, DMA_FROM_DEVICE);
	skb_put(full.skb, length);

	return full.skb;
}

static void emac_count_rx_error(struct net_device *ndev, u32 control)
{
	ndev->stats.rx_errors++;
	if (control & EMAC_RX_CRC_ERROR)
		ndev->stats.rx_crc_errors++;
	else if (control & EMAC_RX_ALIGN_ERROR)
		ndev->stats.rx_frame_errors++;
	else if (control & (EMAC_RX_RUNT | EMAC_RX_LONG))
		ndev->stats.rx_length_errors++;
}

static void emac_receive_frame(struct nuc980_emac *priv, struct emac_buffer *buffer,
			       u32 control)
{
	unsigned int length = FIELD_GET(EMAC_RX_LENGTH, control);
	struct net_device *ndev = priv->ndev;
	struct sk_buff *skb;

	if (!(control & EMAC_RX_GOOD) || length < ETH_HLEN || length > EMAC_RX_SIZE) {
		emac_count_rx_error(ndev, control);
		return;
	}

	if (length <= EMAC_COPY_LENGTH)
		skb = emac_copy_frame(priv, buffer, length);
	else
		skb = emac_take_frame(priv, buffer, length);
	if (!skb) {
		ndev->stats.rx_dropped++;
		return;
	}

	dev_sw_netstats_rx_add(ndev, length);
	skb->protocol = eth_type_trans(skb, ndev);
	napi_gro_receive(&priv->napi, skb);
}

static int emac_receive(struct nuc980_emac *priv, int budget)
{
	int done;

	for (done = 0; done < budget; done++) {
		struct emac_descriptor *descriptor = &priv->rings->rx[priv->rx_next];
		struct emac_buffer *buffer = &priv->rx[priv->rx_next];
		u32 control = le32_to_cpu(READ_ONCE(descriptor->control));

		if (control & EMAC_OWNER_DMA)
			break;
		dma_rmb();

		emac_receive_frame(priv, buffer, control);

		descriptor->buffer = cpu_to_le32(buffer->dma);
		dma_wmb();
		WRITE_ONCE(descriptor->control, cpu_to_le32(EMAC_OWNER_DMA));
		priv->rx_next = (priv->rx_next + 1) % EMAC_RING_SIZE;
	}

	/* The MAC stops where it finds no descriptor, and goes on by this. */
	if (done)
		writel(0, priv->base + EMAC_RSDR);

	return done;
}

/* ---- transmit ---- */

static netdev_tx_t emac_start_xmit(struct sk_buff *skb, struct net_device *ndev)
{
	struct nuc980_emac *priv = netdev_priv(ndev);
	unsigned int n = priv->tx_head % EMAC_RING_SIZE;
	struct emac_descriptor *descriptor = &priv->rings->tx[n];
	dma_addr_t dma;

	dma = dma_map_single(priv->dev, skb->data, skb->len, DMA_TO_DEVICE);
	if (dma_mapping_error(priv->dev, dma)) {
		dev_kfree_skb_any(skb);
		ndev->stats.tx_dropped++;
		return NETDEV_TX_OK;
	}

	priv->tx[n].skb = skb;
	priv->tx[n].dma = dma;
	priv->tx_head++;
	if (priv->tx_head - priv->tx_tail == EMAC_RING_SIZE)
		netif_stop_queue(ndev);
	netdev_sent_queue(ndev, skb->len);
	skb_tx_timestamp(skb);

	descriptor->buffer = cpu_to_le32(dma);
	descriptor->status = cpu_to_le32(skb->len);
	dma_wmb();
	WRITE_ONCE(descriptor->control,
		   cpu_to_le32(EMAC_OWNER_DMA | EMAC_TX_PAD | EMAC_TX_CRC | EMAC_TX_INTERRUPT));
	writel(0, priv->base + EMAC_TSDR);

	return NETDEV_TX_OK;
}

/* Frees the oldest frame on its way; returns its length. */
static unsigned int emac_finish_frame(struct nuc980_emac *priv, u32 status, int budget)
{
	struct emac_buffer *buffer = &priv->tx[priv->tx_tail % EMAC_RING_SIZE];
	unsigned int length = buffer->skb->len;

	if (status & EMAC_TX_COMPLETE)
		dev_sw_netstats_tx_add(priv->ndev, 1, length);
	else
		priv->ndev->stats.tx_errors++;
	dma_unmap_single(priv->dev, buffer->dma, length, DMA_TO_DEVICE);
	napi_consume_skb(buffer->skb, budget);
	priv->tx_tail++;

	return length;
}

static void emac_finish_transmit(struct nuc980_emac *priv, int budget)
{
	struct netdev_queue *queue = netdev_get_tx_queue(priv->ndev, 0);
	unsigned int frames = 0, bytes = 0;

	__netif_tx_lock(queue, smp_processor_id());

	while (priv->tx_tail != priv->tx_head) {
		struct emac_descriptor *descriptor =
			&priv->rings->tx[priv->tx_tail % EMAC_RING_SIZE];

		if (le32_to_cpu(READ_ONCE(descriptor->control)) & EMAC_OWNER_DMA)
			break;
		dma_rmb();

		bytes += emac_finish_frame(priv, le32_to_cpu(descriptor->status), budget);
		frames++;
	}

	netdev_tx_completed_queue(queue, frames, bytes);
	if (frames && netif_tx_queue_stopped(queue))
		netif_tx_wake_queue(queue);

	__netif_tx_unlock(queue);
}

/* Of a MAC that is halted */
static void emac_drop_transmit(struct nuc980_emac *priv)
{
	while (priv->tx_tail != priv->tx_head)
		emac_finish_frame(priv, 0, 0);
	netdev_reset_queue(priv->ndev);
}

/* ---- interrupts ---- */

static irqreturn_t emac_interrupt(int irq, void *data)
{
	struct nuc980_emac *priv = data;

	writel(0, priv->base + EMAC_MIEN);
	napi_schedule(&priv->napi);

	return IRQ_HANDLED;
}

static int emac_poll(struct napi_struct *napi, int budget)
{
	struct nuc980_emac *priv = container_of(napi, struct nuc980_emac, napi);
	u32 status = readl(priv->base + EMAC_MISTA);
	int done;

	/* Before the rings are looked at: what comes later interrupts again. */
	writel(status, priv->base + EMAC_MISTA);

	if (status & EMAC_BUS_ERRORS)
		schedule_work(&priv->recover);
	priv->ndev->stats.rx_missed_errors += readl(priv->base + EMAC_MPCNT);

	emac_finish_transmit(priv, budget);
	done = emac_receive(priv, budget);
	if (done < budget && napi_complete_done(napi, done))
		writel(EMAC_INTERRUPTS, priv->base + EMAC_MIEN);

	return done;
}

/* ---- start and stop ---- */

/* Ends all DMA, and takes the MII registers with it. */
static void emac_reset(struct nuc980_emac *priv)
{
	u32 mcmdr;

	mutex_lock(&priv->lock);
	writel(0, priv->base + EMAC_MCMDR);
	writel(EMAC_MCMDR_SWR, priv->base + EMAC_MCMDR);
	if (readl_poll_timeout(priv->base + EMAC_MCMDR, mcmdr,
			       !(mcmdr & EMAC_MCMDR_SWR), 10, 10000))
		dev_err(priv->dev, "the MAC does not come out of its reset\n");
	mutex_unlock(&priv->lock);
}

static void emac_init_rings(struct nuc980_emac *priv)
{
	struct emac_rings *rings = priv->rings;
	dma_addr_t rx = priv->rings_dma + offsetof(struct emac_rings, rx);
	dma_addr_t tx = priv->rings_dma + offsetof(struct emac_rings, tx);
	int i, next;

	for (i = 0; i < EMAC_RING_SIZE; i++) {
		next = (i + 1) % EMAC_RING_SIZE * sizeof(struct emac_descriptor);

		rings->rx[i].buffer = cpu_to_le32(priv->rx[i].dma);
		rings->rx[i].next = cpu_to_le32(rx + next);
		rings->rx[i].control = cpu_to_le32(EMAC_OWNER_DMA);
		rings->tx[i].next = cpu_to_le32(tx + next);
		rings->tx[i].control = 0;
	}
	priv->rx_next = 0;
	priv->tx_head = 0;
	priv->tx_tail = 0;

	writel(rx, priv->base + EMAC_RXDLSA);
	writel(tx, priv->base + EMAC_TXDLSA);
}

/* From the reset; there are receive buffers. */
static void emac_start(struct nuc980_emac *priv)
{
	struct net_device *ndev = priv->ndev;

	emac_init_rings(priv);
	emac_write_cam(priv, 0, ndev->dev_addr);
	netif_addr_lock_bh(ndev);
	emac_set_rx_mode(ndev);
	netif_addr_unlock_bh(ndev);
	writel(EMAC_RX_SIZE, priv->base + EMAC_DMARFC);
	readl(priv->base + EMAC_MPCNT);

	napi_enable(&priv->napi);
	mutex_lock(&priv->lock);
	writel(EMAC_MCMDR_RXON | EMAC_MCMDR_TXON | EMAC_MCMDR_ALP | EMAC_MCMDR_SPCRC |
	       priv->link_mode, priv->base + EMAC_MCMDR);
	mutex_unlock(&priv->lock);
	writel(0, priv->base + EMAC_RSDR);
	writel(EMAC_INTERRUPTS, priv->base + EMAC_MIEN);

	netif_trans_update(ndev);
	netif_wake_queue(ndev);
}

static void emac_halt(struct nuc980_emac *priv)
{
	napi_disable(&priv->napi);
	netif_tx_disable(priv->ndev);
	emac_reset(priv);
	emac_drop_transmit(priv);
}

static void emac_recover(struct work_struct *work)
{
	struct nuc980_emac *priv = container_of(work, struct nuc980_emac, recover);

	rtnl_lock();
	if (netif_running(priv->ndev)) {
		if (net_ratelimit())
			netdev_err(priv->ndev, "bus error or stuck transmitter: the MAC starts anew\n");
		emac_halt(priv);
		emac_start(priv);
	}
	rtnl_unlock();
}

static void emac_tx_timeout(struct net_device *ndev, unsigned int queue)
{
	struct nuc980_emac *priv = netdev_priv(ndev);

	schedule_work(&priv->recover);
}

static int emac_open(struct net_device *ndev)
{
	struct nuc980_emac *priv = netdev_priv(ndev);
	int ret;

	ret = emac_alloc_rx_buffers(priv);
	if (ret)
		return ret;

	ret = emac_connect_phy(priv);
	if (ret) {
		emac_free_rx_buffers(priv);
		return ret;
	}

	emac_start(priv);
	phy_start(ndev->phydev);

	return 0;
}

static int emac_stop(struct net_device *ndev)
{
	struct nuc980_emac *priv = netdev_priv(ndev);

	phy_stop(ndev->phydev);
	emac_halt(priv);
	phy_disconnect(ndev->phydev);
	emac_free_rx_buffers(priv);

	return 0;
}

static const struct net_device_ops emac_netdev_ops = {
	.ndo_open = emac_open,
	.ndo_stop = emac_stop,
	.ndo_start_xmit = emac_start_xmit,
	.ndo_tx_timeout = emac_tx_timeout,
	.ndo_set_rx_mode = emac_set_rx_mode,
	.ndo_set_mac_address = emac_set_mac_address,
	.ndo_validate_addr = eth_validate_addr,
	.ndo_get_stats64 = dev_get_tstats64,
	.ndo_eth_ioctl = phy_do_ioctl_running,
};

static const struct ethtool_ops emac_ethtool_ops = {
	.get_link = ethtool_op_get_link,
	.get_link_ksettings = phy_ethtool_get_link_ksettings,
	.set_link_ksettings = phy_ethtool_set_link_ksettings,
	.nway_reset = phy_ethtool_nway_reset,
	.get_ts_info = ethtool_op_get_ts_info,
};

/* ---- device ---- */

static int emac_request_irq(struct nuc980_emac *priv, unsigned int index, const char *suffix)
{
	int irq = platform_get_irq(to_platform_device(priv->dev), index);
	const char *name;

	if (irq < 0)
		return irq;

	/* "emac0-rx": with the interrupt's number it fits a thread's name. */
	name = devm_kasprintf(priv->dev, GFP_KERNEL, "%pOFn-%s", priv->dev->of_node, suffix);
	if (!name)
		return -ENOMEM;

	return devm_request_irq(priv->dev, irq, emac_interrupt, 0, name, priv);
}

static int emac_register_mdio(struct nuc980_emac *priv)
{
	priv->bus = devm_mdiobus_alloc(priv->dev);
	if (!priv->bus)
		return -ENOMEM;

	priv->bus->name = "NUC980 EMAC";
	strscpy(priv->bus->id, dev_name(priv->dev), MII_BUS_ID_SIZE);
	priv->bus->read = emac_mdio_read;
	priv->bus->write = emac_mdio_write;
	priv->bus->parent = priv->dev;
	priv->bus->priv = priv;

	return devm_mdiobus_register(priv->dev, priv->bus);
}

static int emac_get_mac_address(struct nuc980_emac *priv)
{
	int ret = of_get_ethdev_address(priv->dev->of_node, priv->ndev);

	if (!ret || ret == -EPROBE_DEFER)
		return ret;

	eth_hw_addr_random(priv->ndev);
	dev_warn(priv->dev, "no local-mac-address in the device tree, so a random one, %pM: set ethaddr and eth1addr in the boot loader, which puts them at the aliases ethernet0 and ethernet1\n",
		 priv->ndev->dev_addr);

	return 0;
}

/* Without a PHY, too: the other port is not to take the name of this one. */
static int emac_register(struct nuc980_emac *priv)
{
	int ret = devm_register_netdev(priv->dev, priv->ndev);

	if (ret)
		return ret;

	rtnl_lock();
	ret = dev_set_threaded(priv->ndev, true);
	rtnl_unlock();

	return ret;
}

static int emac_probe(struct platform_device *pdev)
{
	struct device *dev = &pdev->dev;
	struct nuc980_emac *priv;
	struct net_device *ndev;
	struct clk *clk;
	int ret;

	ndev = devm_alloc_etherdev(dev, sizeof(*priv));
	if (!ndev)
		return -ENOMEM;

	SET_NETDEV_DEV(ndev, dev);
	ndev->netdev_ops = &emac_netdev_ops;
	ndev->ethtool_ops = &emac_ethtool_ops;
	ndev->priv_flags |= IFF_UNICAST_FLT | IFF_LIVE_ADDR_CHANGE;
	ndev->tstats = devm_netdev_alloc_pcpu_stats(dev, struct pcpu_sw_netstats);
	if (!ndev->tstats)
		return -ENOMEM;

	priv = netdev_priv(ndev);
	priv->ndev = ndev;
	priv->dev = dev;
	mutex_init(&priv->lock);
	priv->rings = dmam_alloc_coherent(dev, sizeof(*priv->rings), &priv->rings_dma, GFP_KERNEL);
	if (!priv->rings)
		return -ENOMEM;

	priv->base = devm_platform_ioremap_resource(pdev, 0);
	if (IS_ERR(priv->base))
		return PTR_ERR(priv->base);

	clk = devm_clk_get_enabled(dev, NULL);
	if (IS_ERR(clk))
		return dev_err_probe(dev, PTR_ERR(clk), "no clock\n");

	ret = emac_get_mac_address(priv);
	if (ret)
		return ret;

	/* Whatever the boot loader has left running */
	emac_reset(priv);

	netif_napi_add_weight(ndev, &priv->napi, emac_poll, EMAC_POLL_WEIGHT);
	ret = devm_work_autocancel(dev, &priv->recover, emac_recover);
	if (ret)
		return ret;

	ret = emac_request_irq(priv, 0, "tx");
	if (ret)
		return dev_err_probe(dev, ret, "no transmit interrupt\n");

	ret = emac_request_irq(priv, 1, "rx");
	if (ret)
		return dev_err_probe(dev, ret, "no receive interrupt\n");

	ret = emac_register_mdio(priv);
	if (ret)
		return dev_err_probe(dev, ret, "no MDIO bus\n");

	return emac_register(priv);
}

static const struct of_device_id emac_of_match[] = {
	{ .compatible = "nuvoton,nuc980-emac0" },
	{ .compatible = "nuvoton,nuc980-emac1" },
	{ }
};
MODULE_DEVICE_TABLE(of, emac_of_match);

static struct platform_driver emac_driver = {
	.probe = emac_probe,
	.driver = {
		.name = "nuc980-emac",
		.of_match_table = emac_of_match,
	},
};
module_platform_driver(emac_driver);

MODULE_AUTHOR("The OpenRTU authors");
MODULE_DESCRIPTION("Nuvoton NUC980 Ethernet MAC");
MODULE_LICENSE("GPL");
