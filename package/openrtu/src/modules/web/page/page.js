// SPDX-License-Identifier: GPL-3.0-or-later
// The page of the gateway. All texts of the gateway go into the page as text, never as HTML.
"use strict";

const PAGE_ROWS = 200, PERIOD_MS = 1000, LATE_MS = 10000;
const $ = (id) => document.getElementById(id);
let me = null; // who is logged in
let busy = false; // a command waits for its end, which is shown whatever happens
let newest = []; // rows of the view that is searched
let view = "points", from = 0, search = "", timer = 0, turn = 0;

// ---- parts of the page -------------------------------------------------------------------------

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name, value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== undefined) made.setAttribute(name, value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

// Keeps the cells that say the same: a selection and the focus outlive a second.
function fill(table, columns, rows) {
  const body = table.tBodies[0];
  while (body.rows.length > rows.length) body.lastChild.remove();
  rows.forEach((row, i) => {
    if (!body.rows[i]) {
      const line = element("tr");
      columns.forEach((column) => line.append(element("td", { class: column.class ?? false })));
      body.append(line);
    }
    columns.forEach((column, j) => {
      const cell = body.rows[i].cells[j], shown = column.show(row);
      const key = typeof shown === "object" && shown !== null ? shown.key : String(shown ?? "–");
      if (cell.dataset.key === key) return;
      cell.dataset.key = key;
      cell.replaceChildren(typeof shown === "object" && shown !== null ? shown.make() : key);
    });
  });
}

function table(title, columns, empty, kind) {
  const head = element("tr", {}, ...columns.map((column) => element("th", { class: column.class ?? false }, column.title)));
  const made = element("table", { class: kind ?? false }, element("thead", {}, head), element("tbody"));
  const none = element("p", { class: "empty" }, empty);
  const card = element("section", { class: "card", "aria-label": title }, title ? element("h2", {}, title) : null, made, none);
  return {
    card,
    update(rows) {
      fill(made, columns, rows);
      made.hidden = rows.length === 0;
      none.hidden = rows.length > 0;
    },
  };
}

// ---- words -------------------------------------------------------------------------------------

// A quality by colour, letter and word: of several the worst comes first.
function quality(words) {
  const [worst] = words.split(",");
  return { kind: { good: "good", invalid: "bad" }[worst] ?? "old", letter: worst[0].toUpperCase(), word: words };
}

function state(kind, letter, word) {
  return {
    key: `${kind} ${letter} ${word}`,
    make: () => element("span", { class: `state ${kind}` }, element("span", { class: "letter", "aria-hidden": "true" }, letter), word),
  };
}

function qualityOf(row) {
  const shown = quality(row.quality);
  return state(shown.kind, shown.letter, row.forced ? `${shown.word}, forced` : shown.word);
}

function value(row) {
  if (row.value === null || row.value === undefined) return "–";
  if (typeof row.value === "object") return JSON.stringify(row.value);
  return row.meaning ? `${row.meaning} (${row.value})` : String(row.value);
}

const withUnit = (shown, row) => (row.unit && shown !== "–" ? `${shown} ${row.unit}` : shown);

function age(seconds) {
  if (seconds === null || seconds === undefined) return "never";
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 120) return `${Math.floor(seconds)} s`;
  if (seconds < 7200) return `${Math.floor(seconds / 60)} min`;
  return seconds < 172800 ? `${Math.floor(seconds / 3600)} h` : `${Math.floor(seconds / 86400)} d`;
}

// By the gateway's clock, which need not be the browser's.
function timeOf(row) {
  if (row.age_s === null || !me) return "–";
  return new Date(Date.parse(me.time) - row.age_s * 1000).toISOString().replace("T", " ").slice(0, 19);
}

// ---- the gateway -------------------------------------------------------------------------------

// A text goes as it is, all else as JSON.
async function ask(path, body) {
  const options = { cache: "no-store", signal: AbortSignal.timeout(LATE_MS) };
  if (body !== undefined) {
    options.method = "POST";
    options.headers = { "Content-Type": "application/json", "X-CSRF-Token": me?.csrf ?? "" };
    options.body = typeof body === "string" ? body : JSON.stringify(body);
  }
  const answer = await fetch(path, options);
  const said = await answer.json();
  if (answer.status === 401 && path !== "/api/login") show(null);
  if (!answer.ok) throw Object.assign(new Error(said.text), { said: true, why: said.error });
  return said;
}

