/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/cdc.h"

#include <string.h>

#define COUNT(array) ((unsigned)(sizeof(array) / sizeof((array)[0])))

static const struct iec61850_node analogue[] = {{"f", IEC61850_FLOAT, NULL, 0}};

#define STATUS(name, leaf)                                                                                   \
	static const struct iec61850_node name[] = {                                                         \
	    {"stVal", leaf, NULL, 0}, {"q", IEC61850_QUALITY, NULL, 0}, {"t", IEC61850_TIME, NULL, 0}}
/* Of what is controlled: the last one only if it is selected before (IEC 61850-7-3, presence condition MOsbo). */
#define SELECTED(name, leaf)                                                                                 \
	static const struct iec61850_node name[] = {{"stVal", leaf, NULL, 0},                                \
						    {"q", IEC61850_QUALITY, NULL, 0},                        \
						    {"t", IEC61850_TIME, NULL, 0},                           \
						    {"stSeld", IEC61850_SELD, NULL, 0}}
#define MEASURED(name, value)                                                                                \
	static const struct iec61850_node name[] = {{value, IEC61850_STRUCTURE, analogue, COUNT(analogue)},  \
						    {"q", IEC61850_QUALITY, NULL, 0},                        \
						    {"t", IEC61850_TIME, NULL, 0}}

STATUS(sps, IEC61850_BOOLEAN);
STATUS(dps, IEC61850_DOUBLE);
STATUS(ins, IEC61850_INTEGER);
STATUS(ens, IEC61850_ENUM);
SELECTED(spc, IEC61850_BOOLEAN);
SELECTED(dpc, IEC61850_DOUBLE);
SELECTED(inc, IEC61850_INTEGER);
static const struct iec61850_node act[] = {
    {"general", IEC61850_BOOLEAN, NULL, 0}, {"q", IEC61850_QUALITY, NULL, 0}, {"t", IEC61850_TIME, NULL, 0}};
static const struct iec61850_node acd[] = {{"general", IEC61850_BOOLEAN, NULL, 0},
					   {"dirGeneral", IEC61850_DIRECTION, NULL, 0},
					   {"q", IEC61850_QUALITY, NULL, 0},
					   {"t", IEC61850_TIME, NULL, 0}};
static const struct iec61850_node step[] = {{"posVal", IEC61850_STEP, NULL, 0},
					    {"transInd", IEC61850_TRANSIENT, NULL, 0}};
MEASURED(mv, "mag");
static const struct iec61850_node apc[] = {{"mxVal", IEC61850_STRUCTURE, analogue, COUNT(analogue)},
					   {"q", IEC61850_QUALITY, NULL, 0},
					   {"t", IEC61850_TIME, NULL, 0},
					   {"stSeld", IEC61850_SELD, NULL, 0}};
static const struct iec61850_node mv_range[] = {{"mag", IEC61850_STRUCTURE, analogue, COUNT(analogue)},
						{"range", IEC61850_RANGE, NULL, 0},
						{"q", IEC61850_QUALITY, NULL, 0},
						{"t", IEC61850_TIME, NULL, 0}};
static const struct iec61850_node tap[] = {{"valWTr", IEC61850_STRUCTURE, step, COUNT(step)},
					   {"q", IEC61850_QUALITY, NULL, 0},
					   {"t", IEC61850_TIME, NULL, 0}};
static const struct iec61850_node bcr[] = {
    {"actVal", IEC61850_TOTAL, NULL, 0}, {"q", IEC61850_QUALITY, NULL, 0}, {"t", IEC61850_TIME, NULL, 0}};
static const struct iec61850_node unit[] = {{"SIUnit", IEC61850_SI_UNIT, NULL, 0},
					    {"multiplier", IEC61850_MULTIPLIER, NULL, 0}};
#define LIMIT(name, leaf) static const struct iec61850_node name[] = {{"f", leaf, NULL, 0}}
LIMIT(least, IEC61850_LEAST);
LIMIT(most, IEC61850_MOST);
LIMIT(step_size, IEC61850_STEP_SIZE);
LIMIT(high_high, IEC61850_HIGH_HIGH);
LIMIT(high, IEC61850_HIGH);
LIMIT(low, IEC61850_LOW);
LIMIT(low_low, IEC61850_LOW_LOW);
LIMIT(measured_least, IEC61850_MEASURED_LEAST);
LIMIT(measured_most, IEC61850_MEASURED_MOST);
static const struct iec61850_node range[] = {
    {"hhLim", IEC61850_STRUCTURE, high_high, 1},    {"hLim", IEC61850_STRUCTURE, high, 1},
    {"lLim", IEC61850_STRUCTURE, low, 1},           {"llLim", IEC61850_STRUCTURE, low_low, 1},
    {"min", IEC61850_STRUCTURE, measured_least, 1}, {"max", IEC61850_STRUCTURE, measured_most, 1}};
