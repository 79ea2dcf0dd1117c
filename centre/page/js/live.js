// SPDX-License-Identifier: GPL-3.0-or-later
// What the centre says, and asking it. The tables hold what the view shows, by id.
import { ROLES } from "./codes.js";

export const session = { user: "", role: "", csrf: "" };
export const stations = new Map();
export const points = new Map();
export const alarms = new Map();
export const commands = new Map();
export const centre = { connected: false, collects: true, fault: "", vehicles: 0 };

const AGAIN_MS = [500, 1000, 2000, 5000];
const changed = new Set();
let socket = null;
let view = null;
let offset = 0;
let attempts = 0;
let ended = () => {};

export class Refused extends Error {
  constructor(status, answer) {
    super(answer.error);
    this.status = status;
    this.code = answer.code;
    this.wait = answer.wait_s; // seconds, until it may be asked again
  }
}

export async function ask(path, body, method = body === undefined ? "GET" : "POST") {
  const headers = method === "GET" ? {} : { "Content-Type": "application/json", "X-CSRF-Token": session.csrf };
  const response = await fetch(`api/${path}`, { method, headers, body: method === "GET" ? undefined : JSON.stringify(body ?? {}) });
  const answer = await response.json().catch(() => ({ code: "http", error: response.statusText }));
  if (response.ok) return answer;
  if (response.status === 401 && session.user) ended();
  throw new Refused(response.status, answer);
}

// At once, and again so long after each end, however long that takes: of two questions at a time the later answer need not be the newer one, and
// a centre that is slow is not asked more than it answers. Returns what ends it.
export function repeat(work, pauseMs) {
  let timer = 0;
  let over = false;
  async function turn() {
    await work();
    if (!over) timer = setTimeout(turn, pauseMs);
  }
  turn();
  return () => {
    over = true;
    clearTimeout(timer);
  };
}

export function now() {
  return Date.now() + offset;
}

export function may(role) {
  return ROLES.indexOf(session.role) >= ROLES.indexOf(role);
}

// An alarm is in the list: neither put aside nor a part of another one.
export function stands(alarm) {
  return !alarm.suppressed_by && (alarm.shelved ?? 0) <= now();
}

// Calls back with what changed: {whole, points: [...], gone, stations, alarms, commands}. Returns what ends it.
export function watch(callback) {
  changed.add(callback);
  return () => changed.delete(callback);
}

function tell(change) {
  for (const callback of changed) callback(change);
}

const NOTHING = { whole: false, stations: [], points: [], gone: [], alarms: [], commands: [] };

function take(message) {
  offset = message.now - Date.now();
  Object.assign(centre, { connected: true, collects: message.collects, fault: message.fault });
  if (message.whole) [stations, points, alarms, commands].forEach((table) => table.clear());
  for (const station of message.stations) stations.set(station.id, station);
  // A point that is known is told by what changes of it.
  for (const point of message.points) points.set(point.id, { ...points.get(point.id), ...point });
  for (const id of message.gone) points.delete(id);
  if (message.vehicles !== undefined) centre.vehicles = message.vehicles;
  for (const command of message.commands) commands.set(command.id, command);
  for (const alarm of message.alarms) {
    if (alarm.gone && alarm.acknowledged) alarms.delete(alarm.id);
    else alarms.set(alarm.id, alarm);
  }
  tell({ ...NOTHING, ...message });
}

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/stream`);
  const mine = socket;
  mine.onopen = () => {
    attempts = 0;
    if (view) mine.send(JSON.stringify(view));
  };
  mine.onmessage = (message) => take(JSON.parse(message.data));
  mine.onclose = (event) => {
    if (socket !== mine) return;
    centre.connected = false;
    tell(NOTHING);
    if (event.code === 4401) ended();
    else setTimeout(again, AGAIN_MS[Math.min(attempts++, AGAIN_MS.length - 1)]);
  };
}

// A socket that was refused does not say why: a session that has ended is asked for.
async function again() {
  try {
    await ask("me");
  } catch (error) {
    if (error.status === 401) return;
  }
  if (socket) connect();
}

export function look(at) {
  view = at;
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(view));
}

export function start(whenEnded) {
  ended = whenEnded;
  connect();
}

export function stop() {
  const old = socket;
  socket = null;
  old?.close();
  [stations, points, alarms, commands].forEach((table) => table.clear());
}
