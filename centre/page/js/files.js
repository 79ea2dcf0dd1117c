// SPDX-License-Identifier: GPL-3.0-or-later
// Files that are being made: how far each is, and an end to one that is not wanted. The browser itself loads them.
import { h, Rows, setText } from "./dom.js";
import * as live from "./live.js";
import { number, t } from "./words.js";

const AGAIN_MS = 1000;
const OPEN = ["waits", "made"];
const MIB = 2 ** 20;

// Shown by the frame, on every view. Returns what ends it.
export function showFiles(body) {
  const list = h("ul");
  const panel = h("section", { class: "files", "aria-label": t("files"), role: "status", hidden: true }, list);
  let timer = 0;
  let over = false; // an answer may come after the end
  body.append(panel);
  const rows = new Rows(list, (id, { name }) => {
    const bar = h("progress", { max: 1, "aria-label": name });
    const text = h("span", { class: "muted" });
    const cancel = h("button", { class: "small", title: t("file_cancel"), "aria-label": t("file_cancel"), onclick: () => live.ask(`files/${id}/end`, {}).catch(() => {}) }, "✕");
    return {
      element: h("li", {}, h("strong", {}, name), bar, text, cancel),
      update(file) {
        if (file.state === "waits") bar.removeAttribute("value");
        else bar.value = file.part;
        setText(text, file.state === "waits" ? t("file_waits") : `${Math.floor(file.part * 100)} %, ${number(file.octets / MIB)} MiB`);
      },
    };
  });

  async function look() {
    clearTimeout(timer);
    const files = await live.ask("files").catch(() => null); // a centre that is away for a moment still makes them
    if (over) return;
    if (files) {
      const open = files.filter((file) => OPEN.includes(file.state));
      rows.show(open.map((file) => [file.id, file]));
      panel.hidden = !open.length;
    }
    if (!panel.hidden) again();
  }

  function again() {
    clearTimeout(timer);
    timer = setTimeout(look, AGAIN_MS);
  }

  const clicked = (event) => {
    if (event.target.closest?.("a[download]")) again();
  };
  document.addEventListener("click", clicked);
  look(); // of another tab, or from before the page was loaded again
  return () => {
    over = true;
    clearTimeout(timer);
    document.removeEventListener("click", clicked);
  };
}
