// Records played back: timeline, play, single steps, speed, events; two records side by side in step.

import { colour, sized } from "./canvas.js";
import { DriveView } from "./drive.js";
import { element, say } from "./elements.js";
import { Frames, unpacked, unzipped } from "./frames.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8];
const STRIP_PERIOD = 60; // between two drawings of the strips' line [ms]
const BANDS = { disarmed: "line", ready: "good", engaged: "first", stopping: "second", stopped: "faint", fault: "bad" };

export class Replay {
  /** Open records: each { scene, frames: bytes, details: a promise of bytes }. */
  static async open(page, records) {
    const loaded = await Promise.all(records.map(async ({ scene, frames, details }) => ({
      scene,
      frames: new Frames(unpacked(await unzipped(frames))),
      details,
    })));
    return new Replay(page, loaded);
  }

  constructor(page, records) {
    this.page = page;
    const stage = document.getElementById("stage");
    stage.replaceChildren();
    this.records = records;
    const several = records.length > 1;
    this.views = records.map(({ scene, frames }) => {
      const view = new DriveView(stage, scene, { name: several ? scene.record : "", onEvent: (time) => this.seek(time) });
      view.strips.take(frames);
      // In a headset's session the browser may draw nothing else.
      view.seats.onPicture = () => this.advance(performance.now());
      return view;
    });
    page.titled([...new Set(records.map(({ scene }) => scene.title))].join("  |  "));
    this.begins = Math.min(...records.map(({ frames }) => frames.times[0]));
    this.ends = Math.max(...records.map(({ frames }) => frames.times[frames.count - 1]));
    this.time = this.begins;
    this.rate = 1;
    this.playing = false;
    this.stripsAt = 0;
    this.controls();
    records.forEach(({ frames, details }, index) => {
      details?.then(async (bytes) => {
        frames.addDetails(unpacked(await unzipped(bytes)));
        this.views[index].strips.take(frames);
        this.show();
      }).catch((error) => {
        console.warn("the details could not be read", error);
        frames.detailed = "failed";
        this.views[index].strips.take(frames);
        this.show();
      });
      if (!details) frames.detailed = "failed";
    });
    this.show();
    const draw = (now) => {
      requestAnimationFrame(draw);
      this.advance(now);
    };
    requestAnimationFrame(draw);
  }

  controls() {
    const root = document.getElementById("controls");
    root.hidden = false;
    const button = (text, title, action) => element("button", { type: "button", title, "aria-label": title, onclick: action }, text);
    this.playButton = button("▶", "play or pause (space)", () => this.toggle());
    this.speed = element("select", { "aria-label": "speed", onchange: () => { this.rate = Number(this.speed.value); } },
      ...SPEEDS.map((rate) => element("option", { value: rate, selected: rate === 1 }, `${rate}×`)));
    this.clock = element("output", { "aria-label": "drive time" });
    this.line = element("canvas");
    this.slider = element("div", {
      class: "timeline", role: "slider", tabindex: "0", "aria-label": "drive time",
      "aria-valuemin": this.begins.toFixed(2), "aria-valuemax": this.ends.toFixed(2),
    }, this.line);
    root.replaceChildren(
      element("div", { class: "buttons" },
        button("|◂", "previous event (p)", () => this.jump(-1)),
        button("−1", "one tick back (←)", () => this.step(-1)),
        this.playButton,
        button("+1", "one tick on (→)", () => this.step(1)),
        button("▸|", "next event (e)", () => this.jump(1))),
      this.speed, this.slider, this.clock);
    const take = (event) => {
      const place = this.slider.getBoundingClientRect();
      this.seek(this.begins + ((event.clientX - place.left) / place.width) * (this.ends - this.begins));
    };
    this.slider.addEventListener("pointerdown", (event) => {
      this.slider.setPointerCapture(event.pointerId);
      take(event);
    });
    this.slider.addEventListener("pointermove", (event) => {
      if (event.buttons) take(event);
    });
    new ResizeObserver(() => this.drawTimeline()).observe(this.slider);
  }

  toggle() {
    this.playing = !this.playing;
    if (this.playing && this.time >= this.ends) this.time = this.begins;
    this.before = performance.now();
    this.playButton.textContent = this.playing ? "❚❚" : "▶";
  }

