// SPDX-License-Identifier: GPL-3.0-or-later
// The points of a station: value, quality, time, age; a chart of each; commands.
import { chart, HOUR_MS } from "./chart.js";
import { commandDialogue } from "./command.js";
import { empty, fill, h, Rows, setText, state, th } from "./dom.js";
import { Finder, inOrder } from "./lists.js";
import * as live from "./live.js";
import { quality, stationState, valueText } from "./quality.js";
import { age, t, time } from "./words.js";

const COLUMNS = 6;

export function showPoints(main, wanted) {
  let stationId = wanted;
  let open = 0; // the point whose chart is shown
  const stations = h("ul", { class: "list" });
  const stationFinder = new Finder(update, "station");
  const finder = new Finder(update);
  finder.input.id = "search";
  const head = h("h2", {}, t("points"));
  const link = h("span");
  const body = h("tbody");
  const none = h("div");
  const chartCard = h("section", { class: "card", hidden: true });
  const headings = [["name"], ["value", "number"], ["quality"], ["time"], ["age"], [""]];
  const table = h("table", {}, h("thead", {}, h("tr", {}, ...headings.map(([key, kind]) => th(key, kind)))), body);
  main.append(
    h("div", { class: "side" }, h("div", { class: "top" }, stationFinder.element), stations),
    h("div", { class: "page" }, chartCard,
      h("section", { class: "card" }, h("div", { class: "row" }, head, link, h("span", { class: "grow" }), finder.element), h("div", { class: "scroll" }, table), none)));

  const stationRows = new Rows(stations, (id) => {
    const name = h("span", { class: "name" });
    const word = h("span");
    const button = h("button", { onclick: () => (location.hash = `#points/${id}`) }, name, word);
    return {
      element: h("li", {}, button),
      update(station) {
        setText(name, station.name);
        const { kind, word: text } = stationState(station);
        fill(word, kind + text, () => state(kind, text));
        button.setAttribute("aria-pressed", String(id === stationId));
      },
    };
  });

  const pointRows = new Rows(body, (id, first) => {
    if (first.heading) {
      return { element: h("tr", { class: "device" }, h("td", { colSpan: COLUMNS }, first.heading)), update() {} };
    }
    const name = h("button", { class: "link", onclick: () => openChart(id) });
    const [value, good, at, old, act] = ["value", "", "time", "time", "act"].map((kind) => h("td", { class: kind }));
    const row = h("tr", {}, h("td", {}, name), value, good, at, old, act);
    name.title = `CA ${first.ca} · IOA ${first.ioa}`;
    return {
      element: row,
      update(point) {
        setText(name, point.name);
        const text = valueText(point);
        fill(value, text, () => [text, point.unit ? h("span", { class: "unit" }, point.unit) : ""]);
        const { kind, word } = quality(point);
        fill(good, kind + word, () => state(kind, word));
        row.classList.toggle("stale", kind === "none" || kind === "bad");
        setText(at, time(point.at, true));
        setText(old, point.at ? age(live.now() - point.at) : "–");
        const can = Boolean(point.command) && live.may("operator");
        fill(act, String(can), () => (can ? h("button", { class: "small", "aria-haspopup": "dialog", onclick: () => commandDialogue(id) }, t("command")) : []));
      },
    };
  });

  function openChart(id, span = HOUR_MS, until = Infinity) {
    const point = live.points.get(id);
    const last = until >= live.now();
    const end = Math.round(last ? live.now() : until);
    open = id;
    const place = h("div", { class: "chart" });
    const spans = [["chart_hour", 1], ["chart_day", 24], ["chart_week", 168]].map(([key, hours]) =>
      h("button", { class: "small", "aria-pressed": String(last && hours * HOUR_MS === span), onclick: () => openChart(id, hours * HOUR_MS) }, t(key)));
    const ways = [["earlier", "‹", -span], ["later", "›", span]].map(([key, sign, ms]) =>
      h("button", { class: "small", title: t(key), "aria-label": t(key), onclick: () => openChart(id, span, end + ms) }, sign));
    const file = h("a", { href: `api/points/${id}/history?format=csv&from=${end - span}&to=${end}`, download: "" }, "CSV");
    const trend = h("a", { href: `#trends/points=${id}&span=${span}` }, t("trends"));
    const close = h("button", { class: "small", "aria-label": t("close"), onclick: () => { open = 0; chartCard.hidden = true; } }, "✕");
    chartCard.replaceChildren(h("div", { class: "row" }, h("h2", { class: "grow" }, point.name), ...spans, ...ways, trend, file, close), place);
    chartCard.hidden = false;
    chart(place, point, span, end).catch((error) => place.replaceChildren(h("p", { class: "error" }, t("failed", { error: error.message }))));
  }

  const byName = inOrder((station) => station.name);
  function update() {
    const all = byName([...live.stations.values()]);
    const listed = all.filter((each) => stationFinder.fits(each.name));
    stationRows.show(listed.map((each) => [each.id, each]));
    stationFinder.tell(listed.length, all.length);
    if (!stationId && all.length) {
      history.replaceState(null, "", `#points/${all[0].id}`);
      stationId = all[0].id;
      live.look({ view: "points", station: stationId });
      return;
    }
    const station = live.stations.get(stationId);
    setText(head, station ? t("points_of", { station: station.name }) : t("choose_station"));
    if (station) {
      const { kind, word } = stationState(station);
      fill(link, kind + word, () => state(kind, word));
    }
    const points = [...live.points.values()].filter((point) => point.station === stationId);
    const found = points.filter((point) => finder.fits(`${point.name} ${point.device} ${point.ca}.${point.ioa}`));
    finder.tell(found.length, points.length);
    found.sort((a, b) => a.ca - b.ca || a.ioa - b.ioa);
    const entries = [];
    let device = "";
    for (const point of found) {
      const heading = `${point.device ? `${point.device} · ` : ""}CA ${point.ca}`;
      if (heading !== device) entries.push([`h${point.ca}${heading}`, { heading }]);
      device = heading;
      entries.push([point.id, point]);
    }
    pointRows.show(entries);
    table.hidden = !found.length;
    const why = found.length || !live.centre.connected ? "" : !live.stations.size ? "no_stations" : points.length ? "nothing_found" : "no_points";
    fill(none, why, () => (why ? empty(t(why), t(`${why}_more`)) : []));
  }

  const unwatch = live.watch(update);
  const tick = setInterval(update, 1000);
  const redraw = () => open && openChart(open);
  addEventListener("theme", redraw);
  live.look({ view: "points", station: stationId });
  return () => {
    unwatch();
    clearInterval(tick);
    removeEventListener("theme", redraw);
  };
}
