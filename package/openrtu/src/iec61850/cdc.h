/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Common data classes (IEC 61850-7-3): which attributes a data object has, by functional constraint. */
#ifndef OPENRTU_IEC61850_CDC_H
#define OPENRTU_IEC61850_CDC_H

#include "iec61850/ln_class.h"

/* Functional constraints (IEC 61850-7-2, table 18), in the order of their names. */
enum iec61850_fc {
	IEC61850_BR,
	IEC61850_CF,
	IEC61850_CO,
	IEC61850_DC,
	IEC61850_EX,
	IEC61850_MX,
	IEC61850_RP,
	IEC61850_ST,
	IEC61850_FCS,
};

/* How a data object is controlled (IEC 61850-7-3, CtlModelKind). */
enum iec61850_ctl_kind {
	IEC61850_STATUS_ONLY,
	IEC61850_DIRECT_NORMAL,
	IEC61850_SBO_NORMAL,
	IEC61850_DIRECT_ENHANCED,
	IEC61850_SBO_ENHANCED,
	IEC61850_CTL_MODELS,
};

/* What a data attribute is: its type on the wire, and which part of a data object's state it shows. */
enum iec61850_leaf {
	IEC61850_STRUCTURE,
	IEC61850_BOOLEAN,    /* number */
	IEC61850_DOUBLE,     /* number: a bit string of two */
	IEC61850_ENUM,       /* number, 8 bits */
	IEC61850_INTEGER,    /* number, 32 bits */
	IEC61850_TOTAL,      /* number, 64 bits */
	IEC61850_FLOAT,      /* real */
	IEC61850_STEP,       /* number, 8 bits: a step position */
	IEC61850_TRANSIENT,  /* whether it moves */
	IEC61850_DIRECTION,  /* of a fault: not known */
	IEC61850_RANGE,      /* of a value with limits */
	IEC61850_PERSISTENT, /* whether a command goes on until it is ended: false */
	IEC61850_UNIT,       /* of a counter's pulse: 1 */
	IEC61850_SI_UNIT,    /* of a value */
	IEC61850_MULTIPLIER,
	IEC61850_DEADBAND,     /* all of the next one: 100 % of it, in thousandths */
	IEC61850_DEADBAND_REF, /* real: the point's deadband */
	IEC61850_LEAST,        /* real, this and the next two: what it may be set to */
	IEC61850_MOST,
	IEC61850_STEP_SIZE,
	IEC61850_HIGH_HIGH, /* real, this and the next three: its limits */
	IEC61850_HIGH,
	IEC61850_LOW,
	IEC61850_LOW_LOW,
	IEC61850_MEASURED_LEAST, /* real, this and the next one: of all that it can be */
	IEC61850_MEASURED_MOST,
	IEC61850_CTL_MODEL,    /* how it is controlled */
	IEC61850_SELD,         /* whether it is selected */
	IEC61850_SBO_TIMEOUT,  /* milliseconds that a selection lasts */
	IEC61850_OPER_TIMEOUT, /* ... and an execution, at most */
	IEC61850_QUALITY,
	IEC61850_TIME,
	IEC61850_DESCRIPTION,
	IEC61850_VENDOR,
	IEC61850_REVISION,
	IEC61850_CONFIGURATION,
	IEC61850_NAME_SPACE,
	/* Of a command: what is read of them means nothing. */
	IEC61850_SBO,
	IEC61850_SBOW, /* this and the next two: structures */
	IEC61850_OPER,
	IEC61850_CANCEL,
	IEC61850_OR_IDENT,
	IEC61850_CTL_NUM,
	IEC61850_CHECK,
	/* Of a report control block: */
	IEC61850_RPT_ID,
	IEC61850_RPT_ENA,
	IEC61850_RESV,
	IEC61850_DAT_SET,
	IEC61850_CONF_REV,
	IEC61850_OPT_FLDS,
	IEC61850_BUF_TM,
	IEC61850_SQ_NUM,
	IEC61850_TRG_OPS,
	IEC61850_INTG_PD,
	IEC61850_GI,
	/* Of a buffered one besides: */
	IEC61850_LONG_SQ_NUM,
	IEC61850_PURGE_BUF,
	IEC61850_ENTRY_ID,
	IEC61850_TIME_OF_ENTRY,
	IEC61850_RESV_TMS,
	/* Of both: */
	IEC61850_OWNER,
};

struct iec61850_node {
	const char *name;
	enum iec61850_leaf leaf;
	const struct iec61850_node *children;
	unsigned count;
};

/* The nodes of a data object under a functional constraint. */
struct iec61850_nodes {
	const struct iec61850_node *nodes;
	unsigned count;
};

/* What data of a class, controlled so, has under a functional constraint but CF and CO; nothing: count 0. */
struct iec61850_nodes iec61850_cdc_nodes(enum iec61850_cdc cdc, enum iec61850_ctl_kind model,
					 enum iec61850_fc fc);
/* What it has under CF, if its point has limits (of a set-point; else a deadband), and a unit. */
struct iec61850_nodes iec61850_cdc_settings(enum iec61850_cdc cdc, enum iec61850_ctl_kind model, bool limits,
					    bool unit);
/* Whether it has a ctlModel. */
bool iec61850_cdc_is_controllable(enum iec61850_cdc cdc);
/* Finds an attribute, as mag.f, inside. NULL: there is none. */
const struct iec61850_node *iec61850_cdc_find(struct iec61850_nodes inside, const char *path);
/* What it has under CO when it is controlled so. */
struct iec61850_nodes iec61850_cdc_services(enum iec61850_cdc cdc, enum iec61850_ctl_kind model);

#endif