const query = (values) => new URLSearchParams(values).toString();

// ---- commands ----------------------------------------------------------------------------------

const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

async function order(action, name, wanted) {
  let said;
  try {
    said = await ask("/api/order", { action, name, value: wanted });
  } catch (error) {
    throw Object.assign(error, { refused: error.said });
  }
  while (!said.ended) {
    await pause(200);
    said = await ask(`/api/command?${query({ number: said.number })}`);
    tell(said);
  }
  return said;
}

// The device may have acted.
const UNKNOWN = ["unknown fate", "time-out"];

function outcome(said) {
  const why = said.exception !== undefined ? `${said.result} ${said.exception}` : said.result;
  if (!said.ended) return { kind: "none", title: said.state, text: "the gateway waits for the device" };
  if (UNKNOWN.includes(said.result)) {
    return { kind: "unknown", title: "Fate unknown", text: `${why}: the device may or may not have acted. Look at the point before you do anything.` };
  }
  if (said.state === "accepted selection") return { kind: "good", title: "Selected", text: "the device's owner has accepted the selection" };
  if (said.state === "executed command") return { kind: "good", title: "Executed", text: `${why}: the device's own answer` };
  if (said.state === "interrupted selection") return { kind: "none", title: "Selection given up", text: why };
  return { kind: "bad", title: "Refused", text: `${said.state}: ${why}` };
}

function tell(said) {
  const shown = outcome(said), place = $("outcome");
  if (!place) return;
  place.className = `outcome ${shown.kind}`;
  place.replaceChildren(element("strong", {}, shown.title), element("span", {}, shown.text));
  place.hidden = false;
}

// What a command may be, in words.
function limits(row) {
  return row.max === undefined ? row.expected : withUnit(`${row.min} to ${row.max}`, row);
}

const rowNamed = (name) => newest.find((row) => row.name === name);

// The point's value as long as the dialogue is open.
function showNow(name) {
  const row = rowNamed(name);
  if (row) $("now").replaceChildren(withUnit(value({ value: row.present, meaning: row.present_meaning }), row), " ", qualityOf(row).make());
}

function openCommand(row) {
  const dialog = $("dialog");
  const wanted = element("input", { name: "value", required: true, autocomplete: "off" });
  let selected = false;
  const act = async (action) => {
    busy = true;
    for (const button of dialog.querySelectorAll("button")) button.disabled = true;
    try {
      const said = await order(action, row.name, wanted.value);
      tell(said);
      selected = action === "select" && said.state === "accepted selection";
    } catch (error) {
      // What the gateway refused to begin did not happen; of all else nobody knows.
      tell({ ended: true, state: action, result: error.refused ? error.message : "unknown fate" });
    }
    busy = false;
    for (const button of dialog.querySelectorAll("button")) button.disabled = false;
    wanted.disabled = selected;
    select.hidden = !row.select || selected;
    execute.hidden = row.select && !selected;
    cancel.hidden = !selected;
    (selected ? execute : close).focus();
  };
  const select = element("button", { type: "button", class: "main", hidden: !row.select, click: () => wanted.value && act("select") }, "Select");
  const execute = element("button", { type: "button", class: "main", hidden: row.select, click: () => wanted.value && act("execute") }, "Execute");
  const cancel = element("button", { type: "button", hidden: true, click: () => act("cancel") }, "Give up");
  const close = element("button", { type: "button", click: () => dialog.close() }, "Close");
  dialog.replaceChildren(
    element("h2", { id: "dialog-name" }, row.name),
    element("dl", {},
      element("dt", {}, "Now"), element("dd", { id: "now" }),
      element("dt", {}, "Allowed"), element("dd", { id: "allowed" }, limits(row))),
    element("label", {}, `New value (${row.unit ?? row.type})`, wanted),
    element("p", { id: "outcome", class: "outcome", role: "status", hidden: true }),
    element("div", { class: "row" }, select, execute, cancel, close),
  );
  showNow(row.name);
  dialog.onclose = () => selected && ask("/api/order", { action: "cancel", name: row.name, value: wanted.value }).catch(() => {});
  dialog.showModal();
}

