/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A file of captured frames (pcapng, draft-ietf-opsawg-pcapng). A serial line is no link that Wireshark knows, so each frame says which
 * of its dissectors reads it: link type 252, "exported PDU".
 */
#ifndef OPENRTU_RTUCTL_PCAPNG_H
#define OPENRTU_RTUCTL_PCAPNG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

struct pcapng {
	FILE *file;
};

/* Path "-": standard output. False: errno. */
bool pcapng_begin(struct pcapng *pcapng, const char *path);
/* They count from 0. All come before the first frame. */
void pcapng_interface(struct pcapng *pcapng, const char *name);
/* wall_ns: since 1970. */
void pcapng_frame(struct pcapng *pcapng, uint32_t interface, const char *dissector, bool sent,
		  const uint8_t *octets, size_t length, int64_t wall_ns);
/* False: what was written so far has not reached the file, errno says why. */
bool pcapng_flush(struct pcapng *pcapng);
bool pcapng_end(struct pcapng *pcapng);

#endif
