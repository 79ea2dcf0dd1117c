// SPDX-License-Identifier: GPL-3.0-or-later
// How good a value is, in a shape, a colour and a word; and how a value is written.
import { now, stations } from "./live.js";
import { number, t } from "./words.js";

export const UP = 3;
const OVERFLOW = 1, BLOCKED = 16, SUBSTITUTED = 32, NOT_TOPICAL = 64, INVALID = 128;
const OLD_MS = 60000; // of a position: a vehicle is elsewhere by then
const POSITION = 100, DOUBLE = 1, SINGLE = 0;

// {kind, word}: the worst comes first.
export function quality(point) {
  const station = stations.get(point.station);
  if (!point.at) return { kind: "none", word: t("never") };
  if (station && station.link !== UP) return { kind: "none", word: t("no_link") };
  if (point.quality & INVALID) return { kind: "bad", word: t("invalid") };
  if (point.quality & NOT_TOPICAL) return { kind: "old", word: t("not_topical") };
  if (point.content === POSITION && now() - point.at > OLD_MS) return { kind: "old", word: t("old") };
  if (point.quality & BLOCKED) return { kind: "old", word: t("blocked") };
  if (point.quality & SUBSTITUTED) return { kind: "old", word: t("substituted") };
  if (point.quality & OVERFLOW) return { kind: "old", word: t("overflow") };
  return { kind: "good", word: t("good") };
}

export function stationState(station) {
  if (station.link === UP) return { kind: "good", word: t("connected") };
  if (station.link === 4) return { kind: "bad", word: t("lost") };
  return { kind: "none", word: t(station.link === 1 ? "connecting" : "unknown") };
}

export function valueText(point, value = point.value) {
  if (point.content === POSITION) return `${point.latitude.toFixed(5)}, ${point.longitude.toFixed(5)}`;
  if (value === null || value === undefined) return "–";
  if (point.content === SINGLE || point.command === "single") return t(value ? "on" : "off");
  if (point.content === DOUBLE || point.command === "double") return t(["between", "off", "on", "faulty"][value] ?? "faulty");
  return number(value);
}
