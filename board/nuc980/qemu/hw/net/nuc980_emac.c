/*
 * Nuvoton NUC980 Ethernet MAC, and the PHY on its MII management lines
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 *
 * The MAC is the one of hw/net/npcm7xx_emc.c, which models less of it (no
 * CAM but entry 0, no MII, no link, no runts, control frames or counter).
 * No manual of the chip is public: the names are those of the vendor's
 * drivers, what a bit does is what Nuvoton's M480 BSP (emac_reg.h) says of
 * the same MAC, and reset values are those of npcm7xx_emc.c. The PHY is
 * the board's IC+ IP101G; of its own registers (16 to 31), none does anything.
 *
 * What QEMU's network has no notion of is left out: collisions and deferral
 * of half duplex, FIFO levels, alignment errors. MII accesses and pauses are
 * over at once. Not modelled: time stamps (0x100..), wake-up by magic packet.
 */

#include "qemu/osdep.h"

/* For crc32 */
#include <zlib.h>

#include "hw/irq.h"
#include "hw/misc/nuc980_unimp.h"
#include "hw/net/mii.h"
#include "hw/net/nuc980_emac.h"
#include "hw/qdev-properties.h"
#include "hw/registerfields.h"
#include "migration/vmstate.h"
#include "net/eth.h"
#include "qapi/error.h"
#include "qemu/log.h"
#include "sysemu/dma.h"
#include "trace.h"

REG32(CAMCMR, 0x00)             /* CAM command */
    FIELD(CAMCMR, AUP, 0, 1)
    FIELD(CAMCMR, AMP, 1, 1)
    FIELD(CAMCMR, ABP, 2, 1)
    FIELD(CAMCMR, CCAM, 3, 1)
    FIELD(CAMCMR, ECMP, 4, 1)
REG32(CAMEN, 0x04)              /* CAM enable */
REG32(CAM0M, 0x08)              /* 16 entries of two words */
REG32(CAM0L, 0x0c)
REG32(CAM13M, 0x70)
REG32(CAM13L, 0x74)
REG32(CAM14M, 0x78)
REG32(CAM14L, 0x7c)
REG32(CAM15M, 0x80)
REG32(CAM15L, 0x84)
REG32(TXDLSA, 0x88)             /* first transmit descriptor */
REG32(RXDLSA, 0x8c)             /* first receive descriptor */
REG32(MCMDR, 0x90)              /* MAC command */
    FIELD(MCMDR, RXON, 0, 1)
    FIELD(MCMDR, ALP, 1, 1)
    FIELD(MCMDR, ARP, 2, 1)
    FIELD(MCMDR, ACP, 3, 1)
    FIELD(MCMDR, SPCRC, 5, 1)
    FIELD(MCMDR, MGPWAKE, 6, 1)
    FIELD(MCMDR, TXON, 8, 1)
    FIELD(MCMDR, SDPZ, 16, 1)
    FIELD(MCMDR, FDUP, 18, 1)
    FIELD(MCMDR, OPMOD, 20, 1)
    FIELD(MCMDR, LBK, 21, 1)
    FIELD(MCMDR, RMIIEN, 22, 1)
    FIELD(MCMDR, SWR, 24, 1)
REG32(MIID, 0x94)               /* MII management data */
REG32(MIIDA, 0x98)              /* MII management control and address */
    FIELD(MIIDA, PHYRAD, 0, 5)
    FIELD(MIIDA, PHYAD, 8, 5)
    FIELD(MIIDA, WRITE, 16, 1)
    FIELD(MIIDA, BUSY, 17, 1)
REG32(FFTCR, 0x9c)              /* FIFO threshold control */
REG32(TSDR, 0xa0)               /* transmit start demand */
REG32(RSDR, 0xa4)               /* receive start demand */
REG32(DMARFC, 0xa8)             /* longest frame to receive */
REG32(MIEN, 0xac)               /* interrupt enable, as MISTA */
REG32(MISTA, 0xb0)              /* interrupt status */
    FIELD(MISTA, RXINTR, 0, 1)
    FIELD(MISTA, CRCE, 1, 1)
    FIELD(MISTA, RXOV, 2, 1)
    FIELD(MISTA, PTLE, 3, 1)
    FIELD(MISTA, RXGD, 4, 1)
    FIELD(MISTA, RP, 6, 1)
    FIELD(MISTA, MMP, 7, 1)
    FIELD(MISTA, DFO, 8, 1)
    FIELD(MISTA, DEN, 9, 1)
    FIELD(MISTA, RDU, 10, 1)
    FIELD(MISTA, RXBERR, 11, 1)
    FIELD(MISTA, CFR, 14, 1)
    FIELD(MISTA, TXINTR, 16, 1)
    FIELD(MISTA, TXCP, 18, 1)
    FIELD(MISTA, TDU, 23, 1)
    FIELD(MISTA, TXBERR, 24, 1)
REG32(MGSTA, 0xb4)              /* general status */
    FIELD(MGSTA, CFR, 0, 1)
    FIELD(MGSTA, RXHA, 1, 1)
    FIELD(MGSTA, TXHA, 11, 1)
REG32(MPCNT, 0xb8)              /* missed packet count */
REG32(MRPC, 0xbc)               /* receive pause count */
REG32(MRPCC, 0xc0)              /* receive pause current count */
REG32(MREPC, 0xc4)              /* remote pause count */
REG32(DMARFS, 0xc8)             /* length/type of the last frame */
REG32(CTXDSA, 0xcc)             /* current transmit descriptor */
REG32(CTXBSA, 0xd0)             /* current transmit buffer */
REG32(CRXDSA, 0xd4)             /* current receive descriptor */
REG32(CRXBSA, 0xd8)             /* current receive buffer */
REG32(TSCTL, 0x100)             /* time stamp control */
    FIELD(TSCTL, TSIEN, 1, 1)
    FIELD(TSCTL, TSUPDATE, 3, 1)
