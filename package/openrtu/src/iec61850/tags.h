/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Tags and errors of MMS that several files of this room read or write (ISO 9506-2, clause 14). */
#ifndef OPENRTU_IEC61850_TAGS_H
#define OPENRTU_IEC61850_TAGS_H

/* Of Data (14.4.2). Those of TypeSpecification are the same, but for a structure's parts. */
enum iec61850_data_tag {
	IEC61850_TAG_STRUCTURE = 0xa2,
	IEC61850_TAG_BOOLEAN = 0x83,
	IEC61850_TAG_BIT_STRING = 0x84,
	IEC61850_TAG_INTEGER = 0x85,
	IEC61850_TAG_UNSIGNED = 0x86,
	IEC61850_TAG_FLOATING_POINT = 0x87,
	IEC61850_TAG_OCTET_STRING = 0x89,
	IEC61850_TAG_VISIBLE_STRING = 0x8a,
	IEC61850_TAG_BINARY_TIME = 0x8c,
	IEC61850_TAG_UTC_TIME = 0x91,
};

/* DataAccessError (14.4.3). */
enum iec61850_access_error {
	IEC61850_ACCESS_UNAVAILABLE = 2, /* temporarily */
	IEC61850_ACCESS_DENIED = 3,
	IEC61850_ACCESS_TYPE_INCONSISTENT = 7,
	IEC61850_ACCESS_UNSUPPORTED = 9,
	IEC61850_ACCESS_NON_EXISTENT = 10,
	IEC61850_ACCESS_VALUE_INVALID = 11,
};

/* Of an InformationReport (14.14), from the outside in. */
enum iec61850_report_tag {
	IEC61850_TAG_UNCONFIRMED = 0xa3,
	IEC61850_TAG_INFORMATION_REPORT = 0xa0,
	IEC61850_TAG_VARIABLES = 0xa0, /* the list of them, or */
	IEC61850_TAG_LIST_NAME = 0xa1, /* the name of one */
	IEC61850_TAG_VMD_SPECIFIC = 0x80,
	IEC61850_TAG_RESULTS = 0xa0,
};

#endif
