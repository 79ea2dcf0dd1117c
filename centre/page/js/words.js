// SPDX-License-Identifier: GPL-3.0-or-later
// Languages are files: lang/en.json has every word, the others what differs.
import { offsetText, wall } from "./zone.js";

export const LANGUAGES = { en: "English", de: "Deutsch", sr: "Српски", es: "Español" };

let words = {};
let otherwise = {};
export let language = "en";

async function load(name) {
  return (await fetch(`lang/${name}.json`)).json();
}

export async function speak(name) {
  language = name in LANGUAGES ? name : "en";
  otherwise = await load("en");
  words = language === "en" ? otherwise : await load(language);
  document.documentElement.lang = language;
}

export function chosen() {
  return localStorage.getItem("language") ?? navigator.languages.map((each) => each.slice(0, 2)).find((each) => each in LANGUAGES) ?? "en";
}

// t("refused", {by: "Vera"}): "Refused by {by}"
export function t(key, values = {}) {
  const text = words[key] ?? otherwise[key] ?? key;
  return text.replace(/\{(\w+)\}/g, (_, name) => values[name] ?? "");
}

// A time of today without its day, in the zone that the user has chosen.
export function time(ms, withMilliseconds = false) {
  if (!ms) return "–";
  const at = wall(ms);
  const exact = `${at.clock}${withMilliseconds ? at.ms : ""}${offsetText(ms)}`;
  return at.day === wall(Date.now()).day ? exact : `${at.day} ${exact}`;
}

export function age(ms) {
  const s = Math.max(0, Math.round(ms / 1000));
  if (s < 60) return `${s} s`;
  if (s < 3600) return `${Math.floor(s / 60)} min`;
  if (s < 86400) return `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
  return t("days", { n: Math.floor(s / 86400) });
}

// How far a clock is ahead, or behind with a sign.
export function ahead(ms) {
  if (ms === null) return "–";
  const size = Math.abs(ms);
  return `${ms < 0 ? "−" : "+"}${size < 60000 ? `${(size / 1000).toFixed(1)} s` : age(size)}`;
}

export function number(value) {
  return Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(6)));
}
