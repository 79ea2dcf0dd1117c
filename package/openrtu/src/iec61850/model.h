/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The map as a server of IEC 61850 shows it. A common address, which is a device, is a logical device: IED + "CA" + number. In it
 * LLN0 and LPHD1, the logical nodes that the configuration has given points to, and GGIO1 with a data object for each other
 * point, whose name ends with the point's IOA. Nothing of it is stored but the order of the points and of their logical nodes: names are
 * made and found as they are asked for.
 */
#ifndef OPENRTU_IEC61850_MODEL_H
#define OPENRTU_IEC61850_MODEL_H

#include "iec61850/cdc.h"
#include "iec61850/config.h"
#include "iec61850/kept.h"
#include "iec61850/unit.h"
#include "map/map.h"

#define IEC61850_NAME_SIZE       65 /* an MMS identifier has 64 characters at most (IEC 61850-8-1, 7.3.1) */
#define IEC61850_OR_IDENT_SIZE   64
#define IEC61850_DATA_NAME_SPACE "IEC 61850-7-4:2007B" /* ldNs */
#define IEC61850_REFERENCE_SIZE  (2 * IEC61850_NAME_SIZE)

/* The first two logical nodes of each logical device. */
enum { IEC61850_LLN0, IEC61850_LPHD1, IEC61850_LNS_FIXED };

/* A logical node: what it has without points, then its points. */
struct iec61850_ln {
	const struct iec61850_ln_class *class;
	char name[IEC61850_LN_SIZE];
	uint32_t without;                  /* bit n: data n of the class is there without a point */
	uint32_t fixed;                    /* so many bits */
	uint32_t first, count;             /* of the model's points */
	uint32_t first_block, block_count; /* of the device's, behind the points */
	bool sorted;                       /* in the order of their IOAs, by which they are named */
};

#define IEC61850_NO_MEMBER UINT32_MAX

/* A data set. If the configuration has none of a logical device: status, what its points have under ST, and measured, under MX. */
struct iec61850_set {
	const char *ln; /* NULL: it is an association's own */
	const char *name;
	uint32_t first, count; /* of the model's members */
	uint32_t revision;     /* ConfRev: another one when the members are others */
};

#define IEC61850_LISTS        16 /* data sets that clients have made, at a time */
#define IEC61850_LIST_MEMBERS 64 /* of one */

/* A data set that a client has made: iec61850/list.h. Its set has its number behind those of the configuration. */
struct iec61850_list {
	bool used;
	const void *client; /* whose it is; NULL: everybody's, until somebody deletes it */
	const struct iec61850_device *device;
	char ln[IEC61850_LN_SIZE], name[IEC61850_SET_SIZE];
};

/* TrgOps, and the reasons for inclusion; OptFlds (IEC 61850-8-1, tables 38 and 39): the first bit in the most significant place. */
enum iec61850_trigger {
	IEC61850_DATA_CHANGE = 0x40,
	IEC61850_QUALITY_CHANGE = 0x20,
	IEC61850_DATA_UPDATE = 0x10,
	IEC61850_INTEGRITY = 0x08,
	IEC61850_GENERAL = 0x04,
	IEC61850_TRIGGERS = 0x7c,
	/* No triggers. What a data change is to range and to stSeld, which are not told else: and stSeld as it was then. */
	IEC61850_RANGE_CHANGE = 0x01,
	IEC61850_SELECTION_CHANGE = 0x02,
	IEC61850_WAS_SELECTED = 0x80,
};
enum iec61850_option {
	IEC61850_SEQUENCE = 0x4000,
	IEC61850_TIME_STAMP = 0x2000,
	IEC61850_REASON = 0x1000,
	IEC61850_SET_NAME = 0x0800,
	IEC61850_REFERENCE = 0x0400,
	IEC61850_OVERFLOW = 0x0200,
	IEC61850_ENTRY = 0x0100,
	IEC61850_CONF_REVISION = 0x0080,
	IEC61850_SEGMENTATION = 0x0040,
	IEC61850_OPTIONS = 0x7cc0, /* of an unbuffered block */
	IEC61850_ALL_OPTIONS = 0x7fc0,
};

/* Where a client is, as an IPv6 address. */
struct iec61850_peer {
	uint8_t octets[16];
};

