// SPDX-License-Identifier: GPL-3.0-or-later
// Process pictures: their list, one of them live, and commands from it. docs/process-pictures.md.
import { Bindings, call, saidOf } from "./bound.js";
import { commandDialogue } from "./command.js";
import { empty, fill, h, state } from "./dom.js";
import { draw, svg } from "./drawing.js";
import * as live from "./live.js";
import { valueText } from "./quality.js";
import { t, time } from "./words.js";
import { Zoom } from "./zoom.js";

const AGAIN_MS = 10000; // until a name that is none is looked for again
const MARK = 45; // a mark is this part of the drawing's width

export function showPictures(main, _, argument = "") {
  let wanted = decodeURIComponent(argument);
  let shown = null; // {picture, bindings, zoom}
  let ended = false;
  let every = true; // all is to be shown, and not only what has changed
  let frame = 0;
  let chosen = null; // the number of a binding
  let listed = ""; // what the centre has, as it said it last
  const waiting = new Set();

  const list = h("ul", { class: "list" });
  const title = h("h2", {}, t("pictures"));
  const host = h("div", { class: "drawing" });
  const wrong = h("div", { class: "wrong", role: "alert", hidden: true });
  const tools = [["zoom_in", "+", () => shown?.zoom.by(1.25)], ["zoom_out", "−", () => shown?.zoom.by(0.8)], ["zoom_fit", "⤢", () => shown?.zoom.fit()]]
    .map(([key, sign, onclick]) => h("button", { title: t(key), "aria-label": t(key), onclick }, sign));
  const about = h("div", { class: "row told" });
  const stage = h("div", { class: "stage" }, host);
  main.append(h("div", { class: "side", role: "navigation", "aria-label": t("pictures") }, list),
    h("div", { class: "picture" }, h("div", { class: "row top" }, title, h("span", { class: "grow" }), h("div", { class: "zoom" }, ...tools)), wrong, stage, about));

  // ---- the list ----------------------------------------------------------------------------------

  async function start() {
    const all = await live.ask("pictures");
    if (ended) return;
    listed = JSON.stringify(all);
    list.replaceChildren(...all.map(({ name, title: text }) => h("li", {},
      h("button", { "data-name": name, onclick: () => (location.hash = `#pictures/${encodeURIComponent(name)}`) }, h("span", { class: "name" }, text)))));
    if (!all.length) stage.replaceChildren(empty(t("no_pictures"), t("no_pictures_more")));
    else if (!wanted) {
      wanted = all[0].name;
      history.replaceState(null, "", `#pictures/${encodeURIComponent(wanted)}`);
    }
    for (const button of list.querySelectorAll("button")) button.setAttribute("aria-pressed", String(button.dataset.name === wanted));
    if (wanted) await open();
  }

  async function open() {
    const picture = await live.ask(`pictures/${encodeURIComponent(wanted)}`);
    if (ended) return;
    title.replaceChildren(picture.title);
    warn(picture);
    if (picture.refused.length) return;
    const drawn = draw(host, picture);
    const zoom = new Zoom(host, drawn.root);
    const bindings = new Bindings(picture, drawn, Math.max(zoom.whole.width, zoom.whole.height) / MARK);
    shown = { picture, bindings, zoom };
    drawn.root.setAttribute("role", "group");
    drawn.root.setAttribute("aria-label", picture.title);
    reach();
    live.look({ view: "pictures", picture: wanted });
    later(true);
  }

  function failed(error) {
    if (!ended) stage.replaceChildren(empty(t("picture_failed"), error.message));
  }

  // What does not exist is said, and not only drawn.
  function warn({ refused, mistakes, unknown }) {
    const names = Object.entries(unknown).map(([name, why]) => `${name}: ${t(why === "twice" ? "point_twice" : "point_unknown")}`);
    const said = refused.length ? refused : [...names, ...mistakes];
    wrong.hidden = !said.length;
    if (!said.length) return;
    wrong.replaceChildren(state("bad", t(refused.length ? "picture_refused" : "picture_wrong", { n: said.length })),
      h("details", {}, h("summary", {}, t("what_is_wrong")), h("ul", {}, ...said.map((each) => h("li", {}, each)))));
  }

  // A screen of a control room is never loaded again: a picture that has changed, or is new, is shown by itself.
  async function lookForOthers() {
    const all = await live.ask("pictures").catch(() => null);
    if (ended || !all || JSON.stringify(all) === listed) return;
    shown?.zoom.end();
    shown = null;
    stage.replaceChildren(host);
    await start().catch(failed);
  }

  async function lookAgain() {
    await lookForOthers();
    if (ended || !shown || !Object.keys(shown.picture.unknown).length) return;
    const picture = await live.ask(`pictures/${encodeURIComponent(wanted)}`).catch(() => null);
    if (ended || !picture || picture.svg !== shown.picture.svg || JSON.stringify(picture.points) === JSON.stringify(shown.picture.points)) return;
    Object.assign(shown.picture, picture);
    shown.bindings.connect();
    warn(picture);
    live.look({ view: "pictures", picture: wanted }); // its points are looked for once more
    later(true);
  }

  // ---- what is in it -----------------------------------------------------------------------------

  // What an element does for this user: {picture} or {command}, the id of a point.
  function act(number) {
    const { command, picture } = shown.picture.bound[number];
    if (picture) return { picture };
    const point = live.points.get(shown.picture.points[command]);
    return point?.command && live.may("operator") ? { command: point.id } : {};
  }

  function reach() {
    const { bound } = shown.picture;
    shown.bindings.all.forEach((one, number) => {
      const { owner, picture, command } = bound[number];
      if (!one || (owner !== number && !picture && command === undefined)) return;
      one.element.setAttribute("tabindex", "0");
      one.element.setAttribute("role", picture ? "link" : command === undefined ? "img" : "button");
      if (picture || command !== undefined) {
        one.element.setAttribute("data-acts", "");
        if (owner !== number) call(one.element, picture ? t("picture_open", { name: picture }) : command);
        if (one.element.localName === "g") one.element.prepend(svg("rect", { ...one.area, fill: "none", "pointer-events": "all" })); // a finger is no needle
      }
    });
  }

  function numberAt(event) {
    const element = event.composedPath().find((each) => each.dataset?.bound !== undefined && each.hasAttribute("tabindex"));
    return element ? Number(element.dataset.bound) : null;
  }

  function choose(number) {
    chosen = number;
    tell();
  }

  function go(number) {
    const { picture, command } = act(number);
    if (picture) location.hash = `#pictures/${encodeURIComponent(picture)}`;
    else if (command) commandDialogue(command);
    else choose(number);
  }

  // What is chosen, in words.
  function tell() {
    const { bound, points, unknown } = shown?.picture ?? {};
    const owner = chosen === null ? null : bound[chosen].owner;
    if (owner === null || owner === undefined) return fill(about, "", () => []);
    const name = bound[owner].point;
    const point = live.points.get(points[name]);
    const said = saidOf(point, unknown[name]);
    const value = point ? `${valueText(point)} ${point.unit}` : "?";
    const { command } = act(chosen);
    fill(about, [name, value, said.word, point?.at, command].join("|"), () => [
      h("strong", {}, point?.name ?? name), h("span", {}, value), state(said.kind, said.word), h("span", { class: "muted" }, point ? time(point.at, true) : ""),
      h("span", { class: "grow" }), point ? h("a", { href: `#points/${point.station}` }, live.stations.get(point.station)?.name ?? t("points")) : "",
      command ? h("button", { class: "small", onclick: () => commandDialogue(command) }, t("command")) : ""]);
  }

  host.addEventListener("click", (event) => {
    const number = shown ? numberAt(event) : null;
    if (number !== null) go(number);
  });
  host.addEventListener("focusin", (event) => choose(numberAt(event)));
  host.addEventListener("pointerover", (event) => {
    const number = shown ? numberAt(event) : null;
    if (number !== null) choose(number);
  });
  host.addEventListener("keydown", (event) => {
    if (!shown || event.ctrlKey || event.metaKey || event.altKey) return;
    const number = numberAt(event);
    if (number !== null && (event.key === "Enter" || event.key === " ")) go(number);
    else if (!shown.zoom.key(event.key)) return;
    event.preventDefault();
    event.stopPropagation();
  });

  // ---- live --------------------------------------------------------------------------------------

  function update() {
    frame = 0;
    if (!shown) return;
    const { bindings } = shown;
    bindings.update(every ? bindings.byPoint.keys() : waiting, live.points);
    every = false;
    waiting.clear();
    tell();
  }

  function later(all = false) {
    every ||= all;
    frame ||= requestAnimationFrame(update);
  }

  let before = "";
  const unwatch = live.watch((change) => {
    const { connected, collects } = live.centre;
    const now = `${connected} ${collects}`;
    // A station's link, or ours, concerns every point at once.
    if (change.whole || change.stations.length || now !== before) every = true;
    before = now;
    for (const point of change.points) waiting.add(point.id);
    for (const id of change.gone) waiting.add(id);
    if (every || waiting.size) later();
  });
  const tick = setInterval(() => {
    if (shown) shown.bindings.aging(live.points).forEach((id) => waiting.add(id));
    if (waiting.size) later();
  }, 1000);
  const again = setInterval(lookAgain, AGAIN_MS);
  const retone = () => {
    shown?.bindings.retone();
    later(true);
  };
  addEventListener("theme", retone);
  start().catch(failed);
  return () => {
    ended = true;
    unwatch();
    clearInterval(tick);
    clearInterval(again);
    cancelAnimationFrame(frame);
    removeEventListener("theme", retone);
    shown?.zoom.end();
  };
}
