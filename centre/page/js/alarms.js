// SPDX-License-Identifier: GPL-3.0-or-later
// Alarms to be acknowledged; and what happened: events, commands.
import { fate, stateText } from "./command.js";
import { fill, h, Rows, setText, state, tabs } from "./dom.js";
import * as live from "./live.js";
import { empty } from "./points.js";
import { qualityOf, valueText } from "./quality.js";
import { ahead, number, t, time } from "./words.js";

const PRIORITIES = { 1: ["bad", "high"], 2: ["old", "medium"], 3: ["none", "low"] };
const SHELVED_MIN = 60;
const CAUSES_OF_EVENTS = { 3: "spontaneous", 11: "remote", 12: "local", 20: "interrogated" };
const ACCEPTED = 2; // state of a command
let sound = false;
let names = new Map(); // points of all stations: alarms name them

async function learnNames() {
  names = new Map((await live.ask("points")).map((point) => [point.id, point]));
}

function pointName(id) {
  return names.get(id)?.name ?? `#${id}`;
}

function words(alarm) {
  const point = names.get(alarm.point);
  const value = point ? `${valueText(point, alarm.value)} ${point.unit}`.trim() : number(alarm.value ?? 0);
  const name = live.stations.get(alarm.station)?.name ?? "";
  return t(`alarm_${alarm.kind}`, { n: alarm.value, off: ahead(1000 * alarm.value), ca: alarm.ca, point: pointName(alarm.point), value, area: alarm.area, name });
}

function beep() {
  const context = new AudioContext();
  const tone = context.createOscillator();
  const volume = context.createGain();
  volume.gain.value = 0.08;
  tone.frequency.value = 880;
  tone.connect(volume).connect(context.destination);
  tone.start();
  tone.stop(context.currentTime + 0.25);
  tone.onended = () => context.close();
}

// ---- alarms --------------------------------------------------------------------------------------

function alarmTable(place) {
  const body = h("tbody");
  const none = h("div");
  const failure = h("p", { class: "error", role: "alert" });
  const shelvedButton = h("button", { class: "small", onclick: () => { withShelved = !withShelved; update(); } });
  const soundButton = h("button", { class: "small", onclick: () => { sound = !sound; if (sound) beep(); update(); } }, t("sound"));
  let withShelved = false;
  let known = null;
  const headings = ["priority", "since", "station", "what", "state", "by", ""];
  const table = h("table", {}, h("thead", {}, h("tr", {}, ...headings.map((key) => h("th", { class: key === "by" ? "clutter" : "" }, key ? t(key) : "")))), body);
  place.append(h("section", { class: "card" },
    h("div", { class: "row" }, h("h2", { class: "grow" }, t("alarms")), failure, shelvedButton, soundButton), h("div", { class: "scroll" }, table), none));

  async function doing(path, body) {
    setText(failure, "");
    try {
      await live.ask(path, body);
    } catch (refused) {
      const alarm = live.alarms.get(Number(path.split("/")[1]));
      setText(failure, refused.code === "acknowledged" ? t("acknowledged_first", { by: alarm?.by ?? "?" }) : t("failed", { error: refused.message }));
    }
  }

  const rows = new Rows(body, (id) => {
    const cells = Array.from({ length: 7 }, () => h("td"));
    const [priority, since, station, what, how, by, act] = cells;
    since.className = "time";
    act.className = "act";
    by.className = "clutter";
    const row = h("tr", {}, ...cells);
    return {
      element: row,
      update(alarm) {
        const [kind, word] = PRIORITIES[alarm.priority];
        fill(priority, kind, () => state(kind, t(word)));
        setText(since, time(alarm.since));
        setText(station, live.stations.get(alarm.station)?.name ?? "");
        setText(what, words(alarm));
        const shelved = (alarm.shelved ?? 0) > live.now();
        setText(how, shelved ? t("shelved", { time: time(alarm.shelved) }) : t(alarm.gone ? "gone" : "active"));
        setText(by, alarm.acknowledged ? `${alarm.by}, ${time(alarm.acknowledged)}` : "–");
        row.classList.toggle("unacknowledged", !alarm.acknowledged);
        fill(act, `${Boolean(alarm.acknowledged)}${shelved}`, () => (live.may("operator") ? [
          ...(alarm.acknowledged ? [] : [h("button", { class: "small main", onclick: () => doing(`alarms/${id}/acknowledge`, {}) }, t("acknowledge"))]),
          h("button", { class: "small", onclick: () => doing(`alarms/${id}/shelve`, { minutes: shelved ? 0 : SHELVED_MIN }) }, t(shelved ? "unshelve" : "shelve")),
        ] : []));
      },
    };
  });

  function update() {
    const all = [...live.alarms.values()].sort((a, b) => Boolean(a.acknowledged) - Boolean(b.acknowledged) || a.priority - b.priority || b.since - a.since);
    const shelved = all.filter((alarm) => (alarm.shelved ?? 0) > live.now());
    const shown = withShelved ? all : all.filter((alarm) => !shelved.includes(alarm));
    rows.show(shown.map((alarm) => [alarm.id, alarm]));
    table.hidden = !shown.length;
    fill(none, String(shown.length > 0 || !live.centre.connected), () => (shown.length || !live.centre.connected ? [] : empty(t("no_alarms"), t("no_alarms_more"))));
    setText(shelvedButton, t("shelved_show", { n: shelved.length }));
    shelvedButton.hidden = !shelved.length;
    shelvedButton.setAttribute("aria-pressed", String(withShelved));
    soundButton.setAttribute("aria-pressed", String(sound));
    const active = new Set(all.filter((alarm) => !alarm.acknowledged && !shelved.includes(alarm)).map((alarm) => alarm.id));
    if (sound && known && [...active].some((id) => !known.has(id))) beep();
    known = active;
  }
  const unwatch = live.watch((changes) => {
    if (changes.alarms.some((alarm) => alarm.point && !names.has(alarm.point))) learnNames().then(update);
    update();
  });
  update();
  return unwatch;
}

