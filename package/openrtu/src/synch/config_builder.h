/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What the readers of the net know of each other: the tables while they are put together. */
#ifndef OPENRTU_SYNCH_CONFIG_BUILDER_H
#define OPENRTU_SYNCH_CONFIG_BUILDER_H

#include "config/files.h"
#include "synch/config.h"

struct synch_builder {
	struct config_loader *loader;
	struct synch_tables *tables;
};

/* Each reports at the place what is wrong; SYNCH_NOTHING: it has. */
uint8_t synch_add_place(struct synch_builder *builder, const struct config_place *place, const char *name,
			uint16_t tokens, uint16_t capacity);
uint8_t synch_add_transition(struct synch_builder *builder, const struct config_place *place,
			     const char *name);
void synch_add_arc(struct synch_builder *builder, const struct config_place *place, enum synch_arc_kind kind,
		   uint8_t from_place, uint8_t transition, uint8_t weight);
/* The participant of that name, which is added with its first mention. */
uint8_t synch_take_participant(struct synch_builder *builder, const struct config_place *place,
			       const char *name);
uint8_t synch_find_place(const struct synch_tables *tables, const char *name);
uint8_t synch_find_transition(const struct synch_tables *tables, const char *name);
/* Arcs by transition, as the engine wants them. */
void synch_order_arcs(struct synch_tables *tables);

/* ---- config_arrows.c: the simple form ---------------------------------------------------- */

void synch_read_arrows(struct synch_builder *builder, const struct config_place *array, const json_t *arrows);
/* Who may begin first. Behind synch_read_arrows. */
void synch_read_start(struct synch_builder *builder, const struct config_place *array, const json_t *names);

/* ---- config_net.c: the full form --------------------------------------------------------- */

void synch_read_net(struct synch_builder *builder, const struct config_place *place, const json_t *net);
/* What no module fires. When all is read. */
void synch_check_fired(struct synch_builder *builder, const struct config_place *place);

/* Of "net". */
extern const struct config_table synch_net_table;

#endif