  /** Show a drive time [s]. */
  seek(time) {
    this.time = Math.min(Math.max(time, this.begins), this.ends);
    this.show();
  }

  /** Go by ticks of the first record. */
  step(ticks) {
    const { frames } = this.records[0];
    const k = Math.min(Math.max(frames.at(this.time) + ticks, 0), frames.count - 1);
    if (this.playing) this.toggle();
    this.seek(frames.times[k]);
  }

  jump(way) {
    const times = this.records.flatMap(({ scene }) => scene.events.map(({ time }) => time)).sort((a, b) => a - b);
    const next = way > 0 ? times.find((time) => time > this.time + 1e-3) : times.findLast((time) => time < this.time - 1e-3);
    if (next !== undefined) this.seek(next);
  }

  advance(now) {
    if (!this.playing) {
      if (this.page.moved()) this.views.forEach((view) => view.draw());
      return;
    }
    this.time += ((now - this.before) / 1000) * this.rate;
    this.before = now;
    if (this.time >= this.ends) {
      this.time = this.ends;
      this.toggle();
    }
    this.show();
  }

  show() {
    this.records.forEach(({ frames }, index) => {
      const view = this.views[index];
      const ends = frames.times[frames.count - 1];
      const verdict = this.time >= ends ? this.records[index].scene.verdict : null;
      view.show(frames.frame(frames.at(this.time)), () => Math.min(this.time, ends), verdict);
      view.draw();
      view.markEvent(this.time);
    });
    say(this.clock, `${this.time.toFixed(2)} of ${this.ends.toFixed(1)} s`);
    this.slider.setAttribute("aria-valuenow", this.time.toFixed(2));
    this.slider.setAttribute("aria-valuetext", `${this.time.toFixed(2)} s`);
    this.drawTimeline();
    const now = performance.now();
    if (!this.playing || now - this.stripsAt > STRIP_PERIOD) {
      this.stripsAt = now;
      this.views.forEach((view) => view.strips.mark(this.time));
    }
  }

  drawTimeline() {
    const { context, width, height } = sized(this.line);
    context.clearRect(0, 0, width, height);
    const place = (time) => ((time - this.begins) / (this.ends - this.begins)) * width;
    const band = height / 2 / this.records.length;
    this.records.forEach(({ frames, scene }, row) => {
      const top = height / 4 + row * band;
      for (const [begin, end, state] of (frames.bands ??= stretches(frames))) {
        context.fillStyle = colour(BANDS[state] ?? "line");
        context.fillRect(place(begin), top + 1, Math.max(place(end) - place(begin), 1), band - 2);
      }
      context.fillStyle = colour("ink");
      for (const { time, kind } of scene.events) {
        if (kind === "reason") continue;
        context.fillRect(place(time) - 1, top - 5, 2, 5);
      }
    });
    context.fillStyle = colour("ink");
    context.fillRect(place(this.time) - 2, 0, 4, height);
  }

  themeChanged() {
    this.drawTimeline();
  }

  key(event) {
    const action = {
      " ": () => this.toggle(),
      ArrowRight: () => this.step(event.shiftKey ? 50 : 1),
      ArrowLeft: () => this.step(event.shiftKey ? -50 : -1),
      e: () => this.jump(1),
      p: () => this.jump(-1),
      Home: () => this.seek(this.begins),
      End: () => this.seek(this.ends),
      "[": () => this.faster(-1),
      "]": () => this.faster(1),
    }[event.key];
    action?.();
    return Boolean(action);
  }

  faster(way) {
    const at = Math.min(Math.max(SPEEDS.indexOf(this.rate) + way, 0), SPEEDS.length - 1);
    this.rate = SPEEDS[at];
    this.speed.value = String(this.rate);
  }

  get keys() {
    return [
      ["space", "play or pause"], ["← →", "one tick back or on; with shift, 50"], ["p e", "previous or next event"],
      ["[ ]", "slower or faster"], ["Home End", "begin or end"],
    ];
  }
}

/** Return begin, end and state of each stretch in which the gateway kept a state. */
function stretches(frames) {
  const { t, state } = frames.columns;
  const found = [];
  for (let k = 0; k < frames.count; k += 1) {
    if (k && state[k] === state[k - 1]) found[found.length - 1][1] = t[k];
    else found.push([t[k], t[k], frames.texts.state[state[k]]]);
  }
  return found;
}
