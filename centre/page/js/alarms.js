// SPDX-License-Identifier: GPL-3.0-or-later
// Alarms to be acknowledged; and what happened: events, commands.
import { ALARM_KINDS, CAUSE, EVENT_CAUSES, IDS_MOST, STATE } from "./codes.js";
import { fate, stateText } from "./command.js";
import { empty, fill, h, modal, Rows, setText, state, tabs, th } from "./dom.js";
import { filters } from "./filters.js";
import { list } from "./lists.js";
import * as live from "./live.js";
import { showNotifications } from "./notifications.js";
import { qualityOf, valueText } from "./quality.js";
import { showRates } from "./rates.js";
import { isOn, switchTo } from "./sound.js";
import { ahead, number, t, time } from "./words.js";

const PRIORITIES = { 1: ["bad", "high"], 2: ["old", "medium"], 3: ["none", "low"] };
const SHELVED_MIN = 60;
const CAUSES_OF_EVENTS = {
  [CAUSE.SPONTANEOUS]: "spontaneous", [CAUSE.RETURN_REMOTE]: "remote", [CAUSE.RETURN_LOCAL]: "local", [CAUSE.INTERROGATED]: "interrogated",
};
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

// What one that came often is of, without a value.
function cause(alarm) {
  const of = alarm.point ? pointName(alarm.point) : alarm.ca ? `CA ${alarm.ca}` : "";
  return [t(`kind_${alarm.kind}`), of, alarm.area].filter(Boolean).join(" · ");
}

// ---- alarms --------------------------------------------------------------------------------------

// Not acknowledged before acknowledged, active before gone, then by priority, the newest first.
function byUrgency(a, b) {
  return Boolean(a.acknowledged) - Boolean(b.acknowledged) || Boolean(a.gone) - Boolean(b.gone) || a.priority - b.priority || b.last - a.last;
}

function isShelved(alarm) {
  return (alarm.shelved ?? 0) > live.now();
}

// While a pointer or the focus is among the rows, none moves: a click is meant for what is under it. What is new comes behind them, what
// ends stays until then.
class Order {
  constructor(body) {
    this.body = body;
    this.by = new Set(); // what holds them
    this.ids = [];
    this.last = new Map(); // by id, as it was shown last
    this.changed = () => {};
    body.addEventListener("pointerenter", () => this.by.add("pointer"));
    body.addEventListener("pointerleave", () => this.release("pointer"));
    body.addEventListener("focusin", (event) => { if (event.target.matches(":focus-visible")) this.by.add("focus"); });
    body.addEventListener("focusout", (event) => { if (!body.contains(event.relatedTarget)) this.release("focus"); });
  }

  // Not at once: a row that is taken out with the focus in it says so while the rows are being changed.
  release(what) {
    if (this.by.delete(what)) queueMicrotask(() => this.changed());
  }

  // What had the focus may be gone, which no event says.
  look() {
    if (!this.body.contains(document.activeElement)) this.release("focus");
  }

  of(alarms) {
    const kept = this.by.size ? this.ids : [];
    this.ids = [...new Set([...kept, ...alarms.map((alarm) => alarm.id)])];
    this.last = new Map(this.ids.map((id) => [id, live.alarms.get(id) ?? this.last.get(id)]));
    return [...this.last];
  }

  // Parts that somebody opens, or closes, come and go at once, below their alarm: they are what the click was for.
  open(id, ids) {
    this.close(ids);
    this.ids.splice(this.ids.indexOf(id) + 1, 0, ...ids);
  }

  close(ids) {
    this.ids = this.ids.filter((each) => !ids.includes(each));
  }

  // One that has ended is told once, and is no longer in the list.
  take(alarms) {
    for (const alarm of alarms) if (this.last.has(alarm.id)) this.last.set(alarm.id, alarm);
  }
}

