// SPDX-License-Identifier: GPL-3.0-or-later
// The horn: it sounds on every screen while an alarm is neither acknowledged nor silenced, and again for a new one. What a screen has silenced,
// all windows of that browser have.
import { h, setText } from "./dom.js";
import * as live from "./live.js";
import { t } from "./words.js";

const EVERY_MS = 3000;
let context = null;
let waits = false; // a browser that nobody has touched yet makes no sound

// Who may acknowledge hears it unless it was switched off.
export function isOn() {
  return (localStorage.getItem("sound") ?? String(live.may("operator"))) === "true";
}

export function switchTo(on) {
  localStorage.setItem("sound", String(on));
  if (on) beep();
  dispatchEvent(new Event("horn"));
}

function tone() {
  const oscillator = context.createOscillator();
  const volume = context.createGain();
  volume.gain.value = 0.08;
  oscillator.frequency.value = 880;
  oscillator.connect(volume).connect(context.destination);
  oscillator.start();
  oscillator.stop(context.currentTime + 0.25);
}

// A tone that has waited is made if it is still wanted.
function beep(wanted = () => true) {
  context ??= new AudioContext();
  if (waits) return;
  waits = true;
  context.resume().then(() => { if (wanted()) tone(); }).finally(() => { waits = false; });
}

// One that came again after it was silenced is a new one.
const coming = (alarm) => `${alarm.id}:${alarm.returns}`;
const silenced = () => new Set(JSON.parse(localStorage.getItem("silenced") ?? "[]"));
const asking = () => [...live.alarms.values()].filter((alarm) => !alarm.acknowledged && live.stands(alarm));

// Its button lies over the page: nothing slides when it comes and goes.
export function horn() {
  const button = h("button", { id: "silence", class: "main", hidden: true, onclick: () => silence() });
  let known = new Set();
  const wanted = () => known.size > 0;

  function loud() {
    const quiet = silenced();
    return isOn() ? asking().map(coming).filter((key) => !quiet.has(key)) : [];
  }

  function silence() {
    localStorage.setItem("silenced", JSON.stringify(asking().map(coming)));
    update();
  }

  function update() {
    const now = loud();
    button.hidden = !now.length;
    setText(button, t("silence", { n: now.length }));
    const fresh = now.some((key) => !known.has(key));
    known = new Set(now);
    if (fresh) beep(wanted);
  }

  const unwatch = live.watch(update);
  const timer = setInterval(() => {
    update();
    if (known.size) beep(wanted);
  }, EVERY_MS);
  addEventListener("storage", update); // another window has silenced it
  addEventListener("horn", update);
  return {
    button,
    silence,
    end() {
      unwatch();
      clearInterval(timer);
      removeEventListener("storage", update);
      removeEventListener("horn", update);
    },
  };
}
