# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user may do."""

ROLES = ("viewer", "operator", "engineer")  # each may do what the ones before may

# What a token may, at most: so much as this role.
SCOPES = {"read": "viewer", "command": "operator", "engineer": "engineer"}
