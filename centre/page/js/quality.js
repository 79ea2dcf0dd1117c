// SPDX-License-Identifier: GPL-3.0-or-later
// How good a value is, in a shape, a colour and a word; and how a value is written.
import { CONTENT, LINK, QUALITY } from "./codes.js";
import { now, stations } from "./live.js";
import { number, t } from "./words.js";

const OLD_MS = 60000; // of a position: a vehicle is elsewhere by then

// {kind, word} of the quality alone, as an event has it.
export function qualityOf(bits) {
  const worst = Object.keys(QUALITY).find((name) => bits & QUALITY[name]);
  if (!worst) return { kind: "good", word: t("good") };
  return { kind: worst === "INVALID" ? "bad" : "old", word: t(worst.toLowerCase()) };
}

// {kind, word} of what a point says now.
export function quality(point) {
  const station = stations.get(point.station);
  if (!point.at) return { kind: "none", word: t("never") };
  if (station && station.link !== LINK.UP) return { kind: "none", word: t("no_link") };
  const said = qualityOf(point.quality);
  if (point.content === CONTENT.POSITION && said.kind !== "bad" && now() - point.at > OLD_MS) return { kind: "old", word: t("old") };
  return said;
}

export function stationState(station) {
  if (station.link === LINK.UP) return { kind: "good", word: t("connected") };
  if (station.link === LINK.DOWN) return { kind: "bad", word: t("lost") };
  return { kind: "none", word: t(station.link === LINK.CONNECTING ? "connecting" : "unknown") };
}

export function valueText(point, value = point.value) {
  if (point.content === CONTENT.POSITION) return point.latitude === null ? "–" : `${point.latitude.toFixed(5)}, ${point.longitude.toFixed(5)}`;
  if (value === null || value === undefined) return "–";
  if (point.content === CONTENT.SINGLE || point.command === "single") return t(value ? "on" : "off");
  if (point.content === CONTENT.DOUBLE || point.command === "double") return t(["between", "off", "on", "faulty"][value] ?? "faulty");
  return number(value);
}
