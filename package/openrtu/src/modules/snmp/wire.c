/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/snmp/wire.h"

#include <arpa/inet.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#include "map/address.h"
#include "modules/snmp/bucket.h"

struct wire {
	struct snmp_agent *agent;
	netsnmp_transport transport;
	void *session;
	wire_handler handler;
	void *context;
	struct sockaddr_storage peer; /* of a sink */
	socklen_t peer_size;
	const struct snmp_engine_id *authority; /* of an inform: the sink's */
	bool refused;                           /* something of the sink's was */
};

/* ---- transport --------------------------------------------------------------------------- */

/* Who sent a message, and where its answer goes. libnetsnmp frees it. */
struct origin {
	struct sockaddr_storage address;
	socklen_t size;
	size_t control_size;
	/* Which of this machine's addresses was asked: a machine with several answers from the same. */
	_Alignas(struct cmsghdr) uint8_t control[CMSG_SPACE(sizeof(struct in6_pktinfo))];
};

/* The kernel's word on how a message came, as its answer wants it. */
static void turn_round(struct origin *origin, struct msghdr *header)
{
	struct cmsghdr *control = CMSG_FIRSTHDR(header);
	struct in_pktinfo four;

	origin->control_size = control == NULL ? 0 : header->msg_controllen;
	if (control == NULL || control->cmsg_level != IPPROTO_IP || control->cmsg_type != IP_PKTINFO)
		return;
	memcpy(&four, CMSG_DATA(control), sizeof(four));
	four = (struct in_pktinfo){.ipi_spec_dst = four.ipi_addr};
	memcpy(CMSG_DATA(control), &four, sizeof(four));
}

/* Without a list all are among it. */
static bool is_among(const struct in6_addr *address, const char (*list)[MAP_ADDRESS_SIZE], uint32_t count)
{
	return count == 0 || map_address_place(list, count, address) < count;
}

#define DROPPED_FOR_ONE 32
#define PEEKED          64 /* octets of a message, which hold its head */

/* msgFlags of a message (RFC 3412, 6): a sequence with the version, and one with msgID, msgMaxSize and these. -1: there are none. */
static int flags_of(const uint8_t *octets, size_t size)
{
	static const uint8_t tags[] = {0x30, 0x02, 0x30, 0x02, 0x02, 0x04};
	size_t at = 0;

	for (unsigned i = 0; i < sizeof(tags); i++) {
		size_t length;

		if (at + 2 > size || octets[at] != tags[i])
			return -1;
		length = octets[at + 1];
		at += 2;
		if (length > 0x80) { /* of the sequences alone: their length itself does not matter here */
			at += length - 0x80;
			length = 0;
		}
		if (tags[i] == 0x02)
			at += length;
	}
	return at < size ? octets[at] : -1;
}

static bool is_authenticated(const uint8_t *octets, size_t size)
{
	const int flags = flags_of(octets, size);

	return flags >= 0 && (flags & SNMP_MSG_FLAG_AUTH_BIT) != 0;
}

/* Before a message costs anything. */
static bool is_welcome(struct wire *wire, const struct sockaddr_storage *from, const uint8_t *octets,
		       size_t size)
{
	const struct snmp_settings *settings = wire->agent->settings;
	const int64_t now_ns = map_now_ns();
	struct in6_addr address;

	if (wire->peer_size != 0)
		return true;
	address = map_address_of(from);
	wire->agent->is_clock_master =
	    is_among(&address, settings->clock_masters, settings->clock_master_count);
	return is_among(&address, settings->managers, settings->manager_count) &&
	       (is_authenticated(octets, size) ? bucket_takes(&address, settings->rate, now_ns)
					       : bucket_discovers(&address, settings->rate, now_ns));
}

