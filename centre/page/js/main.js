// SPDX-License-Identifier: GPL-3.0-or-later
// The frame: log in, the head, and which view is shown. The address says which one: #map, #points/3, ...
import { reason, showAccount } from "./account.js";
import { showAlarms } from "./alarms.js";
import { STATE } from "./codes.js";
import { h, modal, setText, shape } from "./dom.js";
import { showFiles } from "./files.js";
import { keysButton, watchKeys } from "./keys.js";
import * as live from "./live.js";
import { showMap } from "./map.js";
import { showPictures } from "./pictures.js";
import { showPoints } from "./points.js";
import { horn } from "./sound.js";
import { showStations } from "./stations.js";
import { showTrends } from "./trends.js";
import { showUsers } from "./users.js";
import { chosen, LANGUAGES, speak, t, time } from "./words.js";
import { chosenZone, zones } from "./zone.js";

const VIEWS = { map: showMap, points: showPoints, alarms: showAlarms, stations: showStations, trends: showTrends, pictures: showPictures, users: showUsers };
const NEEDS = { users: "engineer" }; // all others are for everybody
const REFUSED = ["no_role", "name_taken", "provider", "disabled", "somebody_else"]; // by a provider's login, with words of their own
let leave = () => {};

function theme(name) {
  document.documentElement.dataset.theme = name;
  localStorage.setItem("theme", name);
  dispatchEvent(new Event("theme"));
}

function languages(whenChosen) {
  const options = Object.entries(LANGUAGES).map(([name, text]) => h("option", { value: name, selected: name === document.documentElement.lang }, text));
  const select = h("select", { id: "language", "aria-label": t("language") }, ...options);
  select.addEventListener("change", async () => {
    localStorage.setItem("language", select.value);
    await speak(select.value);
    whenChosen();
  });
  return select;
}

function zoneChoice(whenChosen) {
  const options = Object.entries(zones()).map(([which, name]) => h("option", { value: which, selected: which === chosenZone() }, t(`zone_${which}`, { name })));
  const name = t(`zone_${chosenZone()}`, { name: zones()[chosenZone()] }); // where there is no room for it
  const select = h("select", { id: "zone", "aria-label": t("zone"), title: `${t("zone")}: ${name}` }, ...options);
  select.addEventListener("change", () => {
    localStorage.setItem("zone", select.value);
    whenChosen();
  });
  return select;
}

function themeButton() {
  const other = () => (document.documentElement.dataset.theme === "dark" ? "light" : "dark");
  return h("button", { id: "theme", title: t("theme"), "aria-label": t("theme"), onclick: () => theme(other()) }, "◐");
}

// ---- log in --------------------------------------------------------------------------------------

function showLogin(said = "") {
  const error = h("p", { class: "error", role: "alert" }, said);
  const name = h("input", { id: "name", autocomplete: "username", required: true });
  const password = h("input", { id: "password", type: "password", autocomplete: "current-password", required: true });
  const code = h("input", { id: "code", autocomplete: "one-time-code", inputMode: "numeric", maxLength: 32 });
  const asked = h("label", { hidden: true }, t("code_or_recovery"), code);
  const provider = h("button", { type: "button", hidden: true, onclick: () => location.assign("api/oidc/begin") });
  live.ask("oidc").then(({ label }) => {
    setText(provider, t("login_by", { provider: label }));
    provider.hidden = !label;
  }, () => {});
  const form = h("form", { class: "card" },
    h("div", { class: "brand" }, h("img", { src: "icon.svg", alt: "" }), h("h1", {}, `OpenRTU · ${t("title")}`)),
    h("label", {}, t("user"), name), h("label", {}, t("password"), password), asked,
    error, h("button", { class: "main" }, t("login")), provider, languages(() => showLogin()));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    setText(error, "");
    try {
      await live.ask("login", { name: name.value, password: password.value, code: code.value });
      await enter();
    } catch (refused) {
      const first = refused.code === "code"; // the password was right, and more is needed
      asked.hidden &&= !first;
      setText(error, first ? "" : reason(refused));
      if (asked.hidden) password.select();
      else code.select();
    }
  });
  document.title = t("title");
  document.body.replaceChildren(h("main", { class: "login" }, form));
  name.focus();
}

// What came back from the provider, as a word of the address.
function saidByProvider(word) {
  if (word === "cancelled") return "";
  return t(word === "again" ? "again_done" : REFUSED.includes(word) ? `login_by_${word}` : "login_by_failed");
}

