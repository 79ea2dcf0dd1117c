// SPDX-License-Identifier: GPL-3.0-or-later
// For an engineer: who may what, and who did what.
import { confirmation, reason } from "./account.js";
import { AUDITED, ROLES } from "./codes.js";
import { fill, h, modal, Rows, setText, state, tabs, th } from "./dom.js";
import { Finder, list } from "./lists.js";
import * as live from "./live.js";
import { t, time } from "./words.js";

const SPANS = { last_day: 1, last_week: 7, last_month: 30, all_time: 0 }; // days; 0: from the beginning
const DAY_MS = 86400000;

// ---- users ---------------------------------------------------------------------------------------

// Asked for: what the page is told by itself may not have come yet, and a user without groups sees all.
async function groupsOf(user) {
  const known = (await live.ask("stations")).map((station) => station.group).filter(Boolean);
  return [...new Set([...known, ...(user?.groups ?? [])])].sort();
}

function labelled(key, ...inputs) {
  return h("label", {}, t(key), ...inputs);
}

function check(text, checked) {
  const box = h("input", { type: "checkbox", checked });
  return { box, text, element: h("label", { class: "check" }, box, text) };
}

// One's own role stays, so that there is always an engineer: another one takes it.
function userDialogue(user, known, done) {
  const myself = user?.name === live.session.user;
  const name = h("input", { required: true, maxLength: 64, autocomplete: "off", disabled: Boolean(user) });
  name.value = user?.name ?? "";
  const fixed = Boolean(user?.provided); // the provider says all but who is disabled
  const role = h("select", { disabled: myself || fixed }, ...ROLES.map((each) => h("option", { value: each, selected: each === (user?.role ?? "viewer") }, t(each))));
  const groups = known.map((group) => check(group, Boolean(user?.groups.includes(group))));
  const scope = h("fieldset", {}, h("legend", {}, t("scope")), ...groups.map((each) => each.element), h("span", { class: "muted" }, t("scope_none")));
  const fresh = h("input", { type: "password", autocomplete: "new-password", maxLength: 256, required: !user, disabled: fixed });
  fresh.minLength = 10;
  const off = check(t("disabled"), Boolean(user?.disabled));
  off.box.disabled = myself;
  const { own, element: confirms } = confirmation();
  const failure = h("p", { class: "error", role: "alert" });
  const dialog = h("dialog", { "aria-label": t(user ? "user_change" : "user_add") });
  const remove = h("button", { type: "button", hidden: !user || myself, onclick: () => send(`users/${encodeURIComponent(user.name)}/remove`, {}) }, t("remove"));
  const lost = h("button", { type: "button", hidden: !user?.second_factor || myself, onclick: () => send(`users/${encodeURIComponent(user.name)}/second_factor/end`, {}) }, t("second_lost"));
  const form = h("form", { method: "dialog" },
    h("div", { class: "body" }, h("h2", {}, t(user ? "user_change" : "user_add")), labelled("name", name), labelled("role_name", role), scope,
      fixed ? null : labelled(user ? "password_new" : "password", fresh), off.element, confirms, failure),
    h("div", { class: "end" }, remove, lost, h("span", { class: "grow" }),
      h("button", { type: "button", onclick: () => dialog.close() }, t("cancel")), h("button", { class: "main" }, t("save"))));

  async function send(path, body) {
    setText(failure, "");
    if (!own.reportValidity()) return;
    try {
      await live.ask(path, { ...body, own_password: own.value });
      dialog.close();
      done();
    } catch (refused) {
      setText(failure, reason(refused));
    }
  }

  const scoped = () => (scope.disabled = fixed || role.value === ROLES.at(-1));
  role.addEventListener("change", scoped);
  scoped();
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const seen = role.value === ROLES.at(-1) ? [] : groups.filter((each) => each.box.checked).map((each) => each.text);
    send("users", { name: name.value, role: role.value, groups: seen, disabled: off.box.checked, ...(fresh.value ? { password: fresh.value } : {}) });
  });
  dialog.append(form);
  modal(dialog);
}