// ---- what happened -------------------------------------------------------------------------------

// Newest first, asked for again and again, and when what stands in its head was changed.
export function list(place, title, headings, head, load) {
  const body = h("tbody");
  const none = h("div");
  const table = h("table", {}, h("thead", {}, h("tr", {}, ...headings.map((key) => h("th", {}, t(key))))), body);
  place.append(h("section", { class: "card" }, h("div", { class: "row" }, h("h2", { class: "grow" }, t(title)), ...head),
    h("div", { class: "scroll" }, table), none));
  async function show() {
    const rows = await load();
    body.replaceChildren(...rows.map((cells) => h("tr", {}, ...cells.map((cell, column) => h("td", { class: column ? "" : "time" }, cell)))));
    table.hidden = !rows.length;
    none.replaceChildren(...(rows.length ? [] : [empty(t(`no_${title}`))]));
  }
  const failed = (error) => none.replaceChildren(h("p", { class: "empty error" }, t("failed", { error: error.message })));
  show().catch(failed);
  place.firstElementChild.addEventListener("change", () => show().catch(failed));
  const timer = setInterval(() => show().catch(failed), 5000);
  return () => clearInterval(timer);
}

function stationName(id) {
  return live.stations.get(id)?.name ?? "";
}

// A command of somebody else that waits for this user.
function toRelease(command) {
  if (command.state !== ACCEPTED || !command.release || command.user === live.session.user || !live.may("operator")) return [];
  const failure = h("span", { class: "error", role: "alert" });
  const doing = (what) => live.ask(`commands/${command.id}/${what}`, {}).then(() => failure.parentElement?.querySelectorAll("button").forEach((each) => each.remove()))
    .catch((refused) => setText(failure, t(refused.code) === refused.code ? refused.message : t(refused.code)));
  return [h("button", { class: "small main", onclick: () => doing("execute") }, t("release")), h("button", { class: "small", onclick: () => doing("cancel") }, t("cancel")), failure];
}

const TABS = {
  alarms: alarmTable,
  events: (place) => list(place, "events", ["time", "station", "name", "value", "quality", "cause"],
    [h("a", { href: "api/events?format=csv", download: "" }, "CSV")],
    async () => (await live.ask("events")).map((event) => {
      const point = names.get(event.point);
      const { kind, word } = qualityOf(event.quality);
      return [time(event.at, true), stationName(event.station), pointName(event.point), point ? `${valueText(point, event.value)} ${point.unit}` : number(event.value), state(kind, word),
        CAUSES_OF_EVENTS[event.cause] ?? String(event.cause)];
    })),
  commands: (place) => list(place, "commands", ["time", "user_name", "station", "name", "value", "state"], [],
    async () => (await live.ask("commands")).map((command) => {
      const point = names.get(command.point);
      const ended = [3, 5, 8, 9].includes(command.state);
      return [time(command.begun, true), command.user, stationName(point?.station), pointName(command.point), point ? valueText(point, command.value) : number(command.value),
        h("span", { class: "row" }, state(ended ? fate(command).kind : "none", stateText(command)), ...toRelease(command))];
    })),
};

export function showAlarms(main, _number, tab) {
  live.look({ view: "alarms" });
  learnNames().catch(() => {});
  return tabs(main, TABS, tab);
}
