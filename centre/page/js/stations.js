// SPDX-License-Identifier: GPL-3.0-or-later
// The stations: is the link up, since when, why not; what has come.
import { CLOSING, LINK } from "./codes.js";
import { fill, h, Rows, setText, state } from "./dom.js";
import * as live from "./live.js";
import { empty } from "./points.js";
import { stationState } from "./quality.js";
import { showTrace } from "./trace.js";
import { age, ahead, t, time } from "./words.js";

// Why a session ended; and the errno of a connection that was never made.
const REASONS = {
  [CLOSING.BAD_APDU]: "not an APDU", [CLOSING.BAD_ASDU]: "ASDU too short", [CLOSING.BAD_NS]: "N(S) out of sequence",
  [CLOSING.BAD_NR]: "N(R) never sent", [CLOSING.I_WHILE_STOPPED]: "I frame while stopped", [CLOSING.T1_I_FRAME]: "t1: I frame",
  [CLOSING.T1_TESTFR]: "t1: TESTFR", [CLOSING.UNREAD_ANSWERS]: "too many requests", [CLOSING.TAKEN_OVER]: "taken over",
  [CLOSING.GAVE_WAY]: "gave way", [CLOSING.NOT_SECURE]: "not secure", [CLOSING.NOT_AS_BEFORE]: "no longer allowed",
  [CLOSING.CLOSED_BY_PEER]: "closed by the station", [CLOSING.CLOSED_BY_STATION]: "closed by the centre",
  [CLOSING.T1_STARTDT]: "t1: STARTDT", [CLOSING.STARTED_BY_PEER]: "started by the station",
};
const ERRORS = { 111: "connection refused", 110: "timed out", 113: "no route to host", 101: "network unreachable", 104: "connection reset" };

const CLOCK_WRONG_MS = 5000;

function reason(station) {
  if (station.link === LINK.UP || !station.link) return "";
  return station.reason ? REASONS[station.reason] ?? String(station.reason) : ERRORS[station.error] ?? (station.error ? `errno ${station.error}` : "");
}

export function showStations(main) {
  const body = h("tbody");
  const none = h("div");
  const failure = h("p", { class: "error", role: "alert" });
  const tracing = h("div");
  let endTrace = () => {};
  const search = h("input", { type: "search", placeholder: t("search"), "aria-label": t("search") });
  const headings = [["station"], ["group", "clutter"], ["link"], ["since"], ["reason", "clutter"], ["heard"], ["clock", "number clutter"], ["records", "number clutter"], ["sessions", "number clutter"], [""]];
  const table = h("table", {}, h("thead", {}, h("tr", {}, ...headings.map(([key, kind]) => h("th", { class: kind ?? "" }, key ? t(key) : "")))), body);
  main.append(h("div", { class: "page" }, h("section", { class: "card" },
    h("div", { class: "row" }, h("h2", { class: "grow" }, t("stations")), failure, search), h("div", { class: "scroll" }, table), none), tracing));

  function trace(id) {
    endTrace();
    endTrace = showTrace(tracing, live.stations.get(id));
  }

  async function interrogate(id) {
    setText(failure, "");
    try {
      await live.ask(`stations/${id}/interrogate`, {});
    } catch (refused) {
      setText(failure, t(refused.code) === refused.code ? refused.message : t(refused.code));
    }
  }

  const rows = new Rows(body, (id) => {
    const name = h("a", { href: `#points/${id}` });
    const [group, link, since, why, heard, clock, records, sessions, act] = ["clutter", "", "time", "clutter muted", "time", "number clutter", "number clutter", "number clutter", "act"].map((kind) => h("td", { class: kind }));
    return {
      element: h("tr", {}, h("td", {}, name), group, link, since, why, heard, clock, records, sessions, act),
      update(station) {
        setText(name, station.name);
        setText(group, station.group);
        const { kind, word } = stationState(station);
        fill(link, kind + word, () => state(kind, word));
        setText(since, station.since ? age(live.now() - station.since) : "–");
        setText(why, reason(station));
        setText(heard, station.heard ? `${time(station.heard)}` : "–");
        const wrong = Math.abs(station.clock ?? 0) >= CLOCK_WRONG_MS;
        fill(clock, `${station.clock}`, () => (wrong ? state("old", ahead(station.clock)) : [ahead(station.clock)]));
        setText(records, String(station.records));
        setText(sessions, String(station.sessions));
        const can = station.link === LINK.UP && live.may("operator");
        const sees = live.may("engineer");
        fill(act, `${can} ${sees}`, () => [
          ...(can ? [h("button", { class: "small", onclick: () => interrogate(id) }, t("interrogate"))] : []),
          ...(sees ? [h("button", { class: "small", onclick: () => trace(id) }, t("trace"))] : []),
        ]);
      },
    };
  });

  function update() {
    const words = search.value.toLocaleLowerCase();
    const found = [...live.stations.values()].filter((each) => `${each.name} ${each.group}`.toLocaleLowerCase().includes(words));
    found.sort((a, b) => (a.link === LINK.UP) - (b.link === LINK.UP) || a.name.localeCompare(b.name, undefined, { numeric: true }));
    rows.show(found.map((station) => [station.id, station]));
    table.hidden = !found.length;
    const why = found.length || !live.centre.connected ? "" : live.stations.size ? "nothing_found" : "no_stations";
    fill(none, why, () => (why ? empty(t(why), t(`${why}_more`)) : []));
  }
  search.addEventListener("input", update);
  const unwatch = live.watch(update);
  const tick = setInterval(update, 1000);
  live.look({ view: "stations" });
  return () => {
    endTrace();
    unwatch();
    clearInterval(tick);
  };
}
