/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Registers of the NUC980 that the probes use; names as in the vendor's header files. */
#ifndef NUC980_H
#define NUC980_H

#include <stdint.h>

#define REG(address) (*(volatile uint32_t *)(uintptr_t)(address))
#define BIT(n)       (1u << (n))

/* ---- system and clocks */
#define SYS_RSTSTS     REG(0xb000006c)
#define SYS_AHBIPRST   REG(0xb0000060)
#define SYS_MFP(port)  (&REG(0xb0000070 + 8 * ((port) - 'A'))) /* [0]: pins 0..7, [1]: pins 8..15 */
#define SYS_REGWPCTL   REG(0xb00001fc)
#define CLK_HCLKEN     REG(0xb0000210)
#define CLK_PCLKEN0    REG(0xb0000218)
#define CLK_DIV0       REG(0xb0000220)
#define CLK_DIV4(uart) REG(0xb0000230 + (uart) / 4 * 4) /* 8 bits a UART: [4:3] source, [7:5] divider - 1 */
#define CLK_DIV8       REG(0xb0000240) /* [9:8] source of the watchdog: 3 is the 32768 Hz crystal */
#define CLK_UPLLCON    REG(0xb0000264)
#define SDIC_SIZE0     REG(0xb0002010)

/* ---- interrupt controller */
#define AIC_SRCCTL(n) REG(0xb0042000 + ((n) & ~3)) /* 8 bits a source: [2:0] level, 0 is the FIQ */
#define AIC_RAWSTS(n) REG(0xb0042100 + (n) / 32 * 4)
#define AIC_IRQNUM    REG(0xb0042120)
#define AIC_FIQNUM    REG(0xb0042124)
#define AIC_INTEN(n)  REG(0xb0042130 + (n) / 32 * 4)
#define AIC_INTDIS(n) REG(0xb0042138 + (n) / 32 * 4)
#define AIC_EOIS      REG(0xb0042150)
#define AIC_EOFS      REG(0xb0042154)

#define IRQ_ETIMER(n)  ((const uint8_t[]){16, 17, 30, 31, 32, 34}[n])
#define IRQ_UART(n)    ((const uint8_t[]){36, 37, 38, 43, 39, 44, 40, 45, 41, 46}[n])
#define IRQ_EMAC_TX(n) (21 + (n))
#define IRQ_EMAC_RX(n) (19 + (n))
#define IRQ_GPIO(port) ((const uint8_t[]){8, 9, 10, 11, 49, 57, 63}[(port) - 'A'])
#define IRQ_WDT        1
#define IRQ_PDMA0      25
#define IRQ_FMI        28

/* ---- timers */
#define ETIMER(n)         (0xb0050000 + 0x1000 * ((n) / 2) + 0x100 * ((n) % 2))
#define ETIMER_CTL(n)     REG(ETIMER(n) + 0x00)
#define ETIMER_PRECNT(n)  REG(ETIMER(n) + 0x04)
#define ETIMER_CMPR(n)    REG(ETIMER(n) + 0x08)
#define ETIMER_IER(n)     REG(ETIMER(n) + 0x0c)
#define ETIMER_ISR(n)     REG(ETIMER(n) + 0x10)
#define ETIMER_DR(n)      REG(ETIMER(n) + 0x14)
#define ETIMER_ONE_SHOT   0x01
#define ETIMER_PERIODIC   0x11
#define ETIMER_CONTINUOUS 0x31

/* ---- watchdog */
#define WDT_CTL     REG(0xb0040000)
#define WDT_RSTCNT  REG(0xb0040008)
#define WDT_RSTEN   BIT(1)
#define WDT_RSTF    BIT(2)
#define WDT_IF      BIT(3)
#define WDT_INTEN   BIT(6)
#define WDT_WDTEN   BIT(7)
#define WDT_TOUT(n) ((n) << 8)
#define WDT_KEY     0x5aa5