static int receive(netsnmp_transport *transport, void *buffer, int size, void **opaque, int *opaque_length)
{
	struct origin *origin = calloc(1, sizeof(*origin));
	struct iovec octets = {.iov_base = buffer, .iov_len = (size_t)size};
	struct msghdr header = {.msg_iov = &octets, .msg_iovlen = 1};
	ssize_t got;

	*opaque = origin;
	*opaque_length = origin == NULL ? 0 : (int)sizeof(*origin);
	if (origin == NULL)
		return -1;
	header.msg_name = &origin->address;
	header.msg_namelen = sizeof(origin->address);
	header.msg_control = origin->control;
	header.msg_controllen = sizeof(origin->control);
	got = recvmsg(transport->sock, &header, 0);
	if (got < 0)
		return -1;
	origin->size = header.msg_namelen;
	turn_round(origin, &header);
	return (int)got;
}

static int transmit(netsnmp_transport *transport, const void *buffer, int size, void **opaque,
		    int *opaque_length)
{
	const struct wire *wire = transport->data;
	struct origin *origin = opaque == NULL ? NULL : *opaque;
	struct iovec octets = {.iov_base = (void *)(uintptr_t)buffer, .iov_len = (size_t)size};
	struct msghdr header = {.msg_iov = &octets,
				.msg_iovlen = 1,
				.msg_name = (void *)(uintptr_t)&wire->peer,
				.msg_namelen = wire->peer_size};

	if (origin != NULL && *opaque_length == (int)sizeof(*origin)) {
		header.msg_name = &origin->address;
		header.msg_namelen = origin->size;
		header.msg_control = origin->control_size != 0 ? origin->control : NULL;
		header.msg_controllen = origin->control_size;
	}
	return (int)sendmsg(transport->sock, &header, 0);
}

static int end(netsnmp_transport *transport)
{
	(void)transport;
	return 0;
}

static char *format(netsnmp_transport *transport, const void *data, int size)
{
	(void)transport, (void)data, (void)size;
	return strdup("udp");
}

static void make_transport(struct wire *wire, int fd)
{
	static const oid domain[] = {1, 3, 6, 1, 6, 1, 1};

	wire->transport = (netsnmp_transport){.domain = domain,
					      .domain_length = OID_LENGTH(domain),
					      .sock = fd,
					      .data = wire,
					      .data_length = sizeof(*wire),
					      .msgMaxSize = wire->agent->settings->max_message,
					      .f_recv = receive,
					      .f_send = transmit,
					      .f_close = end,
					      .f_fmtaddr = format};
}

/* ---- sessions ---------------------------------------------------------------------------- */

static int take(int operation, netsnmp_session *session, int request, netsnmp_pdu *pdu, void *context)
{
	struct wire *wire = context;

	(void)request;
	if (operation == NETSNMP_CALLBACK_OP_RECEIVED_MESSAGE && pdu->version == SNMP_VERSION_3)
		wire->handler(wire->context, wire->session, pdu);
	(void)session;
	return 1;
}

/* error: of the library's parser, 0 none. Discovery is among them. */
static int count_damaged(netsnmp_session *session, netsnmp_pdu *pdu, int error)
{
	struct wire *wire = session->callback_magic;

	(void)pdu;
	if (error != 0)
		map_count(&wire->agent->shared->counters[SNMP_COUNT_DAMAGED], 1);
	return 1; /* it is the library's to refuse it */
}

static int note_refused(netsnmp_session *session, netsnmp_pdu *pdu, int error)
{
	struct wire *wire = session->callback_magic;

	(void)pdu;
	wire->refused |= error != 0;
	return 1;
}

static struct wire *make(struct snmp_agent *agent, int fd)
{
	struct wire *wire = calloc(1, sizeof(*wire));

	if (wire == NULL)
		return NULL;
	wire->agent = agent;
	make_transport(wire, fd);
	return wire;
}

struct wire *wire_listen(struct snmp_agent *agent, int fd, wire_handler handler, void *context)
{
	struct wire *wire = make(agent, fd);
	netsnmp_session session;

