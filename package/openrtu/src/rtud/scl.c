/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/scl.h"

static enum config_result print(const struct map_config *config, struct cid_form form)
{
	struct iec61850_model model;
	const bool good = iec61850_model_of(&model, config);

	if (good)
		cid_write(stdout, &model, form, stderr);
	else
		fputs("out of memory\n", stderr);
	iec61850_model_end(&model);
	return good ? CONFIG_GOOD : CONFIG_UNUSABLE;
}

int scl_print(const char *path, struct config_modules modules, struct cid_form form)
{
	struct map_config config;
	enum config_result result = config_load(path, NULL, modules, &config, stderr);

	if (result == CONFIG_GOOD && iec61850_settings(&config) == NULL) {
		fprintf(stderr, "%s: has no object \"iec61850\", and so no server to describe: add one\n",
			path);
		result = CONFIG_WRONG;
	}
	if (result == CONFIG_GOOD)
		result = print(&config, form);
	config_free(&config);
	return (int)result;
}