function showSaid(text) {
  const dialog = h("dialog", { "aria-label": t("login") }, h("div", { class: "body" }, h("p", { role: "status" }, text)),
    h("div", { class: "end" }, h("button", { type: "button", onclick: () => dialog.close() }, t("close"))));
  modal(dialog);
}

async function logOut() {
  live.stop();
  const { provider } = await live.ask("logout", {}).catch(() => ({}));
  leave();
  live.session.user = "";
  if (provider) location.assign(provider); // it leads back to here
  else showLogin();
}

function sessionEnded() {
  live.stop();
  leave();
  live.session.user = "";
  showLogin(t("session_ended"));
}

// ---- the frame -----------------------------------------------------------------------------------

async function enter() {
  Object.assign(live.session, await live.ask("me"));
  frame();
  live.start(sessionEnded);
}

function frame() {
  leave();
  const release = h("a", { class: "asks", href: "#alarms/commands", role: "alert", hidden: true });
  const banner = h("div", { class: "banner", role: "alert", hidden: true });
  const count = h("span", { class: "count", hidden: true });
  const clock = h("span", { class: "clock" });
  const sound = horn();
  const views = Object.keys(VIEWS).filter((name) => live.may(NEEDS[name] ?? "viewer") && (name !== "pictures" || live.session.pictures));
  const links = views.map((name) => h("a", { href: `#${name}` }, t(name)));
  links[2].append(count);
  const heading = h("h1", { class: "visually-hidden" });
  const main = h("main", { id: "main", tabIndex: -1 });
  const account = h("button", { id: "account", title: live.session.user, "aria-haspopup": "dialog", onclick: showAccount }, shape("person"), h("span", {}, t("account")));
  const user = h("button", { id: "logout", title: `${live.session.user} · ${live.session.role}`, onclick: logOut }, shape("leave"), h("span", {}, t("logout")));
  const tools = h("div", { class: "tools", id: "tools" }, clock, zoneChoice(frame), languages(frame), themeButton(), keysButton(views), account, user);
  const menu = h("button", { id: "menu", "aria-label": t("menu"), "aria-expanded": "false", "aria-controls": "tools",
    onclick: () => menu.setAttribute("aria-expanded", String(tools.classList.toggle("open"))) }, "☰");
  document.body.replaceChildren(
    h("header", { class: "head" },
      h("div", { class: "brand" }, h("img", { src: "icon.svg", alt: "" }), h("span", {}, "OpenRTU"), heading),
      h("nav", {}, ...links),
      menu, tools, sound.button),
    banner, release, main);
  const endFiles = showFiles(document.body);

  let end = () => {};
  const go = () => {
    end();
    const [name, argument] = location.hash.slice(1).split("/");
    const view = views.includes(name) ? name : "map";
    links.forEach((link) => (link.hash === `#${view}` ? link.setAttribute("aria-current", "page") : link.removeAttribute("aria-current")));
    document.title = `${t(view)} · ${t("title")}`;
    main.className = `${view}-view`;
    setText(heading, t(view));
    main.replaceChildren();
    tools.classList.remove("open");
    menu.setAttribute("aria-expanded", "false");
    end = VIEWS[view](main, Number(argument) || 0, argument);
  };
  const state = () => {
    const { connected, collects, fault } = live.centre;
    const waits = [...live.commands.values()].filter((command) => command.release && command.state === STATE.ACCEPTED_SELECTION && command.user !== live.session.user);
    release.hidden = !waits.length || !live.may("operator");
    setText(release, t("waits_release", { n: waits.length, by: waits[0]?.user }));
    const text = !connected ? t("disconnected") : fault ? t("store_fault", { fault }) : !collects ? t("no_collector") : "";
    setText(banner, text);
    banner.hidden = !text;
    const open = [...live.alarms.values()].filter((alarm) => !alarm.acknowledged && live.stands(alarm)).length;
    setText(count, String(open));
    count.hidden = !open;
  };
  const tick = setInterval(() => setText(clock, time(live.now())), 500);
  const unwatch = live.watch(state);
  const endKeys = watchKeys(links, sound.silence);
  addEventListener("hashchange", go);
  leave = () => {
    end();
    endFiles();
    unwatch();
    sound.end();
    clearInterval(tick);
    removeEventListener("hashchange", go);
    endKeys();
    leave = () => {};
  };
  go();
}

theme(localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
await speak(chosen());
const [, said] = location.hash.match(/^#login\/(\w+)$/) ?? [];
if (said) history.replaceState(null, "", "#map");
try {
  await enter();
  if (said) showSaid(saidByProvider(said));
} catch {
  showLogin(said ? saidByProvider(said) : "");
}