REG32(TSALMSUBSEC, 0x12c)       /* the last of the time stamp unit */

#define MCMDR_WRITABLE          0x007e037f  /* all but SDPZ and SWR */
#define MCMDR_KEPT_BY_RESET     (R_MCMDR_OPMOD_MASK | R_MCMDR_RMIIEN_MASK | \
                                 R_MCMDR_LBK_MASK)
#define MISTA_BITS              0x11ffcfff
#define MISTA_RX_SOURCES        0x0000fffe
#define MISTA_TX_SOURCES        0xfffe0000

/* Entries 13 to 15 of the CAM make the PAUSE frame that SDPZ sends. */
#define CAM_ADDRESSES           13
#define CAM_PAUSE               0xe000

#define ETH_TYPE_CONTROL        0x8808
#define PAUSE_OPCODE            0x0001

/* Lengths of a frame on the wire count the frame check sequence. */
#define FCS_LEN                 4
#define MIN_WIRE_LEN            64
#define MAX_WIRE_LEN            1518

/*
 * Descriptors are four words. Receive: {owner, status and length; buffer;
 * reserved; next}; transmit: {owner and control; buffer; status and length;
 * next}.
 */
typedef struct EMACDesc {
    uint32_t control;
    uint32_t buffer;
    uint32_t status;
    uint32_t next;
} EMACDesc;

FIELD(DESC, LENGTH, 0, 16)
FIELD(DESC, OWNER, 31, 1)       /* the MAC's */
FIELD(RXDS, RXINTR, 16, 1)
FIELD(RXDS, PTLE, 19, 1)
FIELD(RXDS, RXGD, 20, 1)
FIELD(RXDS, RP, 22, 1)
FIELD(TXDC, PADEN, 0, 1)
FIELD(TXDC, CRCAPP, 1, 1)
FIELD(TXDC, INTEN, 2, 1)
FIELD(TXDS, TXINTR, 16, 1)
FIELD(TXDS, TXCP, 19, 1)

/*
 * A guest can link descriptors through all of its memory: after a burst, the
 * rest waits as long as a burst of the shortest frames takes at 100 Mbit/s.
 */
#define TX_BURST                64
#define TX_BURST_NS             (TX_BURST * 6720)

/* As in Linux's drivers/net/phy/icplus.c */
#define IP101G_PHYID1           0x0243
#define IP101G_PHYID2           0x0c54

#define PHY_BMCR_RESET          (MII_BMCR_SPEED | MII_BMCR_AUTOEN | MII_BMCR_FD)
#define PHY_BMCR_WRITABLE       (MII_BMCR_LOOPBACK | MII_BMCR_SPEED | \
                                 MII_BMCR_AUTOEN | MII_BMCR_PDOWN | \
                                 MII_BMCR_ISOLATE | MII_BMCR_FD | MII_BMCR_CTST)
#define PHY_MODES               (MII_ANAR_TXFD | MII_ANAR_TX | \
                                 MII_ANAR_10FD | MII_ANAR_10)
/* guess: what is at the other end of the cable negotiates all modes */
#define PHY_PARTNER             (MII_ANLPAR_ACK | PHY_MODES | MII_ANLPAR_CSMACD)

static const char *emac_name(NUC980EMACState *s)
{
    return qemu_get_queue(s->nic)->name;
}

/* ---- PHY ---- */

/* The mode that both ends can, or that is forced, as ANAR's bit; else 0 */
static unsigned phy_mode(NUC980EMACState *s)
{
    uint16_t bmcr = s->phy[MII_BMCR];

    if (bmcr & MII_BMCR_AUTOEN) {
        return pow2floor(s->phy[MII_ANAR] & PHY_PARTNER & PHY_MODES);
    }
    if (bmcr & MII_BMCR_SPEED) {
        return bmcr & MII_BMCR_FD ? MII_ANAR_TXFD : MII_ANAR_TX;
    }
    return bmcr & MII_BMCR_FD ? MII_ANAR_10FD : MII_ANAR_10;
}

/* Nothing connected to a NIC is a port without a cable. */
static void phy_update_link(NUC980EMACState *s)
{
    NetClientState *nc = qemu_get_queue(s->nic);
    bool link = nc->peer && !nc->link_down && s->rmii && phy_mode(s) &&
                !(s->phy[MII_BMCR] & MII_BMCR_PDOWN);

    if (s->link != link) {
        trace_nuc980_emac_link(nc->name, link);
        s->link = link;
        s->link_failed |= !link;
    }
}

static void phy_reset(NUC980EMACState *s)
{
    memset(s->phy, 0, sizeof(s->phy));
    s->phy[MII_BMCR] = PHY_BMCR_RESET;      /* guess: the board's straps */
    s->phy[MII_ANAR] = PHY_MODES | MII_ANAR_CSMACD;     /* guess: no pause */
    phy_update_link(s);
}

/* The link bit stays low until read, so that no loss goes unseen. */
static uint16_t phy_read_bmsr(NUC980EMACState *s)
{
    /* guess: the usual abilities, no data sheet was at hand */
    uint16_t value = MII_BMSR_100TX_FD | MII_BMSR_100TX_HD | MII_BMSR_10T_FD |
                     MII_BMSR_10T_HD | MII_BMSR_MFPS | MII_BMSR_AUTONEG |
                     MII_BMSR_EXTCAP;

    if (s->link && (s->phy[MII_BMCR] & MII_BMCR_AUTOEN)) {
        value |= MII_BMSR_AN_COMP;
    }
    if (s->link && !s->link_failed) {
        value |= MII_BMSR_LINK_ST;
    }
    s->link_failed = false;
    return value;
}

