// SPDX-License-Identifier: GPL-3.0-or-later
// The only way elements are made here. Text is text: nothing that a station or a user says becomes markup.
import { firstBeyond } from "./search.js";
import { t } from "./words.js";

const SVG = "http://www.w3.org/2000/svg";

export function h(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && typeof value !== "string") element[name] = value;
    else if (name === "class") element.className = value;
    else if (value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

// Shapes, so that no state is told by its colour alone. 16 by 16.
export const SHAPES = {
  good: "M8 2a6 6 0 1 0 0 12A6 6 0 0 0 8 2z",
  old: "M8 1.5 15 14H1z",
  bad: "M2 2h12v12H2z",
  person: "M8 8.2a3.4 3.4 0 1 0 0-6.8 3.4 3.4 0 0 0 0 6.8zM1.6 14.6a6.4 5.4 0 0 1 12.8 0z",
  leave: "M2 2h7v2H4v8h5v2H2zM10 4.2 14.4 8 10 11.8V9.2H6V6.8h4z",
  none: "M8 .8 15.2 8 8 15.2.8 8zM8 4.4 4.4 8 8 11.6 11.6 8z",
};

export function shape(kind) {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(SVG, "path");
  path.setAttribute("d", SHAPES[kind]);
  path.setAttribute("fill", "currentColor");
  path.setAttribute("fill-rule", "evenodd");
  svg.append(path);
  return svg;
}

export function state(kind, text) {
  return h("span", { class: `state ${kind}` }, shape(kind), h("span", {}, text));
}

export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

const ALL_MOST = 100; // entries that are all in the document; of more, those in sight
const MARGIN_PX = 400; // beyond what is in sight
const GUESS_PX = 36; // of a row that was never shown
const CONTROLS = "a[href], button:not(:disabled), input:not(:disabled), select:not(:disabled)";

// In place of a list that has nothing.
export function empty(head, more = "") {
  return h("div", { class: "empty" }, h("strong", {}, head), more);
}

// The head of a column; one of buttons is only said.
export function th(key, kind = "", content = null) {
  return h("th", { class: kind, scope: "col" }, content ?? (key ? t(key) : h("span", { class: "visually-hidden" }, t("actions"))));
}

// Rows by key, each made once and then only changed: focus and selection stay where they are. Of a long list only the rows in sight are in the
// document, and the one with the focus; what is between them is as high as they would be. The parent is a tbody, or a list that scrolls.
export class Rows {
  constructor(parent, make) {
    this.parent = parent;
    this.make = make; // (key, thing) => { element, update(thing) }
    this.rows = new Map(); // in the document
    this.entries = [];
    this.places = new Map(); // of a key in the entries
    this.heights = new Map();
    this.scroller = null;
    this.drawn = [0, 0]; // from where to where
    this.table = parent.closest("table"); // none: it is a list
    this.table?.classList.add("cards");
    parent.addEventListener("keydown", (event) => this.step(event));
  }

  show(entries) {
    this.entries = entries;
    this.places = new Map(entries.map(([key], place) => [key, place]));
    this.table?.setAttribute("aria-rowcount", String(entries.length + 1)); // its head is the first
    if (!this.scroller && this.parent.isConnected) this.watch();
    this.draw(true);
  }

  watch() {
    this.scroller = this.parent.closest(".list, .page") ?? document.scrollingElement;
    let asked = 0;
    const again = () => { asked ||= requestAnimationFrame(() => { asked = 0; if (!this.covers()) this.draw(false); }); };
    this.scroller.addEventListener("scroll", again, { passive: true });
    let width = 0;
    new ResizeObserver(() => {
      if (this.parent.clientWidth !== width) this.heights.clear(); // texts are broken otherwise
      width = this.parent.clientWidth;
      again();
    }).observe(this.scroller);
  }

  // From the beginning of each entry to that of the next.
  edges() {
    let sum = 0;
    for (const height of this.heights.values()) sum += height;
    const usual = this.heights.size ? sum / this.heights.size : GUESS_PX;
    const edges = new Float64Array(this.entries.length + 1);
    this.entries.forEach(([key], place) => (edges[place + 1] = edges[place] + (this.heights.get(key) ?? usual)));
    return edges;
  }

  // How far the list is scrolled beyond its beginning.
  top() {
    if (this.scroller === this.parent) return this.parent.scrollTop;
    return this.scroller.getBoundingClientRect().top - this.parent.getBoundingClientRect().top;
  }

  // Whether what was drawn last is still all that is in sight.
  covers() {
    const top = this.top();
    const [from, to] = this.drawn;
    return this.entries.length <= ALL_MOST || (Math.max(0, top) >= from && top + this.scroller.clientHeight <= to);
  }

  // What shall be in the document: places of entries, in order.
  inSight(edges) {
    const count = this.entries.length;
    if (count <= ALL_MOST || !this.scroller) return this.entries.slice(0, ALL_MOST).map((_, place) => place);
    const top = this.top();
    const wanted = new Set();
    let place = Math.max(0, firstBeyond(edges, top - MARGIN_PX) - 1);
    const from = edges[place];
    for (; place < count && edges[place] < top + this.scroller.clientHeight + MARGIN_PX; place++) wanted.add(place);
    this.drawn = [from, place < count ? edges[place] : Infinity];
    const [held] = [...this.rows].find(([, row]) => row.element.contains(document.activeElement)) ?? [];
    if (this.places.has(held)) wanted.add(this.places.get(held));
    return [...wanted].sort((a, b) => a - b);
  }

  // Rows that were never shown are guessed; once they are, others may be in sight.
  draw(news) {
    let edges = this.edges();
    let places = this.inSight(edges);
    this.put(places, edges, news);
    for (let tries = 0; tries < 2 && this.measure(places); tries++) {
      edges = this.edges();
      places = this.inSight(edges);
      this.put(places, edges, false);
    }
  }

  // Whether one was measured that is not as high as was thought.
  measure(places) {
    let found = false;
    for (const place of places) {
      const [key] = this.entries[place];
      const height = this.rows.get(key).element.getBoundingClientRect().height;
      if (!height || this.heights.get(key) === height) continue; // none: it is hidden
      this.heights.set(key, height);
      found = true;
    }
    return found && this.entries.length > ALL_MOST;
  }

  put(places, edges, news) {
    const wanted = new Set(places.map((place) => this.entries[place][0]));
    for (const [key, row] of this.rows) {
      if (!wanted.has(key)) {
        this.rows.delete(key);
        row.element.remove();
      }
    }
    for (const gap of this.parent.querySelectorAll(":scope > .gap")) gap.remove();
    let next = 0; // the entry that would follow
    this.at = this.parent.firstElementChild;
    for (const place of places) {
      const [key, thing] = this.entries[place];
      if (place > next) this.gap(edges[place] - edges[next]);
      next = place + 1;
      let row = this.rows.get(key);
      const fresh = !row;
      if (fresh) {
        row = this.make(key, thing);
        this.rows.set(key, row);
        this.label(row.element);
      }
      if (fresh || news) row.update(thing);
      this.number(row.element, place);
      this.insert(row.element);
    }
    if (next < this.entries.length) this.gap(edges.at(-1) - edges[next]);
  }

  // One that is moved loses the focus: others make way for it.
  insert(element) {
    while (this.at && element !== this.at && element.contains(document.activeElement)) {
      const other = this.at;
      this.at = other.nextElementSibling;
      other.remove();
    }
    if (element === this.at) this.at = element.nextElementSibling;
    else this.parent.insertBefore(element, this.at);
  }

  gap(height) {
    const inner = this.table ? [h("td", { colSpan: 99 })] : [];
    const gap = h(this.table ? "tr" : "li", { class: "gap", "aria-hidden": "true" }, ...inner);
    gap.style.height = `${height}px`;
    this.parent.insertBefore(gap, this.at);
  }

  // Where a row is among all is said, since not all are there.
  number(element, place) {
    if (this.table) element.setAttribute("aria-rowindex", String(place + 2));
    else {
      element.setAttribute("aria-posinset", String(place + 1));
      element.setAttribute("aria-setsize", String(this.entries.length));
    }
  }

  // A narrow screen shows a row as a card, in which each cell says what it is.
  label(element) {
    const heads = this.table?.tHead?.rows[0]?.cells ?? [];
    if (element.cells?.length !== heads.length) return;
    [...element.cells].forEach((cell, column) => (cell.dataset.label = heads[column].textContent));
  }

  // Up, down, a page, to either end: to the same control of another row.
  step(event) {
    const here = [...this.rows].find(([, row]) => row.element.contains(event.target));
    if (!here || event.ctrlKey || event.altKey || event.metaKey || event.target.matches("input, select")) return;
    const page = Math.max(1, Math.floor(this.scroller.clientHeight / here[1].element.getBoundingClientRect().height) - 1);
    const last = this.entries.length - 1;
    const way = { ArrowUp: -1, ArrowDown: 1, PageUp: -page, PageDown: page, Home: -last, End: last }[event.key];
    if (!way) return;
    event.preventDefault();
    const column = [...here[1].element.querySelectorAll(CONTROLS)].indexOf(event.target);
    const first = Math.min(last, Math.max(0, this.places.get(here[0]) + way));
    for (const turn of [Math.sign(way), -Math.sign(way)]) { // a heading has none
      for (let place = first; place >= 0 && place <= last; place += turn) {
        const controls = [...this.reveal(place).querySelectorAll(CONTROLS)];
        if (controls.length) return this.focus(controls[column] ?? controls[0]);
      }
    }
  }

  focus(control) {
    control.focus({ preventScroll: true });
    control.scrollIntoView({ block: "nearest" });
  }

  // The element of an entry, which is in sight then.
  reveal(place) {
    const [key] = this.entries[place];
    if (!this.rows.has(key)) {
      const edges = this.edges();
      this.scroller.scrollTop += edges[place] - this.top() - this.scroller.clientHeight / 2;
      this.draw(false);
    }
    return this.rows.get(key).element;
  }
}

// A dialogue, until it is closed. The focus is then where it came from, or, if that is no longer there, at the beginning of the view.
export function modal(dialog) {
  const from = document.activeElement;
  dialog.addEventListener("close", () => {
    dialog.remove();
    (from.isConnected ? from : document.getElementById("main"))?.focus();
  });
  document.body.append(dialog);
  dialog.showModal();
}

// One of several parts is shown. Each is made by its function, which returns what ends it.
export function tabs(main, parts, first) {
  const page = h("div", { class: "page" });
  const place = h("div");
  let end = () => {};
  const buttons = Object.keys(parts).map((name) => h("button", { onclick: () => show(name) }, t(name)));
  function show(name) {
    end();
    place.replaceChildren();
    buttons.forEach((button, number) => button.setAttribute("aria-pressed", String(Object.keys(parts)[number] === name)));
    end = parts[name](place);
  }
  page.append(h("div", { class: "tabs" }, ...buttons), place);
  main.append(page);
  show(first in parts ? first : Object.keys(parts)[0]);
  return () => end();
}

// What stands in a cell is made anew only when its key has changed.
export function fill(element, key, make) {
  if (element.dataset.key === key) return;
  element.dataset.key = key;
  element.replaceChildren(...[make()].flat());
}
