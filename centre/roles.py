# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user may do."""

ROLES = ("viewer", "operator", "engineer")  # each may do what the ones before may