static void phy_unimp(NUC980EMACState *s, unsigned reg)
{
    if (qemu_loglevel_mask(LOG_UNIMP) && !test_and_set_bit(reg, s->phy_seen)) {
        qemu_log("%s: PHY register %u is not modelled\n", emac_name(s), reg);
    }
}

static uint16_t phy_read(NUC980EMACState *s, unsigned reg)
{
    bool negotiated = s->link && (s->phy[MII_BMCR] & MII_BMCR_AUTOEN);

    switch (reg) {
    case MII_BMCR:
    case MII_ANAR:
        return s->phy[reg];
    case MII_BMSR:
        return phy_read_bmsr(s);
    case MII_PHYID1:
        return IP101G_PHYID1;
    case MII_PHYID2:
        return IP101G_PHYID2;
    case MII_ANLPAR:
        return negotiated ? PHY_PARTNER : 0;
    case MII_ANER:
        return negotiated ? MII_ANER_NWAY : 0;
    default:
        phy_unimp(s, reg);
        return s->phy[reg];
    }
}

static void phy_write(NUC980EMACState *s, unsigned reg, uint16_t value)
{
    switch (reg) {
    case MII_BMCR:
        if (value & MII_BMCR_RESET) {
            phy_reset(s);
            return;
        }
        s->phy[reg] = value & PHY_BMCR_WRITABLE;
        phy_update_link(s);
        break;
    case MII_ANAR:
        s->phy[reg] = value;
        phy_update_link(s);
        break;
    case MII_BMSR:
    case MII_PHYID1:
    case MII_PHYID2:
    case MII_ANLPAR:
    case MII_ANER:
        qemu_log_mask(LOG_GUEST_ERROR,
                      "%s: write to read-only PHY register %u\n",
                      emac_name(s), reg);
        break;
    default:
        phy_unimp(s, reg);
        s->phy[reg] = value;
        break;
    }
}

/*
 * Done at once; a real one takes 64 cycles of MDC, 64 us at 1 MHz. MDC runs
 * for the access whatever MDCON says: the vendor's U-Boot never sets it.
 */
static void emac_mii(NUC980EMACState *s)
{
    uint32_t miida = s->regs[R_MIIDA];
    unsigned addr = FIELD_EX32(miida, MIIDA, PHYAD);
    unsigned reg = FIELD_EX32(miida, MIIDA, PHYRAD);
    bool answers = s->mdio && addr == s->phy_addr;

    if (FIELD_EX32(miida, MIIDA, WRITE)) {
        trace_nuc980_emac_mii_write(emac_name(s), addr, reg, s->regs[R_MIID]);
        if (answers) {
            phy_write(s, reg, s->regs[R_MIID]);
        }
    } else {
        /* Pulled up: where nobody answers, all bits are high. */
        s->regs[R_MIID] = answers ? phy_read(s, reg) : 0xffff;
        trace_nuc980_emac_mii_read(emac_name(s), addr, reg, s->regs[R_MIID]);
    }
    s->regs[R_MIIDA] &= ~R_MIIDA_BUSY_MASK;
}

/* ---- interrupts ---- */

static void emac_update_irq(NUC980EMACState *s)
{
    uint32_t enabled = s->regs[R_MIEN];
    uint32_t pending = s->regs[R_MISTA] & enabled;
    bool rx = pending & MISTA_RX_SOURCES;
    bool tx = pending & MISTA_TX_SOURCES;

    s->regs[R_MISTA] = FIELD_DP32(s->regs[R_MISTA], MISTA, RXINTR, rx);
    s->regs[R_MISTA] = FIELD_DP32(s->regs[R_MISTA], MISTA, TXINTR, tx);
    qemu_set_irq(s->rx_irq, rx && (enabled & R_MISTA_RXINTR_MASK));
    qemu_set_irq(s->tx_irq, tx && (enabled & R_MISTA_TXINTR_MASK));
}

static void emac_raise(NUC980EMACState *s, uint32_t status)
{
    s->regs[R_MISTA] |= status;
    emac_update_irq(s);
}

/* ---- DMA ---- */

/* guess: only memory answers a descriptor or a frame, devices are an error */
static const MemTxAttrs emac_dma = { .memory = true };

static bool emac_read_desc(uint32_t addr, EMACDesc *desc)
{
    if (dma_memory_read(&address_space_memory, addr, desc, sizeof(*desc),
                        emac_dma)) {
        return false;
    }
    desc->control = le32_to_cpu(desc->control);
    desc->buffer = le32_to_cpu(desc->buffer);
    desc->status = le32_to_cpu(desc->status);
    desc->next = le32_to_cpu(desc->next);
    return true;
}

static bool emac_write_word(uint32_t addr, uint32_t value)
{
    return !stl_le_dma(&address_space_memory, addr, value, emac_dma);
}

/*
 * Descriptor and buffer stay as they are.
 * guess: only switching the direction off and on, or a reset, goes on
 */
static void emac_rx_bus_error(NUC980EMACState *s, uint32_t addr)
{
    qemu_log_mask(LOG_GUEST_ERROR, "%s: bus error in receive, descriptor 0x%"
                  PRIx32 ", at 0x%" PRIx32 "\n", emac_name(s),
                  s->regs[R_CRXDSA], addr);
    s->rx_dma = NUC980_EMAC_DMA_FAILED;
    emac_raise(s, R_MISTA_RXBERR_MASK);
}

