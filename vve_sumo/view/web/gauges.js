// The gauges of one drive: large numbers, each with a bar where it has limits.

import { element, number, say } from "./elements.js";
import { speedUnit } from "./units.js";

const DEGREES = 180 / Math.PI;
const BRAKING_SHOWN = 8; // end of the bar of decelerations [m/s2]
const LATENCY_SHOWN = 1.5; // end of the latency's bar, in budgets
const NEAR_EDGE = 3; // metres to the edge that count as few

export class Gauges {
  constructor(root, scene) {
    this.scene = scene;
    this.root = root;
    this.parts = {
      speed: this.add("speed", 1),
      braking: this.add("deceleration", 1),
      wished: this.add("wished", 1),
      steering: this.add("steering", 1, true),
      gap: this.add("gap ahead", 0),
      edge: this.add("to the lot's edge", 0),
      quality: this.add("position", 0, false, true),
      latency: this.add("latency", 1),
      note: this.add("controller", 0, false, true),
    };
    this.parts.edge.box.hidden = !scene.lot;
    this.parts.latency.box.hidden = scene.latency_budget === null;
  }

  add(title, bars, fromMiddle = false, text = false) {
    const value = element("dd", text ? { class: "text" } : {}, "–");
    const box = element("div", { class: "gauge" }, element("dt", {}, title), value);
    const made = { box, value, bars: [] };
    if (bars) {
      const track = element("div", { class: fromMiddle ? "track zero" : "track" });
      made.bars = Array.from({ length: bars }, () => track.appendChild(element("b")));
      box.append(track);
    }
    this.root.append(box);
    return made;
  }

  /** Show one frame; null shows that nothing is known. */
  show(frame) {
    const ego = frame?.ego ?? null;
    const { speed, braking, wished: asked, steering, gap, edge, quality, latency, note } = this.parts;
    const unit = speedUnit();
    set(speed, ego && unit.factor * ego.speed, 1, unit.name);
    fill(speed, 0, ego ? ego.speed / (1.2 * this.scene.desired_speed) : 0);
    const real = ego && ego.acceleration !== null ? Math.max(-ego.acceleration, 0) : null;
    const wished = ego && ego.wished !== null ? Math.max(-ego.wished, 0) : null;
    set(braking, real, 1, "m/s²");
    fill(braking, 0, (real ?? 0) / BRAKING_SHOWN);
    set(asked, wished, 1, "m/s²");
    fill(asked, 0, (wished ?? 0) / BRAKING_SHOWN);
    const wheel = ego && ego.steering !== null ? ego.steering * this.scene.ego.steering_ratio : null;
    set(steering, wheel === null ? null : Math.abs(wheel) * DEGREES, 0, wheel > 0.01 ? "° left" : wheel < -0.01 ? "° right" : "°");
    fromMiddle(steering, wheel === null ? 0 : -ego.steering / this.scene.ego.steering_limit);
    setDetail(gap, frame, frame?.gap ?? null, "nothing ahead");
    setDetail(edge, frame, frame?.to_edge ?? null, "not known");
    edge.box.toggleAttribute("data-bad", (frame?.to_edge ?? Infinity) < NEAR_EDGE);
    say(quality.value, frame?.quality ?? "–");
    quality.box.toggleAttribute("data-bad", Boolean(frame?.quality?.startsWith("refused")));
    this.showLatency(frame, latency);
    say(note.value, frame?.note || "–");
  }

  showLatency(frame, part) {
    const budget = this.scene.latency_budget;
    if (budget === null) return;
    const took = frame?.latency ?? null;
    set(part, took === null ? null : 1000 * took, 1, `of ${number(1000 * budget, 0)} ms`);
    fill(part, 0, took === null ? 0 : took / (LATENCY_SHOWN * budget));
    part.box.toggleAttribute("data-bad", took !== null && took > budget);
  }
}

function set(part, value, decimals, unit) {
  const text = number(value, decimals);
  if (part.text === text + unit) return;
  part.text = text + unit;
  part.value.replaceChildren(text, element("small", {}, ` ${unit}`));
}

/** Why a frame has no metres to show: they are computed yet, or there is nothing to measure. */
export function whyNone(frame, nothing) {
  return { coming: "computing …", failed: "could not be computed" }[frame.detailed] ?? (frame.ego ? nothing : "no pose");
}

/** Show metres; where there are none, why. */
function setDetail(part, frame, value, nothing) {
  if (value !== null || !frame) return set(part, value, 1, "m");
  const why = whyNone(frame, nothing);
  if (part.text === why) return;
  part.text = why;
  part.value.replaceChildren(element("small", {}, why));
}

function fill(part, bar, share) {
  part.bars[bar].style.left = "0";
  part.bars[bar].style.width = `${100 * Math.min(Math.max(share, 0), 1)}%`;
}

function fromMiddle(part, share) {
  const held = Math.min(Math.max(share, -1), 1);
  part.bars[0].style.left = `${50 + 50 * Math.min(held, 0)}%`;
  part.bars[0].style.width = `${50 * Math.abs(held)}%`;
}
