// SPDX-License-Identifier: GPL-3.0-or-later
// Which part of the past a list shows: by time, station, kind and text.
import { fill, h } from "./dom.js";
import * as live from "./live.js";
import { t } from "./words.js";
import { fromField, toField, zone } from "./zone.js";

const DAY_MS = 86400000;
const SPANS = { hours_24: 1, days_7: 7, days_30: 30 };
const PAUSE_MS = 300; // of who types

// `kinds`: what the request calls it, and a word for each. `asked` has the request's words; `end` when they are shown no more.
export function filters(kinds, kindKey) {
  const option = (value, text) => h("option", { value }, text);
  const span = h("select", { "aria-label": t("time") }, ...Object.entries(SPANS).map(([key, days]) => option(String(days), t(key))), option("", t("from_to")));
  const from = h("input", { type: "datetime-local", "aria-label": t("from") });
  const to = h("input", { type: "datetime-local", "aria-label": t("to") });
  const exact = h("span", { class: "row", hidden: true }, from, "–", to, h("span", { class: "muted" }, zone()));
  const kind = h("select", { "aria-label": t("what") }, ...Object.entries(kinds).map(([value, text]) => option(value, text)));
  const station = h("select", { "aria-label": t("station") });
  let timer;
  const text = h("input", { type: "search", maxLength: 64, placeholder: t("search"), "aria-label": t("search"), oninput: () => {
    clearTimeout(timer);
    timer = setTimeout(() => text.dispatchEvent(new Event("change", { bubbles: true })), PAUSE_MS);
  } });
  span.addEventListener("change", () => {
    exact.hidden = Boolean(span.value);
    from.value ||= toField(live.now() - DAY_MS);
  });

  // A page that begins here is told them later. One that is chosen stays so, unless it is gone.
  function offer() {
    const all = [...live.stations.values()].map((each) => [String(each.id), each.name]);
    const chosen = station.value;
    fill(station, JSON.stringify(all), () => [["", t("stations")], ...all].map(([value, name]) => option(value, name)));
    station.value = all.some(([id]) => id === chosen) ? chosen : "";
  }
  offer();
  const end = live.watch(offer);

  function asked() {
    const words = new URLSearchParams();
    const set = (name, value) => { if (value) words.set(name, value); };
    if (span.value) set("from", String(Math.round(live.now() - Number(span.value) * DAY_MS)));
    else {
      set("from", from.value && String(fromField(from.value)));
      set("to", to.value && String(fromField(to.value, true)));
    }
    set(kindKey, kind.value);
    set("station", station.value);
    set("text", text.value.trim());
    return words;
  }
  return { elements: [text, span, exact, station, kind], asked, end };
}
