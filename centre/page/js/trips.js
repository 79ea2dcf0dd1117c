// SPDX-License-Identifier: GPL-3.0-or-later
// The trips and stops of a vehicle: when, how far, how fast. The rules are the centre's (trips.py).
import uPlot from "../vendor/uplot.mjs";
import { HOUR_MS, look } from "./chart.js";
import { empty, h, modal, Rows, setText, th } from "./dom.js";
import * as live from "./live.js";
import { age, t, time } from "./words.js";
import { axisTimes } from "./zone.js";

const SPANS = [["chart_day", 24], ["chart_week", 168], ["trend_month", 730.5]];
const KMH = 3.6;

function km(metres) {
  return `${(metres / 1000).toFixed(metres < 100000 ? 2 : 0)} km`;
}

function speeds(place, trip) {
  const { colours, axis, tzDate } = look();
  place.replaceChildren();
  new uPlot({
    width: Math.max(240, place.clientWidth), height: 160, tzDate, legend: { show: true, live: true },
    axes: [{ ...axis, space: 90, values: (_, seconds) => axisTimes(seconds) }, { ...axis, size: 62 }],
    series: [{ label: t("time"), value: (_, second) => (second === null ? "–" : time(second * 1000)) },
      { label: "km/h", stroke: colours.getPropertyValue("--accent"), width: 1.5, value: (_, speed) => (speed === null ? "–" : speed.toFixed(0)) }],
  }, [trip.speeds.map(([at]) => at / 1000), trip.speeds.map(([, speed]) => speed * KMH)], place);
}

export function tripsDialogue(point, name) {
  let asking = 0;
  const body = h("tbody");
  const table = h("table", {}, h("thead", {}, h("tr", {}, ...["trip_kind", "from", "to", "trip_time", "trip_way", "trip_mean", "trip_most"].map((key) => th(key)))), body);
  const none = h("div");
  const sum = h("span", { class: "muted", role: "status" });
  const profile = h("div", { class: "chart" });
  const file = h("a", { download: "" }, "CSV");
  const spans = SPANS.map(([key, hours]) => h("button", { class: "small", onclick: () => show(hours) }, t(key)));
  const dialog = h("dialog", { class: "wide", "aria-label": `${t("trips")} · ${name}` },
    h("div", { class: "row" }, h("h2", { class: "grow" }, `${t("trips")} · ${name}`), ...spans, file,
      h("button", { class: "small", "aria-label": t("close"), onclick: () => dialog.close() }, "✕")),
    sum, profile, h("div", { class: "scroll trips" }, table, none), h("p", { class: "muted" }, t("trip_rules")));

  const rows = new Rows(body, (_, part) => {
    const is = part.kind === "trip";
    const unknown = part.unknown_m ? ` + ${t("trip_unknown", { way: km(part.unknown_m) })}` : "";
    const kind = is ? h("button", { class: "link", onclick: () => speeds(profile, part) }, t("trip")) : t("stop");
    const cells = [kind, time(part.from), time(part.to), age(part.to - part.from), is ? km(part.metres) + unknown : "",
      is ? `${(part.mean * KMH).toFixed(0)} km/h` : "", is ? `${(part.most * KMH).toFixed(0)} km/h` : ""];
    return { element: h("tr", { class: part.kind }, ...cells.map((cell) => h("td", {}, cell))), update() {} };
  });

  async function show(hours) {
    const mine = ++asking;
    spans.forEach((button, n) => button.setAttribute("aria-pressed", String(SPANS[n][1] === hours)));
    const to = Math.round(live.now());
    const query = `trips?point=${point}&from=${to - hours * HOUR_MS}&to=${to}`;
    file.href = `api/${query}&format=csv`;
    setText(sum, "…");
    try {
      const parts = await live.ask(query);
      if (mine !== asking) return;
      const trips = parts.filter((part) => part.kind === "trip");
      rows.show(parts.reverse().map((part) => [`${part.kind} ${part.from} ${to}`, part]));
      table.hidden = !parts.length;
      none.replaceChildren(...(parts.length ? [] : [empty(t("track_empty_span"))]));
      profile.replaceChildren();
      setText(sum, t("trip_sum", { n: trips.length, way: km(trips.reduce((all, trip) => all + trip.metres, 0)) }));
    } catch (error) {
      if (mine === asking) setText(sum, t("failed", { error: error.message }));
    }
  }

  modal(dialog);
  show(SPANS[0][1]);
}