// ---- views -------------------------------------------------------------------------------------

const number = (title, key, more = "") => ({ title, class: `number ${more}`.trim(), show: (row) => row[key] });
const text = (title, key, more = "") => ({ title, class: `text ${more}`.trim(), show: (row) => row[key] });
const flag = (title, key, good, bad) => ({ title, show: (row) => (row[key] ? state("good", "✓", good) : state("bad", "✗", bad)) });

const pointColumns = [
  text("Name", "name"),
  { title: "Value", class: "value", show: value },
  { title: "Quality", show: qualityOf },
  { title: "Age", class: "number", show: (row) => age(row.age_s) },
  { title: "Time (UTC)", class: "number clutter", show: timeOf },
  text("Type", "type", "clutter"),
  number("CA", "ca", "clutter"),
  number("IOA", "ioa", "clutter"),
  text("Owner", "owner", "clutter"),
];

const commandState = (row) => {
  const unknown = UNKNOWN.includes(row.result);
  if (row.state === "executed command") return state("good", "✓", row.state);
  if (unknown) return state("old", "?", `${row.state}: ${row.result}`);
  if (row.state.startsWith("refused")) return state("bad", "✗", `${row.state}: ${row.result}`);
  return state("none", "·", row.state);
};

const commandColumns = [
  text("Name", "name"),
  { title: "State", show: commandState },
  { title: "Value", class: "value", show: value },
  { title: "Age", class: "number", show: (row) => age(row.age_s) },
  text("By", "requester", "clutter"),
  {
    title: "",
    show: (row) => (me?.commands ? { key: row.name, make: () => element("button", { click: () => openCommand(rowNamed(row.name)) }, "Command…") } : ""),
  },
];

const moduleColumns = [
  text("Name", "name"), text("Kind", "kind", "clutter"), flag("Alive", "alive", "alive", "dead"), text("State", "state"),
  { title: "Up", class: "number", show: (row) => age(row.up_s) }, number("Restarts", "restarts"), number("Points", "points"),
  number("Lost events", "lost_events"),
];
const lineColumns = [
  number("Port", "port"), text("Device", "device"), text("Format", "format", "clutter"), flag("Open", "open", "open", "closed"),
  number("Scan ms", "scan_ms"), number("Requests", "requests"), number("Answers", "answers"), number("Time-outs", "timeouts"),
  number("CRC", "crc_errors"), number("Exceptions", "exceptions"), number("Noise", "noise_bytes"),
];
const deviceColumns = [
  number("Port", "port"), number("Id", "id"), text("Description", "description"), text("Identification", "identified"), number("CA", "ca"),
  flag("Alive", "alive", "alive", "dead"), number("Latency ms", "latency_ms"), number("Requests", "requests"),
  number("Answers", "answers"), number("Time-outs", "timeouts"), number("Errors", "errors"),
];
const eventColumns = [
  text("Time", "time"), text("Event", "event"), text("Name", "name"), { title: "Value", class: "value", show: value },
  { title: "Quality", show: (row) => (row.quality === undefined ? "" : qualityOf(row)) }, text("Cause", "cause", "clutter"),
];
// Octets in pairs; of a long frame the beginning, and all of it where the pointer rests.
const octets = (row) => {
  const pairs = row.octets.match(/../g) ?? [], most = 24;
  const shown = pairs.slice(0, most).join(" ") + (pairs.length > most ? " …" : "");
  return { key: row.octets, make: () => element("span", { title: pairs.join(" ") }, shown) };
};
const frameColumns = [
  { title: "Time (UTC)", class: "text", show: (row) => row.time.slice(11, 26) },
  { title: "Direction", show: (row) => (row.direction === "sent" ? state("none", "›", "sent") : state("none", "‹", "received")) },
  text("In words", "text"),
  { title: "Octets", class: "text octets clutter", show: octets },
];
const LEVELS = { error: "bad", warning: "old" };
const logColumns = [
  text("Time", "time", "time"), text("Module", "module", "module"),
  { title: "Level", class: "level", show: (row) => state(LEVELS[row.level] ?? "none", row.level[0].toUpperCase(), row.level) }, text("Text", "text"),
];