	if (wire == NULL)
		return NULL;
	wire->handler = handler;
	wire->context = context;
	snmp_sess_init(&session);
	session.version = SNMP_VERSION_3;
	session.callback = take;
	session.callback_magic = wire;
	session.authenticator = NULL;
	session.isAuthoritative = SNMP_SESS_AUTHORITATIVE;
	session.flags |= SNMP_FLAGS_DONT_PROBE;
	session.rcvMsgMaxSize = SNMP_MAX_RCV_MSG_SIZE;
	wire->session = snmp_sess_add(&session, &wire->transport, NULL, count_damaged);
	return wire->session == NULL ? NULL : wire;
}

static bool find_peer(struct wire *wire, const struct snmp_sink *sink, int family)
{
	struct sockaddr_in6 *six = (struct sockaddr_in6 *)&wire->peer;
	struct sockaddr_in *four = (struct sockaddr_in *)&wire->peer;
	struct in6_addr address;

	if (!map_address_parse(sink->address, &address))
		return false;
	if (family == AF_INET6) {
		*six = (struct sockaddr_in6){
		    .sin6_family = AF_INET6, .sin6_port = htons(sink->port), .sin6_addr = address};
		wire->peer_size = sizeof(*six);
		return true;
	}
	*four = (struct sockaddr_in){.sin_family = AF_INET, .sin_port = htons(sink->port)};
	memcpy(&four->sin_addr, &address.s6_addr[12], sizeof(four->sin_addr));
	wire->peer_size = sizeof(*four);
	return true;
}

/* Of an inform the sink is authoritative, of a trap we are (RFC 3414, 1.5.1). */
struct wire *wire_to_sink(struct snmp_agent *agent, const struct snmp_keyring *ring, uint32_t number, int fd)
{
	const struct snmp_sink *sink = &agent->settings->sinks[number];
	const struct snmp_engine_id *engine = sink->inform ? &ring->sink_engines[number] : &ring->engine;
	struct wire *wire = make(agent, fd);
	netsnmp_session session;

	if (wire == NULL || !find_peer(wire, sink, strchr(sink->address, ':') ? AF_INET6 : AF_INET))
		return NULL;
	snmp_sess_init(&session);
	session.version = SNMP_VERSION_3;
	session.retries = 0;
	session.timeout = sink->timeout_ms * 1000L;
	session.flags |= SNMP_FLAGS_DONT_PROBE;
	session.securityModel = SNMP_SEC_MODEL_USM;
	session.securityLevel = SNMP_SEC_LEVEL_AUTHPRIV;
	session.securityName = (char *)(uintptr_t)agent->settings->users[sink->user].name;
	session.securityNameLen = strlen(session.securityName);
	session.securityEngineID = (u_char *)(uintptr_t)engine->octets;
	session.securityEngineIDLen = engine->size;
	session.contextEngineID = (u_char *)(uintptr_t)ring->engine.octets;
	session.contextEngineIDLen = ring->engine.size;
	session.isAuthoritative = sink->inform ? SNMP_SESS_NONAUTHORITATIVE : SNMP_SESS_AUTHORITATIVE;
	session.callback_magic = wire;
	wire->authority = sink->inform ? engine : NULL;
	wire->session = snmp_sess_add(&session, &wire->transport, NULL, note_refused);
	return wire->session == NULL ? NULL : wire;
}

/* What waits first: 1: it is welcome; 0: it is not; below 0: nothing waits. */
static int look(struct wire *wire)
{
	uint8_t octets[PEEKED];
	struct sockaddr_storage from = {0};
	socklen_t size = sizeof(from);
	const ssize_t got = recvfrom(wire->transport.sock, octets, sizeof(octets), MSG_PEEK | MSG_DONTWAIT,
				     (struct sockaddr *)&from, &size);

	if (got < 0)
		return -1;
	map_count(&wire->agent->shared->counters[SNMP_COUNT_MESSAGES], 1);
	return is_welcome(wire, &from, octets, (size_t)got);
}

static void drop(const struct wire *wire)
{
	uint8_t octet;

	(void)recv(wire->transport.sock, &octet, 1, MSG_DONTWAIT);
	map_count(&wire->agent->shared->counters[SNMP_COUNT_LIMITED], 1);
}

