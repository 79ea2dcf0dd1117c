# SPDX-License-Identifier: GPL-3.0-or-later
# The control centre's page.

PAGE       := build/centre/page
PAGE_FILES := $(shell find centre/page -type f)

codes: $(VENV) ## Maintain: what has its numbers from C, after a change of them
	$(PYTHON) scripts/codes.py

centre-page: $(PAGE)/done ## Build: the control centre's page

$(PAGE)/done: build/centre/npm.done $(PAGE_FILES)
	@rm -rf $(@D)
	$(LOGGED) centre-page node centre/page/build.mjs build/centre/node_modules $(@D)
	@touch $@

build/centre/npm.done: centre/page/package.json centre/page/package-lock.json
build/provider/npm.done: tests/centre/provider/package.json tests/centre/provider/package-lock.json
build/axe/npm.done: tests/centre/axe/package.json tests/centre/axe/package-lock.json
build/modbus-peers/npm.done: tests/peers/npm/package.json tests/peers/npm/package-lock.json
build/centre/npm.done build/provider/npm.done build/axe/npm.done build/modbus-peers/npm.done:
	@command -v npm > /dev/null || scripts/setup-packages.sh scripts/packages-npm.txt
	@mkdir -p $(@D) && cp $^ $(@D)
	$(LOGGED) npm-$(notdir $(@D)) npm --prefix $(@D) ci --ignore-scripts --no-audit --no-fund
	@touch $@
