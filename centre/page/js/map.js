// SPDX-License-Identifier: GPL-3.0-or-later
// The map: vehicles and stations where they are, as good as they are; the track of the chosen one, with its gaps.
import * as maplibre from "../vendor/maplibre-gl.mjs";
import { along, lineColour, Scale } from "./along.js";
import { fill, h, Rows, setText, state } from "./dom.js";
import { inOrder } from "./lists.js";
import * as live from "./live.js";
import { colour, Marks } from "./marks.js";
import { quality, stationState } from "./quality.js";
import { Replay } from "./replay.js";
import { readTiles, tileLayers } from "./tiles.js";
import { tripsDialogue } from "./trips.js";
import { age, t, time } from "./words.js";

maplibre.setWorkerUrl(new URL("../vendor/maplibre-gl-worker.mjs", import.meta.url).href);

const LIST_MOST = 200; // in the list beside the map; who looks for another one searches
const LABELS_MOST = 250; // more markers in sight are told by shape and colour alone: few of their texts would find room
const LOOK_MS = 250; // after the map has moved
const TICK_MS = 1000;
const TRACK_MS = 5000; // a track is asked for again no more often
const METRES_A_DEGREE = 111195;
const FONT = ["sans-serif"];

function source(data) {
  return { type: "geojson", data };
}

const EMPTY = { type: "FeatureCollection", features: [] };

function style(own) {
  const label = (size) => ({ "text-font": FONT, "text-size": size });
  const areaColour = ["case", ["==", ["get", "alarm"], ""], colour("muted"), colour("bad")];
  const halo = { "text-halo-color": colour("panel"), "text-halo-width": 1.6 };
  return {
    version: 8,
    sources: {
      land: source("map/land.json"), borders: source("map/borders.json"), names: source("map/names.json"),
      ...(own ? { own: own.source } : {}), areas: source(EMPTY), "area-places": source(EMPTY), track: source(EMPTY), labels: source(EMPTY),
    },
    layers: [
      { id: "sea", type: "background", paint: { "background-color": colour("sea") } },
      { id: "land", type: "fill", source: "land", paint: { "fill-color": colour("land"), "fill-outline-color": colour("border") } },
      { id: "borders", type: "line", source: "borders", paint: { "line-color": colour("border"), "line-width": 1 } },
      { id: "names", type: "symbol", source: "names", minzoom: 2, maxzoom: 8,
        layout: { ...label(12), "text-field": ["get", "name"], "text-letter-spacing": 0.08, "text-max-width": 7 },
        paint: { "text-color": colour("muted"), "text-halo-color": colour("land"), "text-halo-width": 1, "text-opacity": 0.8 } },
      ...(own ? tileLayers(own, colour, FONT) : []),
      { id: "areas", type: "fill", source: "areas", paint: { "fill-color": areaColour, "fill-opacity": 0.1 } },
      { id: "area-borders", type: "line", source: "areas", paint: { "line-color": areaColour, "line-width": 1.5, "line-dasharray": [3, 2] } },
      { id: "area-names", type: "symbol", source: "area-places", layout: { ...label(12), "text-field": ["get", "label"] }, paint: { "text-color": areaColour, ...halo } },
      { id: "track", type: "line", source: "track", layout: { "line-cap": "round", "line-join": "round" },
        paint: { "line-color": lineColour(colour("accent"), colour("muted")), "line-width": 3, "line-opacity": 0.85 } },
      { id: "labels", type: "symbol", source: "labels",
        layout: { ...label(12), "text-field": ["get", "label"], "text-anchor": "top", "text-offset": [0, 0.95], "text-max-width": 14,
          "symbol-sort-key": ["get", "rank"] },
        paint: { "text-color": colour("text"), ...halo } },
    ],
  };
}

// A circle is drawn as a ring; what makes an alarm is told by a word, too.
function areaFeature({ properties, geometry }) {
  const word = properties.alarm ? `\n${t(`area_${properties.alarm}`)}` : "";
  let shape = geometry;
  if (geometry.type === "Point") {
    const [longitude, latitude] = geometry.coordinates;
    const north = properties.radius_m / METRES_A_DEGREE;
    const east = north / Math.max(0.01, Math.cos((latitude * Math.PI) / 180));
    const ring = Array.from({ length: 65 }, (_, n) => {
      const angle = (n * Math.PI) / 32;
      return [longitude + east * Math.cos(angle), latitude + north * Math.sin(angle)];
    });
    shape = { type: "Polygon", coordinates: [ring] };
  }
  return { type: "Feature", properties: { ...properties, label: properties.name + word }, geometry: shape };
}

