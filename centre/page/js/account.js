// SPDX-License-Identifier: GPL-3.0-or-later
// What one has open, tokens for programs, the own password and a second factor.
import { SCOPES, TOKEN_DAYS_MOST } from "./codes.js";
import { h, modal, Rows, setText, th } from "./dom.js";
import * as live from "./live.js";
import { t, time } from "./words.js";


function input(type, name, more = {}) {
  return h("input", { type, autocomplete: { own: "current-password", fresh: "new-password" }[name] ?? "off", required: true, maxLength: 256, ...more });
}

function labelled(key, field) {
  return h("label", {}, t(key), field);
}

// Why it was refused, in the words of the page.
export function reason(refused) {
  const key = { again: "again_first", own_password: "own_wrong", guesses: "login_wait", wrong_code: "code_wrong", logins: "login_busy", password: "login_failed" }[refused.code] ?? "failed";
  return t(key, { error: refused.message, s: refused.wait });
}

// What confirms a change: the own password, or a login at the provider, in a page of its own.
export function confirmation() {
  const own = h("input", { type: "password", autocomplete: "current-password", maxLength: 256, required: !live.session.provided });
  const element = live.session.provided
    ? h("p", {}, t("again_why"), " ", h("a", { href: "api/oidc/begin?again=1", target: "_blank", rel: "noopener" }, t("again_login")))
    : h("label", {}, t("password_own"), own);
  return { own, element };
}

// A part of the dialogue: what it asks for, and a button that sends it.
function part(key, button, fields, send) {
  const failure = h("p", { class: "error", role: "alert" });
  const done = h("p", { role: "status" });
  const form = h("form", { class: "part" }, h("h3", {}, t(key)), ...fields, done, failure, h("button", { class: "small main" }, t(button)));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    setText(failure, "");
    done.replaceChildren();
    try {
      done.replaceChildren(...(await send()));
      form.reset();
    } catch (refused) {
      setText(failure, reason(refused));
    }
  });
  return form;
}

function sessionTable() {
  const body = h("tbody");
  const failure = h("p", { class: "error", role: "alert" });
  const head = ["what", "token_scope", "address_from", "last_use", "until", ""];
  const element = h("section", { class: "part" }, h("h3", {}, t("open_sessions")), failure,
    h("div", { class: "scroll" }, h("table", {}, h("thead", {}, h("tr", {}, ...head.map((key) => th(key)))), body)));
  const rows = new Rows(body, (id, { own }) => {
    const cells = head.map(() => h("td"));
    cells.at(-1).className = "act";
    if (!own) cells.at(-1).append(h("button", { class: "small", type: "button", onclick: () => end(id) }, t("end_it")));
    return {
      element: h("tr", {}, ...cells),
      update(each) {
        const texts = [each.label || t(each.own ? "this_session" : "a_session"), each.scope ? t(`scope_${each.scope}`) : "", each.address,
          each.seen ? time(each.seen, true) : "", time(each.expires, true)];
        texts.forEach((text, column) => setText(cells[column], text));
      },
    };
  });
  async function end(id) {
    try {
      await live.ask(`sessions/${id}/end`, {});
    } catch (refused) {
      setText(failure, reason(refused));
    }
    show();
  }
  async function show() {
    const open = await live.ask("sessions").catch((refused) => setText(failure, reason(refused)));
    rows.show((open ?? []).map((each) => [each.id, each]));
  }
  show();
  return { element, show };
}

function tokenPart(changed) {
  const label = input("text", "label", { maxLength: 64 });
  const scope = h("select", {}, ...Object.keys(SCOPES).filter((name) => live.may(SCOPES[name])).map((name) => h("option", { value: name }, t(`scope_${name}`))));
  const days = input("number", "days", { min: "1", max: String(TOKEN_DAYS_MOST), step: "1" });
  days.setAttribute("value", "30");
  const own = input("password", "own");
  return part("token_new", "make_it", [labelled("token_for", label), labelled("token_scope", scope), labelled("days_good", days), labelled("password_own", own)], async () => {
    const made = await live.ask("tokens", { label: label.value, scope: scope.value, days: Number(days.value), own_password: own.value });
    changed();
    return [t("token_once"), h("code", { class: "secret" }, made.token)];
  });
}

function passwordPart(changed) {
  const fresh = input("password", "fresh", { minLength: 10 });
  const own = input("password", "own");
  return part("password_change", "save", [labelled("password_fresh", fresh), labelled("password_own", own)], async () => {
    await live.ask("password", { password: fresh.value, own_password: own.value });
    changed();
    return [t("password_changed")];
  });
}

// Codes by an app, asked for from the moment that one of them has come back.
function secondPart() {
  const place = h("div");
  const secret = (made) => [t("second_read"), h("code", { class: "secret" }, made.secret.match(/.{4}/g).join(" ")), h("a", { href: made.uri }, t("second_open"))];

  function offer() {
    const own = input("password", "own");
    const code = input("text", "code", { autocomplete: "one-time-code", maxLength: 32 });
    const begin = part("second_code", "second_on", [labelled("code", code)], async () => {
      const { recovery_codes: codes } = await live.ask("second_factor/begin", { code: code.value });
      show(h("div", { class: "part", role: "status" }, h("h3", {}, t("second_is_on")), t("recovery_once"), h("code", { class: "secret" }, codes.join("  "))));
      return [];
    });
    begin.hidden = true;
    const first = part("second_factor", "second_offer", [h("p", { class: "muted" }, t("second_why")), labelled("password_own", own)], async () => {
      const made = secret(await live.ask("second_factor/offer", { own_password: own.value }));
      begin.hidden = false;
      return made;
    });
    return [first, begin];
  }

  function ending(left) {
    const own = input("password", "own");
    const code = input("text", "code", { autocomplete: "one-time-code", maxLength: 32 });
    const fields = [h("p", { class: "muted" }, t("recovery_left", { n: left })), labelled("password_own", own), labelled("code_or_recovery", code)];
    return part("second_is_on", "second_off", fields, async () => {
      await live.ask("second_factor/end", { own_password: own.value, code: code.value });
      show();
      return [];
    });
  }

  async function show(news) {
    const now = await live.ask("second_factor");
    place.replaceChildren(...(news ? [news] : now.on ? [ending(now.recovery_codes)] : offer()));
  }
  show().catch((refused) => place.replaceChildren(h("p", { class: "error", role: "alert" }, reason(refused))));
  return place;
}

export function showAccount() {
  const dialog = h("dialog", { class: "account", "aria-label": t("account") });
  const open = sessionTable();
  dialog.append(
    h("div", { class: "body" }, h("h2", {}, `${t("account")} · ${live.session.user} · ${t(live.session.role)}`),
      open.element, ...(live.session.provided ? [h("p", { class: "muted" }, t("provided_account"))] : [tokenPart(open.show), passwordPart(open.show), secondPart()])),
    h("div", { class: "end" }, h("button", { type: "button", onclick: () => dialog.close() }, t("close"))));
  modal(dialog);
}
