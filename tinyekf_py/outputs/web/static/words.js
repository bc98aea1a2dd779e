// Numbers as a navigator reads them; "---" for what is not known.

export const NONE = "---";
export const known = (value) => typeof value === "number" && Number.isFinite(value);

export function headingText(degrees) {
  if (!known(degrees)) return NONE;
  const text = degrees.toFixed(1);
  return (text === "360.0" ? "0.0" : text).padStart(5, "0");
}

export function turnText(dps) {
  if (!known(dps)) return NONE;
  const perMinute = Math.abs(dps * 60).toFixed(0);
  if (perMinute === "0") return "0 °/min";
  return dps > 0 ? `${perMinute} °/min ▶` : `◀ ${perMinute} °/min`;
}

export function turnSide(dps) {
  if (!known(dps)) return "";
  return Math.abs(dps * 60) < 0.5 ? "steady" : dps > 0 ? "to starboard" : "to port";
}

function minutesText(angle, digits, sides) {
  const thousandths = Math.round(Math.abs(angle) * 60000);
  const degrees = Math.floor(thousandths / 60000), minutes = (thousandths % 60000) / 1000;
  return `${String(degrees).padStart(digits, "0")}°${minutes.toFixed(3).padStart(6, "0")}′ ${sides[angle < 0 ? 1 : 0]}`;
}

export function positionText(lat, lon, mode) {
  if (mode === "invalid" || !known(lat) || !known(lon)) return NONE;
  const text = `${minutesText(lat, 2, "NS")}  ${minutesText(lon, 3, "EW")}`;
  return mode === "dead-reckoning" ? `${text} (dead reckoning)` : text;
}

export function elapsedText(seconds) {
  const s = Math.floor(seconds);
  return `${Math.floor(s / 3600)}:${String(Math.floor(s / 60) % 60).padStart(2, "0")}:${String(s % 60).padStart(2, "0")}`;
}

export const knots = (mps) => (known(mps) ? `${(mps * 1.943844).toFixed(1)} kn` : NONE);
export const ageText = (s) => (!known(s) ? NONE : s < 1000 ? `${s.toFixed(1)} s` : "> 999 s");

export const MODES = {
  ok: ["OK", "M0-7A7 7 0 1 1-.01-7Z"],
  degraded: ["DEGRADED", "M0-7L7.5 6.5H-7.5Z"],
  "dead-reckoning": ["DEAD RECKONING", "M0-8L8 0 0 8-8 0Z"],
  invalid: ["NO HEADING", "M-7-4.5L-4.5-7 0-2.5 4.5-7 7-4.5 2.5 0 7 4.5 4.5 7 0 2.5-4.5 7-7 4.5-2.5 0Z"],
};
export const FIXES = ["none", "GPS", "DGPS", "PPS", "RTK", "float RTK", "estimated", "manual", "simulated"];
export const WEIGHTS = ["bad", "good", "excellent", "ideal"];
export const MAX_SENSOR_AGE_S = 3;

export function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