static void emac_tx_bus_error(NUC980EMACState *s, uint32_t addr)
{
    qemu_log_mask(LOG_GUEST_ERROR, "%s: bus error in transmit, descriptor 0x%"
                  PRIx32 ", at 0x%" PRIx32 "\n", emac_name(s),
                  s->regs[R_CTXDSA], addr);
    s->tx_dma = NUC980_EMAC_DMA_FAILED;
    emac_raise(s, R_MISTA_TXBERR_MASK);
}

/* ---- receive ---- */

static void emac_missed(NUC980EMACState *s, const char *why, uint32_t status)
{
    trace_nuc980_emac_rx_drop(emac_name(s), why);
    s->regs[R_MPCNT] = (s->regs[R_MPCNT] + 1) & 0xffff;
    if (!s->regs[R_MPCNT]) {
        status |= R_MISTA_MMP_MASK;
    }
    emac_raise(s, status);
}

static bool emac_cam_matches(NUC980EMACState *s, const uint8_t *address)
{
    uint32_t high = ldl_be_p(address);
    uint32_t low = lduw_be_p(address + 4) << 16;

    for (int i = 0; i < CAM_ADDRESSES; i++) {
        if (extract32(s->regs[R_CAMEN], i, 1) &&
            s->regs[R_CAM0M + 2 * i] == high &&
            s->regs[R_CAM0L + 2 * i] == low) {
            return true;
        }
    }
    return false;
}

/* guess: AUP, AMP and ABP accept also what CCAM would reject */
static bool emac_address_wanted(NUC980EMACState *s, const uint8_t *frame)
{
    uint32_t camcmr = s->regs[R_CAMCMR];
    uint32_t all;

    switch (get_eth_packet_type(PKT_GET_ETH_HDR(frame))) {
    case ETH_PKT_BCAST:
        all = R_CAMCMR_ABP_MASK;
        break;
    case ETH_PKT_MCAST:
        all = R_CAMCMR_AMP_MASK;
        break;
    default:
        all = R_CAMCMR_AUP_MASK;
        break;
    }
    if (camcmr & all) {
        return true;
    }
    return (camcmr & R_CAMCMR_ECMP_MASK) &&
           emac_cam_matches(s, frame) != FIELD_EX32(camcmr, CAMCMR, CCAM);
}

/* Flow control is seen in full duplex whatever the CAM says (guess). */
static void emac_rx_control(NUC980EMACState *s, const uint8_t *frame,
                            size_t size)
{
    if (size < ETH_HLEN + 4 || lduw_be_p(frame + ETH_HLEN) != PAUSE_OPCODE ||
        !FIELD_EX32(s->regs[R_MCMDR], MCMDR, FDUP)) {
        return;
    }
    s->regs[R_MRPC] = lduw_be_p(frame + ETH_HLEN + 2);
    s->regs[R_MGSTA] |= R_MGSTA_CFR_MASK;
    emac_raise(s, R_MISTA_CFR_MASK);
}

/* Why the MAC has no use for a frame, or NULL; the status says it, too. */
static const char *emac_rx_refuse(NUC980EMACState *s, const uint8_t *frame,
                                  size_t size)
{
    uint32_t mcmdr = s->regs[R_MCMDR];
    size_t wire_len = size + FCS_LEN;
    unsigned type;

    if (size < ETH_HLEN) {
        emac_raise(s, R_MISTA_RP_MASK);
        return "fragment";
    }
    type = lduw_be_p(frame + ETH_HLEN - 2);
    s->regs[R_DMARFS] = type;
    emac_raise(s, R_MISTA_DEN_MASK);
    if (type == ETH_TYPE_CONTROL) {
        emac_rx_control(s, frame, size);
        if (!FIELD_EX32(mcmdr, MCMDR, ACP)) {
            return "control frame";
        }
    }
    if (!emac_address_wanted(s, frame)) {
        return "address";
    }
    if (wire_len > s->regs[R_DMARFC]) {
        emac_raise(s, R_MISTA_DFO_MASK);
        return "longer than DMARFC";
    }
    if (wire_len > MAX_WIRE_LEN && !FIELD_EX32(mcmdr, MCMDR, ALP)) {
        emac_raise(s, R_MISTA_PTLE_MASK);
        return "long";
    }
    if (wire_len < MIN_WIRE_LEN && !FIELD_EX32(mcmdr, MCMDR, ARP)) {
        emac_raise(s, R_MISTA_RP_MASK);
        return "runt";
    }
    return NULL;
}

/* The frame, and its check sequence unless it is to be stripped */
static bool emac_rx_write_frame(NUC980EMACState *s, uint32_t addr,
                                const uint8_t *frame, size_t size)
{
    if (dma_memory_write(&address_space_memory, addr, frame, size, emac_dma)) {
        return false;
    }
    return FIELD_EX32(s->regs[R_MCMDR], MCMDR, SPCRC) ||
           emac_write_word(addr + size, crc32(0, frame, size));
}

static uint32_t emac_rx_status(NUC980EMACState *s, size_t size)
{
    size_t wire_len = size + FCS_LEN;
    bool strip = FIELD_EX32(s->regs[R_MCMDR], MCMDR, SPCRC);
    uint32_t status = (strip ? size : wire_len) | R_RXDS_RXGD_MASK;

    if (wire_len > MAX_WIRE_LEN) {
        status |= R_RXDS_PTLE_MASK;
    }
    if (wire_len < MIN_WIRE_LEN) {
        status |= R_RXDS_RP_MASK;
    }
    if (s->regs[R_MISTA] & R_MISTA_RXINTR_MASK) {
        status |= R_RXDS_RXINTR_MASK;
    }
    return status;
}

