// SPDX-License-Identifier: GPL-3.0-or-later
// How often alarms came in the last 24 hours, and which: more than ten in ten minutes nobody can follow (EEMUA 191).
import { h, setText, th } from "./dom.js";
import * as live from "./live.js";
import { t, time } from "./words.js";

const AGAIN_MS = 10000;
const BAR_MS = 600000;
const FLOOD = 10; // alarms in ten minutes
const FIGURES = ["last_10_min", "last_hour", "day", "peak", "standing", "unacknowledged", "shelved", "suppressed"];

function bars(told) {
  const most = Math.max(...told.bars, FLOOD);
  const begin = told.now - told.bars.length * BAR_MS;
  const drawn = told.bars.map((count, number) => {
    const bar = h("span", { class: count > FLOOD ? "bar flood" : "bar", title: `${time(begin + number * BAR_MS)}: ${count}` });
    bar.style.height = `${(100 * count) / most}%`;
    return bar;
  });
  const limit = h("span", { class: "limit", title: t("flood", { n: FLOOD }) });
  limit.style.bottom = `${(100 * FLOOD) / most}%`;
  return h("div", { class: "bars", role: "img", "aria-label": t("rates_shown", { peak: told.peak, day: told.day }) }, ...drawn, limit);
}

// `name` says what an alarm is of.
export function showRates(place, name) {
  const figures = h("dl", { class: "figures" });
  const chart = h("div");
  const tables = h("div");
  const failure = h("p", { class: "error", role: "alert" });
  place.append(h("section", { class: "card" }, h("div", { class: "row" }, h("h2", { class: "grow" }, t("rates")), failure),
    figures, chart, h("p", { class: "muted note" }, t("flood", { n: FLOOD })), tables));

  function table(title, none, rows) {
    const head = ["station", "what", "times", "last"].map((key) => th(key));
    const body = rows.map((row) => h("tr", {}, ...[live.stations.get(row.station)?.name ?? "", name(row), String(row.n), time(row.last)].map((text) => h("td", {}, text))));
    return [h("h3", {}, t(title)), rows.length ? h("div", { class: "scroll" }, h("table", {}, h("thead", {}, h("tr", {}, ...head)), h("tbody", {}, ...body))) : h("p", { class: "muted note" }, t(none))];
  }

  async function show() {
    const told = await live.ask("alarms/rates");
    figures.replaceChildren(...FIGURES.map((key) => h("div", { class: key.startsWith("last_10") && told[key] > FLOOD ? "flood" : "" }, h("dt", {}, t(`rate_${key}`)), h("dd", {}, String(told[key])))));
    chart.replaceChildren(bars(told));
    tables.replaceChildren(...table("top_ten", "no_past_alarms", told.top), ...table("chattering", "no_chattering", told.chattering));
    setText(failure, "");
  }
  const failed = (error) => setText(failure, t("failed", { error: error.message }));
  return live.repeat(() => show().catch(failed), AGAIN_MS);
}
