// Strip charts of the last five minutes, and the track, on canvases. A point is one row of /api/history.

import { badgeLetter, isCourse, wrap180 } from "./rose.js";

const SPAN_S = 300, GAP_S = 2.5, RIGHT = 34, LEFT = 34;
const DASHES = { gps1: [7, 4], gps2: [2.5, 3], gps3: [10, 3, 2, 3], gps4: [5, 5], gps5: [1, 4], gps6: [12, 4], gps7: [4, 2], gps8: [8, 2, 1, 2] };

function begin(canvas) {
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (!width || !height) return null;
  const ratio = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "12px system-ui, sans-serif";
  pen.textBaseline = "middle";
  pen.lineWidth = 1;
  pen.setLineDash([]);
  const style = getComputedStyle(document.documentElement);
  return { pen, width, height, colour: (name) => style.getPropertyValue(`--${name}`).trim() };
}

const plotX = (width, newest) => (t) => LEFT + ((t - newest + SPAN_S) / SPAN_S) * (width - LEFT - RIGHT);

function minutes({ pen, width, height, colour }, x, newest, foot) {
  pen.textAlign = "center";
  for (let minute = 0; minute <= 5; minute++) {
    const at = Math.round(x(newest - minute * 60)) + 0.5;
    pen.strokeStyle = colour("line");
    pen.beginPath();
    pen.moveTo(at, 0);
    pen.lineTo(at, height - foot);
    pen.stroke();
    if (foot) {
      pen.fillStyle = colour("quiet");
      pen.fillText(minute ? `-${minute} min` : "now", at, height - foot / 2 + 1);
    }
  }
}

function polyline(pen, points, x, y, value) {
  pen.beginPath();
  let last = -Infinity;
  for (const point of points) {
    const v = value(point);
    if (v === null) { last = -Infinity; continue; }
    const [px, py] = [x(point.t), y(v)];
    if (point.t - last > GAP_S) pen.moveTo(px, py); else pen.lineTo(px, py);
    last = point.t;
  }
  pen.stroke();
}

// Headings unwrapped along the fused one, so that a turn through north does not jump.
function unwrapped(points, count) {
  let reference = null;
  return points.map((point) => {
    const near = (heading) => {
      if (heading === null || heading === undefined) return null;
      return reference === null ? heading : reference + wrap180(heading - reference);
    };
    const fused = near(point.heading);
    const first = Array.from({ length: count }, (_, i) => point.own[i]).find((h) => h !== null && h !== undefined);
    reference = fused ?? near(first) ?? reference;
    return { t: point.t, fused, sigma: point.sigma, own: Array.from({ length: count }, (_, i) => near(point.own[i])) };
  });
}

export function drawHeadings(canvas, points, sensors) {
  const view = begin(canvas);
  if (!view || !points.length) return;
  const { pen, width, height, colour } = view;
  const foot = 18, newest = points.at(-1).t, x = plotX(width, newest);
  const rows = unwrapped(points, sensors.length);
  const values = rows.flatMap((row) => [row.fused, ...row.own]).filter((v) => v !== null).sort((a, b) => a - b);
  if (!values.length) return minutes(view, x, newest, foot);
  let low = values[Math.floor(values.length * 0.005)], high = values[Math.ceil(values.length * 0.995) - 1];
  const middle = (low + high) / 2, span = Math.max(20, (high - low) * 1.15);
  [low, high] = [middle - span / 2, middle + span / 2];
  const y = (v) => ((high - v) / span) * (height - foot - 8) + 4;
  const step = [5, 10, 30, 45, 90, 180, 360].find((s) => span / s <= Math.max(2, (height - foot) / 26)) || 360;
  minutes(view, x, newest, foot);
  pen.textAlign = "right";
  for (let v = Math.ceil(low / step) * step; v <= high; v += step) {
    pen.strokeStyle = colour("line");
    pen.beginPath(); pen.moveTo(LEFT, Math.round(y(v)) + 0.5); pen.lineTo(width - RIGHT, Math.round(y(v)) + 0.5); pen.stroke();
    pen.fillStyle = colour("quiet");
    pen.fillText(String((((v % 360) + 360) % 360)).padStart(3, "0"), LEFT - 5, Math.max(7, y(v)));
  }
  pen.save();
  pen.beginPath(); pen.rect(LEFT, 0, width - LEFT - RIGHT, height - foot); pen.clip();
  sensors.forEach((name, i) => {
    pen.strokeStyle = colour(name); pen.lineWidth = 1.4; pen.setLineDash(DASHES[name] || []);
    polyline(pen, rows, x, y, (row) => row.own[i]);
  });
  pen.setLineDash([]); pen.strokeStyle = colour("strong"); pen.lineWidth = 2.4;
  polyline(pen, rows, x, y, (row) => row.fused);
  pen.restore();
  ends(view, sensors.map((name, i) => [name, rows.at(-1).own[i]]).filter(([, v]) => v !== null), y, height - foot);
}

// The letters of the sensors at the ends of their lines, moved apart where they would touch.
function ends({ pen, width, colour }, marks, y, floor) {
  pen.textAlign = "left"; pen.font = "bold 12px system-ui, sans-serif";
  let last = -Infinity;
  const sorted = marks.map(([name, v]) => [name, Math.max(7, Math.min(floor - 7, y(v)))]).sort((a, b) => a[1] - b[1]);
  const over = Math.max(0, sorted.length * 13 - (floor - (sorted[0]?.[1] ?? 0)));
  for (const [name, at] of sorted) {
    last = Math.max(at - over, last + 13);
    pen.fillStyle = colour(name);
    pen.fillText(badgeLetter(name), width - RIGHT + 8, last);
  }
}

