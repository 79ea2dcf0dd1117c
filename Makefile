# SPDX-License-Identifier: GPL-3.0-or-later
# The one front door. Every target brings what it needs, so `make run` and `make test` are enough on a fresh machine.

SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory
# Containers set it to stay small. Here each of some thousand starts of Python would compile what it imports.
unexport PYTHONDONTWRITEBYTECODE

SRC     := package/openrtu/src
LINESIM := tests/linesim
PLANT   := tests/plant
BENCH   := tests/bench
PYTHON  := .venv/bin/python
LOGGED  := @scripts/logged.sh

# What is a target's alone is never a file.
.PHONY: $(shell sed -n 's/^\([a-z][a-z0-9-]*\):.*/\1/p' Makefile mk/*.mk)

# Debian packages, and Python packages in .venv: each target brings the lists that it uses.
PACKAGES := build/packages.done
EMULATED := build/packages.done build/packages-boards.done build/packages-cross.done build/packages-twin.done
PACKAGE_LISTS := packages packages-boards packages-coverage packages-cross packages-fuzz packages-lint packages-man packages-tests
VENV     := .venv/python.done
BOARDS   := .venv/python-boards.done
CENTRE   := .venv/python-centre.done
COVERED  := .venv/python-coverage.done
IMAGING  := .venv/python-images.done
LINTED   := .venv/python-lint.done
TOOLS    := .venv/python-tools.done
WHEELING := .venv/python-wheels.done
TESTED   := .venv/python-tests.done
SYSROOT  := build/arm-sysroot/done

# A target's line ends with its group and what it does: `## Build: ...`.
HELP_GROUPS := See it,Build,A board,Test,Maintain

help: ## Maintain: show this list
	@awk -F ':.*## ' -v groups='$(HELP_GROUPS)' '/^[a-z0-9-]+:.*## / { \
	  colon = index($$2, ": "); group = substr($$2, 1, colon - 1); \
	  lines[group] = lines[group] sprintf("  make %-17s %s\n", $$1, substr($$2, colon + 2)) \
	} END { \
	  n = split(groups, order, ","); \
	  for (i = 1; i <= n; i++) printf("%s%s\n%s", (i > 1 ? "\n" : ""), order[i], lines[order[i]]) \
	}' $(MAKEFILE_LIST)

# An area each. One may use what those before it define.
include mk/needed.mk mk/gateway.mk mk/centre.mk mk/tools.mk mk/release.mk mk/packages.mk mk/board.mk mk/twin.mk mk/image-debian.mk mk/image-buildroot.mk mk/tests.mk mk/shows.mk

# ---- away with it -----------------------------------------------------------------------------------

clean: ## Maintain: remove what was built
	rm -rf build

distclean: clean ## Maintain: remove the Python environment as well
	rm -rf .venv .pytest_cache .ruff_cache

# ---- what was typed ---------------------------------------------------------------------------------

# Before anything is built. Last, where all that has a default has it.
TYPED := $(foreach name,PORT STATIONS BOARD_IP IMAGE IMAGES SITE BOARD DTS SWITCHES KEY CERTIFICATE FUZZ_SECONDS LIB60870 NVD SEED SEEDS HOURS,$(name)='$(subst ','\'',$($(name)))') \
  IMAGE_TYPED=$(IMAGE_TYPED) DRY_RUN=$(findstring n,$(filter-out --%,$(firstword -$(MAKEFLAGS))))
REFUSED := $(shell $(TYPED) scripts/check-arguments.sh $(MAKECMDGOALS))
$(if $(REFUSED),$(error $(REFUSED)))
