// SPDX-License-Identifier: GPL-3.0-or-later
// The values of a point over time. A value holds until the next; an invalid one is a gap.
import uPlot from "../vendor/uplot.mjs";
import { CHART_ROWS, QUALITY } from "./codes.js";
import { h } from "./dom.js";
import * as live from "./live.js";
import { number, t, time } from "./words.js";
import { axisTimes, zone } from "./zone.js";

export const HOUR_MS = 3600000;

// What all charts have in common: {colours, axis, tzDate (times are in the chosen zone)}
export function look() {
  const colours = getComputedStyle(document.documentElement);
  return {
    colours,
    axis: { stroke: colours.getPropertyValue("--muted"), grid: { stroke: colours.getPropertyValue("--line"), width: 1 }, ticks: { show: false }, font: "12px system-ui" },
    tzDate: (second) => uPlot.tzDate(new Date(second * 1000), zone()),
  };
}

export async function chart(place, point, spanMs, end) {
  const rows = await live.ask(`points/${point.id}/history?from=${end - spanMs}&to=${end}`);
  if (!rows.length) {
    place.replaceChildren(h("p", { class: "muted" }, t("chart_empty")));
    return;
  }
  const good = (row) => (row.quality & QUALITY.INVALID ? null : row.value);
  const times = rows.map((row) => row.at / 1000).concat(end / 1000);
  const values = rows.map(good).concat(good(rows.at(-1)));
  const { colours, axis, tzDate } = look();
  const part = rows.length < CHART_ROWS ? [] : [h("p", { class: "muted" }, t("chart_part", { n: number(CHART_ROWS), time: time(rows[0].at, true) }))];
  place.replaceChildren(...part);
  const width = Math.max(240, place.clientWidth - 28);
  new uPlot({
    width, height: 170, tzDate, legend: { show: true, live: true },
    scales: { x: { range: [(end - spanMs) / 1000, end / 1000] } },
    axes: [{ ...axis, space: 90, values: (_, seconds) => axisTimes(seconds) }, { ...axis, size: 62 }],
    series: [{ value: (_, second) => (second === null ? "–" : time(second * 1000, true)), label: t("time") }, {
      label: point.unit ? `${point.name} (${point.unit})` : point.name, stroke: colours.getPropertyValue("--accent"), width: 1.6,
      paths: uPlot.paths.stepped({ align: 1 }), points: { show: rows.length < 100, size: 5 },
    }],
  }, [times, values], place);
}
