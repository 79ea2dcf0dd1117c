// SPDX-License-Identifier: GPL-3.0-or-later
// A time span once more: where each vehicle was, as far as it is known. Nothing is guessed between two places.
import { h, setText } from "./dom.js";
import * as live from "./live.js";
import { firstBeyond } from "./search.js";
import { t, time } from "./words.js";
import { fromField, toField, zone } from "./zone.js";

const SPEEDS = [1, 10, 60, 300, 1800];
const FRAME_MS = 100;
const STEPS = 1500; // places of a vehicle, about
const VEHICLES_MOST = 500; // more are not asked for at once: one is to be chosen
const HOUR_MS = 3600000;

export class Replay {
  constructor(changed) {
    this.changed = changed;
    this.active = false;
    this.at = 0;
    this.tracks = new Map(); // by point: its name, its times, its ways
    this.from = h("input", { type: "datetime-local", "aria-label": t("from") });
    this.to = h("input", { type: "datetime-local", "aria-label": t("to") });
    this.slider = h("input", { type: "range", class: "grow", "aria-label": t("time"), oninput: () => this.go(Number(this.slider.value)) });
    this.play = h("button", { class: "small main", onclick: () => this.run(!this.timer) });
    this.speed = h("select", { "aria-label": t("speed") }, ...SPEEDS.map((speed) => h("option", { value: String(speed), selected: speed === 60 }, `× ${speed}`)));
    this.status = h("span", { class: "clock" });
    this.element = h("section", { class: "replay", hidden: true, "aria-label": t("replay") },
      h("div", { class: "row" }, h("strong", {}, t("replay")), this.from, "–", this.to, h("span", { class: "muted" }, zone()),
        h("button", { class: "small", onclick: () => this.load() }, t("load")), h("span", { class: "grow" }),
        h("button", { class: "small", "aria-label": t("close"), onclick: () => this.close() }, "✕")),
      h("div", { class: "row" }, this.play, this.slider, this.speed, this.status));
  }

  open(point) {
    const now = live.now();
    this.only = live.points.has(point) ? point : 0;
    this.from.value = toField(now - HOUR_MS);
    this.to.value = toField(now);
    this.element.hidden = false;
    return this.load();
  }

  close() {
    this.run(false);
    this.active = false;
    this.element.hidden = true;
    this.tracks.clear();
    this.changed();
  }

  async load() {
    this.run(false);
    const [begin, end] = [fromField(this.from.value), fromField(this.to.value, true)];
    if (!(begin < end)) return setText(this.status, t("replay_order"));
    const { vehicles } = live.centre;
    if (vehicles > VEHICLES_MOST && !this.only) return setText(this.status, t("replay_many", { n: VEHICLES_MOST }));
    const step = Math.floor(Math.min((end - begin) / STEPS, live.session.gap_s * 500));
    const only = vehicles > VEHICLES_MOST ? `&point=${this.only}` : "";
    setText(this.status, "…");
    let ways;
    try {
      ways = await live.ask(`tracks?from=${begin}&to=${end}&step=${step}${only}`);
    } catch (error) {
      return setText(this.status, t("failed", { error: error.message }));
    }
    if (this.element.hidden) return undefined;
    this.tracks.clear();
    for (const { properties, geometry } of ways.features) {
      const track = this.tracks.get(properties.point) ?? { name: properties.name, times: [], places: [], begins: [] };
      this.tracks.set(properties.point, track);
      const line = geometry.type === "Point" ? [geometry.coordinates] : geometry.coordinates;
      track.begins.push(track.times.length);
      properties.times.forEach((text, number) => {
        track.times.push(Date.parse(text));
        track.places.push(line[number].slice(0, 2));
      });
    }
    Object.assign(this.slider, { min: String(begin), max: String(end), step: "1000" });
    this.end = end;
    this.active = true;
    this.go(begin);
    if (!this.tracks.size) setText(this.status, t("track_empty_span"));
    return undefined;
  }

  run(wanted) {
    clearInterval(this.timer);
    this.timer = 0;
    let last = performance.now();
    if (wanted && this.active) {
      if (this.at >= this.end) this.go(Number(this.slider.min));
      this.timer = setInterval(() => {
        const now = performance.now();
        this.go(Math.min(this.end, this.at + (now - last) * Number(this.speed.value)));
        last = now;
        if (this.at >= this.end) this.run(false);
      }, FRAME_MS);
    }
    setText(this.play, t(this.timer ? "pause" : "play"));
  }

  go(at) {
    this.at = at;
    this.slider.value = String(at);
    setText(this.status, time(at, true));
    this.changed();
  }

  places() {
    const found = [];
    for (const [id, { name, times, places }] of this.tracks) {
      const number = firstBeyond(times, this.at) - 1;
      if (number < 0) continue;
      const fresh = this.at - times[number] <= live.session.gap_s * 1000;
      found.push({ id: `p${id}`, name, kind: fresh ? "good" : "old", word: t(fresh ? "good" : "old"), at: times[number], lngLat: places[number], point: live.points.get(id) });
    }
    return found.sort((a, b) => a.name.localeCompare(b.name, undefined, { numeric: true }));
  }

  // The way of one until now, with its gaps.
  way(id) {
    const track = this.tracks.get(Number(id.slice(1)));
    const end = track ? firstBeyond(track.times, this.at) : 0;
    const features = [];
    track?.begins.forEach((begin, number) => {
      const line = track.places.slice(begin, Math.min(end, track.begins[number + 1] ?? end));
      if (line.length > 1) features.push({ type: "Feature", properties: {}, geometry: { type: "LineString", coordinates: line } });
    });
    return { type: "FeatureCollection", features };
  }
}