/* False: there is no descriptor to put it in. */
static bool emac_rx_store(NUC980EMACState *s, const uint8_t *frame,
                          size_t size)
{
    uint32_t addr = s->regs[R_CRXDSA];
    EMACDesc desc;

    if (!emac_read_desc(addr, &desc)) {
        emac_rx_bus_error(s, addr);
        return true;
    }
    if (!FIELD_EX32(desc.control, DESC, OWNER)) {
        trace_nuc980_emac_rx_halt(emac_name(s), addr);
        s->rx_dma = NUC980_EMAC_DMA_HALTED;
        emac_raise(s, R_MISTA_RDU_MASK);
        return false;
    }
    s->regs[R_CRXBSA] = desc.buffer;
    if (!emac_rx_write_frame(s, desc.buffer, frame, size)) {
        emac_rx_bus_error(s, desc.buffer);
        return true;
    }
    /* Of the descriptor, only the first word is the MAC's to write. */
    s->regs[R_MISTA] |= R_MISTA_RXGD_MASK;
    emac_update_irq(s);
    if (!emac_write_word(addr, emac_rx_status(s, size))) {
        emac_rx_bus_error(s, addr);
        return true;
    }
    trace_nuc980_emac_rx(emac_name(s), addr, desc.buffer, size);
    s->regs[R_CRXDSA] = desc.next & ~3;
    return true;
}

/* False: the frame is to come again after a receive start demand. */
static bool emac_rx_frame(NUC980EMACState *s, const uint8_t *frame,
                          size_t size)
{
    const char *why;

    if (!FIELD_EX32(s->regs[R_MCMDR], MCMDR, RXON)) {
        emac_missed(s, "RXON is clear", 0);
        return true;
    }
    switch (s->rx_dma) {
    case NUC980_EMAC_DMA_FAILED:
        emac_missed(s, "bus error", R_MISTA_RXOV_MASK);
        return true;
    case NUC980_EMAC_DMA_HALTED:
        return false;
    default:
        why = emac_rx_refuse(s, frame, size);
        if (why) {
            trace_nuc980_emac_rx_drop(emac_name(s), why);
            return true;
        }
        return emac_rx_store(s, frame, size);
    }
}

/* RMII has one clock for both speeds: MAC and PHY must agree on one. */
static bool emac_speed_fits(NUC980EMACState *s)
{
    return FIELD_EX32(s->regs[R_MCMDR], MCMDR, OPMOD) ==
           !!(phy_mode(s) & (MII_ANAR_TXFD | MII_ANAR_TX));
}

/*
 * Out of descriptors, the real MAC misses what its FIFO of 256 bytes can't
 * hold. Here, QEMU's queue holds it until the receive start demand: a host
 * sends in no time what takes a wire milliseconds, and a driver that keeps up
 * with the wire would lose frames that it never loses on the chip. With RXON
 * clear or after a bus error nothing is held, so that a driver which starts
 * later hears no stale frames; those count as missed, as they do on the chip.
 */
static ssize_t emac_receive(NetClientState *nc, const uint8_t *buf,
                            size_t size)
{
    NUC980EMACState *s = qemu_get_nic_opaque(nc);

    if (!s->link || FIELD_EX32(s->regs[R_MCMDR], MCMDR, LBK) ||
        (s->phy[MII_BMCR] & (MII_BMCR_ISOLATE | MII_BMCR_LOOPBACK))) {
        trace_nuc980_emac_rx_drop(nc->name, "not connected");
        return size;
    }
    if (!emac_speed_fits(s)) {
        emac_missed(s, "OPMOD is not the PHY's speed", R_MISTA_CRCE_MASK);
        return size;
    }
    return emac_rx_frame(s, buf, size) ? size : 0;
}

/* ---- transmit ---- */

static void emac_loop_back(NUC980EMACState *s, const uint8_t *frame,
                           size_t size)
{
    if (!emac_rx_frame(s, frame, size)) {
        emac_missed(s, "no descriptor", R_MISTA_RXOV_MASK);
    }
}

/* A frame of full length, without its check sequence, leaves the MAC. */
static void emac_send(NUC980EMACState *s, const uint8_t *frame, size_t size)
{
    uint16_t bmcr = s->phy[MII_BMCR];

    if (FIELD_EX32(s->regs[R_MCMDR], MCMDR, LBK)) {
        emac_loop_back(s, frame, size);
    } else if (!s->rmii || (bmcr & (MII_BMCR_ISOLATE | MII_BMCR_PDOWN))) {
        trace_nuc980_emac_tx_drop(emac_name(s), "no PHY");
    } else if (!emac_speed_fits(s)) {
        trace_nuc980_emac_tx_drop(emac_name(s), "OPMOD is not the PHY's speed");
    } else if (bmcr & MII_BMCR_LOOPBACK) {
        emac_loop_back(s, frame, size);
    } else if (!s->link) {
        trace_nuc980_emac_tx_drop(emac_name(s), "no link");
    } else {
        qemu_send_packet(qemu_get_queue(s->nic), frame, size);
    }
}

static bool emac_fcs_fits(const uint8_t *buf, size_t size)
{
    uint32_t fcs;

    if (size < FCS_LEN) {
        return false;
    }
    fcs = ldl_le_p(buf + size - FCS_LEN);
    return fcs == crc32(0, buf, size - FCS_LEN);
}

