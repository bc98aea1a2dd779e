// The page: takes view states from the server's stream, shows them, and says loudly when there are none.

import { drawErrors, drawHeadings, drawTrack, drawWeights } from "./charts.js";
import { Rose } from "./rose.js";
import { Sounder } from "./sound.js";
import { TaskButtons, Tiles } from "./tiles.js";
import { MAX_SENSOR_AGE_S, MODES, NONE, elapsedText, headingText, knots, known, positionText, put, turnSide, turnText } from "./words.js";

const SILENCE_MS = 2000;   // without a message for so long, a connection counts as lost
const CLOSED_MS = 500;     // and so long after the last message when it has been closed
const LATE_S = 2;          // data that come so late do too
const RETRY_MS = 1000;
const CHART_MS = 500;
const THEMES = ["dusk", "day", "night"];

const $ = (id) => document.getElementById(id);
const root = document.documentElement;
const rose = new Rose($("rose"));
const tiles = new Tiles($("tiles"));
const buttons = new TaskButtons($("task-buttons"), (name) => toggle(name));
const sounder = new Sounder($("sound"));

let socket = null;
let state = null;          // the newest view state
let heardAt = performance.now();  // when the last message came
let validAt = null;        // when there last was a heading
let behind = null;         // the least of (our clock - the server's), seconds: what comes later than that is late
let lateS = 0;
let access = { read: true, control: false };
let history = { sensors: [], points: [] };
let sureUntil = 0;
let asked = false;         // for the token, unbidden

// ---- connection ----

function connect() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const own = new WebSocket(`${scheme}//${location.host}/api/stream`);
  socket = own;
  own.onmessage = (event) => {
    if (own !== socket) return;
    own.heard = true;
    take(JSON.parse(event.data));
  };
  own.onclose = () => {
    if (own !== socket) return;
    socket = null;
    setTimeout(async () => { await askAccess(); if (access.read) connect(); }, RETRY_MS);
  };
}

async function askAccess() {
  try {
    access = await (await fetch("api/access", { cache: "no-store" })).json();
  } catch {
    return; // not there: the next turn asks again
  }
  $("unlock").hidden = access.control;
  if (!access.read && !$("login").open && !asked) {
    asked = true;
    $("login").showModal();
  }
}

function take(message) {
  heardAt = performance.now();
  if (message.hello) {
    access.control = message.hello.control;
    behind = null;
  } else if (message.history) {
    history = { sensors: message.history.sensors, points: message.history.points.map(point) };
    drawCharts();
  } else if (message.state) {
    note(message.state);
    state = message.state;
    if (!state.is_stale && state.estimate.mode !== "invalid") validAt = heardAt;
    show();
  }
}

const point = ([t, heading, sigma, mode, lat, lon, own, weight, errors]) => ({ t, heading, sigma, mode, lat, lon, own, weight, errors });

function note(next) {
  const offset = heardAt / 1000 - next.sent_s;
  if (behind === null || offset < behind) behind = offset;
  behind += 1e-5;          // clocks drift: forget slowly
  lateS = offset - behind;
  const names = next.sensors.map((row) => row.name);
  if (state && next.elapsed_s < state.elapsed_s - 1) history.points = []; // a new run
  if (String(names) !== String(history.sensors)) history = { sensors: names, points: [] };
  const last = history.points.at(-1);
  if (last && next.elapsed_s - last.t < 0.45) return;
  const { estimate } = next;
  history.points.push({
    t: next.elapsed_s, heading: estimate.heading_deg, sigma: estimate.heading_sigma_deg, mode: estimate.mode,
    lat: estimate.lat_deg, lon: estimate.lon_deg,
    own: next.sensors.map((row) => row.heading_deg), weight: next.sensors.map((row) => row.weight),
    errors: next.sensors.map((row) => row.errors),
  });
  while (history.points[0].t < next.elapsed_s - 300) history.points.shift();
}

// ---- what is shown ----

const isLost = () => performance.now() - heardAt > (socket?.heard ? SILENCE_MS : CLOSED_MS) || lateS > LATE_S;

