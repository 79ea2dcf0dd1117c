/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "iec61850/ln_class.h"

#include <float.h>

#include "map/type.h"

const char *const iec61850_cdc_names[IEC61850_CDCS] = {"SPS", "DPS", "INS", "ENS", "ENC", "ACT",
						       "ACD", "BCR", "MV",  "SPC", "DPC", "INC",
						       "BSC", "ISC", "APC", "LPL", "DPL", "MV"};

#define COUNT(array) ((uint8_t)(sizeof(array) / sizeof((array)[0])))
#define IS(name, cdc)                                                                                        \
	{                                                                                                    \
		name, IEC61850_##cdc, 0, 0                                                                   \
	}
#define MANDATORY(name, cdc)                                                                                 \
	{                                                                                                    \
		name, IEC61850_##cdc, IEC61850_MANDATORY, 0                                                  \
	}
#define ONE_OF(name, cdc)                                                                                    \
	{                                                                                                    \
		name, IEC61850_##cdc, IEC61850_ONE_OF, 0                                                     \
	}
#define MULTI(name, cdc)                                                                                     \
	{                                                                                                    \
		name, IEC61850_##cdc, IEC61850_MULTI, 0                                                      \
	}
#define ENUMERATED(name, cdc, presence, of)                                                                  \
	{                                                                                                    \
		name, IEC61850_##cdc, presence, IEC61850_##of##_KIND                                         \
	}

/* What the abstract classes of 7-4 have. Mod and NamPlt are the logical device's, in LLN0; Beh follows from it. */
#define BEHAVIOUR  ENUMERATED("Beh", ENS, IEC61850_MANDATORY, BEHAVIOUR)
#define FUNCTION   BEHAVIOUR, IS("Blk", SPS)
#define LOCAL      IS("Loc", SPS), IS("LocKey", SPS), IS("LocSta", SPC)
#define CONTROLLED LOCAL, IS("CmdBlk", SPC), IS("OpCntRs", INC)
#define EQUIPMENT  ENUMERATED("EEHealth", ENS, 0, HEALTH), IS("OpTmh", INS)
#define SWITCHING                                                                                            \
	FUNCTION, MANDATORY("Loc", SPS), MANDATORY("OpCnt", INS), MANDATORY("Pos", DPC),                     \
	    MANDATORY("BlkOpn", SPC), MANDATORY("BlkCls", SPC), EQUIPMENT, IS("LocKey", SPS),                \
	    IS("Dsc", SPS), IS("LocSta", SPC), IS("ChaMotEna", SPC)
#define PROTECTION  FUNCTION, IS("OpCntRs", INC)
#define SUPERVISION FUNCTION, IS("OpCntRs", INC)

static const struct iec61850_data lln0[] = {BEHAVIOUR, ENUMERATED("Health", ENS, IEC61850_MANDATORY, HEALTH),
					    ENUMERATED("Mod", ENC, IEC61850_MANDATORY, BEHAVIOUR),
					    MANDATORY("NamPlt", LPL)};
static const struct iec61850_data lphd[] = {ENUMERATED("PhyHealth", ENS, IEC61850_MANDATORY, HEALTH),
					    MANDATORY("PhyNam", DPL), MANDATORY("Proxy", SPS)};
static const struct iec61850_data ggio[] = {
    FUNCTION,           CONTROLLED,          EQUIPMENT,           MULTI("IntIn", INS),
    MULTI("Alm", SPS),  MULTI("Wrn", SPS),   MULTI("Ind", SPS),   MULTI("CntVal", BCR),
    MULTI("AnIn", MV),  MULTI("AnOut", APC), MULTI("SPCSO", SPC), MULTI("DPCSO", DPC),
    MULTI("ISCSO", INC)};
static const struct iec61850_data calh[] = {FUNCTION, ONE_OF("GrAlm", SPS), ONE_OF("GrWrn", SPS),
					    ONE_OF("GrInd", SPS), IS("AlmLstOv", SPS)};
static const struct iec61850_data cilo[] = {FUNCTION, MANDATORY("EnaOpn", SPS), MANDATORY("EnaCls", SPS)};
static const struct iec61850_data cswi[] = {FUNCTION,          MANDATORY("Pos", DPC), CONTROLLED,
					    IS("OpOpn", ACT),  IS("SelOpn", SPS),     IS("OpCls", ACT),
					    IS("SelCls", SPS), IS("PosA", DPC),       IS("PosB", DPC),
					    IS("PosC", DPC),   IS("SwModKey", SPC)};
static const struct iec61850_data ktnk[] = {FUNCTION, EQUIPMENT, IS("LevPct", MV), IS("Vlm", MV)};
static const struct iec61850_data mmdc[] = {FUNCTION,      IS("Watt", MV),     IS("Amp", MV),
					    IS("Vol", MV), IS("VolPsGnd", MV), IS("VolNgGnd", MV),
					    IS("Ris", MV), IS("RisPsGnd", MV), IS("RisNgGnd", MV)};