/*
 * From what the descriptor gives to a frame as QEMU knows it: padded, and
 * without a check sequence. Without CRCAPP the guest brings its own, and who
 * receives it drops a wrong one. The buffer has room for MIN_WIRE_LEN.
 */
static void emac_tx_frame(NUC980EMACState *s, uint32_t control,
                          uint8_t *buf, size_t size)
{
    if (!FIELD_EX32(control, TXDC, CRCAPP)) {
        if (!emac_fcs_fits(buf, size)) {
            trace_nuc980_emac_tx_drop(emac_name(s), "check sequence");
            return;
        }
        size -= FCS_LEN;
    }
    if (FIELD_EX32(control, TXDC, PADEN)) {
        size = MAX(size, MIN_WIRE_LEN - FCS_LEN);
    }
    if (size < ETH_HLEN) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: frame of %zu bytes to send\n",
                      emac_name(s), size);
        return;
    }
    emac_send(s, buf, size);
}

static bool emac_tx_finish(NUC980EMACState *s, uint32_t addr,
                           const EMACDesc *desc, size_t size)
{
    uint32_t status = size | R_TXDS_TXCP_MASK;

    if (FIELD_EX32(desc->control, TXDC, INTEN)) {
        emac_raise(s, R_MISTA_TXCP_MASK);
        if (s->regs[R_MISTA] & R_MISTA_TXINTR_MASK) {
            status |= R_TXDS_TXINTR_MASK;
        }
    }
    /* The owner last: the driver polls it. */
    return emac_write_word(addr + offsetof(EMACDesc, status), status) &&
           emac_write_word(addr, desc->control & ~R_DESC_OWNER_MASK);
}

static void emac_tx_next(NUC980EMACState *s)
{
    uint32_t addr = s->regs[R_CTXDSA];
    g_autofree uint8_t *buf = NULL;
    EMACDesc desc;
    size_t size;

    if (!emac_read_desc(addr, &desc)) {
        emac_tx_bus_error(s, addr);
        return;
    }
    if (!FIELD_EX32(desc.control, DESC, OWNER)) {
        trace_nuc980_emac_tx_halt(emac_name(s), addr);
        s->tx_dma = NUC980_EMAC_DMA_HALTED;
        emac_raise(s, R_MISTA_TDU_MASK);
        return;
    }
    size = FIELD_EX32(desc.status, DESC, LENGTH);
    buf = g_malloc0(MAX(size, MIN_WIRE_LEN));
    s->regs[R_CTXBSA] = desc.buffer;
    if (dma_memory_read(&address_space_memory, desc.buffer, buf, size,
                        emac_dma)) {
        emac_tx_bus_error(s, desc.buffer);
        return;
    }
    trace_nuc980_emac_tx(emac_name(s), addr, desc.buffer, size);
    emac_tx_frame(s, desc.control, buf, size);
    if (!emac_tx_finish(s, addr, &desc, size)) {
        emac_tx_bus_error(s, addr);
        return;
    }
    s->regs[R_CTXDSA] = desc.next & ~3;
}

static void emac_tx_run(void *opaque)
{
    NUC980EMACState *s = opaque;

    for (int i = 0; i < TX_BURST; i++) {
        if (s->tx_dma != NUC980_EMAC_DMA_RUNNING) {
            return;
        }
        emac_tx_next(s);
    }
    timer_mod(s->tx_timer,
              qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL) + TX_BURST_NS);
}

/* guess: the pause is CAM15L[31:16]; sent without regard to TXON */
static void emac_send_pause(NUC980EMACState *s)
{
    uint8_t frame[MIN_WIRE_LEN - FCS_LEN] = { };

    if ((s->regs[R_CAMEN] & CAM_PAUSE) != CAM_PAUSE) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: PAUSE frame to be sent, but CAM "
                      "entries 13 to 15 are not enabled\n", emac_name(s));
        return;
    }
    stl_be_p(frame, s->regs[R_CAM13M]);
    stw_be_p(frame + 4, s->regs[R_CAM13L] >> 16);
    stl_be_p(frame + 6, s->regs[R_CAM14M]);
    stw_be_p(frame + 10, s->regs[R_CAM14L] >> 16);
    stl_be_p(frame + 12, s->regs[R_CAM15M]);
    stw_be_p(frame + 16, s->regs[R_CAM15L] >> 16);
    emac_send(s, frame, sizeof(frame));
}

/* ---- registers ---- */

static void emac_flush(NUC980EMACState *s)
{
    qemu_flush_queued_packets(qemu_get_queue(s->nic));
}

/* guess: reset values, from npcm7xx_emc.c */
static void emac_reset_regs(NUC980EMACState *s)
{
    memset(s->regs, 0, sizeof(s->regs));
    emac_flush(s);
    s->regs[R_TXDLSA] = 0xfffffffc;
    s->regs[R_RXDLSA] = 0xfffffffc;
    s->regs[R_MIIDA] = 0x00900000;
    s->regs[R_FFTCR] = 0x0101;
    s->regs[R_DMARFC] = 0x0800;
    s->regs[R_MPCNT] = 0x7fff;
    s->tx_dma = NUC980_EMAC_DMA_HALTED;
    s->rx_dma = NUC980_EMAC_DMA_HALTED;
    timer_del(s->tx_timer);
    emac_update_irq(s);
}

static void emac_soft_reset(NUC980EMACState *s)
{
    uint32_t kept = s->regs[R_MCMDR] & MCMDR_KEPT_BY_RESET;

    emac_reset_regs(s);
    s->regs[R_MCMDR] = kept;
}

