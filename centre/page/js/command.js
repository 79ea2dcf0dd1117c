// SPDX-License-Identifier: GPL-3.0-or-later
// The dialogue of a command: what is now, what shall be; each step as it is answered; how it ended.
import { RESULT, STATE } from "./codes.js";
import { fill, h, modal, setText, shape, state } from "./dom.js";
import * as live from "./live.js";
import { quality, valueText } from "./quality.js";
import { t, time } from "./words.js";

const ENDED = [STATE.REFUSED_SELECTION, STATE.INTERRUPTED_SELECTION, STATE.REFUSED_COMMAND, STATE.EXECUTED_COMMAND];
const NOT_SENT = { [RESULT.OUT_OF_RANGE]: "out_of_range", [RESULT.BUSY]: "busy" };
const CHOICES = { single: [0, 1], double: [1, 2], step: [-1, 1] };

// How far it is.
function stage(command) {
  return ENDED.includes(command.state) ? Infinity : command.state;
}

// How it ended: {kind, head, more}
export function fate(command) {
  if (command.state === STATE.EXECUTED_COMMAND) return { kind: "good", head: t("fate_done"), more: t("fate_done_more") };
  if (command.result === RESULT.UNKNOWN_FATE) return { kind: "old", head: t("fate_unknown"), more: t("fate_unknown_more") };
  if (command.result === RESULT.TIMEOUT) return { kind: "old", head: t("fate_timeout"), more: t("fate_timeout_more") };
  if (command.result === RESULT.EXCEPTION) return { kind: "bad", head: t("fate_refused"), more: t("fate_refused_more", { cause: command.cause }) };
  if (command.state === STATE.INTERRUPTED_SELECTION) return { kind: "none", head: t("fate_cancelled"), more: t("fate_cancelled_more") };
  return { kind: "bad", head: t("fate_not_sent"), more: t(NOT_SENT[command.result] ?? "not_up") };
}

export function stateText(command) {
  if (ENDED.includes(command.state)) return fate(command).head;
  const steps = {
    [STATE.SELECTION_REQUEST]: "step_selecting", [STATE.ACCEPTED_SELECTION]: "step_selected",
    [STATE.INTERRUPTION_REQUEST]: "step_cancelling", [STATE.EXECUTION_REQUEST]: "step_execution",
  };
  return t(steps[command.state] ?? "step_executing");
}

function outcome({ kind, head, more }) {
  return h("div", { class: `outcome ${kind}`, role: "status" }, shape(kind), h("span", {}, h("strong", {}, head), more));
}

