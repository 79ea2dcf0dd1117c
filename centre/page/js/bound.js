// SPDX-License-Identifier: GPL-3.0-or-later
// What an element shows of its point. What an attribute says was read by the centre (centre/bindings.py); here it
// is looked up for a value, and only what differs from before is touched.
import { CONTENT, LINK, QUALITY } from "./codes.js";
import { SHAPES } from "./dom.js";
import { darkened, isDark, svg } from "./drawing.js";
import { centre, stations } from "./live.js";
import { quality, valueText } from "./quality.js";
import { t, time } from "./words.js";

const COLOURS = ["text", "muted", "line", "panel", "accent", "good", "old", "bad"];

// What is to be said of a point: {kind, word, words (of cases), known (its value is to be believed)}
export function saidOf(point, why = "") {
  if (why) return { kind: "bad", words: ["invalid"], known: false, word: t(why === "twice" ? "point_twice" : "point_unknown") };
  if (!point) return { kind: "none", words: ["never"], known: false, word: t("never") };
  const lost = !centre.connected || !centre.collects || stations.get(point.station)?.link !== LINK.UP;
  if (!point.at) return { kind: "none", word: t(lost ? "no_link" : "never"), words: lost ? ["never", "lost"] : ["never"], known: false };
  if (lost) return { kind: "none", word: t("no_link"), words: ["lost"], known: false };
  const words = Object.keys(QUALITY).filter((name) => point.quality & QUALITY[name]).map((name) => name.toLowerCase().replace("_", "-"));
  const { kind, word } = quality(point);
  return { kind, word, words: words.length ? words : ["good"], known: kind !== "bad" && kind !== "none" };
}

function within([low, high], value) {
  return value !== null && value !== undefined && (low === null || value >= low) && (high === null || value <= high);
}

// A word of the quality comes before each value, and `else` is for a value that is believed.
function fits(condition, value, said) {
  if (typeof condition === "string") return said.words.includes(condition);
  return condition !== null && within(condition, value);
}

export function found(cases, value, said, believed) {
  const byWord = cases.find(([condition]) => typeof condition === "string" && said.words.includes(condition));
  if (byWord) return byWord[1];
  if (believed && !said.known) return undefined;
  const byValue = cases.find(([condition]) => typeof condition !== "string" && fits(condition, value, said));
  return (byValue ?? cases.find(([condition]) => condition === null && said.known))?.[1];
}

export function proportional(steps, value) {
  const after = steps.findIndex(([at]) => at >= value);
  if (after === 0) return steps[0].slice(1);
  if (after < 0) return steps.at(-1).slice(1);
  const [[from, ...a], [to, ...b]] = [steps[after - 1], steps[after]];
  return a.map((each, i) => each + ((b[i] - each) * (value - from)) / (to - from));
}

