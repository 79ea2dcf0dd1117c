# SPDX-License-Identifier: GPL-3.0-or-later
# The tools as Python packages.

WHEELS := build/wheels
# setuptools would take what an earlier build has left.
LEFT := build/python package/openrtu/python/build

wheels: centre-page $(WHEELING) ## Build: openrtu-tools and the modules' library openrtu, for pip, in build/wheels
	rm -rf $(WHEELS) $(LEFT)
	$(LOGGED) wheels env SOURCE_DATE_EPOCH=$$(scripts/source-date.sh) $(PYTHON) -m pip wheel --disable-pip-version-check --no-build-isolation \
	  --no-deps --wheel-dir $(WHEELS) . ./package/openrtu/python
	rm -rf $(LEFT)