static void emac_switch_tx(NUC980EMACState *s, bool on)
{
    if (on) {
        s->regs[R_CTXDSA] = s->regs[R_TXDLSA] & ~3;
        s->tx_dma = NUC980_EMAC_DMA_RUNNING;
        emac_tx_run(s);
    } else {
        s->regs[R_MGSTA] |= R_MGSTA_TXHA_MASK;
        s->tx_dma = NUC980_EMAC_DMA_HALTED;
        timer_del(s->tx_timer);
    }
}

/* guess: the first descriptor is read with the first frame, not before */
static void emac_switch_rx(NUC980EMACState *s, bool on)
{
    if (on) {
        s->regs[R_CRXDSA] = s->regs[R_RXDLSA] & ~3;
        s->rx_dma = NUC980_EMAC_DMA_RUNNING;
    } else {
        s->regs[R_MGSTA] |= R_MGSTA_RXHA_MASK;
        s->rx_dma = NUC980_EMAC_DMA_HALTED;
    }
    emac_flush(s);
}

static void emac_write_mcmdr(NUC980EMACState *s, uint32_t value)
{
    uint32_t changed = s->regs[R_MCMDR] ^ value;

    if (FIELD_EX32(value, MCMDR, SWR)) {
        trace_nuc980_emac_reset(emac_name(s));
        emac_soft_reset(s);
        return;
    }
    s->regs[R_MCMDR] = value & MCMDR_WRITABLE;
    if (changed & value & R_MCMDR_MGPWAKE_MASK) {
        qemu_log_mask(LOG_UNIMP, "%s: wake-up by magic packet is not "
                      "modelled\n", emac_name(s));
    }
    if (FIELD_EX32(value, MCMDR, SDPZ)) {
        emac_send_pause(s);
    }
    if (changed & R_MCMDR_RXON_MASK) {
        emac_switch_rx(s, FIELD_EX32(value, MCMDR, RXON));
    }
    if (changed & R_MCMDR_TXON_MASK) {
        emac_switch_tx(s, FIELD_EX32(value, MCMDR, TXON));
    }
}

static void emac_demand_tx(NUC980EMACState *s)
{
    if (FIELD_EX32(s->regs[R_MCMDR], MCMDR, TXON) &&
        s->tx_dma == NUC980_EMAC_DMA_HALTED) {
        s->tx_dma = NUC980_EMAC_DMA_RUNNING;
        emac_tx_run(s);
    }
}

static void emac_demand_rx(NUC980EMACState *s)
{
    if (FIELD_EX32(s->regs[R_MCMDR], MCMDR, RXON) &&
        s->rx_dma == NUC980_EMAC_DMA_HALTED) {
        s->rx_dma = NUC980_EMAC_DMA_RUNNING;
        emac_flush(s);
    }
}

static void emac_unimp(NUC980EMACState *s, hwaddr addr)
{
    nuc980_unimp_once(s->seen, emac_name(s), addr);
}

static uint64_t emac_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980EMACState *s = opaque;
    uint32_t value = 0;

    switch (addr) {
    case A_CAMCMR ... A_FFTCR:
    case A_DMARFC ... A_MGSTA:
    case A_MRPC ... A_CRXBSA:
        value = s->regs[addr / 4];
        break;
    case A_MPCNT:
        value = s->regs[R_MPCNT];
        s->regs[R_MPCNT] = 0;
        break;
    case A_TSDR:
    case A_RSDR:
        qemu_log_mask(LOG_GUEST_ERROR, "%s: read of write-only register 0x%"
                      HWADDR_PRIx "\n", emac_name(s), addr);
        break;
    case A_TSCTL ... A_TSALMSUBSEC:
        emac_unimp(s, addr);
        value = s->regs[addr / 4];
        break;
    default:
        emac_unimp(s, addr);
        break;
    }
    trace_nuc980_emac_read(emac_name(s), addr, value);
    return value;
}

static void emac_write(void *opaque, hwaddr addr, uint64_t data, unsigned size)
{
    NUC980EMACState *s = opaque;
    uint32_t value = data;

    trace_nuc980_emac_write(emac_name(s), addr, value);
    switch (addr) {
    case A_CAMCMR:
        s->regs[R_CAMCMR] = value & 0x1f;
        break;
    case A_CAM0M ... A_CAM15L:
        /* The second word of an entry has but two bytes of an address. */
        s->regs[addr / 4] = addr & 4 ? value & 0xffff0000 : value;
        break;
    case A_TXDLSA:
    case A_RXDLSA:
        s->regs[addr / 4] = value;
        break;
    case A_MCMDR:
        emac_write_mcmdr(s, value);
        break;
    case A_MIIDA:
        s->regs[R_MIIDA] = value;
        if (FIELD_EX32(value, MIIDA, BUSY)) {
            emac_mii(s);
        }
        break;
    case A_FFTCR:
        s->regs[R_FFTCR] = value & 0x00300303;
        break;
    case A_TSDR:
        emac_demand_tx(s);
        break;
    case A_RSDR:
        emac_demand_rx(s);
        break;
    case A_CAMEN:
    case A_MIID:
    case A_DMARFC:
    case A_MPCNT:
        s->regs[addr / 4] = value & 0xffff;
        break;
    case A_MIEN:
        s->regs[R_MIEN] = value & MISTA_BITS;
        emac_update_irq(s);
        break;
    case A_MISTA:
        s->regs[R_MISTA] &= ~value;
        emac_update_irq(s);
        break;
    case A_MGSTA:
        s->regs[R_MGSTA] &= ~value;     /* guess: as MISTA */
        break;
    case A_MRPC ... A_CRXBSA:
        qemu_log_mask(LOG_GUEST_ERROR, "%s: write to read-only register 0x%"
                      HWADDR_PRIx "\n", emac_name(s), addr);
        break;
    case A_TSCTL:
        /* A driver waits for these two to clear themselves. */
        value &= ~(R_TSCTL_TSIEN_MASK | R_TSCTL_TSUPDATE_MASK);
        /* fall through */
    case A_TSCTL + 4 ... A_TSALMSUBSEC:
        emac_unimp(s, addr);
        s->regs[addr / 4] = value;
        break;
    default:
        emac_unimp(s, addr);
        break;
    }
}

