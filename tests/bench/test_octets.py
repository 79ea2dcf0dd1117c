# SPDX-License-Identifier: GPL-3.0-or-later
"""The bench of octets: what the kernel counts is what both sides say, and the table has its ratio."""

from octets import GPX, JSON, Count, Row, http_row, mqtt_row, table


def test_octets_of_the_others_on_real_connections() -> None:
    mqtt = mqtt_row()
    of_publish = 2 + 2 + len("stations/3067") + 2 + len(JSON)
    assert (mqtt.count.gave, mqtt.count.took) == (of_publish * mqtt.positions, 4 * mqtt.positions)
    assert mqtt.count.segments >= 2 * mqtt.positions
    http = http_row()
    assert http.count.took == len("HTTP/1.1 204 No Content\r\n\r\n") * http.positions
    assert http.count.gave > len(GPX) * http.positions


def test_table() -> None:
    rows = [Row("type 201", Count(35, 15, 2), 1), Row("GPX by HTTP", Count(54, 1000, 8), 2)]
    _, _, first, second = (
        [cell.strip() for cell in line.split("|")[1:-1]] for line in table(rows).splitlines()
    )
    assert first == ["type 201", "35.0", "15.0", "2.0", "1.00"]
    assert second == ["GPX by HTTP", "500.0", "27.0", "4.0", "10.54"]