static const struct iec61850_data mmet[] = {
    FUNCTION,           IS("EnvTmp", MV),    IS("WetBlbTmp", MV), IS("CloudCvr", MV),
    IS("EnvHum", MV),   IS("DewPt", MV),     IS("HorInsol", MV),  IS("HorWdDir", MV),
    IS("HorWdSpd", MV), IS("WdGustSpd", MV), IS("EnvPres", MV),   IS("RnFll", MV)};
static const struct iec61850_data mmtr[] = {FUNCTION,           IS("TotVAh", BCR), IS("TotWh", BCR),
					    IS("TotVArh", BCR), IS("SupWh", BCR),  IS("SupVArh", BCR),
					    IS("DmdWh", BCR),   IS("DmdVArh", BCR)};
static const struct iec61850_data mmxu[] = {FUNCTION,
					    IS("TotW", MV),
					    IS("TotVAr", MV),
					    IS("TotVA", MV),
					    IS("TotPF", MV),
					    IS("Hz", MV),
					    IS("HzRte", MV),
					    IS("AvAPhs", MV),
					    IS("AvPPVPhs", MV),
					    IS("AvPhVPhs", MV),
					    IS("AvWPhs", MV),
					    IS("AvVAPhs", MV),
					    IS("AvVArPhs", MV),
					    IS("AvPFPhs", MV),
					    IS("AvZPhs", MV),
					    IS("MaxAPhs", MV),
					    IS("MaxPPVPhs", MV),
					    IS("MaxPhVPhs", MV),
					    IS("MaxWPhs", MV),
					    IS("MaxVAPhs", MV),
					    IS("MaxVArPhs", MV),
					    IS("MaxPFPhs", MV),
					    IS("MaxZPhs", MV),
					    IS("MinAPhs", MV),
					    IS("MinPPVPhs", MV),
					    IS("MinPhVPhs", MV),
					    IS("MinWPhs", MV),
					    IS("MinVAPhs", MV),
					    IS("MinVArPhs", MV),
					    IS("MinPFPhs", MV),
					    IS("MinZPhs", MV)};
static const struct iec61850_data pdif[] = {PROTECTION, MANDATORY("Op", ACT), IS("Str", ACD)};
static const struct iec61850_data pdis[] = {PROTECTION, MANDATORY("Op", ACT), MANDATORY("Str", ACD)};
static const struct iec61850_data ptov[] = {PROTECTION, MANDATORY("Str", ACD), IS("Op", ACT)};
static const struct iec61850_data ptrc[] = {PROTECTION, ONE_OF("Str", ACD), ONE_OF("Op", ACT),
					    ONE_OF("Tr", ACT)};
static const struct iec61850_data rbrf[] = {FUNCTION, ONE_OF("OpEx", ACT), ONE_OF("OpIn", ACT),
					    IS("Str", ACD), IS("OpCntRs", INC)};
static const struct iec61850_data rrec[] = {FUNCTION, MANDATORY("OpCls", ACT),
					    ENUMERATED("AutoRecSt", ENS, IEC61850_MANDATORY, RECLOSING),
					    IS("RecCyc", INS)};
static const struct iec61850_data simg[] = {
    SUPERVISION,           MANDATORY("InsAlm", SPS), ONE_OF("PresAlm", SPS), ONE_OF("DenAlm", SPS),
    ONE_OF("TmpAlm", SPS), IS("InsBlk", SPS),        IS("InsTr", SPS),       IS("InsLevMax", SPS),
    IS("InsLevMin", SPS),  IS("InsBlkTmh", INS),     IS("Pres", MV),         IS("Tmp", MV),
    IS("Den", MV)};
static const struct iec61850_data stmp[] = {SUPERVISION,     IS("Alm", SPS),     IS("RteAlm", SPS),
					    IS("Trip", SPS), IS("RteTrip", SPS), IS("Tmp", MV),
					    IS("TmpRte", MV)};
static const struct iec61850_data xcbr[] = {SWITCHING, IS("MaxOpCap", INS), IS("SumSwARs", BCR),
					    ENUMERATED("CBOpCap", ENS, 0, CAPABILITY),
					    ENUMERATED("POWCap", ENS, 0, ON_WAVE)};
static const struct iec61850_data xswi[] = {SWITCHING, ENUMERATED("SwTyp", ENS, IEC61850_MANDATORY, SWITCH),
					    IS("MaxOpCap", INS), ENUMERATED("SwOpCap", ENS, 0, CAPABILITY)};
static const struct iec61850_data yltc[] = {FUNCTION,
					    MANDATORY("EndPosR", SPS),
					    MANDATORY("EndPosL", SPS),
					    ONE_OF("TapPos", ISC),
					    ONE_OF("TapChg", BSC),
					    CONTROLLED,
					    EQUIPMENT,
					    IS("OpCnt", INS),
					    IS("OoStep", SPS),
					    IS("LTCCycAlm", SPS),
					    IS("BlkLoVisc", SPS)};
