// SPDX-License-Identifier: GPL-3.0-or-later
// The frames of a station, as they come and go; the centre keeps them as long as a page asks.
import { FRAMES_MOST } from "./codes.js";
import { h, setText, th } from "./dom.js";
import * as live from "./live.js";
import { t, time } from "./words.js";

const PERIOD_MS = 1000;

function row(frame) {
  const objects = (frame.objects ?? []).map(([ioa, text]) => `${ioa}: ${text}`).join("\n");
  return h("tr", { title: frame.octets ?? "" }, h("td", { class: "time" }, time(frame.at, true)), h("td", {}, frame.sent ? "→" : "←"),
    h("td", {}, `${frame.kind} (${frame.what})`), h("td", {}, frame.type ?? ""), h("td", {}, frame.cause ?? ""),
    h("td", { class: "number" }, frame.ca === null || frame.ca === undefined ? "" : String(frame.ca)), h("td", { class: "objects" }, objects));
}

// Below the stations, until it is closed. Returns what ends it.
export function showTrace(place, station) {
  const body = h("tbody");
  const failure = h("p", { class: "error", role: "alert" });
  const headings = ["time", "direction", "frame", "type", "cause", "CA", "value"];
  let last = 0;
  let asks = true;

  async function ask() {
    try {
      const frames = await live.ask(`stations/${station.id}/trace?after=${last}`);
      if (!asks) return;
      setText(failure, "");
      last = frames.at(-1)?.number ?? last;
      body.prepend(...frames.map(row).reverse());
      while (body.childElementCount > FRAMES_MOST) body.lastElementChild.remove();
    } catch (refused) {
      setText(failure, t(refused.code) === refused.code ? refused.message : t(refused.code));
      last = 0;
    }
  }

  function end() {
    asks = false;
    endAsking();
    place.replaceChildren();
  }
  place.replaceChildren(h("section", { class: "card trace" },
    h("div", { class: "row" }, h("h2", { class: "grow" }, `${t("trace")}: ${station.name}`), failure, h("button", { class: "small", onclick: end }, t("close"))),
    h("div", { class: "scroll" }, h("table", {}, h("thead", {}, h("tr", {}, ...headings.map((key) => th(key)))), body))));
  const endAsking = live.repeat(ask, PERIOD_MS);
  return end;
}