/* What is not welcome is dropped at once, many times as much: it must not stand in the queue before what is. */
void wire_read(struct wire *wire, unsigned most)
{
	const unsigned most_dropped = DROPPED_FOR_ONE * most;
	unsigned dropped = 0;
	int welcome;
	fd_set set;

	while (most > 0 && dropped < most_dropped && (welcome = look(wire)) >= 0) {
		if (welcome == 0) {
			drop(wire);
			dropped++;
			continue;
		}
		FD_ZERO(&set);
		FD_SET(wire->transport.sock, &set);
		snmp_new_message(wire->agent);
		snmp_sess_read(wire->session, &set);
		most--;
	}
}

void wire_expire(struct wire *wire)
{
	snmp_sess_timeout(wire->session);
}

bool wire_discovers_anew(struct wire *wire)
{
	const struct snmp_engine_id *engine = wire->authority;
	const bool again = engine != NULL && wire->refused;
	u_int boots = 0, seconds = 0;

	wire->refused = false;
	if (!again ||
	    get_enginetime(engine->octets, engine->size, &boots, &seconds, FALSE) != SNMPERR_SUCCESS ||
	    boots == 0)
		return false;
	set_enginetime(engine->octets, engine->size, 0, 0, TRUE);
	return true;
}

void *wire_session(struct wire *wire)
{
	return wire->session;
}

int wire_fd(const struct wire *wire)
{
	return wire->transport.sock;
}

/* ---- the library ------------------------------------------------------------------------- */

uint32_t wire_statistic(enum snmp_statistic which)
{
	static const int numbers[] = {
	    [SNMP_BAD_VERSIONS] = STAT_SNMPINBADVERSIONS,
	    [SNMP_PARSE_ERRORS] = STAT_SNMPINASNPARSEERRS,
	    [SNMP_UNKNOWN_MODELS] = STAT_SNMPUNKNOWNSECURITYMODELS,
	    [SNMP_INVALID_MESSAGES] = STAT_SNMPINVALIDMSGS,
	    [SNMP_USM_LEVELS] = STAT_USMSTATSUNSUPPORTEDSECLEVELS,
	    [SNMP_USM_WINDOWS] = STAT_USMSTATSNOTINTIMEWINDOWS,
	    [SNMP_USM_USERS] = STAT_USMSTATSUNKNOWNUSERNAMES,
	    [SNMP_USM_ENGINES] = STAT_USMSTATSUNKNOWNENGINEIDS,
	    [SNMP_USM_DIGESTS] = STAT_USMSTATSWRONGDIGESTS,
	    [SNMP_USM_DECRYPTIONS] = STAT_USMSTATSDECRYPTIONERRORS,
	};

	return snmp_get_statistic(numbers[which]);
}

/* It need not have these: they are a draft. */
#ifdef NETSNMP_DRAFT_BLUMENTHAL_AES_04
#define OF_DRAFT(protocol)                                                                                   \
	{                                                                                                    \
		protocol, OID_LENGTH(protocol)                                                               \
	}
#else
#define OF_DRAFT(protocol)                                                                                   \
	{                                                                                                    \
		NULL, 0                                                                                      \
	}
#endif

static const struct {
	const oid *name;
	size_t length;
} privs[SNMP_PRIVS] = {{usmAESPrivProtocol, OID_LENGTH(usmAESPrivProtocol)},
		       OF_DRAFT(usmAES192PrivProtocol),
		       OF_DRAFT(usmAES256PrivProtocol)};