function alarmTable(place) {
  const body = h("tbody");
  const none = h("div");
  const failure = h("p", { class: "error", role: "alert" });
  const news = h("p", { class: "visually-hidden", "aria-live": "polite" });
  const search = h("input", { type: "search", placeholder: t("search"), "aria-label": t("search"), oninput: () => update() });
  const many = h("button", { class: "small", onclick: () => acknowledgeShown() });
  const shelvedButton = h("button", { class: "small", onclick: () => { withShelved = !withShelved; update(); } });
  const soundButton = h("button", { class: "small", onclick: () => { switchTo(!isOn()); update(); } }, t("sound"));
  let withShelved = false;
  const opened = new Set(); // alarms whose parts are shown
  let parts = new Map(); // by alarm
  let known = null;
  let toAcknowledge = [];
  const headings = ["priority", "since", "station", "what", "state", "by", ""];
  const table = h("table", {}, h("thead", {}, h("tr", {}, ...headings.map((key) => th(key)))), body);
  place.append(h("section", { class: "card" },
    h("div", { class: "row" }, h("h2", { class: "grow" }, t("alarms")), failure, search, many, shelvedButton, soundButton),
    news, h("div", { class: "scroll" }, table), none));
  const order = new Order(body);
  order.changed = () => update();

  async function doing(path, content) {
    setText(failure, "");
    try {
      await live.ask(path, content);
    } catch (refused) {
      const alarm = live.alarms.get(Number(path.split("/")[1]));
      setText(failure, refused.code === "acknowledged" ? t("acknowledged_first", { by: alarm?.by ?? "?" }) : t("failed", { error: refused.message }));
    }
  }

  const acknowledgeShown = () => doing("alarms/acknowledge", { ids: toAcknowledge.slice(0, IDS_MOST) });

  const rows = new Rows(body, (id) => {
    const cells = Array.from({ length: 7 }, () => h("td"));
    const [priority, since, station, what, how, by, act] = cells;
    since.className = "time";
    act.className = "act";
    const row = h("tr", {}, ...cells);
    return {
      element: row,
      update(alarm) {
        const [kind, word] = PRIORITIES[alarm.priority];
        fill(priority, kind, () => state(kind, t(word)));
        setText(since, time(alarm.since));
        setText(station, alarm.kind === "network" ? "" : (live.stations.get(alarm.station)?.name ?? "")); // of many
        setText(what, alarm.returns ? `${words(alarm)} (${t("again", { n: alarm.returns, time: time(alarm.last) })})` : words(alarm));
        const shelved = isShelved(alarm);
        const now = [t(alarm.gone ? "gone" : "active"), ...(alarm.suppressed_by ? [t("suppressed")] : [])].join(", ");
        row.classList.toggle("part", Boolean(alarm.suppressed_by));
        const many = parts.get(id)?.length ?? 0;
        setText(how, shelved ? [t("shelved", { time: time(alarm.shelved) }), alarm.why].filter(Boolean).join(": ") : now);
        setText(by, alarm.acknowledged ? `${alarm.by}, ${time(alarm.acknowledged)}` : "–");
        row.classList.toggle("unacknowledged", !alarm.acknowledged);
        const over = !live.alarms.has(id);
        const show = () => {
          if (opened.delete(id)) order.close(under(id).map((each) => each.id));
          else {
            opened.add(id);
            order.open(id, under(id).map((each) => each.id));
          }
          update();
        };
        const partsButton = () => (many ? [h("button", { class: "small", "aria-expanded": String(opened.has(id)), onclick: show }, t("parts", { n: many }))] : []);
        const focused = act.contains(document.activeElement);
        fill(act, `${Boolean(alarm.acknowledged)}${shelved}${over}${many}${opened.has(id)}`, () => (live.may("operator") && !over ? [
          ...partsButton(),
          ...(alarm.acknowledged ? [] : [h("button", { class: "small main", onclick: () => doing(`alarms/${id}/acknowledge`, {}) }, t("acknowledge"))]),
          h("button", { class: "small", "aria-haspopup": shelved ? undefined : "dialog", onclick: () => (shelved ? doing(`alarms/${id}/shelve`, { minutes: 0 }) : shelve(id)) }, t(shelved ? "unshelve" : "shelve")),
        ] : partsButton()));
        // Who acts by keys goes on in the same row.
        if (focused && !act.contains(document.activeElement)) act.querySelector("button")?.focus();
      },
    };
  });

  function shelve(id) {
    const why = h("input", { maxLength: 200, "aria-label": t("why"), placeholder: t("why") });
    const dialog = h("dialog", { "aria-label": t("shelve") },
      h("form", { method: "dialog", class: "body", onsubmit: () => doing(`alarms/${id}/shelve`, { minutes: SHELVED_MIN, why: why.value }) },
        h("h2", {}, t("shelve")), why,
        h("div", { class: "end" }, h("button", { type: "button", onclick: () => dialog.close() }, t("close")), h("button", { class: "main" }, t("shelve")))));
    modal(dialog);
  }

  const withParts = (alarm) => [alarm, ...(opened.has(alarm.id) ? under(alarm.id) : [])];
  const under = (id) => [...(parts.get(id) ?? [])].sort(byUrgency).flatMap(withParts);

  function fits(alarm) {
    const wanted = search.value.toLocaleLowerCase();
    return !wanted || `${live.stations.get(alarm.station)?.name ?? ""} ${words(alarm)}`.toLocaleLowerCase().includes(wanted);
  }

  function update() {
    const all = [...live.alarms.values()];
    const shelved = all.filter(isShelved);
    parts = Map.groupBy(all.filter((alarm) => alarm.suppressed_by), (alarm) => alarm.suppressed_by);
    const shown = all.filter((alarm) => !alarm.suppressed_by && (withShelved || !isShelved(alarm)) && (fits(alarm) || parts.get(alarm.id)?.some(fits)))
      .sort(byUrgency).flatMap(withParts);
    rows.show(order.of(shown));
    table.hidden = !order.ids.length;
    fill(none, String(order.ids.length > 0 || !live.centre.connected), () => (order.ids.length || !live.centre.connected ? [] : empty(t("no_alarms"), t("no_alarms_more"))));
    setText(shelvedButton, t("shelved_show", { n: shelved.length }));
    shelvedButton.hidden = !shelved.length;
    shelvedButton.setAttribute("aria-pressed", String(withShelved));
    soundButton.setAttribute("aria-pressed", String(isOn()));
    toAcknowledge = shown.filter((alarm) => !alarm.acknowledged).map((alarm) => alarm.id);
    setText(many, t("acknowledge_shown", { n: toAcknowledge.length }));
    many.hidden = toAcknowledge.length < 2 || !live.may("operator");
    const active = new Set(all.filter((alarm) => !alarm.acknowledged && live.stands(alarm)).map((alarm) => alarm.id));
    const fresh = known ? [...active].filter((id) => !known.has(id)).length : 0;
    if (fresh) setText(news, t("new_alarms", { n: fresh }));
    known = active;
    order.look();
  }
  const unwatch = live.watch((changes) => {
    order.take(changes.alarms);
    if (changes.alarms.some((alarm) => alarm.point && !names.has(alarm.point))) learnNames().then(update);
    update();
  });
  update();
  return unwatch;
}