static const MemoryRegionOps emac_ops = {
    .read = emac_read,
    .write = emac_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = {
        .min_access_size = 4,
        .max_access_size = 4,
    },
};

/* ---- device ---- */

static void emac_set_rmii(void *opaque, int n, int level)
{
    NUC980EMACState *s = opaque;

    s->rmii = level;
    phy_update_link(s);
}

static void emac_set_mdio(void *opaque, int n, int level)
{
    NUC980_EMAC(opaque)->mdio = level;
}

static void emac_link_status_changed(NetClientState *nc)
{
    phy_update_link(qemu_get_nic_opaque(nc));
}

static NetClientInfo emac_net_info = {
    .type = NET_CLIENT_DRIVER_NIC,
    .size = sizeof(NICState),
    .receive = emac_receive,
    .link_status_changed = emac_link_status_changed,
};

/* The two pin inputs are others' outputs: they stay. */
static void emac_reset(DeviceState *dev)
{
    NUC980EMACState *s = NUC980_EMAC(dev);

    emac_reset_regs(s);
    phy_reset(s);
    s->link_failed = false;
}

static void emac_init(Object *obj)
{
    NUC980EMACState *s = NUC980_EMAC(obj);
    SysBusDevice *sbd = SYS_BUS_DEVICE(obj);

    memory_region_init_io(&s->iomem, obj, &emac_ops, s, TYPE_NUC980_EMAC,
                          NUC980_EMAC_SIZE);
    sysbus_init_mmio(sbd, &s->iomem);
    sysbus_init_irq(sbd, &s->tx_irq);
    sysbus_init_irq(sbd, &s->rx_irq);
    qdev_init_gpio_in_named(DEVICE(obj), emac_set_rmii, "rmii", 1);
    qdev_init_gpio_in_named(DEVICE(obj), emac_set_mdio, "mdio", 1);
}

static void emac_realize(DeviceState *dev, Error **errp)
{
    NUC980EMACState *s = NUC980_EMAC(dev);

    if (s->phy_addr > 31) {
        error_setg(errp, "phy-addr %u: a PHY's MII address is 0 to 31",
                   s->phy_addr);
        return;
    }
    s->tx_timer = timer_new_ns(QEMU_CLOCK_VIRTUAL, emac_tx_run, s);
    /* Only a label here: the guest writes its own address to the CAM. */
    qemu_macaddr_default_if_unset(&s->conf.macaddr);
    s->nic = qemu_new_nic(&emac_net_info, &s->conf, TYPE_NUC980_EMAC, dev->id,
                          &dev->mem_reentrancy_guard, s);
    qemu_format_nic_info_str(qemu_get_queue(s->nic), s->conf.macaddr.a);
}

static void emac_unrealize(DeviceState *dev)
{
    NUC980EMACState *s = NUC980_EMAC(dev);

    qemu_del_nic(s->nic);
    timer_free(s->tx_timer);
}

/* The cable is this machine's, whatever it was on the one that saved. */
static int emac_post_load(void *opaque, int version_id)
{
    NUC980EMACState *s = opaque;

    phy_update_link(s);
    emac_update_irq(s);
    return 0;
}

static const VMStateDescription vmstate_nuc980_emac = {
    .name = TYPE_NUC980_EMAC,
    .version_id = 1,
    .minimum_version_id = 1,
    .post_load = emac_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_TIMER_PTR(tx_timer, NUC980EMACState),
        VMSTATE_BOOL(rmii, NUC980EMACState),
        VMSTATE_BOOL(mdio, NUC980EMACState),
        VMSTATE_UINT32_ARRAY(regs, NUC980EMACState, NUC980_EMAC_REGS),
        VMSTATE_UINT32(tx_dma, NUC980EMACState),
        VMSTATE_UINT32(rx_dma, NUC980EMACState),
        VMSTATE_UINT16_ARRAY(phy, NUC980EMACState, NUC980_EMAC_PHY_REGS),
        VMSTATE_BOOL(link, NUC980EMACState),
        VMSTATE_BOOL(link_failed, NUC980EMACState),
        VMSTATE_END_OF_LIST()
    }
};

static Property emac_properties[] = {
    DEFINE_NIC_PROPERTIES(NUC980EMACState, conf),
    DEFINE_PROP_UINT8("phy-addr", NUC980EMACState, phy_addr, 1),
    DEFINE_PROP_END_OF_LIST(),
};

static void emac_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->desc = "Nuvoton NUC980 Ethernet MAC";
    dc->realize = emac_realize;
    dc->unrealize = emac_unrealize;
    dc->reset = emac_reset;
    dc->vmsd = &vmstate_nuc980_emac;
    set_bit(DEVICE_CATEGORY_NETWORK, dc->categories);
    device_class_set_props(dc, emac_properties);
}

static const TypeInfo emac_types[] = {
    {
        .name = TYPE_NUC980_EMAC,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980EMACState),
        .instance_init = emac_init,
        .class_init = emac_class_init,
    },
};

DEFINE_TYPES(emac_types)
