/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The machine below the gateway, as IF-MIB and HOST-RESOURCES-MIB show it. What the kernel says is handed in: this room asks it
 * nothing.
 */
#ifndef OPENRTU_SNMP_MACHINE_H
#define OPENRTU_SNMP_MACHINE_H

#include <stdbool.h>
#include <stdint.h>

#include "snmp/shared.h"

#define SNMP_IF_NAME_SIZE    16 /* IFNAMSIZ */
#define SNMP_IF_ALIAS_SIZE   65 /* ifAlias: SIZE (0..64) */
#define SNMP_IF_ADDRESS_SIZE 32 /* MAX_ADDR_LEN */

/* As ifOperStatus has it. */
enum snmp_link {
	SNMP_LINK_UP = 1,
	SNMP_LINK_DOWN,
	SNMP_LINK_TESTING,
	SNMP_LINK_UNKNOWN,
	SNMP_LINK_DORMANT,
	SNMP_LINK_NOT_PRESENT,
	SNMP_LINK_LOWER_DOWN,
};

enum snmp_traffic {
	SNMP_IN_OCTETS,
	SNMP_IN_PACKETS, /* to one address */
	SNMP_IN_MULTICAST,
	SNMP_IN_DISCARDS,
	SNMP_IN_ERRORS,
	SNMP_OUT_OCTETS,
	SNMP_OUT_PACKETS,
	SNMP_OUT_DISCARDS,
	SNMP_OUT_ERRORS,
	SNMP_TRAFFIC
};

struct snmp_interface {
	uint32_t kernel; /* the kernel's number of it, another one each time that it comes */
	uint32_t number; /* ifIndex */
	char name[SNMP_IF_NAME_SIZE], alias[SNMP_IF_ALIAS_SIZE];
	uint8_t address[SNMP_IF_ADDRESS_SIZE];
	uint8_t address_size;
	uint8_t link; /* enum snmp_link */
	bool enabled, promiscuous, connector;
	uint16_t type;       /* IANAifType */
	uint32_t mtu, speed; /* Mbit/s, 0: unknown */
	uint64_t traffic[SNMP_TRAFFIC];
	int64_t changed_ns; /* its link last, 0: before the agent began */
	int64_t came_ns;    /* 0: before the agent began */
	int64_t told_ns;    /* a change of its link last */
	uint8_t told;       /* that link */
	bool seen;
};

/* As hrStorageTypes have it. */
enum snmp_storage_type {
	SNMP_STORAGE_RAM = 2,
	SNMP_STORAGE_VIRTUAL,
	SNMP_STORAGE_DISK,
	SNMP_STORAGE_RAM_DISK = 8,
	SNMP_STORAGE_FLASH,
};

struct snmp_storage {
	uint32_t number; /* hrStorageIndex */
	uint8_t type;    /* enum snmp_storage_type */
	char name[SNMP_NUMBERED_SIZE];
	uint64_t unit, size, used; /* the latter two in units of so many octets */
	bool seen;
};

#define SNMP_STORAGES_MAX (2 + SNMP_MOUNTS_MAX) /* memory and swap, and file systems */

struct snmp_machine {
	struct snmp_interface interfaces[SNMP_INTERFACES_MAX]; /* by number */
	uint32_t interface_count;
	int64_t interfaces_changed_ns; /* when one came or went, 0: before the agent began */
	struct snmp_storage storages[SNMP_STORAGES_MAX]; /* by number */
	uint32_t storage_count;
	uint64_t memory_kb;
	int64_t up_ns; /* since the machine started, 0: nothing has been looked at yet */
};

struct snmp_agent;

/* What the kernel says of an interface, number, times, told and seen aside. One too many is left out. */
void snmp_interface_is(struct snmp_agent *agent, const struct snmp_interface *interface);
void snmp_interface_gone(struct snmp_agent *agent, uint32_t kernel);
/* Around a list of all interfaces: what is not in it has gone. */
void snmp_interfaces_before(struct snmp_agent *agent);
void snmp_interfaces_after(struct snmp_agent *agent);
/* Numbers what became of links. */
void snmp_links_tick(struct snmp_agent *agent);
/* The same of storage. Memory and swap have their numbers, a file system gets the one that its place had before. */
void snmp_storages_before(struct snmp_agent *agent);
void snmp_storage_is(struct snmp_agent *agent, const struct snmp_storage *storage);
void snmp_storages_after(struct snmp_agent *agent);

#endif
