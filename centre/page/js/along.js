// SPDX-License-Identifier: GPL-3.0-or-later
// Values along a track: where was it measured? Each piece of the way has the shade of what held where it begins.
import { h, setText } from "./dom.js";
import { firstBeyond } from "./search.js";
import { t } from "./words.js";

const COLOURS = ["#2f6fdb", "#1d9a6c", "#d4a017", "#d1382c"]; // from the lowest to the highest; light and dark pages show them
const SHADES = 24; // pieces whose shades are the same are one line
const NONE = -1; // nothing valid is known there

// What held then: the last that came before. Columns are in order of time.
function heldAt(columns, at) {
  return columns[firstBeyond(columns, at, ([begin]) => begin) - 1]?.[3] ?? null;
}

// The ways of a vehicle in pieces, each with its shade from 0 to 1, or NONE; the lowest and the highest value that were there.
export function along(ways, columns) {
  const held = ways.features.map(({ geometry, properties }) => (geometry.type === "LineString" ? properties.times.map((text) => heldAt(columns, Date.parse(text))) : []));
  const known = held.flat().filter((value) => value !== null);
  const low = Math.min(...known), high = Math.max(...known);
  const shade = (value) => (value === null ? NONE : high > low ? Math.round((SHADES * (value - low)) / (high - low)) / SHADES : 0);
  const features = ways.features.flatMap((feature, number) => {
    const shades = held[number].slice(0, -1).map(shade);
    if (!shades.length) return [feature];
    const begins = shades.flatMap((each, at) => (at && shades[at - 1] === each ? [] : [at]));
    return begins.map((begin, each) => ({
      type: "Feature", properties: { shade: shades[begin] },
      geometry: { type: "LineString", coordinates: feature.geometry.coordinates.slice(begin, (begins[each + 1] ?? shades.length) + 1) },
    }));
  });
  return { ways: { type: "FeatureCollection", features }, low: known.length ? low : null, high: known.length ? high : null };
}

// How the map draws them; a way without values is as it was.
export const lineColour = (plain, unknown) => ["case", ["!", ["has", "shade"]], plain, ["<", ["get", "shade"], 0], unknown,
  ["interpolate", ["linear"], ["get", "shade"], ...COLOURS.flatMap((each, number) => [number / (COLOURS.length - 1), each])]];

// Which point's values: a choice, and what the colours mean.
export class Scale {
  constructor(changed) {
    this.select = h("select", { class: "grow", "aria-label": t("along"), onchange: changed });
    this.low = h("span");
    this.high = h("span");
    const shades = h("span", { class: "shades grow" });
    shades.style.background = `linear-gradient(to right, ${COLOURS.join(", ")})`;
    this.bar = h("div", { class: "row muted", id: "scale", hidden: true }, this.low, shades, this.high);
    this.points = [];
  }

  offer(points) {
    this.points = points.filter((point) => point.latitude === undefined);
    this.select.replaceChildren(h("option", { value: "" }, t("along_none")), ...this.points.map((point) => h("option", { value: point.id }, point.name)));
    this.say(null, null);
  }

  get chosen() { return this.points.find((point) => point.id === Number(this.select.value)); }

  say(low, high) {
    const unit = this.chosen?.unit ? ` ${this.chosen.unit}` : "";
    this.bar.hidden = !this.chosen;
    setText(this.low, low === null ? t("along_nothing") : `${low}${unit}`);
    setText(this.high, high === null ? "" : `${high}${unit}`);
  }
}