function show() {
  const lost = isLost();
  const link = lost ? "lost" : state ? "live" : "waiting";
  if (root.dataset.link !== link) root.dataset.link = link;
  if (!access.read) {
    put($("lost-title"), "✕ LOCKED");
    put($("lost-detail"), "the token is needed to read");
  } else if (lost) {
    const seconds = Math.round((performance.now() - heardAt) / 1000);
    const late = lateS > LATE_S && seconds < 2;
    put($("lost-title"), late ? "✕ DATA COME LATE" : "✕ CONNECTION LOST");
    put($("lost-detail"), late ? `${lateS.toFixed(0)} s behind the boat` : `nothing heard for ${seconds} s; trying again`);
  } else {
    put($("lost-title"), "");
    put($("lost-detail"), "");
  }
  if (!state) return showAlarms([], lost);
  const gone = lost || state.is_stale;
  const estimate = gone ? { mode: "invalid", pos_mode: "invalid" } : state.estimate;
  const valid = estimate.mode !== "invalid" && known(estimate.heading_deg);
  showHeading(estimate, valid, gone);
  const navigation = gone ? {} : state.navigation;
  put($("cog"), known(navigation.cog_deg) ? `${headingText(navigation.cog_deg)}°` : NONE);
  put($("sog"), knots(navigation.sog_mps));
  put($("position"), positionText(estimate.lat_deg, estimate.lon_deg, estimate.pos_mode));
  put($("reference"), state.position_of);
  put($("reference-short"), state.position_of.includes("antennas") ? "Antennas at" : "Ref. point at");
  $("simulated").hidden = !state.simulated;
  put($("method"), state.method);
  const utc = known(navigation.utc_s) ? new Date(navigation.utc_s * 1000).toISOString().slice(11, 19) + " UTC" : "";
  put($("clock"), utc || elapsedText(state.elapsed_s));
  put($("recording"), state.recording_failure ? `✕ ${state.recording_failure}` : state.recording ? "● REC" : "");
  $("recording").title = state.recording;
  $("recording").classList.toggle("failing", Boolean(state.recording_failure));
  tiles.show(state.sensors, navigation, gone);
  buttons.show(state.tasks, access.control && !lost);
  $("start-all").disabled = $("stop-all").disabled = !access.control || lost;
  $("unlock").hidden = access.control;
  showAlarms(gone ? [] : state.alarms, lost);
}

function showHeading(estimate, valid, gone) {
  const [word, shape] = MODES[estimate.mode] || MODES.invalid;
  if (root.dataset.heading !== estimate.mode) {
    root.dataset.heading = estimate.mode;
    $("mode-shape").setAttribute("d", shape);
  }
  put($("mode-word"), word);
  put($("heading"), valid ? headingText(estimate.heading_deg) : NONE);
  const calibrated = state.sigma_is_calibrated ? "" : " uncalibrated";
  put($("sigma"), valid && known(estimate.heading_sigma_deg) ? `± ${estimate.heading_sigma_deg.toFixed(1)}°${calibrated}` : "");
  const ago = validAt === null ? "none yet" : `last one ${Math.round((performance.now() - validAt) / 1000)} s ago`;
  put($("turn"), valid ? turnText(estimate.rate_of_turn_dps) : ago);
  put($("turn-side"), valid ? turnSide(estimate.rate_of_turn_dps) : "");
  const own = gone ? [] : state.sensors.filter((row) => known(row.heading_deg) && row.age_s <= MAX_SENSOR_AGE_S && row.port_state === "open");
  rose.show(valid ? estimate.heading_deg : NaN, estimate.heading_sigma_deg ?? NaN, estimate.rate_of_turn_dps ?? NaN, own);
  document.title = `${valid ? headingText(estimate.heading_deg) + "°" : word} – tinyekf`;
}

function showAlarms(alarms, lost) {
  const area = $("alarms");
  const wanted = JSON.stringify(alarms.map(({ severity, text }) => [severity, text]));
  if (area.dataset.shown !== wanted) {
    area.dataset.shown = wanted;
    area.replaceChildren(...alarms.map(({ severity, text }) => {
      const line = document.createElement("p");
      line.className = severity === "alarm" ? "alarm" : "warning";
      const kind = document.createElement("span");
      kind.className = "kind";
      kind.textContent = severity === "alarm" ? "✕ ALARM" : "▲ WARNING";
      line.append(kind, text);
      return line;
    }));
  }
  sounder.set(lost || alarms.some((alarm) => alarm.severity === "alarm"));
}

function drawCharts() {
  const { points, sensors } = history;
  drawHeadings($("chart-headings"), points, sensors.filter((name) => name !== "imu"));
  drawWeights($("chart-weights"), points, sensors);
  drawErrors($("chart-errors"), points, sensors);
  drawTrack($("chart-track"), points, root.dataset.link === "live" && state ? state.estimate.heading_deg ?? NaN : NaN);
  $("charts").dataset.seconds = points.length ? Math.round(points.at(-1).t - points[0].t) : 0;
}

// ---- what is done ----

async function post(path, body) {
  const answer = await fetch(path, {
    method: "POST", cache: "no-store",
    ...(body ? { body: JSON.stringify(body), headers: { "Content-Type": "application/json" } } : {}),
  });
  return { ok: answer.ok, status: answer.status, ...(await answer.json()) };
}

async function toggle(name) {
  if (!state) return;
  const task = state.tasks.find((one) => one.name === name);
  const running = task ? task.running : state.tasks.every((one) => one.running);
  const verb = running ? "stop" : "start";
  if (!access.control) return tell("Unlock first: control needs the token.");
  try {
    const answer = await post(`api/tasks/${name}/${verb}`);
    if (answer.status === 401) { access.control = false; $("login").showModal(); }
    tell(answer.ok ? `${name} ${running ? "stopped" : "started"}` : `${name}: ${answer.error}`);
  } catch {
    tell(`${name}: no answer`);
  }
}

