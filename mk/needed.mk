# SPDX-License-Identifier: GPL-3.0-or-later
# What is needed: Debian packages, Python packages in .venv.

setup: LISTS := $(PACKAGE_LISTS)
setup: $(PACKAGE_LISTS:%=build/%.done) $(TESTED) $(LINTED) $(COVERED) ## Maintain: bring what most tests need: Debian packages, Python packages into .venv

tools: $(BOARDS) $(CENTRE) $(TOOLS) ## Build: what the tools of scripts/ import, into .venv

# LISTS names those that a goal needs besides: who is not root gets one command for all of them.
build/%.done: scripts/%.txt scripts/setup-packages.sh
	@scripts/setup-packages.sh $< $(LISTS:%=scripts/%.txt)
	@mkdir -p $(@D) && touch $@

# The first one makes .venv anew, so the others come again behind it.
$(VENV): scripts/python.txt requirements.txt scripts/setup-python.sh | $(PACKAGES)
	@scripts/setup-python.sh $<
	@touch $@

.venv/%.done: scripts/%.txt $(VENV)
	@scripts/setup-python.sh $<
	@touch $@

$(BOARDS): | build/packages-boards.done
$(LINTED): | build/packages-lint.done
$(TESTED): $(BOARDS) $(CENTRE) $(IMAGING) $(TOOLS) | build/packages-tests.done

$(SYSROOT): scripts/setup-sysroot.sh | build/packages-cross.done
	$(LOGGED) arm-sysroot scripts/setup-sysroot.sh $(@D)
	@touch $@
