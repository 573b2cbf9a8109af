// What plays: the time runs on until it is halted, or the scene ends.

import { byId } from "./dom.js";

const SPEEDS = [1, 10, 60, 300, 900, 3600, 21600, 86400, 604800]; // seconds in a second
const NAMES = ["as it is", "10 s", "1 min", "5 min", "15 min", "1 h", "6 h", "1 day", "1 week"];
const PLAYED_S = 40; // how long all of a scene takes at the speed that is set at first

export class Player {
  // `moveTo(t)` moves the instant of the state.
  constructor(state, moveTo) {
    this.state = state;
    this.moveTo = moveTo;
    this.frame = null; // the next one, while it plays
    this.button = byId("play");
    this.speed = byId("speed");
  }

  toggle() {
    if (this.frame === null) this.play();
    else this.pause();
  }

  play() {
    const { state } = this;
    this.say("Pause");
    if (state.isAtEnd()) this.moveTo(state.model.span[0]);
    let before = performance.now();
    const step = (now) => {
      this.moveTo(state.t + ((now - before) / 1000) * Number(this.speed.value));
      before = now;
      if (state.isAtEnd()) this.pause();
      else this.frame = requestAnimationFrame(step);
    };
    this.frame = requestAnimationFrame(step);
  }

  pause() {
    if (this.frame === null) return;
    cancelAnimationFrame(this.frame);
    this.frame = null;
    this.say("Play");
  }

  // What the button does next.
  say(label) {
    this.button.classList.toggle("playing", label === "Pause");
    this.button.setAttribute("aria-label", label);
  }

  // Speeds to choose from, that at which all of the scene takes about PLAYED_S first.
  offerSpeeds() {
    const [from, to] = this.state.model.span;
    const wanted = (to - from) / PLAYED_S;
    const nearest = SPEEDS.reduce((best, s) => (Math.abs(Math.log(s / wanted)) < Math.abs(Math.log(best / wanted)) ? s : best));
    this.speed.replaceChildren(...SPEEDS.map((s, n) => new Option(s === 1 ? NAMES[n] : `${NAMES[n]}/s`, s, s === nearest, s === nearest)));
  }
}