// What came in a time, of one station and kind or of all.
function pastAlarms(place) {
  const { elements, asked, end } = filters({ "": t("all_alarms"), ...Object.fromEntries(ALARM_KINDS.map((key) => [key, t(`kind_${key}`)])) }, "kind");
  const endList = list(place, "past_alarms", ["since", "station", "what", "until_gone", "by"], elements, async () => (
    (await live.ask(`alarms?${asked()}`)).map((alarm) => [alarm.id, time(alarm.since), stationName(alarm.station), words(alarm),
      alarm.gone ? time(alarm.gone) : t("active"), alarm.acknowledged ? `${alarm.by}, ${time(alarm.acknowledged)}` : "–"])));
  return () => { endList(); end(); };
}

// ---- what happened -------------------------------------------------------------------------------

function stationName(id) {
  return live.stations.get(id)?.name ?? "";
}

// A command of somebody else that waits for this user.
function toRelease(command) {
  if (command.state !== STATE.ACCEPTED_SELECTION || !command.release || command.user === live.session.user || !live.may("operator")) return [];
  const failure = h("span", { class: "error", role: "alert" });
  const doing = (what) => live.ask(`commands/${command.id}/${what}`, {}).then(() => failure.parentElement?.querySelectorAll("button").forEach((each) => each.remove()))
    .catch((refused) => setText(failure, t(refused.code) === refused.code ? refused.message : t(refused.code)));
  return [h("button", { class: "small main", onclick: () => doing("execute") }, t("release")), h("button", { class: "small", onclick: () => doing("cancel") }, t("cancel")), failure];
}

function showEvents(place) {
  const { elements, asked, end } = filters({ "": t("all_causes"), ...Object.fromEntries(EVENT_CAUSES.map((key) => [key, t(`cause_${key}`)])) }, "cause");
  const file = h("a", { download: "" }, "CSV");
  const endList = list(place, "events", ["time", "station", "name", "value", "quality", "cause"], [...elements, file], async () => {
    const words = asked();
    file.setAttribute("href", `api/events?${new URLSearchParams([...words, ["format", "csv"]])}`);
    return (await live.ask(`events?${words}`)).map((event) => {
      const point = names.get(event.point);
      const { kind, word } = qualityOf(event.quality);
      return [event.id, time(event.at, true), stationName(event.station), pointName(event.point), point ? `${valueText(point, event.value)} ${point.unit}` : number(event.value), state(kind, word),
        CAUSES_OF_EVENTS[event.cause] ?? String(event.cause)];
    });
  });
  return () => { endList(); end(); };
}

const TABS = {
  alarms: alarmTable,
  past_alarms: pastAlarms,
  events: showEvents,
  rates: (place) => showRates(place, cause),
  commands: (place) => list(place, "commands", ["time", "user_name", "station", "name", "value", "state"], [],
    async () => (await live.ask("commands")).map((command) => {
      const point = names.get(command.point);
      const ended = [3, 5, 8, 9].includes(command.state);
      return [command.id, time(command.begun, true), command.user, stationName(point?.station), pointName(command.point), point ? valueText(point, command.value) : number(command.value),
        h("span", { class: "row" }, state(ended ? fate(command).kind : "none", stateText(command)), ...toRelease(command))];
    })),
};

export function showAlarms(main, _number, tab) {
  live.look({ view: "alarms" });
  learnNames().catch(() => {});
  return tabs(main, live.may("operator") ? { ...TABS, notifications: showNotifications } : TABS, tab);
}
