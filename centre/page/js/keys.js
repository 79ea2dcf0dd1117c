// SPDX-License-Identifier: GPL-3.0-or-later
// The keys of the page, and the dialogue that lists them. None of them commands; none works while somebody types.
import { h, modal } from "./dom.js";
import { t } from "./words.js";

const TYPED = "input, select, textarea, [contenteditable], dialog";

function filter() {
  return document.querySelector("main .page input[type=search], main input[type=search]");
}

function showKeys(views) {
  const keys = [...views.map((name, number) => [[String(number + 1)], t(name)]), [["/", "Ctrl+F"], t("key_filter")], [["↑", "↓", "PgUp", "PgDn", "Home", "End"], t("key_rows")],
    [["Tab", "Enter"], t("key_tab")], [["↑", "↓", "←", "→", "+", "−"], t("key_map")], [["Esc"], t("key_escape")], [["s"], t("key_silence")], [["?"], t("keys")]];
  const dialog = h("dialog", { "aria-label": t("keys") },
    h("div", { class: "body" }, h("h2", {}, t("keys")),
      h("dl", { class: "keys" }, ...keys.flatMap(([names, what]) => [h("dt", {}, ...names.map((name) => h("kbd", {}, name))), h("dd", {}, what)]))),
    h("div", { class: "end" }, h("button", { type: "button", onclick: () => dialog.close() }, t("close"))));
  modal(dialog);
}

export function keysButton(views) {
  return h("button", { id: "keys", title: t("keys"), "aria-label": t("keys"), "aria-haspopup": "dialog", onclick: () => showKeys(views) }, "?");
}

// Returns what ends it.
export function watchKeys(links, silence) {
  const keys = (event) => {
    const find = event.key === "f" && (event.ctrlKey || event.metaKey) && !event.altKey && !event.shiftKey;
    const field = filter();
    // The browser's own search does not find a row that is out of sight. In the field itself the browser's is called.
    if (find && field && document.activeElement !== field && !document.querySelector("dialog[open]")) {
      event.preventDefault();
      field.select();
      field.focus();
      return;
    }
    if (event.target.closest(TYPED) || event.ctrlKey || event.metaKey || event.altKey) return;
    links[Number(event.key) - 1]?.click();
    if (event.key === "s") silence();
    if (event.key === "?") document.getElementById("keys").click();
    if (event.key === "/" && field) {
      event.preventDefault();
      field.focus();
    }
  };
  addEventListener("keydown", keys);
  return () => removeEventListener("keydown", keys);
}
