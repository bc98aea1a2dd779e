// One tile a sensor, one button a task. What sensors and devices say reaches the page as text alone.

import { badge, badgeLetter, isCourse, ownColour, svg } from "./rose.js";
import { FIXES, MAX_SENSOR_AGE_S, NONE, WEIGHTS, ageText, headingText, known, put } from "./words.js";

const SHAPES = { open: "●", stopped: "■", stale: "▲" };

function make(name, className, parent) {
  const element = document.createElement(name);
  if (className) element.className = className;
  parent.append(element);
  return element;
}

function pair(row, label) {
  const span = make("span", "", row);
  span.append(`${label} `);
  return make("b", "", span);
}

class Tile {
  constructor(name, root) {
    const course = isCourse(name);
    this.name = name;
    this.root = make("article", "tile", root);
    this.root.dataset.sensor = name;
    this.root.style.setProperty("--own", ownColour(name));
    const title = make("h3", "", this.root);
    const icon = svg("svg", { viewBox: "-12 -12 24 24", "aria-hidden": "true" }, title);
    badge(name, 10, icon);
    svg("text", {}, icon).textContent = badgeLetter(name);
    title.append(name);
    this.state = make("span", "state", title);
    const own = make("p", "own", this.root);
    make("small", "", own).textContent = course ? "COG" : name === "imu" ? "roll, pitch" : "HDG";
    this.own = make("span", "", own);
    this.sigma = make("small", "", own);
    const first = make("p", "row", this.root);
    this.rate = pair(first, "rate");
    this.age = pair(first, "age");
    if (course) {
      const second = make("p", "row", this.root);
      this.fix = pair(second, "fix");
      this.hdop = pair(second, "HDOP");
      const third = make("p", "row", this.root);
      this.weight = pair(third, "weight");
      this.bars = make("span", "weight", third);
      this.bars.setAttribute("aria-hidden", "true");
      for (let i = 0; i < 3; i++) make("i", "", this.bars);
    }
    const last = make("p", "row", this.root);
    this.errors = pair(last, "errors");
    this.why = make("p", "why", this.root);
  }

  show(row, navigation, gone) {
    const state = gone ? "unknown" : row.port_state;
    const fresh = state === "open" && known(row.age_s) && row.age_s <= MAX_SENSOR_AGE_S;
    put(this.state, `${SHAPES[state] || "✕"} ${state}`);
    this.state.className = `state ${state === "open" || state === "stopped" ? state : ""}`;
    this.root.classList.toggle("off", state !== "open");
    const heading = fresh ? row.heading_deg : null;
    const angle = this.name === "imu" ? attitudeText(fresh ? navigation : {}) : known(heading) ? `${headingText(heading)}°` : NONE;
    put(this.own, angle);
    put(this.sigma, known(heading) && known(row.heading_sigma_deg) ? `± ${row.heading_sigma_deg.toFixed(1)}°` : "");
    put(this.rate, fresh && known(row.rate_hz) ? `${row.rate_hz.toFixed(1)} Hz` : NONE);
    put(this.age, gone ? NONE : ageText(row.age_s));
    put(this.errors, String(row.errors));
    if (this.fix) {
      const weight = fresh && known(row.weight) ? row.weight : null;
      put(this.fix, (fresh && FIXES[row.fix_quality]) || NONE);
      put(this.hdop, fresh && known(row.hdop) ? row.hdop.toFixed(1) : NONE);
      put(this.weight, weight === null ? NONE : `${Number(weight.toFixed(1))} ${WEIGHTS[Math.round(weight)] || ""}`);
      [...this.bars.children].forEach((bar, i) => bar.classList.toggle("on", weight !== null && weight > i + 0.5));
    }
    const why = gone || state === "open" || state === "stopped" ? row.last_error : row.port_text;
    put(this.why, why);
    this.why.title = why;
  }
}

function attitudeText({ roll_deg, pitch_deg }) {
  return known(roll_deg) && known(pitch_deg) ? `${roll_deg.toFixed(1)}°, ${pitch_deg.toFixed(1)}°` : NONE;
}

export class Tiles {
  constructor(root) {
    this.root = root;
    this.tiles = new Map();
  }

  show(sensors, navigation, gone) {
    for (const row of sensors) {
      if (!this.tiles.has(row.name)) this.tiles.set(row.name, new Tile(row.name, this.root));
      this.tiles.get(row.name).show(row, navigation, gone);
    }
    for (const [name, tile] of this.tiles) {
      if (!sensors.some((row) => row.name === name)) { tile.root.remove(); this.tiles.delete(name); }
    }
  }
}

export class TaskButtons {
  constructor(root, toggle) {
    this.root = root;
    this.toggle = toggle;
    this.buttons = new Map();
  }

  show(tasks, enabled) {
    for (const task of tasks) {
      const parts = this.buttons.get(task.name) || this.make(task);
      put(parts.state, task.running ? "▶ runs" : "■ stopped");
      parts.button.classList.toggle("stopped", !task.running);
      parts.button.setAttribute("aria-pressed", String(task.running));
      parts.button.title = `${task.running ? "Stop" : "Start"} ${task.name} (key ${task.key})`;
      parts.button.disabled = !enabled;
    }
  }

  make(task) {
    const button = make("button", "task", this.root);
    button.type = "button";
    button.dataset.task = task.name;
    make("b", "", button).textContent = task.name;
    make("kbd", "", button).textContent = task.key;
    const state = make("span", "", button);
    button.addEventListener("click", () => this.toggle(task.name));
    const parts = { button, state };
    this.buttons.set(task.name, parts);
    return parts;
  }
}