/* False: the library has not got this encryption, or there is no memory. */
static bool add_user(const char *name, const struct snmp_engine_id *engine, const struct snmp_keys *keys)
{
	static const struct {
		const oid *name;
		size_t length;
	} auths[SNMP_AUTHS] = {{usmHMAC192SHA256AuthProtocol, OID_LENGTH(usmHMAC192SHA256AuthProtocol)},
			       {usmHMAC256SHA384AuthProtocol, OID_LENGTH(usmHMAC256SHA384AuthProtocol)},
			       {usmHMAC384SHA512AuthProtocol, OID_LENGTH(usmHMAC384SHA512AuthProtocol)}};
	struct usmUser *user = privs[keys->priv].name == NULL ? NULL : usm_create_user();

	if (user == NULL)
		return false;
	free(user->authProtocol);
	free(user->privProtocol);
	user->name = strdup(name);
	user->secName = strdup(name);
	user->engineID = netsnmp_memdup(engine->octets, engine->size);
	user->engineIDLen = engine->size;
	user->authProtocol = snmp_duplicate_objid(auths[keys->auth].name, auths[keys->auth].length);
	user->authProtocolLen = auths[keys->auth].length;
	user->authKey = netsnmp_memdup(keys->auth_key, keys->auth_size);
	user->authKeyLen = keys->auth_size;
	user->privProtocol = snmp_duplicate_objid(privs[keys->priv].name, privs[keys->priv].length);
	user->privProtocolLen = privs[keys->priv].length;
	user->privKey = netsnmp_memdup(keys->priv_key, keys->priv_size);
	user->privKeyLen = keys->priv_size;
	user->userStatus = RS_ACTIVE;
	user->userStorageType = ST_READONLY;
	usm_add_user(user);
	return true;
}

static bool add_users(const struct snmp_agent *agent, const struct snmp_keyring *ring)
{
	bool good = true;

	for (uint32_t i = 0; i < agent->settings->user_count; i++)
		good &= add_user(agent->settings->users[i].name, &ring->engine, &ring->users[i]);
	for (uint32_t i = 0; i < agent->settings->sink_count; i++)
		if (agent->settings->sinks[i].inform)
			good &= add_user(agent->settings->users[agent->settings->sinks[i].user].name,
					 &ring->sink_engines[i], &ring->sinks[i]);
	return good;
}

#define NO_FOLDER "/dev/null/none" /* below a file not even root makes one, as the library would */

/* Nothing of the machine's Net-SNMP: neither its files nor what they say, and no MIB. */
static void keep_to_itself(void)
{
	setenv("MIBS", "", 1);
	setenv("MIBDIRS", NO_FOLDER, 1);
	setenv("SNMPCONFPATH", NO_FOLDER, 1);
	setenv("SNMP_PERSISTENT_DIR", NO_FOLDER, 1);
	netsnmp_ds_set_boolean(NETSNMP_DS_LIBRARY_ID, NETSNMP_DS_LIB_DONT_READ_CONFIGS, 1);
	netsnmp_ds_set_boolean(NETSNMP_DS_LIBRARY_ID, NETSNMP_DS_LIB_DONT_PERSIST_STATE, 1);
	netsnmp_ds_set_boolean(NETSNMP_DS_LIBRARY_ID, NETSNMP_DS_LIB_DISABLE_V1, 1);
	netsnmp_ds_set_boolean(NETSNMP_DS_LIBRARY_ID, NETSNMP_DS_LIB_DISABLE_V2c, 1);
	/* What is wrong with a message is counted. Without any handler the library would write to stderr. */
	snmp_enable_calllog();
}

/* engineBoots_conf() adds one to what a file of the library's would say. */
static void set_boots(const struct snmp_keyring *ring, uint32_t boots)
{
	char before[16];

	snprintf(before, sizeof(before), "%u", boots - 1);
	set_exact_engineID(ring->engine.octets, ring->engine.size);
	engineBoots_conf("engineBoots", before);
	set_enginetime(ring->engine.octets, ring->engine.size, boots, (u_int)snmpv3_local_snmpEngineTime(),
		       TRUE);
}

bool wire_init(struct snmp_agent *agent, const struct snmp_keyring *ring)
{
	keep_to_itself();
	init_snmp("rtu-snmp");
	set_boots(ring, agent->boots);
	if (add_users(agent, ring))
		return true;
	map_log(agent->map, MAP_LOG_ERROR,
		"this build's Net-SNMP cannot take all keys of %s: make them anew with AES-128",
		agent->settings->keys);
	return false;
}