function pager(total, again) {
  const most = Math.max(0, total - 1), last = from + PAGE_ROWS >= total;
  return {
    key: `${from} ${total}`,
    make: () => [
      element("button", { disabled: from === 0, click: () => { from = Math.max(0, from - PAGE_ROWS); again(); } }, "‹ Back"),
      element("span", { class: "muted" }, total === 0 ? "none" : `${from + 1} to ${Math.min(from + PAGE_ROWS, total)} of ${most + 1}`),
      element("button", { disabled: last, click: () => { from += PAGE_ROWS; again(); } }, "More ›"),
    ],
  };
}

function searched(columns, path, empty) {
  const shown = table("", columns, empty), pages = element("div", { class: "row" });
  const field = element("input", {
    type: "search", placeholder: "Search a name ( / )", "aria-label": "Search a name", id: "search",
    input: () => { search = field.value; from = 0; again(); },
  });
  field.value = search;
  let key = "";
  const update = async () => {
    const said = await ask(`${path}?${query({ from, count: PAGE_ROWS, search })}`);
    if (from >= said.total && from > 0) from = 0;
    shown.update(newest = said.rows);
    if ($("dialog").open) showNow($("dialog-name").textContent);
    const next = pager(said.total, again);
    if (key !== next.key) pages.replaceChildren(...next.make());
    key = next.key;
  };
  return { parts: [element("div", { class: "row" }, field, pages), shown.card], update };
}

const VIEWS = {
  points: ["Points", () => searched(pointColumns, "/api/points", "No point has such a name.")],
  alarms: ["Alarms", () => {
    const dead = table("Modules that do not run", moduleColumns, "All modules run.");
    const closed = table("Lines that are not open", lineColumns, "All lines are open.");
    const bad = table("Points that are not good", pointColumns, "All points are good.");
    return {
      parts: [dead.card, closed.card, bad.card],
      async update() {
        dead.update((await ask("/api/modules")).rows.filter((row) => !row.alive && row.kind !== "rtuctl"));
        closed.update((await ask("/api/lines")).rows.filter((row) => !row.open));
        bad.update((await ask(`/api/points?${query({ bad: 1, count: PAGE_ROWS })}`)).rows);
      },
    };
  }],
  events: ["Events", () => {
    const shown = table("", eventColumns, "Nothing has happened yet.");
    return { parts: [shown.card], update: async () => shown.update((await ask(`/api/events?${query({ count: PAGE_ROWS })}`)).rows.reverse()) };
  }],
  commands: ["Commands", () => searched(commandColumns, "/api/commands", "No point can be commanded.")],
  lines: ["Lines", () => {
    const lines = table("Lines", lineColumns, "There are no lines."), devices = table("Devices", deviceColumns, "There are no devices.");
    return {
      parts: [lines.card, devices.card],
      async update() {
        const { rows } = await ask("/api/lines");
        lines.update(rows);
        devices.update(rows.flatMap((row) => row.devices));
      },
    };
  }],
  modules: ["Modules", () => {
    const shown = table("Modules", moduleColumns, "There are none.");
    const counters = table("Counters", [text("Module", "module"), text("Counter", "counter"), number("Value", "value")], "There are none.");
    return {
      parts: [shown.card, counters.card],
      async update() {
        shown.update((await ask("/api/modules")).rows);
        counters.update((await ask("/api/counters")).rows);
      },
    };
  }],
  log: ["Log", () => {
    const shown = table("", logColumns, "The log is empty.", "log");
    return { parts: [shown.card], update: async () => shown.update((await ask(`/api/log?${query({ count: 200 })}`)).rows.reverse()) };
  }],
  frames: ["Frames", () => {
    const shown = table("", frameColumns, "Nothing has gone over this line.");
    const ports = element("select", { "aria-label": "Line", change: () => again() });
    let known = "";
    return {
      parts: [element("div", { class: "row" }, element("label", {}, "Line ", ports)), shown.card],
      async update() {
        const { rows } = await ask("/api/lines"), names = rows.map((row) => `port ${row.port}, ${row.device}`);
        if (known !== names.join()) {
          ports.replaceChildren(...rows.map((row, i) => element("option", { value: row.port, selected: String(row.port) === ports.value }, names[i])));
          known = names.join();
        }
        shown.update(ports.value ? (await ask(`/api/frames?${query({ port: ports.value, count: 100 })}`)).rows.reverse() : []);
      },
    };
  }],
  setup: ["Set-up", setUp],
};

