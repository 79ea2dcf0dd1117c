// SPDX-License-Identifier: GPL-3.0-or-later
// A process picture becomes elements. The centre has written it anew from what it knows; DOMPurify looks at it
// once more, and it stands in a shadow root, where its names and its style meet nothing of the page.
import DOMPurify from "../vendor/purify.mjs";

const SVG = "http://www.w3.org/2000/svg";
const FORBIDDEN = ["a", "style", "image", "filter", "textPath", "animate", "animateTransform", "animateMotion", "set", "mpath"];
const PURIFY = {
  USE_PROFILES: { svg: true }, ADD_TAGS: ["use"], ADD_ATTR: ["href"], FORBID_TAGS: FORBIDDEN, FORBID_ATTR: ["style"],
  ALLOW_UNKNOWN_PROTOCOLS: false, RETURN_DOM_FRAGMENT: true,
};
const OUT = /url\s*\(\s*(?!['"]?#)/i; // an url() that is not of this picture

const purify = DOMPurify(window);
purify.addHook("uponSanitizeAttribute", (_, attribute) => {
  const { attrName, attrValue } = attribute;
  if (attrName.endsWith("href") ? !attrValue.startsWith("#") : OUT.test(attrValue)) attribute.keepAttr = false;
});

export function svg(tag, attributes = {}, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

// A policy that forbids style in markup lets a script set it: property by property, and never as text.
function styled(root) {
  for (const element of root.querySelectorAll("[data-style]")) {
    for (const declaration of element.dataset.style.split(";")) {
      const [name, value] = declaration.split(/:(.*)/s);
      if (value && !OUT.test(value)) element.style.setProperty(name, value);
    }
    element.removeAttribute("data-style");
  }
}

// The picture's rules: nothing but declarations of elements in it.
function rulesOf(css) {
  const sheet = new CSSStyleSheet();
  sheet.replaceSync(css);
  for (let i = sheet.cssRules.length - 1; i >= 0; i--) {
    if (!(sheet.cssRules[i] instanceof CSSStyleRule) || OUT.test(sheet.cssRules[i].cssText)) sheet.deleteRule(i);
  }
  return sheet;
}

const OURS = `
:host { display: block; position: absolute; inset: 0; contain: strict; touch-action: none; }
svg { width: 100%; height: 100%; display: block; user-select: none; }
svg.dragged { will-change: transform; overflow: visible; }
[tabindex] { outline: none; }
[tabindex]:focus-visible { outline: 2px solid var(--accent); outline-offset: 2px; }
[data-acts] { cursor: pointer; }
.marks { pointer-events: none; }
.marks .good { display: none; }
.marks .old { color: var(--old); } .marks .bad { color: var(--bad); } .marks .none { color: var(--none); }
.hatch { stroke-width: 1.6; fill: none; }
#hatch-bad { color: var(--bad); } #hatch-none { color: var(--none); }
`;

// Stripes: what is not known has no colour of its own, and looks like no state.
function hatch(kind) {
  return svg("pattern", { id: `hatch-${kind}`, width: 4, height: 4, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" },
    svg("path", { class: "hatch", d: "M1 0V4", stroke: "currentColor" }));
}

// {root, elements: by the number of their binding}
export function draw(host, picture) {
  const place = host.shadowRoot ?? host.attachShadow({ mode: "open" });
  const root = purify.sanitize(picture.svg, PURIFY).firstElementChild;
  const rules = rulesOf(picture.css);
  const ours = new CSSStyleSheet();
  ours.replaceSync(OURS);
  place.adoptedStyleSheets = [rules, ours];
  styled(root);
  root.prepend(svg("defs", {}, hatch("bad"), hatch("none")));
  place.replaceChildren(root);
  const elements = [];
  for (const element of root.querySelectorAll("[data-bound]")) elements[element.dataset.bound] = element;
  return { root, elements, tones: new Tones(root, rules) };
}

// ---- the dark ------------------------------------------------------------------------------------

const COLOURED = ["fill", "stroke", "stop-color"];
const GREY = 0.15; // so much its channels differ

function channels(text) {
  const found = /^rgba?\(([\d.]+), ([\d.]+), ([\d.]+)(?:, ([\d.]+))?\)$/.exec(text);
  return found ? found.slice(1).map((each) => (each === undefined ? 1 : Number(each))) : null;
}

// In the dark greys are turned over, and colours keep their hue: a drawing made on white is not a lamp at night.
export function darkened(text) {
  const found = channels(text);
  if (!found) return text;
  const [red, green, blue, alpha] = found;
  const [most, least] = [Math.max(red, green, blue) / 255, Math.min(red, green, blue) / 255];
  const light = (most + least) / 2;
  const range = most - least;
  const turned = range < GREY || light > 0.8 ? 0.93 - 0.81 * light : Math.max(light, 0.56);
  if (range < GREY) return `hsl(210 14% ${Math.round(turned * 100)}% / ${alpha})`;
  const saturation = range / (1 - Math.abs(2 * light - 1));
  const [r, g, b] = [red, green, blue].map((each) => each / 255);
  const hue = 60 * (most === r ? ((g - b) / range + 6) % 6 : most === g ? (b - r) / range + 2 : (r - g) / range + 4);
  return `hsl(${hue.toFixed(0)} ${Math.round(Math.min(saturation, 0.75) * 100)}% ${Math.round(turned * 100)}% / ${alpha})`;
}

export function isDark() {
  return document.documentElement.dataset.theme === "dark";
}

class Tones {
  constructor(root, rules) {
    const own = (element, property) => element === root || element.hasAttribute(property) || element.style.getPropertyValue(property)
      || [...rules.cssRules].some((rule) => rule.style.getPropertyValue(property) && element.matches(rule.selectorText));
    this.found = [];
    for (const element of [root, ...root.querySelectorAll("*")]) {
      for (const property of COLOURED) {
        if (!own(element, property) || element.closest("pattern[id^=hatch]")) continue;
        const drawn = getComputedStyle(element).getPropertyValue(property);
        if (channels(drawn)) this.found.push([element, property, element.style.getPropertyValue(property), drawn]);
      }
    }
  }

  show() {
    const dark = isDark();
    for (const [element, property, own, drawn] of this.found) element.style.setProperty(property, dark ? darkened(drawn) : own);
  }
}