static const struct iec61850_data yptr[] = {
    FUNCTION,         EQUIPMENT,         IS("OpNoLod", SPS), IS("OpOvA", SPS), IS("OpOvV", SPS),
    IS("OpUnV", SPS), IS("LodFact", MV), IS("MaxVA", MV),    IS("OvlTm", MV),  IS("OvlTmEmg", MV)};
static const struct iec61850_data zbat[] = {FUNCTION,         EQUIPMENT,           IS("BatHi", SPS),
					    IS("BatLo", SPS), IS("VolChgRte", MV), IS("Vol", MV),
					    IS("Amp", MV),    IS("TestRsl", SPS),  IS("BatTest", SPC)};

#define CLASS(name, data)                                                                                    \
	{                                                                                                    \
		name, data, COUNT(data)                                                                      \
	}
const struct iec61850_ln_class iec61850_ln_classes[] = {
    [IEC61850_CLASS_LLN0] = CLASS("LLN0", lln0),
    [IEC61850_CLASS_LPHD] = CLASS("LPHD", lphd),
    [IEC61850_CLASS_GGIO] = CLASS("GGIO", ggio),
    CLASS("CALH", calh),
    CLASS("CILO", cilo),
    CLASS("CSWI", cswi),
    CLASS("KTNK", ktnk),
    CLASS("MMDC", mmdc),
    CLASS("MMET", mmet),
    CLASS("MMTR", mmtr),
    CLASS("MMXU", mmxu),
    CLASS("PDIF", pdif),
    CLASS("PDIS", pdis),
    CLASS("PIOC", pdif),
    CLASS("PTOC", pdis),
    CLASS("PTOV", ptov),
    CLASS("PTRC", ptrc),
    CLASS("PTUV", pdis),
    CLASS("RBRF", rbrf),
    CLASS("RREC", rrec),
    CLASS("SIMG", simg),
    CLASS("STMP", stmp),
    CLASS("XCBR", xcbr),
    CLASS("XSWI", xswi),
    CLASS("YLTC", yltc),
    CLASS("YPTR", yptr),
    CLASS("ZBAT", zbat),
};
const size_t iec61850_ln_class_count = COUNT(iec61850_ln_classes);

bool iec61850_is_whole(enum map_type type)
{
	const struct map_type_row *row = &map_types[type];

	return row->class == MAP_CLASS_POSITION || row->class == MAP_CLASS_PATTERN ||
	       (row->class == MAP_CLASS_MEASURED && row->form == MAP_FORM_SIGNED &&
		row->width > FLT_MANT_DIG);
}

struct iec61850_data iec61850_default_data(const struct map_point *point)
{
	const bool command = (point->flags & MAP_POINT_COMMAND) != 0;

	if (iec61850_is_whole(point->type))
		return command ? (struct iec61850_data)IS("ISCSO", INC)
			       : (struct iec61850_data)IS("IntIn", INS);
	switch (map_class_of(point)) {
	case MAP_CLASS_STATE:
		if (point->type == MAP_DOUBLE)
			return (struct iec61850_data)IS("DPCSO", DPC);
		return command ? (struct iec61850_data)IS("SPCSO", SPC)
			       : (struct iec61850_data)IS("Ind", SPS);
	case MAP_CLASS_MEASURED:
		return command ? (struct iec61850_data)IS("AnOut", APC)
			       : (struct iec61850_data)IS("AnIn", MV);
	case MAP_CLASS_POSITION:
	case MAP_CLASS_PATTERN:
	case MAP_CLASS_TOTAL:
		break;
	}
	return (struct iec61850_data)IS("CntVal", BCR);
}

bool iec61850_cdc_takes(enum iec61850_cdc cdc, enum map_type type)
{
	switch (cdc) {
	case IEC61850_SPS:
	case IEC61850_ACT:
	case IEC61850_ACD:
	case IEC61850_SPC:
		return type == MAP_SINGLE;
	case IEC61850_DPS:
	case IEC61850_DPC:
		return type == MAP_DOUBLE;
	case IEC61850_INS:
	case IEC61850_ENS:
	case IEC61850_INC:
		return iec61850_is_whole(type);
	case IEC61850_BSC:
	case IEC61850_ISC:
		return type == MAP_STEP;
	case IEC61850_BCR:
		return type == MAP_COUNTER;
	case IEC61850_MV:
		return map_types[type].class == MAP_CLASS_MEASURED;
	case IEC61850_APC:
		return map_types[type].class == MAP_CLASS_MEASURED && !iec61850_is_whole(type);
	case IEC61850_ENC:
	case IEC61850_LPL:
	case IEC61850_DPL:
	case IEC61850_MV_RANGE:
	case IEC61850_CDCS:
		break;
	}
	return false;
}