/* ---- UART */
#define UART(n)        (0xb0070000 + 0x1000 * (n))
#define UART_DAT(n)    REG(UART(n) + 0x00)
#define UART_IER(n)    REG(UART(n) + 0x04)
#define UART_FCR(n)    REG(UART(n) + 0x08)
#define UART_LCR(n)    REG(UART(n) + 0x0c)
#define UART_FSR(n)    REG(UART(n) + 0x18)
#define UART_ISR(n)    REG(UART(n) + 0x1c)
#define UART_TOR(n)    REG(UART(n) + 0x20)
#define UART_BAUD(n)   REG(UART(n) + 0x24)
#define IER_RDA        BIT(0)
#define IER_THRE       BIT(1)
#define IER_RXTO       BIT(4)
#define IER_TOCNTEN    BIT(11)
#define IER_TXPDMAEN   BIT(14)
#define IER_RXPDMAEN   BIT(15)
#define FCR_RESET      (BIT(1) | BIT(2))
#define FCR_TRIGGER_1  0x00
#define FCR_TRIGGER_8  0x20
#define FCR_TRIGGER_14 0x30
#define FSR_RX_OVER    BIT(0)
#define FSR_RX_EMPTY   BIT(14)
#define FSR_TX_EMPTY   BIT(22)
#define FSR_TX_FULL    BIT(23)
#define FSR_TX_DONE    BIT(28)
#define ISR_RDA_INT    BIT(8)
#define ISR_THRE_INT   BIT(9)
#define ISR_RXTO_INT   BIT(12)

/* ---- PDMA */
#define PDMA0           0xb0008000
#define PDMA_CTL(c)     REG(PDMA0 + 0x00 + 16 * (c))
#define PDMA_SA(c)      REG(PDMA0 + 0x04 + 16 * (c))
#define PDMA_DA(c)      REG(PDMA0 + 0x08 + 16 * (c))
#define PDMA_NEXT(c)    REG(PDMA0 + 0x0c + 16 * (c))
#define PDMA_CHCTL      REG(PDMA0 + 0x400)
#define PDMA_INTEN      REG(PDMA0 + 0x418)
#define PDMA_INTSTS     REG(PDMA0 + 0x41c)
#define PDMA_TDSTS      REG(PDMA0 + 0x424)
#define PDMA_TOUTPSC    REG(PDMA0 + 0x430)
#define PDMA_TOUTEN     REG(PDMA0 + 0x434)
#define PDMA_TOUTIEN    REG(PDMA0 + 0x438)
#define PDMA_TOC(c)     REG(PDMA0 + 0x440 + 4 * ((c) / 2))
#define PDMA_CHRST      REG(PDMA0 + 0x460)
#define PDMA_REQSEL(c)  REG(PDMA0 + 0x480 + 4 * ((c) / 4))
#define PDMA_BASIC      1u
#define PDMA_SCATTER    2u
#define PDMA_SINGLE     BIT(2)
#define PDMA_SA_FIXED   (3u << 8)
#define PDMA_DA_FIXED   (3u << 10)
#define PDMA_COUNT(n)   (((n)-1u) << 16)
#define PDMA_UART_TX(n) (4u + 2 * (n)) /* UART0..7 */
#define PDMA_UART_RX(n) (5u + 2 * (n))

