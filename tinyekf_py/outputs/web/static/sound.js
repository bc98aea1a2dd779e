// Two tones, again and again, while there is an alarm and the sound is switched on.

const PERIOD_MS = 1800;

export class Sounder {
  constructor(button) {
    this.button = button;
    this.context = null;
    this.alarmed = false;
    this.on = localStorage.getItem("sound") === "on";
    button.addEventListener("click", () => this.toggle());
    // A browser lets a page sound once somebody has touched it.
    for (const event of ["pointerdown", "keydown"]) document.addEventListener(event, () => this.wake());
    this.label();
    setInterval(() => { if (this.alarmed && this.on) this.beep(); }, PERIOD_MS);
  }

  toggle() {
    this.on = !this.on;
    localStorage.setItem("sound", this.on ? "on" : "off");
    this.label();
    this.wake();
    if (this.on) this.beep();
  }

  set(alarmed) {
    if (alarmed && !this.alarmed && this.on) this.beep();
    this.alarmed = alarmed;
  }

  label() {
    this.button.textContent = this.on ? "♪ on" : "♪ off";
    this.button.setAttribute("aria-pressed", String(this.on));
  }

  wake() {
    if (!this.on) return;
    this.context ??= new AudioContext();
    this.context.resume();
  }

  beep() {
    if (!this.context || this.context.state !== "running") return;
    const now = this.context.currentTime;
    [880, 660].forEach((pitch, i) => {
      const tone = this.context.createOscillator(), gain = this.context.createGain();
      tone.frequency.value = pitch;
      gain.gain.setValueAtTime(0.0001, now + i * 0.28);
      gain.gain.exponentialRampToValueAtTime(0.3, now + i * 0.28 + 0.02);
      gain.gain.exponentialRampToValueAtTime(0.0001, now + i * 0.28 + 0.25);
      tone.connect(gain).connect(this.context.destination);
      tone.start(now + i * 0.28);
      tone.stop(now + i * 0.28 + 0.26);
    });
  }
}
