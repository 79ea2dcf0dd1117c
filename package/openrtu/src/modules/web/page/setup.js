// SPDX-License-Identifier: GPL-3.0-or-later
// The view of who changes lines, devices and points: an editor that knows the keys, the dry run, the trial, the history.
"use strict";

// Of what the user writes nothing is lost when the view is left.
const draft = { text: null, base: 0, path: "", history: [], note: "" };
let keysOfPlaces = null; // by place and key, once they are loaded

const PHASES = {
  none: ["none", "Nothing is proposed", ""],
  checking: ["none", "Is being checked", ""],
  checked: ["good", "Can be applied", "Nothing has changed yet."],
  applying: ["none", "Comes into force", ""],
  trial: ["old", "On trial", "The file on the gateway is still the former one."],
  keeping: ["none", "Is being written", ""],
  returning: ["old", "The former configuration comes back", ""],
  stuck: ["bad", "The former configuration could not come back", "It is tried again. The log says why."],
};

// ---- where the cursor is ------------------------------------------------------------------------

// The keys and indexes that lead to a place of a text that need not be right yet.
function pathAt(text, end) {
  const stack = [];
  let last = null, at = 0;
  const top = () => stack.at(-1);
  while (at < end) {
    const c = text[at];
    if (c === '"') {
      const from = at + 1;
      for (at++; at < text.length && text[at] !== '"' && text[at] !== "\n"; at++) if (text[at] === "\\") at++;
      last = text.slice(from, at);
      if (at >= end && top() && !top().value) top().key = last;
    } else if (c === ":" && top()) {
      top().key = last;
      top().value = true;
    } else if (c === "{" || c === "[") {
      stack.push({ list: c === "[", index: 0, key: null, value: false });
    } else if (c === "}" || c === "]") {
      stack.pop();
    } else if (c === "," && top()) {
      top().index++;
      top().key = null;
      top().value = false;
    }
    at++;
  }
  return stack.map((each) => (each.list ? each.index : each.key));
}

const TABLES = ["coils", "discrete_inputs", "input_registers", "holding_registers"];

// Which keys there are at a path, and which of them it stands at. NULL: none that the page may change.
function placeOf(path) {
  const rest = path.slice();
  const outer = rest.shift();
  if (outer === "port" && typeof rest[0] === "number") {
    rest.shift();
    if (rest.length === 1) return ["line", rest[0]];
    if (rest[0] === "rs485") return ["rs485", rest[1]];
    if (rest[0] !== "slaves" || typeof rest[1] !== "number") return null;
    rest.splice(0, 2);
  } else if (outer === "templates" && rest.length > 1) {
    rest.shift();
  } else {
    return null;
  }
  if (rest.length === 1) return ["device", rest[0]];
  if (rest[0] === "identification") return ["identification", rest[1]];
  if (rest[0] === "overrides" && rest.length === 3) return ["object", rest[2]];
  return TABLES.includes(rest[0]) && rest.length === 3 ? ["object", rest[2]] : null;
}

// ---- the editor -----------------------------------------------------------------------------------

function editorOf() {
  const lines = element("pre", { class: "lines", "aria-hidden": "true" });
  const area = element("textarea", {
    id: "text", spellcheck: "false", autocapitalize: "off", autocomplete: "off", wrap: "off", "aria-label": "Configuration",
    input: () => { draft.text = area.value; number(); hint(); },
    scroll: () => { lines.scrollTop = area.scrollTop; },
    keyup: () => hint(), click: () => hint(),
  });
  const hints = element("section", { class: "card hints", "aria-label": "Keys" });
  const number = () => {
    const count = area.value.split("\n").length;
    if (lines.dataset.count === String(count)) return;
    lines.dataset.count = count;
    lines.textContent = Array.from({ length: count }, (_, i) => i + 1).join("\n");
  };
  const insert = (key) => {
    area.setRangeText(`"${key}": `, area.selectionStart, area.selectionEnd, "end");
    area.focus();
    area.dispatchEvent(new Event("input"));
  };
  const hint = () => {
    const path = pathAt(area.value, area.selectionStart), place = placeOf(path);
    const named = path.filter((each) => each !== null).join(" › ");
    const keys = place && keysOfPlaces ? keysOfPlaces[place[0]] : null, key = keys?.[place[1]];
    hints.replaceChildren(
      element("h2", {}, named || "The file"),
      element("p", { class: "muted" }, !keys ? "What stands here the page may not change: lines (port), devices (slaves), their points and templates alone."
        : key ? `${key.says}` : place[1] ? "The page may not change this key." : "The keys of this place:"),
      key ? element("p", {}, element("strong", {}, key.values), key.default === undefined ? "" : `  Without it: ${key.default}`) : "",
      element("div", { class: "chips" }, ...Object.keys(keys ?? {}).map((each) =>
        element("button", { type: "button", title: keys[each].says, "aria-pressed": String(each === place[1]), click: () => insert(each) }, each))),
    );
  };
  return {
    parts: element("div", { class: "editor" }, element("div", { class: "card sheet" }, lines, area), hints),
    set(text) { area.value = text; number(); hint(); },
    go(line, column) {
      const before = area.value.split("\n").slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
      const end = area.value.indexOf("\n", before);
      area.focus();
      area.setSelectionRange(before + column - 1, end < 0 ? area.value.length : end);
      area.scrollTop = Math.max(0, (line - 6) * parseFloat(getComputedStyle(area).lineHeight));
      hint();
    },
    hint, number,
  };
}

