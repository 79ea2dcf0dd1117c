// SPDX-License-Identifier: GPL-3.0-or-later
// Made by `make codes` from the headers of C; do not edit.
// Of a quality, the worst bit comes first.
export const QUALITY = {
  INVALID: 128,
  NOT_TOPICAL: 64,
  SUBSTITUTED: 32,
  BLOCKED: 16,
  OVERFLOW: 1,
};
export const LINK = {
  WAITING: 0,
  CONNECTING: 1,
  STARTING: 2,
  UP: 3,
  DOWN: 4,
  STANDBY: 5,
  SECURING: 6,
};
export const CLOSING = {
  OPEN: 0,
  BAD_APDU: 1,
  BAD_ASDU: 2,
  BAD_NS: 3,
  BAD_NR: 4,
  I_WHILE_STOPPED: 5,
  T1_I_FRAME: 6,
  T1_TESTFR: 7,
  UNREAD_ANSWERS: 8,
  TAKEN_OVER: 9,
  GAVE_WAY: 10,
  NOT_SECURE: 11,
  NOT_AS_BEFORE: 12,
  CLOSED_BY_PEER: 13,
  CLOSED_BY_STATION: 14,
  T1_STARTDT: 15,
  STARTED_BY_PEER: 16,
};
export const CONTENT = {
  SINGLE: 0,
  DOUBLE: 1,
  STEP: 2,
  BITS: 3,
  NORMALIZED: 4,
  SCALED: 5,
  FLOAT: 6,
  TOTAL: 7,
  PROTECTION_EVENT: 8,
  PROTECTION_START: 9,
  PROTECTION_OUTPUT: 10,
  PACKED_SINGLES: 11,
  INITIALISATION: 12,
  POSITION: 100,
};
export const CAUSE = {
  CYCLIC: 1,
  BACKGROUND: 2,
  SPONTANEOUS: 3,
  INITIALISED: 4,
  REQUEST: 5,
  ACTIVATION: 6,
  ACTIVATION_CON: 7,
  DEACTIVATION: 8,
  DEACTIVATION_CON: 9,
  ACTIVATION_TERM: 10,
  RETURN_REMOTE: 11,
  RETURN_LOCAL: 12,
  INTERROGATED: 20,
  COUNTERS_REQUESTED: 37,
  UNKNOWN_TYPE: 44,
  UNKNOWN_CAUSE: 45,
  UNKNOWN_CA: 46,
  UNKNOWN_IOA: 47,
};
export const STATE = {
  INACTIVE: 0,
  SELECTION_REQUEST: 1,
  ACCEPTED_SELECTION: 2,
  REFUSED_SELECTION: 3,
  INTERRUPTION_REQUEST: 4,
  INTERRUPTED_SELECTION: 5,
  EXECUTION_REQUEST: 6,
  EXECUTING: 7,
  REFUSED_COMMAND: 8,
  EXECUTED_COMMAND: 9,
};
export const RESULT = {
  NONE: 0,
  DONE: 1,
  EXCEPTION: 2,
  TIMEOUT: 3,
  TOO_OLD: 4,
  NOT_SELECTED: 5,
  INTERLOCK: 6,
  OUT_OF_RANGE: 7,
  NOT_COMMANDABLE: 8,
  UNKNOWN_FATE: 9,
  NO_SCALE: 10,
  SENT: 11,
  NOT_UP: 64,
  BUSY: 65,
  NOT_KNOWN: 66,
};
// Of the centre's own modules.
export const ALARM_KINDS = ["lost", "quality", "clock", "high", "low", "state", "inside", "outside", "network"];
export const AUDITED = ["commands", "alarms", "stations", "exports", "logins", "users"];
export const ROLES = ["viewer", "operator", "engineer"];
export const SCOPES = {"read": "viewer", "command": "operator", "engineer": "engineer"};
export const EVENT_CAUSES = ["spontaneous", "requested", "remote", "local", "interrogated"];
export const IDS_MOST = 5000;
export const CHART_ROWS = 5000;
export const FRAMES_MOST = 500;
export const TOKEN_DAYS_MOST = 366;
