// SPDX-License-Identifier: GPL-3.0-or-later
// Who was told of alarms, and what waits; not what was told.
import { empty, h, setText, state, th } from "./dom.js";
import * as live from "./live.js";
import { t, time } from "./words.js";

const AGAIN_MS = 5000;

function how(message) {
  if (message.taken) return state("good", t("told_taken"));
  if (message.ended) return state("bad", t("told_given_up"));
  return message.next > live.now() ? state("old", t("told_again", { time: time(message.next) })) : state("none", t("told_waits"));
}

function table(headings, rows) {
  return h("div", { class: "scroll" }, h("table", {}, h("thead", {}, h("tr", {}, ...headings.map((key) => th(key)))),
    h("tbody", {}, ...rows.map((cells) => h("tr", {}, ...cells.map((cell) => h("td", {}, cell)))))));
}

export function showNotifications(place) {
  const failure = h("p", { class: "error", role: "alert" });
  const body = h("div");
  place.append(h("section", { class: "card" }, h("div", { class: "row" }, h("h2", { class: "grow" }, t("notifications")), failure), body));
  async function show() {
    const { targets, messages } = await live.ask("notifications");
    body.replaceChildren(...(targets.length ? [
      table(["target", "by_way", "waiting", "last_taken", "failure"],
        targets.map((each) => [each.name, t(`way_${each.by}`), String(each.waiting), time(each.last), each.error])),
      table(["time", "target", "state", "tries", "failure"],
        messages.map((each) => [time(each.made), each.target, how(each), String(each.tries), each.error])),
    ] : [empty(t("no_notifications"), t("no_notifications_more"))]));
    setText(failure, "");
  }
  const failed = (error) => setText(failure, t("failed", { error: error.message }));
  return live.repeat(() => show().catch(failed), AGAIN_MS);
}
