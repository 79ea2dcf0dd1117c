/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What the tests of the Ethernet ports need on the board and BusyBox has not.
 *
 *   network settings PORT          prints "SPEED full|half auto|forced DRIVER"
 *   network force PORT SPEED full|half
 *   network negotiate PORT         all modes again, and once more from the start
 *   network join PORT COUNT        multicast groups 239.1.0.1 and on, until it is ended
 */

#include <arpa/inet.h>
#include <linux/ethtool.h>
#include <linux/sockios.h>
#include <net/if.h>
#include <netinet/in.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

static int socket_fd;

static void fail(const char *what)
{
	perror(what);
	exit(1);
}

static void ethtool(const char *port, void *command)
{
	struct ifreq request = {0};

	strncpy(request.ifr_name, port, IFNAMSIZ - 1);
	request.ifr_data = command;
	if (ioctl(socket_fd, SIOCETHTOOL, &request) < 0)
		fail(port);
}

static void show_settings(const char *port)
{
	struct ethtool_cmd settings = {.cmd = ETHTOOL_GSET};
	struct ethtool_drvinfo driver = {.cmd = ETHTOOL_GDRVINFO};

	ethtool(port, &settings);
	ethtool(port, &driver);
	printf("%u %s %s %s\n", ethtool_cmd_speed(&settings),
	       settings.duplex == DUPLEX_FULL ? "full" : "half", settings.autoneg ? "auto" : "forced",
	       driver.driver);
}

static void force(const char *port, unsigned speed, const char *duplex)
{
	struct ethtool_cmd settings = {.cmd = ETHTOOL_GSET};

	ethtool(port, &settings);
	settings.cmd = ETHTOOL_SSET;
	settings.autoneg = AUTONEG_DISABLE;
	settings.duplex = strcmp(duplex, "full") ? DUPLEX_HALF : DUPLEX_FULL;
	ethtool_cmd_speed_set(&settings, speed);
	ethtool(port, &settings);
}

static void negotiate(const char *port)
{
	struct ethtool_cmd settings = {.cmd = ETHTOOL_GSET};
	struct ethtool_value again = {.cmd = ETHTOOL_NWAY_RST};

	ethtool(port, &settings);
	settings.cmd = ETHTOOL_SSET;
	settings.autoneg = AUTONEG_ENABLE;
	settings.advertising = settings.supported;
	ethtool(port, &settings);
	ethtool(port, &again);
}

static void join(const char *port, unsigned count)
{
	struct ip_mreqn group = {.imr_ifindex = (int)if_nametoindex(port)};

	for (unsigned n = 1; n <= count; n++) {
		group.imr_multiaddr.s_addr = htonl(0xef010000 + n);
		if (setsockopt(socket_fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof group) < 0)
			fail("IP_ADD_MEMBERSHIP");
	}
	puts("joined");
	fflush(stdout);
	pause();
}

int main(int argc, char **argv)
{
	socket_fd = socket(AF_INET, SOCK_DGRAM, 0);
	if (socket_fd < 0)
		fail("socket");
	if (argc == 3 && !strcmp(argv[1], "settings"))
		show_settings(argv[2]);
	else if (argc == 5 && !strcmp(argv[1], "force"))
		force(argv[2], (unsigned)atoi(argv[3]), argv[4]);
	else if (argc == 3 && !strcmp(argv[1], "negotiate"))
		negotiate(argv[2]);
	else if (argc == 4 && !strcmp(argv[1], "join"))
		join(argv[2], (unsigned)atoi(argv[3]));
	else
		return 2;
	return 0;
}