static const struct iec61850_node described[] = {{"d", IEC61850_DESCRIPTION, NULL, 0}};

/* Under CF: what comes with limits, what is always there, what comes with a unit. */
#define UNITS                                                                                                \
	{                                                                                                    \
		"units", IEC61850_STRUCTURE, unit, COUNT(unit)                                               \
	}
static const struct iec61850_node measured[] = {
    {"db", IEC61850_DEADBAND, NULL, 0}, {"dbRef", IEC61850_DEADBAND_REF, NULL, 0}, UNITS};
static const struct iec61850_node ranged[] = {{"db", IEC61850_DEADBAND, NULL, 0},
					      {"dbRef", IEC61850_DEADBAND_REF, NULL, 0},
					      {"rangeC", IEC61850_STRUCTURE, range, COUNT(range)},
					      UNITS};
static const struct iec61850_node whole[] = {UNITS};

/* What is controlled has a selection's time if it is selected before (MOsbo), and an execution's if that is reported (MOenhanced). */
#define CTL_MODEL                                                                                            \
	{                                                                                                    \
		"ctlModel", IEC61850_CTL_MODEL, NULL, 0                                                      \
	}
#define SBO_TIMEOUT                                                                                          \
	,                                                                                                    \
	{                                                                                                    \
		"sboTimeout", IEC61850_SBO_TIMEOUT, NULL, 0                                                  \
	}
#define OPER_TIMEOUT                                                                                         \
	,                                                                                                    \
	{                                                                                                    \
		"operTimeout", IEC61850_OPER_TIMEOUT, NULL, 0                                                \
	}
#define CONTROLLED(name, before, behind)                                                                     \
	static const struct iec61850_node name[] = {before CTL_MODEL behind};                                \
	static const struct iec61850_node name##_sbo[] = {before CTL_MODEL SBO_TIMEOUT behind};              \
	static const struct iec61850_node name##_enhanced[] = {before CTL_MODEL OPER_TIMEOUT behind};        \
	static const struct iec61850_node name##_sbo_enhanced[] = {                                          \
	    before CTL_MODEL SBO_TIMEOUT OPER_TIMEOUT behind}
#define RANGE_OF_VALUES                                                                                      \
	{"minVal", IEC61850_STRUCTURE, least, COUNT(least)},                                                 \
	    {"maxVal", IEC61850_STRUCTURE, most, COUNT(most)},                                               \
	    {"stepSize", IEC61850_STRUCTURE, step_size, COUNT(step_size)},
#define PERSISTENT                                                                                           \
	,                                                                                                    \
	{                                                                                                    \
		"persistent", IEC61850_PERSISTENT, NULL, 0                                                   \
	}
#define AND_UNITS , UNITS
CONTROLLED(controlled, , );
CONTROLLED(counted, , AND_UNITS);
CONTROLLED(settable, RANGE_OF_VALUES, AND_UNITS);
static const struct iec61850_node stepped[] = {CTL_MODEL PERSISTENT};

/* The services of a command (8-1, 20.5 and annex E): which there are, the model says. */
static const struct iec61850_node origin[] = {{"orCat", IEC61850_ENUM, NULL, 0},
					      {"orIdent", IEC61850_OR_IDENT, NULL, 0}};
#define SERVICE(name, leaf, children)                                                                        \
	{                                                                                                    \
		name, leaf, children, COUNT(children)                                                        \
	}
#define CANCELLING(...)                                                                                      \
	{__VA_ARGS__}, {"origin", IEC61850_STRUCTURE, origin, COUNT(origin)},                                \
	    {"ctlNum", IEC61850_CTL_NUM, NULL, 0}, {"T", IEC61850_TIME, NULL, 0},                            \
	{                                                                                                    \
		"Test", IEC61850_BOOLEAN, NULL, 0                                                            \
	}
#define OPERATING(...)                                                                                       \
	CANCELLING(__VA_ARGS__),                                                                             \
	{                                                                                                    \
		"Check", IEC61850_CHECK, NULL, 0                                                             \
	}
