// The compass rose: heading up, the card turns. Each sensor has a needle of its own, dashed where it is a course.

const SVG = "http://www.w3.org/2000/svg";
const RIM = 186, INNER = 128, BADGE = 219, BADGE_APART_DEG = 7.2;
const TURN_DEG_PER_DPS = 30; // 3 degrees a second is a quarter of the rose

export function svg(name, attributes = {}, parent = null) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (parent) parent.append(element);
  return element;
}

const rad = (degrees) => (degrees * Math.PI) / 180;
const at = (degrees, radius) => [radius * Math.sin(rad(degrees)), -radius * Math.cos(rad(degrees))];
export const wrap180 = (degrees) => ((((degrees + 180) % 360) + 360) % 360) - 180;

export const isCourse = (name) => name.startsWith("gps");
export const badgeLetter = (name) => (isCourse(name) ? name.slice(3) : name[0].toUpperCase());
export const ownColour = (name) => `var(--${name})`;

// The outline that stands for a sensor wherever it is shown: a circle for a receiver, a square for anything else.
export function badge(name, size, parent) {
  return isCourse(name)
    ? svg("circle", { r: size, class: "badge course" }, parent)
    : svg("rect", { x: -size, y: -size, width: 2 * size, height: 2 * size, class: "badge" }, parent);
}

export class Rose {
  constructor(root) {
    svg("circle", { r: RIM, class: "face" }, root);
    this.sector = svg("path", { class: "sector fused" }, root);
    this.card = svg("g", { class: "card" }, root);
    for (let degrees = 0; degrees < 360; degrees += 5) {
      const long = degrees % 30 === 0 ? 16 : degrees % 10 === 0 ? 11 : 6;
      const [x1, y1] = at(degrees, RIM), [x2, y2] = at(degrees, RIM - long);
      svg("line", { x1, y1, x2, y2, class: degrees % 30 ? "tick" : "tick major" }, this.card);
      if (degrees % 30 === 0) {
        const cardinal = { 0: "N", 90: "E", 180: "S", 270: "W" }[degrees];
        const text = svg("text", { transform: `rotate(${degrees}) translate(0 ${-RIM + 32})` }, this.card);
        text.textContent = cardinal || String(degrees).padStart(3, "0");
        if (cardinal) text.setAttribute("class", "cardinal");
      }
    }
    svg("circle", { r: RIM, class: "rim" }, root);
    svg("circle", { r: INNER, class: "rim" }, root);
    this.turn = svg("path", { class: "turn fused" }, root);
    this.needles = svg("g", {}, root);
    svg("path", { d: `M0 ${-RIM - 1}L9 ${-RIM - 15}L-9 ${-RIM - 15}Z M-2 ${-INNER}L-2 ${-RIM}L2 ${-RIM}L2 ${-INNER}Z`, class: "lubber fused" }, root);
    const c = 0.68 * INNER;
    svg("path", { d: `M${-c} ${-c}L${c} ${c}M${c} ${-c}L${-c} ${c}`, class: "cross" }, root).setAttribute("opacity", ".3");
    this.own = new Map();
  }

  // headings: [{name, heading_deg}], of the sensors that have one now.
  show(heading, sigma, rate, headings) {
    const shown = Number.isFinite(heading);
    if (shown) this.card.setAttribute("transform", `rotate(${-heading})`);
    this.sector.setAttribute("d", shown && Number.isFinite(sigma) ? sectorPath(Math.min(sigma, 180)) : "");
    this.turn.setAttribute("d", shown && Number.isFinite(rate) ? arcPath(rate) : "");
    const ahead = shown ? heading : 0;
    const placed = spread(headings.map((one) => ({ ...one, angle: wrap180(one.heading_deg - ahead) })));
    const names = new Set(placed.map((one) => one.name));
    for (const [name, parts] of this.own) parts.group.style.display = names.has(name) && shown ? "" : "none";
    if (shown) for (const one of placed) this.place(one);
  }

  place({ name, angle, label }) {
    const parts = this.own.get(name) || this.make(name);
    parts.line.setAttribute("transform", `rotate(${angle})`);
    const [x1, y1] = at(angle, RIM + 1), [x2, y2] = at(label, BADGE - 11);
    parts.leader.setAttribute("d", `M${x1} ${y1}L${x2} ${y2}`);
    const [x, y] = at(label, BADGE);
    parts.mark.setAttribute("transform", `translate(${x} ${y})`);
  }

  make(name) {
    const group = svg("g", { class: isCourse(name) ? "needle course" : "needle" }, this.needles);
    const line = svg("line", { x1: 0, y1: -INNER, x2: 0, y2: -RIM, stroke: ownColour(name) }, group);
    const leader = svg("path", { class: "leader", stroke: ownColour(name) }, group);
    const mark = svg("g", {}, group);
    badge(name, 11, mark).setAttribute("stroke", ownColour(name));
    const text = svg("text", { class: "badge-text" }, mark);
    text.textContent = badgeLetter(name);
    text.style.fill = ownColour(name);
    line.style.stroke = leader.style.stroke = ownColour(name);
    mark.firstChild.style.stroke = ownColour(name);
    const parts = { group, line, leader, mark };
    this.own.set(name, parts);
    return parts;
  }
}

// Places for badges near their angles that do not touch each other, nor the mark at the top.
function spread(marks) {
  const blocks = [];
  for (const mark of marks.sort((a, b) => a.angle - b.angle)) {
    let block = { marks: [mark], centre: mark.angle };
    for (let before = blocks.at(-1); before && start(block) < end(before) + BADGE_APART_DEG; before = blocks.at(-1)) {
      blocks.pop();
      const all = [...before.marks, ...block.marks];
      block = { marks: all, centre: all.reduce((sum, one) => sum + one.angle, 0) / all.length };
    }
    blocks.push(block);
  }
  return blocks.flatMap((block) => block.marks.map((mark, i) => ({ ...mark, label: start(block) + i * BADGE_APART_DEG })));
}
const start = (block) => block.centre - ((block.marks.length - 1) * BADGE_APART_DEG) / 2;
const end = (block) => block.centre + ((block.marks.length - 1) * BADGE_APART_DEG) / 2;

function sectorPath(sigma) {
  const [x1, y1] = at(-sigma, RIM), [x2, y2] = at(sigma, RIM), [x3, y3] = at(sigma, INNER), [x4, y4] = at(-sigma, INNER);
  const large = sigma > 90 ? 1 : 0;
  return `M${x1} ${y1}A${RIM} ${RIM} 0 ${large} 1 ${x2} ${y2}L${x3} ${y3}A${INNER} ${INNER} 0 ${large} 0 ${x4} ${y4}Z`;
}

function arcPath(rate) {
  const angle = Math.max(-90, Math.min(90, rate * TURN_DEG_PER_DPS));
  if (Math.abs(angle) < 0.5) return "";
  const radius = INNER - 5;
  const [x, y] = at(angle, radius);
  return `M0 ${-radius}A${radius} ${radius} 0 ${Math.abs(angle) > 180 ? 1 : 0} ${angle > 0 ? 1 : 0} ${x} ${y}`;
}