// Where an area's name stands: a text of a polygon would be drawn once in each tile that has a part of it.
function nameFeature({ properties, geometry }) {
  const [ring] = geometry.coordinates;
  const middle = [0, 1].map((axis) => {
    const numbers = ring.map((corner) => corner[axis]);
    return (Math.min(...numbers) + Math.max(...numbers)) / 2;
  });
  return { type: "Feature", properties, geometry: { type: "Point", coordinates: middle } };
}

// Everything that has a place: {id, name, kind, word, at, lngLat, point?}
function places() {
  const found = [];
  for (const station of live.stations.values()) {
    if (!station.location) continue;
    const { kind, word } = stationState(station);
    found.push({ id: `s${station.id}`, name: station.name, kind, word, at: station.heard, lngLat: [station.location[1], station.location[0]], fixed: true });
  }
  for (const point of live.points.values()) {
    if (point.latitude === undefined || point.latitude === null || !point.at) continue;
    const name = live.stations.get(point.station)?.name ?? point.name;
    found.push({ id: `p${point.id}`, name, ...quality(point), at: point.placed, lngLat: [point.longitude, point.latitude], point });
  }
  return found;
}

function labelOf(place, now) {
  return place.kind === "good" ? place.name : `${place.name}\n${place.word}, ${age(now - place.at)}`;
}

// The first find room first.
const RANKS = { chosen: 0, bad: 1, old: 2, none: 3, good: 4 };

function labelFeature(place, now, chosen) {
  return { type: "Feature", properties: { label: labelOf(place, now), rank: RANKS[chosen ? "chosen" : place.kind] },
    geometry: { type: "Point", coordinates: place.lngLat } };
}

