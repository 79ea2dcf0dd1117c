#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# validate-dtb.sh DTB: the bindings against the meta-schema, then the device tree against the bindings.
set -euo pipefail
dtb=$(realpath "$1")
cd "$(dirname "$0")/.."

# Both exit 0 also when they have found something: what they print decides. A compatible string without a binding is a
# slip in the name of one of ours; gpio-leds and the like have theirs in the kernel, and so has the type of their
# properties, without which dt-validate holds raw bytes against dt-core.yaml.
found=$(
	.venv/bin/dt-doc-validate dts/bindings 2>&1
	.venv/bin/dt-validate -m -s dts/bindings "$dtb" 2>&1 |
		sed "/: b'.*' is not of type 'object', 'integer', 'array', 'boolean', 'null'$/{N;d}" |
		grep -vP "failed to match any schema with compatible: \[(?!.*'(nuvoton|openrtu),)" || [[ $? -eq 1 ]]
) || found+=$'\nnot validated'
if [[ -n $found ]]; then
	echo "$found" >&2
	exit 1
fi
echo "$1: valid"