function lanes(canvas, points, sensors, drawLane) {
  const view = begin(canvas);
  if (!view || !points.length || !sensors.length) return;
  const { pen, height, width, colour } = view;
  const newest = points.at(-1).t, x = plotX(width, newest), tall = height / sensors.length;
  minutes(view, x, newest, 0);
  sensors.forEach(([name, i], row) => {
    const floor = Math.round((row + 1) * tall) - 2;
    pen.textAlign = "right"; pen.font = "bold 12px system-ui, sans-serif"; pen.fillStyle = colour(name);
    pen.fillText(badgeLetter(name), LEFT - 10, floor - tall / 2 + 2);
    pen.strokeStyle = colour("line"); pen.beginPath(); pen.moveTo(LEFT, floor + 0.5); pen.lineTo(width - RIGHT, floor + 0.5); pen.stroke();
    pen.fillStyle = pen.strokeStyle = colour(name);
    const text = drawLane(pen, i, x, floor, tall - 5, width - RIGHT);
    pen.textAlign = "left"; pen.font = "12px system-ui, sans-serif"; pen.fillStyle = colour("ink");
    pen.fillText(text, width - RIGHT + 5, floor - tall / 2 + 2);
  });
}

export function drawWeights(canvas, points, sensors) {
  const receivers = sensors.map((name, i) => [name, i]).filter(([name]) => isCourse(name));
  lanes(canvas, points, receivers, (pen, i, x, floor, tall, right) => {
    for (let k = 0; k < points.length; k++) {
      const weight = points[k].weight[i];
      if (!weight) continue;
      const next = points[k + 1];
      const from = Math.round(x(points[k].t)), to = next && next.t - points[k].t < GAP_S ? Math.round(x(next.t)) : from + 1;
      const top = Math.round(floor - (weight / 3) * tall), wide = Math.min(to, right) - from;
      pen.globalAlpha = 0.35; pen.fillRect(from, top, wide, floor - top);
      pen.globalAlpha = 1; pen.fillRect(from, top, wide, 2);
    }
    const now = points.at(-1).weight[i];
    return now === null || now === undefined ? "---" : String(now);
  });
}

export function drawErrors(canvas, points, sensors) {
  lanes(canvas, points, sensors.map((name, i) => [name, i]), (pen, i, x, floor, tall) => {
    for (let k = 1; k < points.length; k++) {
      const more = points[k].errors[i] - points[k - 1].errors[i];
      if (more > 0) pen.fillRect(x(points[k].t) - 1, floor - Math.min(1, 0.4 + 0.2 * Math.log10(more)) * tall, 2.5, Math.min(1, 0.4 + 0.2 * Math.log10(more)) * tall);
    }
    const count = points.at(-1).errors[i] ?? 0;
    return count > 9999 ? "> 9 k" : String(count);
  });
}

export function drawTrack(canvas, points, heading) {
  const view = begin(canvas);
  if (!view) return;
  const { pen, width, height, colour } = view;
  const placed = points.filter((point) => point.lat !== null && point.lon !== null);
  pen.fillStyle = colour("quiet"); pen.textAlign = "left";
  if (!placed.length) { pen.fillText("no position", 8, 14); return; }
  const origin = placed.at(-1), metres = 111195, across = metres * Math.cos((origin.lat * Math.PI) / 180);
  const local = placed.map((point) => ({ t: point.t, e: wrap180(point.lon - origin.lon) * across, n: (point.lat - origin.lat) * metres }));
  const [e0, e1] = range(local.map((p) => p.e)), [n0, n1] = range(local.map((p) => p.n));
  const scale = Math.min((width - 40) / Math.max(e1 - e0, 20), (height - 60) / Math.max(n1 - n0, 20));
  const px = (p) => width / 2 + (p.e - (e0 + e1) / 2) * scale, py = (p) => height / 2 - 6 - (p.n - (n0 + n1) / 2) * scale;
  pen.strokeStyle = colour("ink"); pen.lineWidth = 2; pen.lineJoin = "round";
  pen.beginPath();
  local.forEach((p, i) => (i && p.t - local[i - 1].t <= GAP_S ? pen.lineTo(px(p), py(p)) : pen.moveTo(px(p), py(p))));
  pen.stroke();
  const here = local.at(-1);
  pen.save(); pen.translate(px(here), py(here)); pen.fillStyle = colour("care");
  if (Number.isFinite(heading)) {
    pen.rotate((heading * Math.PI) / 180);
    pen.beginPath(); pen.moveTo(0, -14); pen.lineTo(7, 9); pen.lineTo(0, 5); pen.lineTo(-7, 9); pen.closePath(); pen.fill();
  } else { pen.beginPath(); pen.arc(0, 0, 5, 0, 7); pen.fill(); }
  pen.restore();
  const wanted = 90 / scale, power = 10 ** Math.floor(Math.log10(wanted)), bar = [5, 2, 1].map((m) => m * power).find((m) => m <= wanted);
  pen.strokeStyle = colour("quiet"); pen.lineWidth = 2; pen.beginPath();
  pen.moveTo(10, height - 14); pen.lineTo(10, height - 8); pen.lineTo(10 + bar * scale, height - 8); pen.lineTo(10 + bar * scale, height - 14); pen.stroke();
  pen.fillStyle = colour("quiet");
  pen.fillText(bar >= 1000 ? `${bar / 1000} km` : `${bar} m`, 16 + bar * scale, height - 10);
  pen.textAlign = "center"; pen.fillText("N", width - 14, 26);
  pen.beginPath(); pen.moveTo(width - 14, 4); pen.lineTo(width - 9, 17); pen.lineTo(width - 19, 17); pen.closePath(); pen.fill();
}

const range = (values) => values.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);