/* A report control block. */
struct iec61850_block {
	const struct iec61850_device *device;
	struct iec61850_block *next_enabled;
	uint32_t ln;      /* of the device's */
	const char *name; /* before its index */
	uint8_t index;    /* from 1 */
	bool buffered;
	uint32_t set;              /* of the model's */
	uint32_t own_set;          /* that it has of the configuration */
	uint32_t kept_number;      /* of a buffered one: of its reader */
	const void *owner;         /* the association that has it; NULL: none */
	struct iec61850_peer peer; /* of the owner, or of the former one while the block is kept for it */
	int64_t reserved_ns;       /* so long it is kept for the owner that is gone */
	char *id;                  /* in the model's ids; empty: its reference */
	bool enabled, reserved;
	uint8_t triggers;
	uint16_t number;  /* SqNum of the next report */
	uint16_t segment; /* SubSqNum of the next one */
	uint16_t options;
	uint32_t buffer_ms, integrity_ms;
	int64_t due_ns;                   /* of what is pending; 0: nothing is */
	int64_t integrity_ns;             /* of the next integrity report */
	struct iec61850_kept_block *kept; /* of a buffered one, in its reader */
	struct map_history_reader *reader;
	uint8_t *reasons; /* of each member: why it is to be reported, 0: it is not */
};

struct iec61850_device {
	uint16_t ca;
	uint32_t first, count;   /* of the model's points */
	struct iec61850_ln *lns; /* in the order in which clients see them */
	uint32_t ln_count;
	uint32_t first_set, set_count; /* of the model's, in the order of their names */
	struct iec61850_block *blocks;
	uint32_t block_count;
};

/* Where a point is in the model. */
struct iec61850_place {
	uint32_t number : 24; /* of its data object in ln: there are no more than IOAs */
	uint32_t fc : 8;      /* under which its value is: enum iec61850_fc */
	uint32_t member;      /* the first one that it is; IEC61850_NO_MEMBER: of no data set */
	uint16_t device, ln;
};

struct iec61850_model {
	const struct map *map;
	const struct map_config *config;
	const struct iec61850_settings *settings;
	uint32_t *points;                            /* sorted by common address, logical node, and IOA */
	const struct iec61850_assignment **assigned; /* to each point; NULL: it is one of GGIO1 */
	struct iec61850_ln *lns;                     /* of all devices */
	uint32_t ln_count;
	struct iec61850_device *devices;
	uint32_t device_count;
	struct iec61850_set *sets; /* of the configuration, then of lists */
	uint32_t set_count;        /* of the configuration */
	uint32_t longest_set;      /* members that a set can have */
	struct iec61850_list lists[IEC61850_LISTS];
	/*
	 * Of each member of a data set: the point, the attribute of it (NULL: all that it has under its functional constraint), and the
	 * earlier member that is of the same point, and one more (0: there is none). Memory that nobody has written to takes none.
	 */
	uint32_t *members;
	const struct iec61850_node **nodes;
	uint32_t *earlier;
	uint32_t member_count;
	struct iec61850_block *blocks; /* of all devices */
	uint32_t block_count;
	struct iec61850_block *enabled; /* those that are, the last one last: most never are */
	/* Of each block. Hardly one has any, and memory that nobody has written to takes none. */
	char (*ids)[IEC61850_RPT_ID_SIZE];
	uint8_t *reasons;
	size_t reason_count;
	struct iec61850_place *places;
	struct iec61850_unit units[MAP_UNITS_MAX + 1]; /* by number in map_point.unit */
	bool *selected;                                /* each point, as it was told last */
	struct map_sample *image; /* of each point, as the events have it that were taken */
	struct iec61850_buffer buffer;
	uint32_t revision; /* of the configuration, as configRev shows it */
	int64_t started_ns;
};

#define IEC61850_WHOLE UINT32_MAX

/* A named variable: a logical node, a functional constraint in it, a data object, or an attribute. */
struct iec61850_object {
	const struct iec61850_device *device;
	uint32_t ln;                      /* of the device's */
	uint32_t fc;                      /* enum iec61850_fc; IEC61850_WHOLE: all */
	uint32_t number;                  /* of the data object in its logical node; IEC61850_WHOLE: all */
	const struct iec61850_node *node; /* NULL: all of the data object under fc */
};

/* What a data object is made of. */
struct iec61850_class {
	const char *name;                      /* its common data class */
	enum iec61850_enumeration enumeration; /* of its stVal */
	bool controllable;
	bool has_limits, has_unit, has_range; /* of its point */
	enum iec61850_ctl_kind control;
};

/* The model of a configuration, without what happens in its map. False: no memory. The configuration stays. */
bool iec61850_model_of(struct iec61850_model *model, const struct map_config *config);
/* The same of a map's. */
bool iec61850_model_begin(struct iec61850_model *model, const struct map *map);
void iec61850_model_end(struct iec61850_model *model);

/* ---- names ------------------------------------------------------------------------------- */

