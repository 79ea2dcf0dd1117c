// SPDX-License-Identifier: GPL-3.0-or-later
// What a long list has above it: a field that filters it, and heads that sort it.
import { empty, h, Rows, setText, th } from "./dom.js";
import * as live from "./live.js";
import { t } from "./words.js";

const AGAIN_MS = 5000;

// By name, as people count: names are compared only when there are others than the last time, since that of thousands takes longest of all.
export function inOrder(nameOf, idOf = (thing) => thing.id) {
  const { compare } = new Intl.Collator(undefined, { numeric: true });
  let names = new Map();
  let rank = new Map();
  return (all) => {
    if (all.length !== rank.size || all.some((thing) => names.get(idOf(thing)) !== nameOf(thing))) {
      names = new Map(all.map((thing) => [idOf(thing), nameOf(thing)]));
      rank = new Map([...all].sort((a, b) => compare(nameOf(a), nameOf(b))).map((thing, number) => [idOf(thing), number]));
    }
    const ordered = new Array(all.length);
    for (const thing of all) ordered[rank.get(idOf(thing))] = thing;
    return ordered;
  };
}

// The field that filters. The browser's own search would find no row that is out of sight.
export class Finder {
  constructor(changed, key = "search") {
    this.input = h("input", { type: "search", placeholder: t(key), "aria-label": t(key), oninput: changed });
    this.count = h("span", { class: "muted", role: "status" });
    this.element = h("div", { class: "finder" }, this.count, this.input);
  }

  fits(text) {
    return text.toLocaleLowerCase().includes(this.input.value.toLocaleLowerCase());
  }

  // How many of all are left; nothing when nothing is sought.
  tell(found, all) {
    setText(this.count, this.input.value ? t("found_of", { n: found, all }) : "");
  }
}

// Heads of columns. Those that say what counts sort: once up, once down, then as before.
export class Heads {
  constructor(columns, changed) {
    this.columns = columns; // [key, class, of a thing: a text or a number]
    this.by = -1;
    this.turn = 1;
    this.changed = changed;
    this.heads = columns.map(([key, kind, value], column) =>
      th(key, kind, value ? h("button", { type: "button", class: "sort", onclick: () => this.choose(column) }, t(key)) : null));
    this.row = h("tr", {}, ...this.heads);
  }

  choose(column) {
    if (this.by !== column) [this.by, this.turn] = [column, 1];
    else if (this.turn > 0) this.turn = -1;
    else this.by = -1;
    this.heads.forEach((head, number) => {
      if (number === this.by) head.setAttribute("aria-sort", this.turn > 0 ? "ascending" : "descending");
      else head.removeAttribute("aria-sort");
    });
    this.changed();
  }

  // Sorts them; whether somebody has chosen by what. What is equal stays as it is.
  sort(things) {
    const value = this.columns[this.by]?.[2];
    if (!value) return false;
    const { compare } = new Intl.Collator(undefined, { numeric: true });
    const values = new Map(things.map((thing) => [thing, value(thing) ?? 0]));
    things.sort((a, b) => {
      const [one, other] = [values.get(a), values.get(b)];
      return this.turn * (typeof one === "string" ? compare(one, other) : one - other);
    });
    return true;
  }
}

// Asked for again and again, and when what stands in its head was changed. load() answers with a key and the cells of each row; what they hold
// stays as long as it is the same, with the focus.
export function list(place, title, headings, head, load) {
  const body = h("tbody");
  const none = h("div");
  const table = h("table", {}, h("thead", {}, h("tr", {}, ...headings.map((key) => th(key)))), body);
  place.append(h("section", { class: "card" }, h("div", { class: "row" }, h("h2", { class: "grow" }, t(title)), ...head),
    h("div", { class: "scroll" }, table), none));
  const rows = new Rows(body, (_, [, ...cells]) => {
    const boxes = cells.map((_cell, column) => h("td", { class: column ? "" : "time" }));
    return {
      element: h("tr", {}, ...boxes),
      update([, ...now]) {
        now.forEach((cell, column) => {
          if (!(cell instanceof Node)) setText(boxes[column], cell);
          else if (!boxes[column].firstChild?.isEqualNode(cell)) boxes[column].replaceChildren(cell);
        });
      },
    };
  });
  let asked = 0;
  async function show() {
    const mine = ++asked;
    const found = await load();
    if (mine !== asked) return; // what stands in its head was changed meanwhile
    rows.show(found.map((row) => [row[0], row]));
    table.hidden = !found.length;
    none.replaceChildren(...(found.length ? [] : [empty(t(`no_${title}`))]));
  }
  const failed = (error) => none.replaceChildren(h("p", { class: "empty error" }, t("failed", { error: error.message })));
  place.firstElementChild.addEventListener("change", () => show().catch(failed));
  return live.repeat(() => show().catch(failed), AGAIN_MS);
}