export function commandDialogue(pointId) {
  const first = live.points.get(pointId);
  const heading = h("h2", {}, `${t("command_of")}: ${first.name}`);
  const now = h("dd");
  const choice = h("div", { class: "choices" });
  const steps = h("ol", { class: "steps" });
  const end = h("div");
  const cancel = h("button", { type: "button" });
  const go = h("button", { type: "button", class: "main" });
  const dialog = h("dialog", { "aria-label": first.name },
    h("div", { class: "body" }, heading,
      h("dl", {}, h("dt", {}, t("station")), h("dd", {}, live.stations.get(first.station)?.name ?? ""), h("dt", {}, t("now")), now),
      choice, steps, end),
    h("div", { class: "end" }, cancel, go));
  let value = null;
  let command = null;
  let busy = false;
  let left = false; // by Escape

  const choices = CHOICES[first.command];
  if (choices) {
    for (const each of choices) {
      const text = first.command === "step" ? (each > 0 ? "+1" : "−1") : valueText(first, each);
      choice.append(h("button", { type: "button", "aria-pressed": "false", onclick: (event) => {
        value = each;
        for (const button of choice.children) button.setAttribute("aria-pressed", String(button === event.currentTarget));
        update();
      } }, text));
    }
  } else {
    const input = h("input", { type: "number", step: first.command === "float" ? "any" : "1", "aria-label": t("value_new"), placeholder: t("value_new"),
      oninput: () => { value = input.value === "" ? null : Number(input.value); update(); } });
    if (first.minimum !== null) input.min = first.minimum;
    if (first.maximum !== null) input.max = first.maximum;
    choice.append(input);
  }

  function step(text, at) {
    for (const each of steps.children) each.className = "";
    steps.append(h("li", { class: "now" }, h("span", {}, text), h("time", {}, time(at, true))));
  }

  async function doing(path, body) {
    busy = true;
    update();
    try {
      const answer = await live.ask(path, body);
      took(answer);
      took(live.commands.get(answer.id) ?? answer); // the stream may have told its end before this answer came
    } catch (refused) {
      const more = t(refused.code) === refused.code ? refused.message : t(refused.code);
      end.replaceChildren(outcome({ kind: "bad", head: t("fate_not_sent"), more }));
    }
    busy = false;
    if (left) leave();
    update();
  }

  // An answer of HTTP may come after a newer one of the stream. Their times do not tell: they are of the centre and of rtu-centre, whose clocks are
  // looked at when it is their turn, and may be set.
  function took(next) {
    if (command && (next.id !== command.id || stage(next) <= stage(command))) return;
    command = next;
    step(stateText(command), command.changed);
    if (command.state === STATE.ACCEPTED_SELECTION) end.replaceChildren(h("div", { class: "muted" }, t(command.release ? "wait_release" : "still_selected")));
    else if (ENDED.includes(command.state)) end.replaceChildren(outcome(fate(command)));
    else end.replaceChildren();
    if (left) leave();
  }

  // It ended while there was no connection: who is told all is not told of what has ended.
  function missed() {
    live.ask(`commands/${command.id}`).then((answer) => { took(answer); update(); }, () => {});
  }

  // Escape leaves no selection behind, nor one whose answer is yet to come.
  function leave() {
    if (command?.state === STATE.ACCEPTED_SELECTION) live.ask(`commands/${command.id}/cancel`, {}).catch(() => {});
    else if (busy || command?.state === STATE.SELECTION_REQUEST) return;
    unwatch();
  }

  function update() {
    const point = live.points.get(pointId) ?? first;
    const { kind, word } = quality(point);
    fill(now, `${valueText(point)}${kind}${word}`, () => [h("strong", {}, `${valueText(point)} ${point.unit}  `), state(kind, word)]);
    const selected = command?.state === STATE.ACCEPTED_SELECTION;
    const running = command && !ENDED.includes(command.state) && !selected;
    const ended = command && ENDED.includes(command.state);
    for (const each of choice.children) each.disabled = Boolean(command);
    setText(cancel, t(selected ? "cancel" : "close"));
    setText(go, t(selected ? "execute" : first.selects && !command ? "select" : "send"));
    go.hidden = Boolean(ended || running || (selected && command.release));
    go.disabled = busy || value === null;
    cancel.disabled = busy;
    // A button that is disabled loses the focus. It goes to the one that does nothing by a second Enter.
    if (!busy && dialog.open && !dialog.contains(document.activeElement)) cancel.focus();
  }

  go.addEventListener("click", () => {
    end.replaceChildren();
    if (command) doing(`commands/${command.id}/execute`, {});
    else doing("commands", { point: pointId, value });
  });
  cancel.addEventListener("click", () => {
    if (command?.state === STATE.ACCEPTED_SELECTION) doing(`commands/${command.id}/cancel`, {});
    else dialog.close();
  });
  dialog.addEventListener("cancel", () => {
    left = true;
  });
  const unwatch = live.watch(({ whole }) => {
    const newer = command && live.commands.get(command.id);
    if (newer) took(newer);
    else if (whole && command && !ENDED.includes(command.state)) missed();
    update();
  });
  dialog.addEventListener("close", () => {
    if (left) leave();
    else unwatch();
  });
  update();
  modal(dialog);
  choice.firstElementChild.focus();
}
