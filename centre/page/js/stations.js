// SPDX-License-Identifier: GPL-3.0-or-later
// The stations: is the link up, since when, why not; what has come.
import { CLOSING, LINK } from "./codes.js";
import { empty, fill, h, Rows, setText, state } from "./dom.js";
import { Finder, Heads, inOrder } from "./lists.js";
import * as live from "./live.js";
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
  const finder = new Finder(update);
  const name = (station) => station.name;
  const heads = new Heads([["station", "", name], ["group", "", (each) => each.group], ["link", "", (each) => each.link], ["since", "", (each) => -each.since],
    ["reason"], ["heard", "", (each) => -each.heard], ["clock", "number", (each) => -Math.abs(each.clock ?? 0)], ["records", "number", (each) => -each.records],
    ["sessions", "number", (each) => -each.sessions], [""]], update);
  const table = h("table", {}, h("thead", {}, heads.row), body);
  main.append(h("div", { class: "page" }, h("section", { class: "card" },
    h("div", { class: "row" }, h("h2", { class: "grow" }, t("stations")), failure, finder.element), h("div", { class: "scroll" }, table), none), tracing));

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
    const [group, link, since, why, heard, clock, records, sessions, act] = ["", "", "time", "muted", "time", "number", "number", "number", "act"].map((kind) => h("td", { class: kind }));
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

  const byName = inOrder(name);
  function update() {
    const all = [...live.stations.values()];
    const found = byName(all).filter((each) => finder.fits(`${each.name} ${each.group}`));
    if (!heads.sort(found)) found.sort((a, b) => (a.link === LINK.UP) - (b.link === LINK.UP)); // who has none comes first
    rows.show(found.map((station) => [station.id, station]));
    finder.tell(found.length, all.length);
    table.hidden = !found.length;
    const why = found.length || !live.centre.connected ? "" : all.length ? "nothing_found" : "no_stations";
    fill(none, why, () => (why ? empty(t(why), t(`${why}_more`)) : []));
  }
  const unwatch = live.watch(update);
  const tick = setInterval(update, 1000);
  live.look({ view: "stations" });
  return () => {
    endTrace();
    unwatch();
    clearInterval(tick);
  };
}
