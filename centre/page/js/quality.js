// SPDX-License-Identifier: GPL-3.0-or-later
// How good a value is, in a shape, a colour and a word; and how a value is written.
import { now, stations } from "./live.js";
import { number, t } from "./words.js";

export const UP = 3;
// The worst comes first: a bit of the quality, how it is drawn, its word.
const BITS = [[128, "bad", "invalid"], [64, "old", "not_topical"], [16, "old", "blocked"], [32, "old", "substituted"], [1, "old", "overflow"]];
const OLD_MS = 60000; // of a position: a vehicle is elsewhere by then
const POSITION = 100, DOUBLE = 1, SINGLE = 0;

// {kind, word} of the quality alone, as an event has it.
export function qualityOf(bits) {
  const [, kind, word] = BITS.find(([bit]) => bits & bit) ?? [0, "good", "good"];
  return { kind, word: t(word) };
}

// {kind, word} of what a point says now.
export function quality(point) {
  const station = stations.get(point.station);
  if (!point.at) return { kind: "none", word: t("never") };
  if (station && station.link !== UP) return { kind: "none", word: t("no_link") };
  const said = qualityOf(point.quality);
  if (point.content === POSITION && said.kind !== "bad" && now() - point.at > OLD_MS) return { kind: "old", word: t("old") };
  return said;
}

export function stationState(station) {
  if (station.link === UP) return { kind: "good", word: t("connected") };
  if (station.link === 4) return { kind: "bad", word: t("lost") };
  return { kind: "none", word: t(station.link === 1 ? "connecting" : "unknown") };
}

export function valueText(point, value = point.value) {
  if (point.content === POSITION) return point.latitude === null ? "–" : `${point.latitude.toFixed(5)}, ${point.longitude.toFixed(5)}`;
  if (value === null || value === undefined) return "–";
  if (point.content === SINGLE || point.command === "single") return t(value ? "on" : "off");
  if (point.content === DOUBLE || point.command === "double") return t(["between", "off", "on", "faulty"][value] ?? "faulty");
  return number(value);
}