function stopAll() {
  const button = $("stop-all");
  if (performance.now() < sureUntil) {
    sureUntil = 0;
    button.classList.remove("sure");
    put(button, "Stop all");
    return post("api/tasks/all/stop").then((a) => tell(a.ok ? "all stopped" : a.error), () => tell("no answer"));
  }
  sureUntil = performance.now() + 4000;
  button.classList.add("sure");
  put(button, "No heading then. Sure?");
  tell("Once more to stop all tasks: there will be no heading.");
  setTimeout(() => { if (sureUntil) { sureUntil = 0; button.classList.remove("sure"); put(button, "Stop all"); } }, 4000);
}

function startAll() {
  return post("api/tasks/all/start").then((a) => tell(a.ok ? "all started" : a.error), () => tell("no answer"));
}

const tell = (text) => put($("told"), text);

function setTheme(name) {
  root.dataset.theme = name;
  put($("theme"), name[0].toUpperCase() + name.slice(1));
  localStorage.setItem("theme", name);
  document.querySelector("meta[name=theme-color]").content = getComputedStyle(root).getPropertyValue("--ground").trim();
  drawCharts();
}
const nextTheme = () => setTheme(THEMES[(THEMES.indexOf(root.dataset.theme) + 1) % THEMES.length]);

const tabs = [...document.querySelectorAll("[role=tab]")];
function choose(tab, focus = false) {
  for (const one of tabs) {
    const chosen = one === tab;
    one.setAttribute("aria-selected", String(chosen));
    one.tabIndex = chosen ? 0 : -1;
    $(one.getAttribute("aria-controls")).classList.toggle("chosen", chosen);
  }
  if (focus) tab.focus();
  drawCharts();
}
const besides = (step) => tabs[(tabs.findIndex((t) => t.getAttribute("aria-selected") === "true") + step + tabs.length) % tabs.length];
for (const tab of tabs) {
  tab.addEventListener("click", () => choose(tab));
  tab.addEventListener("keydown", (event) => {
    if (event.key === "ArrowRight" || event.key === "ArrowLeft") choose(besides(event.key === "ArrowRight" ? 1 : -1), true);
  });
}

const KEYS = { n: [nextTheme, "day, dusk, night"], m: [() => sounder.toggle(), "sound with alarms"], v: [() => choose(besides(1)), "next panel"], "?": [() => showKeys(), "these keys"] };
function showKeys() {
  const list = [...Object.entries(KEYS).map(([key, [, what]]) => [key, what])];
  if (state) list.push(...state.tasks.map((task) => [task.key, `start or stop ${task.name}`]), ["a", "start all, or stop all (twice)"]);
  $("key-list").replaceChildren(...list.flatMap(([key, what]) => {
    const term = document.createElement("dt"), text = document.createElement("dd");
    term.textContent = key;
    text.textContent = what;
    return [term, text];
  }));
  $("keys").showModal();
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || event.repeat || document.querySelector("dialog[open]")) return;
  if (KEYS[event.key]) return KEYS[event.key][0]();
  if (event.key === "a" && state) return state.tasks.every((task) => task.running) ? stopAll() : startAll();
  const task = state && state.tasks.find((one) => one.key === event.key);
  if (task) toggle(task.name);
});

async function login(token) {
  const answer = await post("api/login", { token }).catch(() => ({ ok: false, error: "no answer" }));
  if (!answer.ok) return put($("login-error"), answer.error);
  $("token").value = "";
  $("login").close();
  await askAccess();
  const before = socket;
  connect();
  before?.close();
}

$("login-form").addEventListener("submit", (event) => { event.preventDefault(); login($("token").value); });
$("login-cancel").addEventListener("click", () => $("login").close());
$("unlock").addEventListener("click", () => { put($("login-error"), ""); $("login").showModal(); });
$("keys-close").addEventListener("click", () => $("keys").close());
$("help").addEventListener("click", showKeys);
$("theme").addEventListener("click", nextTheme);
$("stop-all").addEventListener("click", stopAll);
$("start-all").addEventListener("click", startAll);
window.addEventListener("resize", drawCharts);

setTheme(THEMES.includes(localStorage.getItem("theme")) ? localStorage.getItem("theme") : "dusk");
setInterval(() => { show(); if (socket && performance.now() - heardAt > 2 * SILENCE_MS) socket.close(); }, 250);
setInterval(drawCharts, CHART_MS);
// A link with the token behind "#token=" unlocks a screen without a keyboard; that part is never sent to a server.
const given = new URLSearchParams(location.hash.slice(1)).get("token");
if (given) window.history.replaceState(null, "", location.pathname);
(given ? login(given) : askAccess()).then(() => { if (!socket && access.read) connect(); });
