# SPDX-License-Identifier: GPL-3.0-or-later
# The pages as a site, and a release.

SITE_VENV := build/pages/venv

site: $(SITE_VENV)/done ## Build: the pages as a site to search, also without network
	scripts/site-source.py build/pages/source
	$(LOGGED) site env NO_MKDOCS_2_WARNING=1 $(SITE_VENV)/bin/mkdocs build --strict

# Of its own: what MkDocs needs and what the tools need do not bind each other.
$(SITE_VENV)/done: requirements-site.txt | build/packages-site.done
	@rm -rf $(@D) && /usr/bin/python3 -m venv $(@D)
	$(LOGGED) site-python $(@D)/bin/pip install --disable-pip-version-check --requirement $<
	@touch $@

PARTS ?=

release: build/packages-release.done ## Build: what a release publishes, in build/release (PARTS=)
	rm -rf build/release
	PARTS='$(PARTS)' scripts/release-files.sh --make build/release build
