/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Reads a flattened device tree where it lies: Devicetree Specification 0.4, chapter 5. */
#include "kernel.h"

#include <stdbool.h>

#define FDT_MAGIC      0xd00dfeed
#define FDT_BEGIN_NODE 1
#define FDT_END_NODE   2
#define FDT_PROP       3
#define FDT_NOP        4

uint32_t be32(const void *number)
{
	const uint8_t *byte = number;

	return (uint32_t)byte[0] << 24 | (uint32_t)byte[1] << 16 | (uint32_t)byte[2] << 8 | byte[3];
}

static bool same(const char *one, const char *other)
{
	while (*one && *one == *other) {
		one++;
		other++;
	}
	return *one == *other;
}

static uint32_t length(const char *text)
{
	uint32_t n = 0;

	while (text[n])
		n++;
	return n;
}

/* The path's rest when its first part is this node's name, else NULL. */
static const char *below(const char *path, const char *node)
{
	path++; /* the slash */
	while (*node && *node == *path) {
		node++;
		path++;
	}
	return *node == '\0' && (*path == '/' || *path == '\0') ? path : NULL;
}

const void *tree_property(const void *tree, const char *path, const char *name, uint32_t *size)
{
	const uint8_t *at = (const uint8_t *)tree + be32((const uint8_t *)tree + 8);
	const char *names = (const char *)tree + be32((const uint8_t *)tree + 12);
	unsigned depth = 0, found = 0; /* of the node at hand, and of the last one on the path */

	if (be32(tree) != FDT_MAGIC)
		return NULL;
	if (same(path, "/"))
		path++;
	for (;;) {
		const uint32_t token = be32(at);
		at += 4;
		if (token == FDT_BEGIN_NODE) {
			const char *node = (const char *)at;
			const char *rest = depth && *path ? below(path, node) : NULL;

			if (depth == 0 || (depth == found && rest)) {
				path = depth ? rest : path;
				found++;
			}
			depth++;
			at += (length(node) + 4) & ~3u;
		} else if (token == FDT_PROP) {
			*size = be32(at);
			if (depth == found && !*path && same(names + be32(at + 4), name))
				return at + 8;
			at += 8 + ((*size + 3) & ~3u);
		} else if (token == FDT_END_NODE) {
			if (depth-- == found) /* left without having found it */
				return NULL;
		} else if (token != FDT_NOP) {
			return NULL;
		}
	}
}
