# SPDX-License-Identifier: GPL-2.0-or-later
CONFIG_NUC980=y