export function showMap(main) {
  const canvas = h("div", { class: "canvas" });
  const legend = h("div", { class: "legend" });
  const about = h("section", { class: "about", hidden: true });
  const list = h("ul", { class: "list" });
  const search = h("input", { type: "search", placeholder: t("search"), "aria-label": t("search") });
  const more = h("div", { class: "muted more" });
  const all = h("button", { class: "grow", onclick: () => showAll() }, t("whole_map"));
  const replay = new Replay(() => update());
  const again = h("button", { class: "grow", onclick: () => replay.open(Number(chosen.id.slice(1))) }, t("replay"));
  main.append(
    h("div", { class: "side" }, h("div", { class: "top" }, search, h("div", { class: "row" }, all, again)), list, more),
    h("div", { class: "map" }, canvas, legend, about, replay.element));

  const map = new maplibre.Map({ container: canvas, style: style(), center: [15, 47], zoom: 3.2, attributionControl: false,
    dragRotate: false, maxPitch: 0, maxZoom: 17, renderWorldCopies: true,
    fadeDuration: 0 }); // markers move each second: texts that fade would have the whole map drawn all the time
  window.openrtuMap = map; // for whoever looks in the browser's console, and the tests
  map.touchZoomRotate.disableRotation();
  map.keyboard.disableRotation();
  map.addControl(new maplibre.NavigationControl({ showCompass: false }));
  map.addControl(new maplibre.ScaleControl(), "bottom-right");
  map.addControl(new maplibre.AttributionControl({ customAttribution: "Natural Earth", compact: false }), "bottom-right");

  const marks = new Marks(map);
  let labels = ""; // as the map has them
  let pointed = ""; // at which the pointer is
  let tracked = false; // the map has a track
  const chosen = { id: "", follow: false, asked: 0, at: 0 };
  const clock = () => (replay.active ? replay.at : live.now());
  const found = () => (replay.active ? replay.places() : places());
  let areas = [];
  let shown = false;
  let fits = true; // the map shows all as soon as it is known where they are
  let ready = false;

  function dress() {
    map.addLayer(marks, "labels");
    drawAreas();
    labels = "";
    ready = true;
    draw(found());
    chosen.asked = 0;
    track();
  }

  function drawAreas() {
    map.getSource("areas").setData({ type: "FeatureCollection", features: areas });
    map.getSource("area-places").setData({ type: "FeatureCollection", features: areas.map(nameFeature) });
  }

  function draw(all) {
    marks.show(all);
    if (ready) write();
  }

  // Texts of those in sight while they are few, and of the one that is chosen or pointed at.
  function write() {
    const now = clock();
    const seen = marks.inSight();
    const asked = (place) => place.id === chosen.id || place.id === pointed;
    const features = (seen.length <= LABELS_MOST ? seen : seen.filter(asked)).map((place) => labelFeature(place, now, asked(place)));
    const text = JSON.stringify(features);
    if (text === labels) return;
    labels = text;
    map.getSource("labels").setData({ type: "FeatureCollection", features });
  }

  function pointAt(place) {
    if (pointed === (place?.id ?? "")) return;
    pointed = place?.id ?? "";
    map.getCanvas().style.cursor = place ? "pointer" : "";
    if (ready) write();
  }

  // The centre tells what this part of the map has, the chosen one and what is searched; and where all of them are.
  let looking = 0;
  function look() {
    clearTimeout(looking);
    const bounds = map.getBounds();
    live.look({ view: "map", chosen: chosen.id.startsWith("p") ? Number(chosen.id.slice(1)) : 0, search: search.value.slice(0, 64),
      bounds: [bounds.getSouth(), bounds.getWest(), bounds.getNorth(), bounds.getEast()] });
  }

  function lookSoon() {
    clearTimeout(looking);
    looking = setTimeout(look, LOOK_MS);
  }

  function showAll() {
    fits = true;
    chosen.follow = false;
    look();
  }

  function fit([south, west, north, east]) {
    fits = false;
    map.fitBounds([[west, south], [east, north]], { padding: { top: 60, bottom: 90, left: 60, right: 70 }, maxZoom: 12, animate: shown });
    shown = true;
  }

  // ---- the chosen one ----
  const rows = new Rows(list, (id) => {
    const name = h("span", { class: "name" });
    const word = h("span");
    const more = h("span", { class: "more" });
    const button = h("button", { onclick: () => choose(id) }, name, word, more);
    return {
      element: h("li", {}, button),
      update(place) {
        setText(name, place.name);
        fill(word, place.kind + place.word, () => state(place.kind, place.word));
        setText(more, place.at ? `${time(place.at)} · ${age(clock() - place.at)}` : "–");
        button.setAttribute("aria-pressed", String(chosen.id === id));
      },
    };
  });

  function choose(id) {
    Object.assign(chosen, { id, follow: false, asked: 0 });
    const place = found().find((each) => each.id === id);
    if (place) map.easeTo({ center: place.lngLat, zoom: Math.max(map.getZoom(), 10), duration: 400 });
    about.dataset.of = "";
    look();
    update();
  }

  const facts = h("dl");
  const follow = h("button", { class: "small", onclick: () => { chosen.follow = !chosen.follow; update(); } });
  const trackText = h("span", { class: "muted" });
  const scale = new Scale(() => { chosen.asked = 0; track(); });

  function showChosen(all) {
    const place = all.find((each) => each.id === chosen.id);
    about.hidden = !place;
    if (!place) return;
    if (about.dataset.of !== place.id) {
      about.dataset.of = place.id;
      scale.offer([]);
      if (place.point) live.ask(`points?station=${place.point.station}`).then((points) => about.dataset.of === place.id && scale.offer(points), () => {});
      const files = ["GPX", "KML", "GeoJSON", "CSV"].map((form) => h("a", { href: `api/tracks?point=${place.point?.id}&format=${form.toLowerCase()}`, download: "" }, form));
      const close = h("button", { class: "small", "aria-label": t("close"), onclick: () => { chosen.id = ""; clearTrack(); update(); } }, "✕");
      about.replaceChildren(
        h("div", { class: "row" }, h("h2", { class: "grow" }, place.name), close), facts,
        ...(place.point ? [h("div", { class: "row" }, follow, h("button", { class: "small", "aria-haspopup": "dialog", onclick: () => tripsDialogue(place.point.id, place.name) }, t("trips")), trackText), h("div", { class: "row" }, h("span", { class: "muted" }, t("along")), scale.select), scale.bar, h("div", { class: "row" }, h("span", { class: "muted" }, t("export")), ...files)]
          : [h("a", { href: `#points/${place.id.slice(1)}` }, t("points_of", { station: place.name }))]));
    }
    const lines = [[t("quality"), () => state(place.kind, place.word), place.kind + place.word], [t("time"), time(place.at)],
      [t("age"), place.at ? age(clock() - place.at) : "–"], [t("latitude"), `${place.lngLat[1].toFixed(6)}°`], [t("longitude"), `${place.lngLat[0].toFixed(6)}°`]];
    if (place.point && !replay.active) lines.push([t("altitude"), place.point.altitude === null ? "–" : `${place.point.altitude.toFixed(0)} m`], [t("satellites"), String(place.point.satellites)]);
    while (facts.children.length > 2 * lines.length) facts.lastChild.remove();
    lines.forEach(([name, value, key], number) => {
      if (facts.children.length <= 2 * number) facts.append(h("dt"), h("dd"));
      setText(facts.children[2 * number], name);
      const cell = facts.children[2 * number + 1];
      if (typeof value === "function") fill(cell, key, value);
      else { delete cell.dataset.key; setText(cell, value); }
    });
    setText(follow, t(chosen.follow ? "follows" : "follow"));
    follow.setAttribute("aria-pressed", String(chosen.follow));
    if (chosen.follow) map.setCenter(place.lngLat);
  }

  // The map is drawn again only when there is a track.
  function clearTrack() {
    if (ready && tracked) map.getSource("track").setData(EMPTY);
    tracked = false;
    setText(trackText, "");
  }

  async function track() {
    if (ready && replay.active) {
      Object.assign(chosen, { asked: 0 });
      map.getSource("track").setData(replay.way(chosen.id));
      tracked = true;
      setText(trackText, "");
      return;
    }
    const point = live.points.get(Number(chosen.id.slice(1)));
    if (!ready || !chosen.id.startsWith("p") || !point) {
      if (!chosen.id.startsWith("p")) clearTrack();
      return;
    }
    if (Date.now() - chosen.asked < TRACK_MS || (chosen.asked && point.at === chosen.at)) return;
    Object.assign(chosen, { asked: Date.now(), at: point.at });
    const { id } = chosen;
    const by = scale.chosen;
    const [ways, answer] = await Promise.all([live.ask(`tracks?point=${point.id}`).catch(() => null), by && live.ask(`trends?points=${by.id}`).catch(() => null)]);
    if (!ways || chosen.id !== id || scale.chosen !== by || replay.active) return;
    const seen = answer ? along(ways, answer.trends[0].columns) : { ways, low: null, high: null };
    map.getSource("track").setData(seen.ways);
    scale.say(seen.low, seen.high);
    tracked = true;
    const gaps = ways.features.filter((each) => !each.properties.goes_on).length - 1;
    setText(trackText, gaps < 0 ? t("track_empty") : gaps ? `${t("track_hour")}, ${t("gaps", { n: gaps })}` : t("track_hour"));
  }

  const ordered = inOrder((place) => place.name);
  let updated = 0;
  function update(change) {
    updated = performance.now();
    const all = found();
    if (change?.extent && fits) fit(change.extent);
    draw(all);
    const words = search.value.toLocaleLowerCase();
    const fitting = words ? ordered(all).filter((place) => place.name.toLocaleLowerCase().includes(words)) : ordered(all);
    rows.show(fitting.slice(0, LIST_MOST).map((place) => [place.id, place]));
    const others = (replay.active ? all.length : Math.max(live.centre.vehicles, all.length)) - Math.min(fitting.length, LIST_MOST);
    setText(more, others > 0 && !words ? t("more_search", { n: others }) : "");
    showChosen(all);
    track();
  }

  fill(legend, "all", () => ["good", "old", "bad", "none"].map((kind) => state(kind, t({ good: "good", old: "old", bad: "invalid", none: "no_link" }[kind]))));
  map.on("style.load", dress); // at first, in another theme, and when a context of WebGL that was lost is back
  map.on("webglcontextlost", () => (ready = false));
  map.on("click", (event) => { const place = marks.under(event.lngLat); if (place) choose(place.id); });
  map.on("mousemove", (event) => pointAt(marks.under(event.lngLat)));
  map.on("mouseout", () => pointAt(null));
  map.on("movestart", (event) => { if (event.originalEvent) { shown = true; fits = false; } }); // the user's place is kept
  map.on("moveend", () => { lookSoon(); if (ready) write(); });
  map.on("dragstart", () => { if (chosen.follow) { chosen.follow = false; update(); } });
  search.addEventListener("input", () => { update(); lookSoon(); });
  let own = null; // the map of one's own
  let gone = false;
  const themed = () => { ready = false; map.setStyle(style(own), { diff: false }); };
  addEventListener("theme", themed);
  const unwatch = live.watch(update);
  const tick = setInterval(() => { if (performance.now() - updated > TICK_MS / 2) update(); }, TICK_MS); // ages grow
  look();
  if (live.session.tiles) {
    readTiles(maplibre).then((tiles) => {
      if (gone) return;
      own = tiles;
      if (tiles.attribution) map.addControl(new maplibre.AttributionControl({ customAttribution: tiles.attribution, compact: false }), "bottom-right");
      themed();
    }).catch((error) => console.warn(`map/own.pmtiles: ${error.message}`));
  }
  live.ask("areas").then((answer) => {
    areas = answer.features.map(areaFeature);
    if (ready) drawAreas();
  }).catch(() => {});
  return () => {
    unwatch();
    clearTimeout(looking);
    gone = true;
    replay.close();
    clearInterval(tick);
    removeEventListener("theme", themed);
    map.remove();
  };
}