function userTable(place) {
  const body = h("tbody");
  const failure = h("p", { class: "error", role: "alert" });
  const finder = new Finder(() => update());
  place.append(h("section", { class: "card" },
    h("div", { class: "row" }, h("h2", { class: "grow" }, t("users")), failure, finder.element,
      h("button", { class: "small main", "aria-haspopup": "dialog", onclick: () => edit(null) }, t("user_add"))),
    h("div", { class: "scroll" }, h("table", {}, h("thead", {}, h("tr", {}, ...["name", "role_name", "scope", "state", ""].map((key) => th(key)))), body))));
  let known = new Map();
  const rows = new Rows(body, (name) => {
    const [role, scope, enabled] = [0, 0, 0].map(() => h("td"));
    const act = h("td", { class: "act" }, h("button", { class: "small", "aria-haspopup": "dialog", onclick: () => edit(known.get(name)) }, t("change")));
    return {
      element: h("tr", {}, h("td", {}, name), role, scope, enabled, act),
      update(user) {
        setText(role, t(user.role));
        setText(scope, user.groups.join(", ") || t("scope_all"));
        fill(enabled, String(user.disabled), () => (user.disabled ? state("none", t("disabled")) : state("good", t("enabled"))));
      },
    };
  });
  function update() {
    const found = [...known].filter(([, user]) => finder.fits(`${user.name} ${t(user.role)} ${user.groups.join(" ")}`));
    rows.show(found);
    finder.tell(found.length, known.size);
  }
  const failed = (error) => setText(failure, t("failed", { error: error.message }));
  const edit = (user) => groupsOf(user).then((groups) => userDialogue(user, groups, show), failed);
  async function show() {
    const users = await live.ask("users").catch(failed);
    known = new Map((users ?? []).map((user) => [user.name, user]));
    update();
  }
  show();
  return () => {};
}

// ---- who did what --------------------------------------------------------------------------------

function choice(name, options) {
  return h("select", { "aria-label": t(name) }, ...options.map(([value, text]) => h("option", { value: String(value) }, text)));
}

function auditTable(place) {
  const names = h("datalist", { id: "who" });
  const who = h("input", { type: "search", list: "who", placeholder: t("user_name"), "aria-label": t("user_name") });
  const station = choice("station", [["", t("scope_all")]]);
  const kind = choice("action", [["", t("all_alarms")], ...AUDITED.map((each) => [each, t(each)])]);
  const span = choice("time", Object.entries(SPANS).map(([key, days]) => [days, t(key)]));
  const file = h("a", { download: "" }, "CSV");
  span.value = String(SPANS.last_month);
  const stations = live.ask("stations").then((all) => all.sort((a, b) => a.name.localeCompare(b.name, undefined, { numeric: true })));
  stations.then((all) => station.append(...all.map((each) => h("option", { value: String(each.id) }, each.name)))).catch(() => {});
  live.ask("users").then((users) => names.append(...users.map((user) => h("option", { value: user.name })))).catch(() => {});

  function question() {
    const days = Number(span.value);
    const from = days ? Math.round(live.now() - days * DAY_MS) : 0;
    const asked = { user: who.value, station: station.value, kind: kind.value };
    return new URLSearchParams([["from", from], ...Object.entries(asked).filter(([, value]) => value)]);
  }

  return list(place, "audit", ["time", "user_name", "action", "station", "detail"], [who, names, station, kind, span, file], async () => {
    const asked = question();
    file.href = `api/audit?format=csv&${asked}`;
    const called = new Map((await stations).map((each) => [each.id, each.name]));
    return (await live.ask(`audit?${asked}`)).map((row) => [row.id, time(row.at, true), row.user, t(`did_${row.action.replace(" ", "_")}`), called.get(row.station) ?? "", row.detail]);
  });
}

export function showUsers(main, _number, tab) {
  live.look({ view: "alarms" }); // of no point: the page's head needs no more
  return tabs(main, { users: userTable, audit: auditTable }, tab);
}
