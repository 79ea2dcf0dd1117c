// SPDX-License-Identifier: GPL-3.0-or-later
// Points of any stations over any time, together. The address keeps what is shown: #trends/points=1,2&span=3600000 follows the
// clock, #trends/points=1,2&from=…&to=… does not. The centre gives as many columns as the screen has, with the lowest and highest of each.
import uPlot from "../vendor/uplot.mjs";
import { HOUR_MS, look } from "./chart.js";
import { CONTENT, LINK } from "./codes.js";
import { empty, fill, h, Rows, setText, state } from "./dom.js";
import * as live from "./live.js";
import { qualityOf, valueText } from "./quality.js";
import { firstBeyond } from "./search.js";
import { number, t, time } from "./words.js";
import { axisTimes } from "./zone.js";

const POINTS_MOST = 8; // that colours and dashes tell apart; the centre answers 12
const SPANS = [["chart_hour", 1], ["chart_day", 24], ["chart_week", 168], ["trend_month", 730.5], ["trend_year", 8766]];
const SPAN_LEAST_MS = 1000, SPAN_MOST_MS = 50 * 8766 * HOUR_MS;
const ASK_MS = 120; // after the last turn of the wheel
const FOLLOW_MS = [1000, 60000]; // a pixel's time, within these
const COLOURS = ["#0a7bd6", "#d55e00", "#009e73", "#c2569b", "#a07800", "#3aa0e0", "#8b5cf6", "#7d858c"];
const DASHES = [[], [8, 3], [2, 3], [10, 3, 2, 3], [5, 5], [12, 4], [3, 6], [1, 2]];
const STRIP = 5, HEIGHT = 340, AXES_MOST = 4;
const STATES = [CONTENT.SINGLE, CONTENT.DOUBLE]; // they are drawn on a scale of their own
const AT = 0, LOW = 1, HIGH = 2, LAST = 3, QUALITY = 4; // of a column

// What an address says; anything that is none of it is left out.
export function readAddress(text, now) {
  const said = new URLSearchParams(text);
  const numbers = (said.get("points") ?? "").split(",").map(Number).filter((id) => Number.isInteger(id) && id > 0);
  const points = [...new Set(numbers)].slice(0, POINTS_MOST);
  const [from, to] = ["from", "to"].map((name) => Number(said.get(name)));
  if (from && to - from >= SPAN_LEAST_MS && to - from <= SPAN_MOST_MS) return { points, from, to, follows: false };
  const asked = Number(said.get("span"));
  const span = asked >= SPAN_LEAST_MS && asked <= SPAN_MOST_MS ? asked : HOUR_MS;
  return { points, from: now - span, to: now, follows: true };
}

export function writeAddress({ points, from, to, follows }) {
  const span = follows ? `span=${Math.round(to - from)}` : `from=${Math.round(from)}&to=${Math.round(to)}`;
  return `#trends/points=${points.join(",")}&${span}`;
}

// The column in which a time lies; undefined before the first.
export function columnAt(columns, at) {
  return columns[firstBeyond(columns, at, (column) => column[AT]) - 1];
}

// Until when the last value of a trend is known to hold.
function knownUntil(trend, to) {
  const station = live.stations.get(trend.station);
  const lost = station && station.link !== LINK.UP && station.since ? station.since : Infinity;
  return Math.max(Math.min(to, live.now(), lost), trend.columns.at(-1)?.[AT] ?? 0);
}