/* ---- Ethernet */
#define EMAC(n)        (0xb0012000 + 0x10000 * (n))
#define EMAC_CAMCMR(n) REG(EMAC(n) + 0x00)
#define EMAC_CAMEN(n)  REG(EMAC(n) + 0x04)
#define EMAC_CAM0M(n)  REG(EMAC(n) + 0x08)
#define EMAC_CAM0L(n)  REG(EMAC(n) + 0x0c)
#define EMAC_TXDLSA(n) REG(EMAC(n) + 0x88)
#define EMAC_RXDLSA(n) REG(EMAC(n) + 0x8c)
#define EMAC_MCMDR(n)  REG(EMAC(n) + 0x90)
#define EMAC_MIID(n)   REG(EMAC(n) + 0x94)
#define EMAC_MIIDA(n)  REG(EMAC(n) + 0x98)
#define EMAC_TSDR(n)   REG(EMAC(n) + 0xa0)
#define EMAC_RSDR(n)   REG(EMAC(n) + 0xa4)
#define EMAC_DMARFC(n) REG(EMAC(n) + 0xa8)
#define EMAC_MIEN(n)   REG(EMAC(n) + 0xac)
#define EMAC_MISTA(n)  REG(EMAC(n) + 0xb0)
#define MCMDR_RXON     BIT(0)
#define MCMDR_SPCRC    BIT(5)
#define MCMDR_TXON     BIT(8)
#define MCMDR_FDUP     BIT(18)
#define MCMDR_100M     BIT(20)
#define MCMDR_SWR      BIT(24)
#define MIIDA_BUSY     BIT(17)
#define MIIDA_MDCON    BIT(19)
#define CAMCMR_AUP     BIT(0)
#define CAMCMR_ABP     BIT(2)
#define CAMCMR_ECMP    BIT(4)
#define MISTA_RXINTR   BIT(0)
#define MISTA_RXGD     BIT(4)
#define MISTA_TXINTR   BIT(16)
#define MISTA_TXCP     BIT(18)
#define RXDS_OWN_DMA   BIT(31)
#define RXDS_RXGD      BIT(20)
#define TXDS_OWN_DMA   BIT(31)
#define TXDS_INTERRUPT BIT(2)
#define TXDS_CRC       BIT(1)
#define TXDS_PAD       BIT(0)
#define TXDS_TXCP      BIT(19)

/* ---- GPIO */
#define GPIO(port)         (0xb0004000 + 0x40 * ((port) - 'A'))
#define GPIO_MODE(port)    REG(GPIO(port) + 0x00) /* 2 bits a pin: 0 in, 1 out */
#define GPIO_DOUT(port)    REG(GPIO(port) + 0x08)
#define GPIO_PIN(port)     REG(GPIO(port) + 0x10)
#define GPIO_INTTYPE(port) REG(GPIO(port) + 0x18)
#define GPIO_INTEN(port)   REG(GPIO(port) + 0x1c) /* [15:0] falling, [31:16] rising */
#define GPIO_INTSRC(port)  REG(GPIO(port) + 0x20)

/* ---- NAND */
#define FMI_DMACTL     REG(0xb0019400)
#define FMI_DMASA      REG(0xb0019408)
#define FMI_CTL        REG(0xb0019800)
#define NAND_CTL       REG(0xb00198a0)
#define NAND_INTEN     REG(0xb00198a8)
#define NAND_INTSTS    REG(0xb00198ac)
#define NAND_CMD       REG(0xb00198b0)
#define NAND_ADDR      REG(0xb00198b4)
#define NAND_DATA      REG(0xb00198b8)
#define NAND_RACTL     REG(0xb00198bc)
#define NAND_ECTL      REG(0xb00198c0)
#define NAND_ECCSTS(n) REG(0xb00198d0 + 4 * (n))
#define NAND_RA(n)     REG(0xb0019a00 + 4 * (n))
#define NAND_CTL_RST   BIT(0)
#define NAND_CTL_READ  BIT(1)
#define NAND_CTL_WRITE BIT(2)
#define NAND_CTL_SPARE BIT(4) /* parity goes out with the data */
#define NAND_CTL_3B    BIT(8)
#define NAND_CTL_2K    BIT(16)
#define NAND_CTL_T8    BIT(20)
#define NAND_CTL_ECC   BIT(23)
#define NAND_CTL_CS0   BIT(25) /* active low */
#define NAND_CTL_CS1   BIT(26)
#define NAND_DONE      BIT(0)
#define NAND_ECC_EVENT BIT(2)
#define NAND_READY     BIT(10)

#endif
