// SPDX-License-Identifier: GPL-3.0-or-later
// The zone of all times: the site's, UTC or the browser's, as the user has chosen. A time says its offset from UTC (ISO 8601: 14:05:09 +01, 13:05:09Z),
// so an hour that the change of the clocks repeats is told from the first one.
import { session } from "./live.js";

const QUARTER_MS = 900000; // no zone changes in between
const DAY_MS = 86400000;
const KEPT_MOST = 10000;
const offsets = new Map(); // by zone and quarter of an hour

const PAD = (number, digits = 2) => String(Math.abs(number)).padStart(digits, "0");

function isKnown(name) {
  try {
    return Boolean(new Intl.DateTimeFormat("en", { timeZone: name }));
  } catch {
    return false;
  }
}

// What can be chosen: which, and its name.
export function zones() {
  const site = isKnown(session.zone) ? session.zone : "UTC";
  return { site, utc: "UTC", browser: Intl.DateTimeFormat().resolvedOptions().timeZone };
}

export function chosenZone() {
  return localStorage.getItem("zone") in zones() ? localStorage.getItem("zone") : "site";
}

export function zone() {
  return zones()[chosenZone()];
}

// In ms, of a moment.
function offset(ms, name = zone()) {
  const key = `${name} ${Math.floor(ms / QUARTER_MS)}`;
  if (!offsets.has(key)) {
    if (offsets.size >= KEPT_MOST) offsets.clear();
    const form = new Intl.DateTimeFormat("en-GB", { timeZone: name, hourCycle: "h23", era: "short", year: "numeric", month: "numeric", day: "numeric", hour: "numeric", minute: "numeric", second: "numeric" });
    const part = Object.fromEntries(form.formatToParts(ms).map(({ type, value }) => [type, Number(value)]));
    offsets.set(key, Date.UTC(part.year, part.month - 1, part.day, part.hour, part.minute, part.second) - Math.floor(ms / 1000) * 1000);
  }
  return offsets.get(key);
}

export function offsetText(ms) {
  const minutes = Math.round(offset(ms) / 60000);
  const rest = minutes % 60 ? `:${PAD(minutes % 60)}` : "";
  return minutes ? `\u00a0${minutes < 0 ? "−" : "+"}${PAD(Math.trunc(minutes / 60))}${rest}` : "Z";
}

// The day and the clock of a moment, without its offset.
export function wall(ms) {
  const [day, clock] = new Date(ms + offset(ms)).toISOString().split("T");
  return { day, clock: clock.slice(0, 8), ms: clock.slice(8, 12) };
}

// For an input of the kind datetime-local, which knows no zone; and what is meant by its text. A time that there is twice is the first one, or the
// last; one that is left out is as far behind the change.
export function toField(ms) {
  const { day, clock } = wall(ms);
  return `${day}T${clock.slice(0, 5)}`;
}

export function fromField(text, last = false) {
  const named = Date.parse(`${text}Z`);
  const [before, after] = [named - DAY_MS, named + DAY_MS].map((ms) => named - offset(ms));
  const real = [before, after].filter((ms) => ms + offset(ms) === named);
  return real.length ? (last ? Math.max(...real) : Math.min(...real)) : before;
}

// Texts of an axis of time, in seconds, as fine as its steps: the first, and each that has another offset than the one before, say it; a new day says
// which.
export function axisTimes(seconds) {
  const step = seconds.length > 1 ? seconds[1] - seconds[0] : 60;
  let before = { day: "", offset: "" };
  return seconds.map((second) => {
    const at = wall(second * 1000);
    const now = { day: at.day, offset: offsetText(second * 1000) };
    const offset = now.offset === before.offset ? "" : now.offset;
    const newDay = now.day === before.day ? "" : `\n${at.day}`;
    before = now;
    if (step >= DAY_MS / 1000) return `${at.day.slice(0, step > 300 * 86400 ? 4 : step > 27 * 86400 ? 7 : 10)}${offset}`;
    return `${step < 1 ? at.clock + at.ms : at.clock.slice(0, step < 60 ? 8 : 5)}${offset}${newDay}`;
  });
}