export function showTrends(main, _, argument = "") {
  const seen = readAddress(argument, live.now());
  let trends = []; // as the centre has answered
  let drawn = { from: 0, to: 0, columns: 1000 }; // what they are of
  let plot = null;
  let asking = 0; // the last question
  let soon = 0;
  const place = h("div", { class: "chart trend", tabIndex: 0, role: "img", "aria-label": t("trends") });
  const status = h("span", { class: "muted", role: "status" });
  const when = h("span", { class: "muted" });
  const legend = h("tbody");
  const table = h("table", {}, h("thead", {}, h("tr", {}, ...["name", "value", "trend_range", "quality", ""].map((key) => h("th", {}, key ? t(key) : "")))), legend);
  const file = h("a", { download: "" }, "CSV");
  const spans = SPANS.map(([key, hours]) => h("button", { class: "small", onclick: () => show(live.now() - hours * HOUR_MS, live.now(), true) }, t(key)));
  const follow = h("button", { class: "small", onclick: () => show(live.now() - (seen.to - seen.from), live.now(), true) }, t("trend_follow"));
  const ways = [["earlier", "‹", () => pan(-0.5)], ["later", "›", () => pan(0.5)], ["trend_in", "+", () => zoom(0.5)], ["trend_out", "−", () => zoom(2)]].map(
    ([key, sign, act]) => h("button", { class: "small", title: t(key), "aria-label": t(key), onclick: act }, sign));
  const search = h("input", { type: "search", placeholder: t("station"), "aria-label": t("station") });
  const list = h("ul", { class: "list" });
  const nothing = h("div");
  const body = h("div", {}, h("div", { class: "row when" }, when, h("span", { class: "grow" }), status), place, h("div", { class: "scroll" }, table));
  main.append(
    h("div", { class: "side" }, h("div", { class: "top" }, search), list),
    h("div", { class: "page" }, h("section", { class: "card" },
      h("div", { class: "row" }, h("h2", { class: "grow" }, t("trends")), ...spans, follow, ...ways, file), nothing, body,
      h("p", { class: "muted hint" }, t("trend_keys")))));

  // ---- which points --------------------------------------------------------------------------

  let opened = 0; // the station whose points are listed
  let offered = []; // its points
  const stationRows = new Rows(list, (key) => {
    const name = h("span", { class: "name" });
    const mark = h("span");
    const button = h("button", { onclick: () => (key.startsWith("s") ? open(Number(key.slice(1))) : toggle(Number(key.slice(1)))) }, name, mark);
    return {
      element: h("li", { class: key.startsWith("p") ? "inner" : "" }, button),
      update(each) {
        setText(name, each.name);
        if (key.startsWith("s")) button.setAttribute("aria-expanded", String(each.id === opened));
        else button.setAttribute("aria-pressed", String(seen.points.includes(each.id)));
        setText(mark, key.startsWith("p") ? each.unit : "");
      },
    };
  });

  function offer() {
    const words = search.value.toLocaleLowerCase();
    const all = [...live.stations.values()].filter((each) => each.name.toLocaleLowerCase().includes(words));
    all.sort((a, b) => a.name.localeCompare(b.name, undefined, { numeric: true }));
    const entries = [];
    for (const station of all.slice(0, 200)) {
      entries.push([`s${station.id}`, station]);
      if (station.id === opened) entries.push(...offered.map((point) => [`p${point.id}`, point]));
    }
    stationRows.show(entries);
  }

  async function open(id) {
    opened = opened === id ? 0 : id;
    offered = [];
    offer();
    if (!opened) return;
    const found = await live.ask(`points?station=${id}`).catch(() => []);
    if (opened !== id) return;
    offered = found.filter((point) => point.latitude === undefined).sort((a, b) => a.ca - b.ca || a.ioa - b.ioa);
    offer();
  }

  function toggle(id) {
    if (seen.points.includes(id)) seen.points = seen.points.filter((each) => each !== id);
    else if (seen.points.length < POINTS_MOST) seen.points.push(id);
    else { setText(status, t("trend_many", { n: POINTS_MOST })); return; }
    offer();
    show(seen.from, seen.to, seen.follows);
  }

  // ---- which time ----------------------------------------------------------------------------

  function show(from, to, follows) {
    const span = Math.min(Math.max(to - from, SPAN_LEAST_MS), SPAN_MOST_MS);
    const middle = (from + to) / 2;
    Object.assign(seen, follows ? { from: to - span, to } : { from: middle - span / 2, to: middle + span / 2 }, { follows });
    history.replaceState(null, "", writeAddress(seen));
    plot?.setScale("x", { min: seen.from / 1000, max: seen.to / 1000 }); // at once; what belongs there comes soon
    say();
    clearTimeout(soon);
    soon = setTimeout(ask, ASK_MS);
  }

  function zoom(factor, at = seen.follows ? seen.to : (seen.from + seen.to) / 2) {
    show(at - (at - seen.from) * factor, at + (seen.to - at) * factor, seen.follows && at === seen.to);
  }

  function pan(part) {
    const ms = (seen.to - seen.from) * part;
    show(seen.from + ms, seen.to + ms, false);
  }

  function keys(event) {
    const act = { "+": () => zoom(0.5), "=": () => zoom(0.5), "-": () => zoom(2), ArrowLeft: () => (event.shiftKey ? pan(-0.25) : step(-1)),
      ArrowRight: () => (event.shiftKey ? pan(0.25) : step(1)), PageUp: () => pan(-1), PageDown: () => pan(1), End: () => follow.click() }[event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    act();
  }

  // The cursor, a fiftieth further.
  function step(sign) {
    if (!plot) return;
    const { width, height } = plot.over.getBoundingClientRect();
    const left = plot.cursor.left < 0 ? width : plot.cursor.left;
    plot.setCursor({ left: Math.min(Math.max(left + (sign * width) / 50, 0), width), top: height / 2 });
  }

  // ---- what is there -------------------------------------------------------------------------

  async function ask() {
    clearTimeout(soon);
    const mine = ++asking;
    const part = { from: Math.round(seen.from), to: Math.round(seen.to), columns: Math.max(100, Math.min(2000, Math.round(place.clientWidth))) };
    const query = `trends?points=${seen.points.join(",")}&from=${part.from}&to=${part.to}&columns=${part.columns}`;
    let found = [];
    try {
      if (seen.points.length) found = (await live.ask(query)).trends;
      setText(status, "");
    } catch (error) {
      if (mine === asking) setText(status, t("failed", { error: error.message }));
      again();
      return;
    }
    if (mine !== asking || ended) return;
    [trends, drawn] = [found, part];
    file.href = `api/${query}&format=csv`;
    file.hidden = !found.length;
    draw();
    again();
  }

  function again() {
    if (!seen.follows || ended) return;
    const pixel = (seen.to - seen.from) / Math.max(place.clientWidth, 300);
    soon = setTimeout(() => {
      if (document.hidden || place.matches(".holds")) return again();
      const span = seen.to - seen.from;
      Object.assign(seen, { from: live.now() - span, to: live.now() });
      return ask();
    }, Math.min(Math.max(pixel, FOLLOW_MS[0]), FOLLOW_MS[1]));
  }

  function scaleOf(trend) {
    return STATES.includes(trend.content) ? "state" : `unit ${trend.unit}`;
  }

  function bounds(scale) {
    const numbers = trends.filter((each) => scaleOf(each) === scale).flatMap((each) => each.columns.flatMap((column) => [column[LOW], column[HIGH]])).filter((value) => value !== null);
    const [low, high] = numbers.reduce(([least, most], value) => [Math.min(least, value), Math.max(most, value)], [Infinity, -Infinity]);
    if (scale === "state") return [-0.1, Math.max(1, high) + 0.1];
    if (!numbers.length) return [0, 1];
    const room = high > low ? (high - low) * 0.06 : Math.abs(high) * 0.1 || 1;
    return [low - room, high + room];
  }

  function draw() {
    const scales = [...new Set(trends.map(scaleOf))];
    const times = [...new Set(trends.flatMap((each) => [...each.columns.map((column) => column[AT]), knownUntil(each, drawn.to)]))].sort((a, b) => a - b);
    const key = JSON.stringify([trends.map((each) => [each.point, each.unit]), document.documentElement.dataset.theme]);
    const data = [times.map((ms) => ms / 1000), ...trends.map((trend) => {
      const until = knownUntil(trend, drawn.to);
      return times.map((ms) => (ms > until ? null : columnAt(trend.columns, ms)?.[LAST] ?? null));
    })];
    nothing.replaceChildren(...(trends.length ? [] : [empty(t("trend_none"), t("trend_none_more"))]));
    body.hidden = !trends.length;
    if (!plot || plot.key !== key) make(scales, data, key);
    else plot.setData(data, false);
    plot?.setScale("x", { min: seen.from / 1000, max: seen.to / 1000 });
    say();
  }

  function make(scales, data, key) {
    plot?.destroy();
    plot = null;
    if (!trends.length) return;
    const { colours, axis, tzDate } = look();
    plot = new uPlot({
      width: Math.max(240, place.clientWidth - 28), height: HEIGHT, legend: { show: false }, tzDate,
      cursor: { drag: { x: true, y: false, setScale: false, dist: 6 }, points: { show: false } },
      scales: { x: { time: true, range: (_self, low, high) => [low, high] }, ...Object.fromEntries(scales.map((scale) => [scale, { range: () => bounds(scale) }])) },
      axes: [{ ...axis, space: 90, values: (_, seconds) => axisTimes(seconds) },
        ...scales.slice(0, AXES_MOST).map((scale, n) => ({ ...axis, scale, side: n % 2 ? 1 : 3, size: 62, incrs: scale === "state" ? [1] : undefined, grid: { ...axis.grid, show: n === 0 },
          label: scale === "state" ? t("trend_states") : scale.slice(5), labelSize: scale === "unit " ? 0 : 18, labelFont: "12px system-ui" }))],
      series: [{}, ...trends.map((trend, n) => ({ scale: scaleOf(trend), stroke: COLOURS[n], width: 1.25, dash: DASHES[n], paths: uPlot.paths.stepped({ align: 1 }), points: { show: false }, spanGaps: false }))],
      hooks: { drawAxes: [envelopes], draw: [strips], setCursor: [say], setSelect: [select] },
    }, data, place);
    plot.key = key;
    plot.over.addEventListener("wheel", (event) => {
      event.preventDefault();
      const at = seen.from + ((seen.to - seen.from) * event.offsetX) / plot.over.clientWidth;
      zoom(event.deltaY > 0 ? 1.25 : 0.8, seen.follows && event.offsetX > plot.over.clientWidth * 0.95 ? seen.to : at);
    }, { passive: false });
    plot.over.addEventListener("mousedown", () => place.classList.add("holds")); // a span that is chosen does not run away
  }

  function select(self) {
    place.classList.remove("holds");
    const { left, width } = self.select;
    if (width < 6) return;
    self.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    const [from, to] = [self.posToVal(left, "x"), self.posToVal(left + width, "x")];
    show(from * 1000, to * 1000, false);
  }

  const released = () => place.classList.remove("holds");
  addEventListener("mouseup", released);

  // Calls with each column and where on the canvas it begins and ends.
  function each(self, trend, act) {
    const until = knownUntil(trend, drawn.to);
    trend.columns.forEach((column, n) => {
      const next = trend.columns[n + 1]?.[AT] ?? Math.max(until, column[AT]);
      const [left, right] = [column[AT], next].map((ms) => self.valToPos(ms / 1000, "x", true));
      act(column, left, right);
    });
  }

  function clipped(self, act) {
    self.ctx.save();
    self.ctx.beginPath();
    self.ctx.rect(self.bbox.left, self.bbox.top, self.bbox.width, self.bbox.height);
    self.ctx.clip();
    act(self.ctx);
    self.ctx.restore();
  }

  // From the lowest to the highest of each column, behind the lines.
  function envelopes(self) {
    clipped(self, (ctx) => trends.forEach((trend, n) => {
      if (trend.exact) return;
      ctx.globalAlpha = 0.35;
      ctx.fillStyle = COLOURS[n];
      each(self, trend, (column, left, right) => {
        if (column[LOW] === null) return;
        const [top, bottom] = [column[HIGH], column[LOW]].map((value) => self.valToPos(value, scaleOf(trend), true));
        ctx.fillRect(left, top, Math.max(right - left, 1), Math.max(bottom - top, 1));
      });
    }));
  }

  // Where a value was anything but good: a line for each point at the lower edge, as high as it is bad.
  function strips(self) {
    const colours = getComputedStyle(document.documentElement);
    const size = STRIP * devicePixelRatio;
    clipped(self, (ctx) => trends.forEach((trend, n) => {
      const bottom = self.bbox.top + self.bbox.height - (trends.length - 1 - n) * (size + 1);
      each(self, trend, (column, left, right) => {
        if (!column[QUALITY]) return;
        const { kind } = qualityOf(column[QUALITY]);
        const high = kind === "bad" ? size : size / 2;
        ctx.fillStyle = colours.getPropertyValue(`--${kind}`);
        ctx.fillRect(left, bottom - high, Math.max(right - left, 1), high);
      });
    }));
  }

  // ---- in words ------------------------------------------------------------------------------

  const legendRows = new Rows(legend, (id) => {
    const [name, value, range, quality] = ["", "value", "value", ""].map((kind) => h("td", { class: kind }));
    const swatch = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    const line = document.createElementNS("http://www.w3.org/2000/svg", "path");
    swatch.setAttribute("viewBox", "0 0 28 8");
    swatch.setAttribute("aria-hidden", "true");
    swatch.classList.add("swatch");
    line.setAttribute("d", "M0 4H28");
    line.setAttribute("stroke-width", "3");
    swatch.append(line);
    const text = h("span");
    name.append(swatch, text);
    const away = h("button", { class: "small", "aria-label": t("remove"), title: t("remove"), onclick: () => toggle(id) }, "✕");
    return {
      element: h("tr", { "data-point": String(id) }, name, value, range, quality, h("td", { class: "act" }, away)),
      update({ trend, n, column, quality: said }) {
        setText(text, `${trend.station_name} · ${trend.name}`);
        line.setAttribute("stroke", COLOURS[n]);
        line.setAttribute("stroke-dasharray", DASHES[n].join(" "));
        const written = (number_) => (number_ === null || number_ === undefined ? "–" : STATES.includes(trend.content) ? valueText(trend, number_) : number(number_));
        const unit = trend.unit ? ` ${trend.unit}` : "";
        setText(value, column && column[LAST] !== null && said.kind !== "none" ? written(column[LAST]) + unit : "–");
        setText(range, !column || column[LOW] === null || column[LOW] === column[HIGH] ? "" : `${written(column[LOW])} … ${written(column[HIGH])}`);
        fill(quality, said.kind + said.word, () => state(said.kind, said.word));
      },
    };
  });

  function say() {
    const points = !plot || plot.cursor.left === null || plot.cursor.left < 0;
    const at = points ? Math.min(seen.to, live.now()) : plot.posToVal(plot.cursor.left, "x") * 1000;
    setText(when, points ? `${time(seen.from)} – ${time(seen.to)}` : time(at, true));
    legendRows.show(trends.map((trend, n) => {
      const column = columnAt(trend.columns, at);
      const lost = column && at > knownUntil(trend, drawn.to) + 1000;
      const quality = !column ? { kind: "none", word: t("never") } : lost ? { kind: "none", word: t(at > live.now() ? "unknown" : "no_link") } : qualityOf(column[QUALITY]);
      return [trend.point, { trend, n, column, quality }];
    }));
    spans.forEach((button, n) => button.setAttribute("aria-pressed", String(seen.follows && Math.abs(seen.to - seen.from - SPANS[n][1] * HOUR_MS) < 1000)));
    follow.setAttribute("aria-pressed", String(seen.follows));
  }

  let ended = false;
  const resized = new ResizeObserver(() => {
    if (plot && Math.abs(plot.width - Math.max(240, place.clientWidth - 28)) > 2) plot.setSize({ width: Math.max(240, place.clientWidth - 28), height: HEIGHT });
  });
  resized.observe(place);
  place.addEventListener("keydown", keys);
  search.addEventListener("input", offer);
  const themed = () => trends.length && draw();
  addEventListener("theme", themed);
  const unwatch = live.watch(offer);
  live.look({ view: "points", station: 0 }); // stations and their links; the values are asked for
  offer();
  ask();
  return () => {
    ended = true;
    clearTimeout(soon);
    unwatch();
    resized.disconnect();
    removeEventListener("theme", themed);
    removeEventListener("mouseup", released);
    plot?.destroy();
  };
}