// What rtud says: a line that names one of the text leads there.
function reportOf(text, path, editor) {
  return text.split("\n").filter(Boolean).map((said) => {
    const found = said.startsWith(`${path}:`) ? said.slice(path.length).match(/^:(\d+)(?::(\d+))?: (.*)$/s) : null;
    if (!found) return element("li", {}, said);
    const line = Number(found[1]);
    return element("li", { class: "bad" }, element("button", { type: "button", click: () => editor.go(line, Number(found[2] ?? 1)) }, `Line ${line}`), ` ${found[3]}`);
  });
}

// ---- the view -----------------------------------------------------------------------------------

async function wish(name, body) {
  await ask(`/api/setup/${name}`, body);
  for (;;) {
    const said = await ask("/api/setup");
    if (!said.waits) return said;
    await pause(200);
  }
}

function setUp() {
  const editor = editorOf();
  const status = element("p", { class: "outcome", role: "status", id: "phase" });
  const report = element("ul", { class: "report", id: "report" });
  const history = element("tbody");
  let state = { phase: "none", report: "" }, acting = false, reported = "";

  const act = async (what) => {
    acting = true;
    draft.note = "";
    buttons();
    try {
      state = await what() ?? state;
      if (state.refused) draft.note = "The gateway has refused it: it is busy, or what it holds is another one's, or older. Check again.";
    } catch (error) {
      draft.note = error.said ? error.message : "The gateway does not answer.";
    }
    acting = false;
    show();
  };
  const load = (number) => act(async () => {
    const said = await wish("show", { number });
    const file = await ask("/api/setup/text");
    draft.history = file.history;
    draft.path = file.path ?? draft.path;
    if (file.error) draft.note = file.error;
    else {
      draft.text = file.text;
      if (number === 0) draft.base = file.base;
      editor.set(draft.text);
    }
    return said;
  });
  const button = (words, what, kind) => element("button", { type: "button", class: kind ?? false, click: what }, words);
  const check = button("Check", () => act(() => wish(`check?${query({ base: draft.base })}`, draft.text)), "main");
  const apply = button("Apply for 60 s", () => act(() => wish("apply", { proposed: state.proposed })));
  const keep = button("Keep it", () => act(async () => {
    const said = await wish("confirm", { proposed: state.proposed });
    if (said.good) draft.base = state.proposed;
    return said;
  }), "main");
  const back = button("Take it back", () => act(() => wish("return", {})));
  const again = button("Load the file in force", () => load(0));

  function buttons() {
    const trial = state.phase === "trial";
    check.disabled = acting || draft.text === null || !["none", "checked"].includes(state.phase);
    apply.disabled = acting || state.phase !== "checked" || !state.mine;
    again.disabled = acting;
    keep.hidden = back.hidden = !trial;
    keep.disabled = acting || !state.mine;
    back.disabled = acting;
  }
  function show() {
    const [kind, title, more] = PHASES[state.phase] ?? PHASES.none;
    const by = state.phase !== "none" && state.user ? ` (${state.user})` : "";
    const left = state.phase === "trial" ? `${Math.ceil(state.left_s)} s left to keep it. ` : "";
    status.className = `outcome ${draft.note ? "bad" : kind}`;
    status.replaceChildren(element("strong", {}, title + by), element("span", {}, [left + more, draft.note].filter(Boolean).join(" ")));
    if (reported !== state.report + draft.path) report.replaceChildren(...reportOf(state.report, draft.path, editor));
    reported = state.report + draft.path;
    report.hidden = !state.report;
    history.replaceChildren(...draft.history.map((row) => element("tr", {},
      element("td", { class: "number" }, String(row.number)), element("td", {}, row.time.replace("T", " ").replace("Z", "")), element("td", {}, row.user),
      element("td", {}, button("Load", () => load(row.number))))));
    buttons();
  }
  if (draft.text === null) load(0);
  else editor.set(draft.text);
  if (!keysOfPlaces) fetch("/keys.json").then((answer) => answer.json()).then((keys) => { keysOfPlaces = keys; editor.hint(); }).catch(() => {});
  show();
  return {
    parts: [
      element("div", { class: "row" }, check, apply, keep, back, again),
      status, report, editor.parts,
      element("section", { class: "card", "aria-label": "History" }, element("h2", {}, "Files that were replaced"),
        element("table", {}, element("thead", {}, element("tr", {}, ...["Number", "Replaced (UTC)", "By", ""].map((each) => element("th", {}, each)))), history)),
    ],
    async update() {
      if (acting) return;
      const was = state.phase;
      state = await ask("/api/setup");
      if (was !== state.phase && state.phase === "none") draft.note = "";
      show();
    },
  };
}
