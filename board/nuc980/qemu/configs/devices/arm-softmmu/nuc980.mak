# SPDX-License-Identifier: GPL-2.0-or-later
CONFIG_NUC980=y
# For -device w25q64,bus=ssi.1 and the like
CONFIG_SSI_M25P80=y