void iec61850_device_name(const struct iec61850_model *model, const struct iec61850_device *device,
			  char out[IEC61850_NAME_SIZE]);
/* NULL: there is none of this name. */
const struct iec61850_device *iec61850_find_device(const struct iec61850_model *model, const uint8_t *name,
						   size_t size);
/* Finds a variable as MMS names it, like GGIO1$MX$AnIn30001$mag$f. */
bool iec61850_find(const struct iec61850_model *model, const struct iec61850_device *device,
		   const uint8_t *name, size_t size, struct iec61850_object *out);
const char *iec61850_fc_name(uint32_t fc);
void iec61850_object_name(const struct iec61850_model *model, const struct iec61850_object *object,
			  char out[IEC61850_NAME_SIZE]);

/* The same of an attribute too, as GGIO1$MX$AnIn30001$mag$f. */
void iec61850_variable_name(const struct iec61850_model *model, const struct iec61850_object *object,
			    char out[IEC61850_NAME_SIZE]);

/* d: the point's name, or the device's. */
void iec61850_description(const struct iec61850_model *model, const struct iec61850_object *object,
			  char out[MAP_NAME_SIZE]);

/* ---- structure --------------------------------------------------------------------------- */

/* How many data objects a logical node has. */
uint32_t iec61850_object_count(const struct iec61850_device *device, uint32_t ln);
/* What a data object has under a functional constraint; nothing: count 0. */
struct iec61850_nodes iec61850_nodes_of(const struct iec61850_model *model,
					const struct iec61850_device *device, uint32_t ln, uint32_t number,
					enum iec61850_fc fc);
/* Whether a logical node has anything under it. */
bool iec61850_has(const struct iec61850_model *model, const struct iec61850_device *device, uint32_t ln,
		  enum iec61850_fc fc);
/* The class of a data object, which is no control block. */
struct iec61850_class iec61850_class_of(const struct iec61850_model *model,
					const struct iec61850_object *object);
/* The unit in which a point's value is shown. */
struct iec61850_unit iec61850_unit_of(const struct iec61850_model *model, const struct map_point *point);
/* The data object of a point. */
struct iec61850_object iec61850_object_of(const struct iec61850_model *model, uint32_t point);
/* How a point is controlled: as the configuration has it, if anybody may. */
enum iec61850_ctl_kind iec61850_ctl_model(const struct iec61850_model *model, uint32_t point);
/* The report control block that a data object is; NULL: it is none. */
struct iec61850_block *iec61850_block_of(const struct iec61850_device *device, uint32_t ln, uint32_t number);
/* The object that a control block is. */
struct iec61850_object iec61850_block_object(const struct iec61850_block *block);
static inline const struct iec61850_set *iec61850_set_of(const struct iec61850_model *model,
							 const struct iec61850_block *block)
{
	return &model->sets[block->set];
}
/* The name of a data set in its logical device, as LLN0$status. */
void iec61850_set_name(const struct iec61850_set *set, char out[IEC61850_NAME_SIZE]);
/* The data set of this name. NULL: there is none. */
const struct iec61850_set *iec61850_find_set(const struct iec61850_model *model,
					     const struct iec61850_device *device, const uint8_t *name,
					     size_t size);
/* The data object of a set's member. */
struct iec61850_object iec61850_member(const struct iec61850_model *model, const struct iec61850_set *set,
				       uint32_t member);
/* The last member of the set that is of a point, and then those before it. IEC61850_NO_MEMBER: there is none. */
uint32_t iec61850_last_member(const struct iec61850_model *model, uint32_t point, uint32_t set);
uint32_t iec61850_member_before(const struct iec61850_model *model, uint32_t member, uint32_t set);
/* The one before it, of any set. */
static inline uint32_t iec61850_earlier(const struct iec61850_model *model, uint32_t member)
{
	return model->earlier[member] - 1; /* 0: IEC61850_NO_MEMBER */
}
/* Whether a member of the model's is one of the set. */
static inline bool iec61850_set_has(const struct iec61850_model *model, uint32_t set, uint32_t member)
{
	return member - model->sets[set].first < model->sets[set].count;
}
/* Adds a member to the set that was made last. */
void iec61850_add_member(struct iec61850_model *model, uint32_t set, uint32_t member, uint32_t point,
			 const struct iec61850_node *node);
/* Takes away all of a set's. */
void iec61850_clear_set(struct iec61850_model *model, uint32_t set);
/* The point that a data object shows; MAP_NONE: it is the logical device's own. */
uint32_t iec61850_point_of(const struct iec61850_model *model, const struct iec61850_object *object);

#endif
