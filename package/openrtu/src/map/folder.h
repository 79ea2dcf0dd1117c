/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Folders in which a module keeps what shall outlive the map. */
#ifndef OPENRTU_MAP_FOLDER_H
#define OPENRTU_MAP_FOLDER_H

/* Opens a folder, made with all on the way to it. -1 with errno. */
int map_open_folder(const char *path);

#endif
