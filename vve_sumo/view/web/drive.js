// One drive on the page: its state, street, lot, gauges, events and strips. Shows frames; does not know where from.

import { colour } from "./canvas.js";
import { element, say } from "./elements.js";
import { Gauges } from "./gauges.js";
import { Lot } from "./lot.js";
import { Seats } from "./seats.js";
import { Street, legendOf } from "./street.js";
import { Strips } from "./strips.js";

const MOST_EVENTS = 500; // of a live drive's list

export class DriveView {
  /** Make the view of a scene in `root`, under the `name` of its record where another is beside it; `onEvent` is called with the time [s] of an event that was chosen. */
  constructor(root, scene, { name = "", onEvent = null } = {}) {
    this.scene = scene;
    this.onEvent = onEvent;
    this.name = element("h2", { class: "name", hidden: !name }, name);
    this.state = element("p", { class: "state" }, element("strong", {}, "…"), element("span"));
    const street = element("canvas", { role: "img", "aria-label": "the street from above" });
    const lot = element("canvas", { role: "img", "aria-label": "the lot from above; a click shows the car close by" });
    const lotWords = element("p");
    const gauges = element("dl", { class: "gauges" });
    this.list = element("ol", { class: "events", "aria-label": "events" });
    const strips = element("div", { class: "strips" });
    this.legend = element("ul", { class: "legend" });
    this.box = element(
      "article", { class: name ? "drive narrow" : "drive" }, this.name, this.state,
      element("div", { class: "street" }, street, this.legend),
      element("section", { class: "side" },
        element("div", { class: "lot", hidden: !scene.lot }, lotWords, lot), gauges, this.list),
      strips,
    );
    root.append(this.box);
    this.street = new Street(street, scene);
    this.seats = new Seats(street.parentElement, this.street, scene);
    this.lot = new Lot(lot, lotWords, scene);
    this.gauges = new Gauges(gauges, scene);
    this.strips = new Strips(strips);
    this.frame = null;
    this.lastEvent = -Infinity;
    this.drawLegend();
    for (const event of scene.events) this.addEvent(event);
    const resized = new ResizeObserver(() => this.draw());
    for (const canvas of [street, lot]) resized.observe(canvas);
  }

  /**
   * Show a frame from now on; `clock` gives the drive time that is displayed [s], which the frame is predicted to.
   * A `verdict` says that the drive is over and what it came to.
   */
  show(frame, clock = () => frame.t, verdict = null) {
    this.frame = frame;
    this.seats.show(frame, clock);
    const [phase, why] = this.state.children;
    const [first, ...rest] = frame.said.split(": ");
    say(phase, verdict ? "over" : first);
    const contact = frame.contact ? `contact with ${frame.contact.replaceAll("+", ", ")}` : "";
    say(why, [verdict && inWords(verdict), contact, rest.join(": ")].filter(Boolean).join("; "));
    const state = verdict ? { true: "passed", false: "failed" }[verdict.passed] ?? "over" : frame.state;
    if (this.state.dataset.state !== state) this.state.dataset.state = state;
    this.gauges.show(frame);
  }

  /** Draw the canvases. */
  draw() {
    if (this.seats.inSpace) this.seats.draw();
    else this.street.draw(this.frame);
    this.lot.draw(this.frame);
  }

  /** Mark what is shown as old, or as present. */
  stale(is) {
    this.box.classList.toggle("stale", is);
  }

  addEvent({ time, kind, text }) {
    this.lastEvent = time;
    const label = `${time.toFixed(1)} s`;
    const item = element("li", {}, element("button", { type: "button", onclick: () => this.onEvent?.(time) },
      element("time", {}, label), element("span", { class: `kind-${kind}` }, text)));
    item.dataset.time = time;
    const atEnd = this.list.scrollTop + this.list.clientHeight > this.list.scrollHeight - 40;
    this.list.append(item);
    while (this.list.children.length > MOST_EVENTS) this.list.firstChild.remove();
    if (this.scene.source === "live" && atEnd) this.list.scrollTop = this.list.scrollHeight;
  }

  /** Mark the last event that is not after a time [s]. */
  markEvent(time) {
    let last = null;
    for (const item of this.list.children) {
      if (Number(item.dataset.time) <= time + 1e-6) last = item;
    }
    if (last === this.marked) return;
    this.marked?.classList.remove("now");
    last?.classList.add("now");
    this.marked = last;
    if (last) this.list.scrollTop = Math.max(0, last.offsetTop - this.list.offsetTop - this.list.clientHeight / 2);
  }

  drawLegend() {
    this.legend.replaceChildren(...legendOf(this.street.scene).map(([name, text, how]) => {
      const sign = element("i");
      sign.style.borderColor = colour(name);
      if (how === "rim") sign.style.borderStyle = name === "occluded" ? "dashed" : "solid";
      else sign.style.background = colour(name);
      if (how === "dot" || name === "false") sign.style.borderRadius = "50%";
      return element("li", {}, sign, text);
    }));
  }

  unitsChanged() {
    this.gauges.show(this.frame);
    this.strips.unitsChanged();
  }

  themeChanged() {
    this.drawLegend();
    this.strips.themeChanged();
    this.draw();
  }
}

/** What a drive came to: its outcome, and its criteria. */
function inWords({ outcome, passed, failed }) {
  const criteria = { true: "criteria passed", false: `FAILED: ${failed.join("; ")}` }[passed] ?? "";
  return [outcome, criteria].filter(Boolean).join(", ");
}
