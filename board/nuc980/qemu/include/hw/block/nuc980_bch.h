/*
 * Nuvoton NUC980 flash memory interface: its error-correcting code
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_BLOCK_NUC980_BCH_H
#define HW_BLOCK_NUC980_BCH_H

/*
 * A binary BCH code over GF(2^15), p(x) = x^15 + x + 1, shortened to the
 * message. A message and its parity are bit streams, most significant bit of
 * each byte first; the first bit has the highest power. Parity is padded with
 * zeros to whole bytes.
 *
 * Source: Nuvoton's own encoder for NAND images ("To meet Nuvoton chip
 * design", 2011, among the tools of several of its chips with this interface);
 * pages read from a NUC970's flash have just this parity.
 */
typedef struct NUC980BCH NUC980BCH;

#define NUC980_BCH_MAX_T            24
#define NUC980_BCH_MAX_PARITY       45      /* bytes */

/* The code that corrects t errors; t is 4, 8, 12, 15 or 24. */
const NUC980BCH *nuc980_bch(unsigned t);

/* Bytes: 8, 15, 23, 29, 45 */
unsigned nuc980_bch_parity_size(const NUC980BCH *code);

void nuc980_bch_encode(const NUC980BCH *code, const uint8_t *message,
                       size_t size, uint8_t *parity);

/*
 * Compares a message with its parity. Returns the number of wrong bits and
 * where they are, counted from the message's first bit on into the parity and
 * in that order; or -1 if they are more than the code corrects.
 */
int nuc980_bch_decode(const NUC980BCH *code, const uint8_t *message,
                      size_t size, const uint8_t *parity,
                      unsigned where[NUC980_BCH_MAX_T]);

#endif /* HW_BLOCK_NUC980_BCH_H */