#define CONTROLS(value, ...)                                                                                 \
	static const struct iec61850_node value##_operate[] = {OPERATING(__VA_ARGS__)};                      \
	static const struct iec61850_node value##_cancel[] = {CANCELLING(__VA_ARGS__)};                      \
	static const struct iec61850_node value##_direct[] = {                                               \
	    SERVICE("Oper", IEC61850_OPER, value##_operate)};                                                \
	static const struct iec61850_node value##_sbo[] = {                                                  \
	    {"SBO", IEC61850_SBO, NULL, 0},                                                                  \
	    SERVICE("Oper", IEC61850_OPER, value##_operate),                                                 \
	    SERVICE("Cancel", IEC61850_CANCEL, value##_cancel)};                                             \
	static const struct iec61850_node value##_sbow[] = {                                                 \
	    SERVICE("SBOw", IEC61850_SBOW, value##_operate),                                                 \
	    SERVICE("Oper", IEC61850_OPER, value##_operate),                                                 \
	    SERVICE("Cancel", IEC61850_CANCEL, value##_cancel)}

CONTROLS(binary, "ctlVal", IEC61850_BOOLEAN, NULL, 0);
CONTROLS(integer, "ctlVal", IEC61850_INTEGER, NULL, 0);
CONTROLS(set_point, "ctlVal", IEC61850_STRUCTURE, analogue, COUNT(analogue));
static const struct iec61850_node pulses[] = {{"pulsQty", IEC61850_UNIT, NULL, 0}, UNITS};
static const struct iec61850_node plate[] = {{"vendor", IEC61850_VENDOR, NULL, 0},
					     {"swRev", IEC61850_REVISION, NULL, 0},
					     {"d", IEC61850_DESCRIPTION, NULL, 0},
					     {"configRev", IEC61850_CONFIGURATION, NULL, 0}};
static const struct iec61850_node name_space[] = {{"ldNs", IEC61850_NAME_SPACE, NULL, 0}};
static const struct iec61850_node physical_plate[] = {{"vendor", IEC61850_VENDOR, NULL, 0}};

#define NODES(nodes)                                                                                         \
	{                                                                                                    \
		nodes, COUNT(nodes)                                                                          \
	}
static const struct iec61850_nodes classes[IEC61850_CDCS][IEC61850_FCS] = {
    [IEC61850_SPS] = {[IEC61850_ST] = NODES(sps), [IEC61850_DC] = NODES(described)},
    [IEC61850_DPS] = {[IEC61850_ST] = NODES(dps), [IEC61850_DC] = NODES(described)},
    [IEC61850_ACT] = {[IEC61850_ST] = NODES(act), [IEC61850_DC] = NODES(described)},
    [IEC61850_ACD] = {[IEC61850_ST] = NODES(acd), [IEC61850_DC] = NODES(described)},
    [IEC61850_BSC] = {[IEC61850_ST] = NODES(tap), [IEC61850_DC] = NODES(described)},
    [IEC61850_ISC] = {[IEC61850_ST] = NODES(tap), [IEC61850_DC] = NODES(described)},
    [IEC61850_INS] = {[IEC61850_ST] = NODES(ins), [IEC61850_DC] = NODES(described)},
    [IEC61850_ENS] = {[IEC61850_ST] = NODES(ens)},
    [IEC61850_ENC] = {[IEC61850_ST] = NODES(ens)},
    [IEC61850_MV] = {[IEC61850_MX] = NODES(mv), [IEC61850_DC] = NODES(described)},
    [IEC61850_BCR] = {[IEC61850_ST] = NODES(bcr), [IEC61850_DC] = NODES(described)},
    [IEC61850_SPC] = {[IEC61850_ST] = NODES(spc), [IEC61850_DC] = NODES(described)},
    [IEC61850_DPC] = {[IEC61850_ST] = NODES(dpc), [IEC61850_DC] = NODES(described)},
    [IEC61850_INC] = {[IEC61850_ST] = NODES(inc), [IEC61850_DC] = NODES(described)},
    [IEC61850_APC] = {[IEC61850_MX] = NODES(apc), [IEC61850_DC] = NODES(described)},
    [IEC61850_LPL] = {[IEC61850_DC] = NODES(plate), [IEC61850_EX] = NODES(name_space)},
    [IEC61850_DPL] = {[IEC61850_DC] = NODES(physical_plate)},
    [IEC61850_MV_RANGE] = {[IEC61850_MX] = NODES(mv_range), [IEC61850_DC] = NODES(described)},
};

/* What is there under CF: all of nodes, but the first ones without limits, and the last one without a unit. */
#define SHOWN(nodes)                                                                                         \
	{                                                                                                    \
		[IEC61850_STATUS_ONLY] = NODES(nodes)                                                        \
	}
#define BY_MODEL(nodes)                                                                                      \
	{                                                                                                    \
		[IEC61850_STATUS_ONLY] = NODES(nodes), [IEC61850_DIRECT_NORMAL] = NODES(nodes),              \
		[IEC61850_SBO_NORMAL] = NODES(nodes##_sbo),                                                  \
		[IEC61850_DIRECT_ENHANCED] = NODES(nodes##_enhanced),                                        \
		[IEC61850_SBO_ENHANCED] = NODES(nodes##_sbo_enhanced)                                        \
	}
static const struct {
	struct iec61850_nodes nodes[IEC61850_CTL_MODELS];
	unsigned limits, units;
} settings[IEC61850_CDCS] = {
    [IEC61850_INS] = {SHOWN(whole), 0, 1},         [IEC61850_ENC] = {SHOWN(controlled), 0, 0},
    [IEC61850_BCR] = {SHOWN(pulses), 0, 1},        [IEC61850_MV] = {SHOWN(measured), 2, 1},
    [IEC61850_SPC] = {BY_MODEL(controlled), 0, 0}, [IEC61850_DPC] = {BY_MODEL(controlled), 0, 0},
    [IEC61850_INC] = {BY_MODEL(counted), 0, 1},    [IEC61850_BSC] = {SHOWN(stepped), 0, 0},
    [IEC61850_ISC] = {SHOWN(controlled), 0, 0},    [IEC61850_APC] = {BY_MODEL(settable), 3, 1},
    [IEC61850_MV_RANGE] = {SHOWN(ranged), 2, 1},
};

#define MODELS(value)                                                                                        \
	{                                                                                                    \
		[IEC61850_DIRECT_NORMAL] = NODES(value##_direct),                                            \
		[IEC61850_SBO_NORMAL] = NODES(value##_sbo),                                                  \
		[IEC61850_DIRECT_ENHANCED] = NODES(value##_direct),                                          \
		[IEC61850_SBO_ENHANCED] = NODES(value##_sbow)                                                \
	}
static const struct iec61850_nodes services[IEC61850_CDCS][IEC61850_CTL_MODELS] = {
    [IEC61850_SPC] = MODELS(binary),
    [IEC61850_DPC] = MODELS(binary),
    [IEC61850_INC] = MODELS(integer),
    [IEC61850_APC] = MODELS(set_point)};

struct iec61850_nodes iec61850_cdc_nodes(enum iec61850_cdc cdc, enum iec61850_ctl_kind model,
					 enum iec61850_fc fc)
{
	struct iec61850_nodes all = classes[cdc][fc];

	if (model != IEC61850_SBO_NORMAL && model != IEC61850_SBO_ENHANCED && all.count > 0 &&
	    all.nodes[all.count - 1].leaf == IEC61850_SELD)
		all.count--;
	return all;
}

struct iec61850_nodes iec61850_cdc_settings(enum iec61850_cdc cdc, enum iec61850_ctl_kind model, bool limits,
					    bool has_unit)
{
	const struct iec61850_nodes all = settings[cdc].nodes[model];
	const unsigned before = limits ? 0 : settings[cdc].limits,
		       behind = has_unit ? 0 : settings[cdc].units;

	if (all.count == before + behind)
		return (struct iec61850_nodes){0};
	return (struct iec61850_nodes){all.nodes + before, all.count - before - behind};
}

bool iec61850_cdc_is_controllable(enum iec61850_cdc cdc)
{
	const struct iec61850_nodes all = settings[cdc].nodes[IEC61850_STATUS_ONLY];

	for (unsigned i = 0; i < all.count; i++)
		if (all.nodes[i].leaf == IEC61850_CTL_MODEL)
			return true;
	return false;
}

struct iec61850_nodes iec61850_cdc_services(enum iec61850_cdc cdc, enum iec61850_ctl_kind model)
{
	return services[cdc][model];
}

const struct iec61850_node *iec61850_cdc_find(struct iec61850_nodes inside, const char *path)
{
	const size_t size = strcspn(path, ".");

	for (unsigned i = 0; i < inside.count; i++) {
		const struct iec61850_node *node = &inside.nodes[i];

		if (strlen(node->name) != size || memcmp(node->name, path, size) != 0)
			continue;
		return path[size] == '\0'
			   ? node
			   : iec61850_cdc_find((struct iec61850_nodes){node->children, node->count},
					       path + size + 1);
	}
	return NULL;
}
