/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A module in C: the level of a tank without its waves. "config" is not looked at: the time constant is ten scans. */
#include <openrtu.h>
#include <stdio.h>

int main(int argc, char **argv)
{
	struct openrtu *rtu = openrtu_attach(argc, argv);
	struct openrtu_sample level;
	double smooth = 0;
	bool begun = false;
	int in, out;

	if (rtu == NULL) {
		fprintf(stderr, "%s: %s\n", argv[0], openrtu_error());
		return 1;
	}
	in = openrtu_point(rtu, "tank.level");
	out = openrtu_point(rtu, "tank.level-smooth");
	while (openrtu_wait(rtu)) {
		openrtu_scan_begin(rtu);
		openrtu_read(rtu, in, &level);
		if (!begun)
			smooth = level.value;
		begun = true;
		smooth += (level.value - smooth) / 10;
		openrtu_write(rtu, out, smooth);
		openrtu_scan_end(rtu);
	}
	openrtu_detach(rtu);
	return 0;
}