// Of a user who may.
const NEEDS = { setup: () => me?.setup };
const views = () => Object.keys(VIEWS).filter((name) => NEEDS[name]?.() ?? true);

// ---- the whole ---------------------------------------------------------------------------------

let shown = null, refreshed = Promise.resolve();

// One behind the other: of two questions at a time the later answer need not be the newer one.
function again() {
  clearTimeout(timer);
  const own = ++turn;
  refreshed = refreshed.then(() => refresh(own));
}

async function refresh(own) {
  if (own !== turn) return;
  try {
    const said = await ask("/api/state");
    if (own !== turn) return;
    me = said;
    await shown?.update();
    $("banner").hidden = true;
    head();
  } catch (error) {
    if (!me) return;
    $("banner").textContent = error.said ? error.message : "The gateway does not answer. What you see is old.";
    $("banner").hidden = false;
  }
  if (own === turn && me) timer = setTimeout(again, document.hidden ? 10 * PERIOD_MS : PERIOD_MS);
}

function head() {
  if (!me) return;
  $("station").textContent = document.title = me.station;
  $("user").textContent = `${me.name} (${me.role})`;
  $("clock").textContent = `${me.time.replace("T", " ").slice(0, 19)} UTC${me.clock_set ? "" : ", clock not set"}`;
  for (const link of $("nav").children) {
    link.hidden = !views().includes(link.dataset.view);
    if (link.dataset.view === view) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
    if (link.dataset.view !== "alarms") continue;
    const count = me.bad > 0 ? [element("span", { class: "count" }, String(me.bad))] : [];
    if (link.dataset.bad !== String(me.bad)) link.replaceChildren("Alarms", ...count);
    link.dataset.bad = me.bad;
  }
}

function open() {
  const wanted = location.hash.slice(1);
  view = views().includes(wanted) ? wanted : "points";
  from = 0;
  search = "";
  shown = VIEWS[view][1]();
  $("view").replaceChildren(...shown.parts);
  again();
}

// Shows the views to who is logged in, or asks who it is.
function show(who) {
  me = who;
  turn++;
  clearTimeout(timer);
  $("head").hidden = $("view").hidden = !who;
  $("login").hidden = Boolean(who);
  $("banner").hidden = true;
  if (who) open();
  else {
    shown = null;
    $("view").replaceChildren();
    if ($("dialog").open && !busy) $("dialog").close();
    document.querySelector("[name=name]").focus();
  }
}

async function logIn(event) {
  event.preventDefault();
  const form = event.target;
  $("why").hidden = true;
  try {
    await ask("/api/login", { name: form.name.value, password: form.password.value, code: form.code.value });
    form.reset();
    $("code").hidden = true;
    show(await ask("/api/state"));
  } catch (error) {
    if (error.why === "code") $("code").hidden = false;
    if (!$("code").hidden) form.code.focus();
    $("why").textContent = error.said ? error.message : "The gateway does not answer.";
    $("why").hidden = false;
  }
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  localStorage.setItem("theme", theme);
}

function turnTheme() {
  setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
}

function key(event) {
  if (!me || event.ctrlKey || event.altKey || event.metaKey || $("dialog").open) return;
  if (["INPUT", "TEXTAREA"].includes(event.target.tagName)) {
    if (event.key === "Escape") event.target.blur();
    return;
  }
  const names = views(), at = Number(event.key) - 1;
  if (names[at]) location.hash = names[at];
  else if (event.key === "t") turnTheme();
  else if (event.key === "/" && $("search")) { event.preventDefault(); $("search").focus(); }
}

setTheme(localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
$("nav").append(...Object.entries(VIEWS).map(([name, [title]], i) => element("a", { href: `#${name}`, "data-view": name, title: `${title} (${i + 1})` }, title)));
$("theme").addEventListener("click", turnTheme);
$("logout").addEventListener("click", () => ask("/api/logout", {}).catch(() => {}).then(() => show(null)));
document.querySelector("#login form").addEventListener("submit", logIn);
addEventListener("hashchange", () => me && open());
addEventListener("keydown", key);
ask("/api/state").then(show, () => show(null));
