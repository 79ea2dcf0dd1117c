// SPDX-License-Identifier: GPL-3.0-or-later
// The only way elements are made here. Text is text: nothing that a station or a user says becomes markup.
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

// Rows by key, each made once and then only changed: focus and selection stay where they are.
export class Rows {
  constructor(parent, make) {
    this.parent = parent;
    this.make = make; // (key, thing) => { element, update(thing) }
    this.rows = new Map();
  }

  show(entries) {
    const wanted = new Map(entries);
    for (const [key, row] of this.rows) {
      if (!wanted.has(key)) {
        row.element.remove();
        this.rows.delete(key);
      }
    }
    let place = this.parent.firstElementChild;
    for (const [key, thing] of wanted) {
      let row = this.rows.get(key);
      if (!row) {
        row = this.make(key, thing);
        this.rows.set(key, row);
      }
      row.update(thing);
      if (row.element === place) place = place.nextElementSibling;
      else this.parent.insertBefore(row.element, place);
    }
  }
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