function colour(name) {
  if (name === "none") return "none";
  if (COLOURS.includes(name)) return `var(--${name})`;
  if (!isDark()) return name;
  const long = name.length === 4 ? name.replace(/[^#]/g, "$&$&") : name;
  const [red, green, blue] = [1, 3, 5].map((i) => parseInt(long.slice(i, i + 2), 16));
  return darkened(`rgb(${red}, ${green}, ${blue})`);
}

function filled(template, point, said) {
  const fields = {
    value: (digits) => (!point ? "?" : digits && Number.isFinite(point.value) ? point.value.toFixed(digits) : valueText(point)),
    unit: () => point?.unit ?? "", name: () => point?.name ?? "", quality: () => said.word, time: () => time(point?.at),
  };
  return template.replace(/{(\w+)(?::(\d))?}/g, (_, field, digits) => fields[field](digits));
}

function set(element, property, value) {
  if (element.style.getPropertyValue(property) !== value) element.style.setProperty(property, value);
}

// How each attribute is shown; those that say whom, what for or where are not in here.
export const SHOWN = {
  text: (one, template, point, said) => one.say(filled(template, point, said), said),
  words: (one, cases, point, said) => one.say(filled(found(cases, point?.value, said, false) ?? "{value}", point, said), said),
  fill: (one, cases, point, said) => one.paint("fill", found(cases, point?.value, said, true), said),
  stroke: (one, cases, point, said) => one.paint("stroke", found(cases, point?.value, said, true), said),
  visible: (one, conditions, point, said) => {
    const unknown = point?.value === null || point?.value === undefined;
    const seen = conditions.some((condition) => fits(condition, point?.value, said)) || (unknown && !said.known);
    set(one.element, "visibility", seen ? "" : "hidden");
  },
  rotate: (one, steps, point) => one.place("rotate", steps, point, ([angle]) => `rotate(${angle} ${one.pivot.join(" ")})`),
  move: (one, steps, point) => one.place("move", steps, point, ([x, y]) => `translate(${x} ${y})`),
  level: (one, steps, point) => {
    const share = Number.isFinite(point?.value) ? proportional(steps, point.value)[0] : 0;
    set(one.element, "clip-path", `inset(${((1 - share) * 100).toFixed(2)}% 0px 0px)`);
  },
};

// Its name for who hears the picture. Who commands by voice says what is written on it.
export function call(element, text) {
  const written = element.hasAttribute("data-acts") ? [...element.querySelectorAll("text")].map((each) => each.textContent.trim()).join(" ") : "";
  const name = written ? `${text} · ${written}` : text;
  if (element.getAttribute("aria-label") !== name) element.setAttribute("aria-label", name);
}

// An element with its binding.
class Bound {
  constructor(element, binding) {
    this.element = element;
    this.binding = binding;
    this.shows = Object.keys(SHOWN).filter((name) => name in binding);
    this.own = { fill: element.style.fill, stroke: element.style.stroke };
    this.drawn = this.own;
    this.transform = element.getAttribute("transform") ?? "";
    this.moved = { move: "", rotate: "" };
  }

  undress() {
    for (const property of ["fill", "stroke"]) set(this.element, property, this.own[property]);
  }

  dress() {
    this.drawn = { fill: this.element.style.fill, stroke: this.element.style.stroke };
  }

  // Once it is laid out.
  measure(box) {
    this.area = { x: box.x, y: box.y, width: box.width, height: box.height };
    this.pivot = this.binding.pivot ?? [box.x + box.width / 2, box.y + box.height / 2];
  }

  show(point, said) {
    for (const name of this.shows) SHOWN[name](this, this.binding[name], point, said);
  }

  // A value that is not to be believed is crossed out, and is no number of its own colour.
  say(text, said) {
    if (this.element.textContent !== text) this.element.textContent = text;
    if ("fill" in this.binding) return;
    set(this.element, "fill", said.kind === "good" ? this.drawn.fill : `var(--${said.kind})`);
    set(this.element, "text-decoration", said.known ? "" : "line-through");
  }

  paint(property, wanted, said) {
    if (wanted !== undefined) set(this.element, property, colour(wanted));
    else if (said.known) set(this.element, property, this.drawn[property]);
    else set(this.element, property, `url("#hatch-${said.kind}")`);
  }

  place(name, steps, point, text) {
    this.moved[name] = Number.isFinite(point?.value) ? text(proportional(steps, point.value)) : "";
    const transform = [this.transform, this.moved.move, this.moved.rotate].filter(Boolean).join(" ");
    if (this.element.getAttribute("transform") !== transform) this.element.setAttribute("transform", transform);
  }
}

// All of a picture.
export class Bindings {
  constructor(picture, { root, elements, tones }, size) {
    this.picture = picture;
    this.tones = tones;
    this.root = root;
    this.size = size; // of a mark
    this.all = picture.bound.map((binding, number) => (elements[number] ? new Bound(elements[number], binding) : null));
    this.marks = svg("g", { class: "marks", "aria-hidden": "true" });
    this.byPoint = new Map(); // by id: numbers
    this.measure();
    root.append(this.marks);
    this.connect();
    this.retone();
  }

  // Dark or light: what is drawn, before it shows any value.
  retone() {
    for (const one of this.all) one?.undress();
    this.tones.show();
    for (const one of this.all) one?.dress();
  }

  // All are asked before anything is changed: else each would lay the picture out once more.
  measure() {
    const inverse = this.root.getScreenCTM()?.inverse();
    for (const one of this.all) {
      if (!one) continue;
      one.measure(one.element.getBBox());
      const matrix = inverse?.multiply(one.element.getScreenCTM());
      const corner = new DOMPoint(one.area.x + one.area.width, one.area.y);
      one.corner = matrix ? corner.matrixTransform(matrix) : corner;
    }
  }

  connect() {
    const { bound, points } = this.picture;
    this.byPoint.clear();
    this.all.forEach((one, number) => {
      if (!one || bound[number].owner === null) return;
      const id = points[bound[bound[number].owner].point];
      if (!this.byPoint.has(id)) this.byPoint.set(id, []);
      this.byPoint.get(id).push(number);
    });
  }

  nameOf(number) {
    const { owner } = this.picture.bound[number];
    return owner === null ? "" : this.picture.bound[owner].point;
  }

  // Those of these points; undefined is for all that are not there.
  update(ids, points) {
    for (const id of ids) {
      const point = points.get(id);
      const numbers = this.byPoint.get(id) ?? [];
      const said = (number) => saidOf(point, this.picture.unknown[this.nameOf(number)]);
      for (const number of numbers) this.all[number].show(point, said(number));
      for (const number of numbers) if (this.picture.bound[number].owner === number) this.mark(this.all[number], point, said(number), this.nameOf(number));
    }
  }

  // A shape beside what is not good, and its word for who hears the picture.
  mark(one, point, said, name) {
    if (one.marked !== said.kind) {
      one.marked = said.kind;
      if (!one.sign) {
        one.sign = svg("path", { fill: "currentColor", "fill-rule": "evenodd", stroke: "var(--panel)", "stroke-width": 1, "paint-order": "stroke" });
        one.sign.setAttribute("transform", `translate(${one.corner.x - this.size / 2} ${one.corner.y - this.size / 2}) scale(${this.size / 16})`);
        this.marks.append(one.sign);
      }
      one.sign.setAttribute("class", said.kind);
      one.sign.setAttribute("d", SHAPES[said.kind]);
    }
    const text = point ? `${point.name}: ${`${valueText(point)} ${point.unit}`.trim()}, ${said.word}` : `${name}: ${said.word}`;
    call(one.element, text);
  }

  // A position grows old by itself.
  aging(points) {
    return [...this.byPoint.keys()].filter((id) => points.get(id)?.content === CONTENT.POSITION);
  }
}
