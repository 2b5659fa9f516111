// Strips of speed, acceleration and gap over time, by uPlot: of a whole record with a line at the present time, or of
// the last seconds of a live drive.

import { colour } from "./canvas.js";
import { element } from "./elements.js";
import { speedUnit } from "./units.js";

const MOST_POINTS = 2000; // of a record's strip: more than a screen has pixels
const LIVE_SPAN = 20; // of a live drive's strips [s]
const LIVE_PERIOD = 0.1; // between two points of them [s]
const HEIGHT = 120;
const LABEL_WIDTH = 8.5; // of a character beside an axis [pixels]
const LABEL_ROOM = 14; // beside an axis's labels [pixels]
const LEAST_ROOM = 42; // of an axis with its labels [pixels]

const STRIPS = [
  // `least`: what a strip spans at least, so that noise at constant speed does not fill it.
  { title: "speed", unit: () => speedUnit().name, least: 10, lines: [["real", "first", (f) => scaled(f.ego?.speed, speedUnit().factor)]] },
  {
    title: "acceleration",
    unit: () => "m/s²",
    least: 2,
    lines: [
      ["real", "first", (f) => f.ego?.acceleration],
      ["wished", "second", (f) => f.ego?.wished],
    ],
  },
  { title: "gap ahead", unit: () => "m", least: 10, lines: [["gap", "third", (f) => f.gap]] },
];

const scaled = (value, factor) => (value === null || value === undefined ? null : factor * value);

export class Strips {
  constructor(root) {
    this.root = root;
    this.plots = [];
    this.data = null;
    this.drawnAt = -Infinity;
    this.factor = speedUnit().factor; // of the speeds in the data
    new ResizeObserver(() => this.fit()).observe(root);
  }

  /** Take a whole record, with the gaps if its details are there. */
  take(frames) {
    const step = Math.max(1, Math.ceil(frames.count / MOST_POINTS));
    const c = frames.columns;
    const rows = Array.from({ length: Math.ceil(frames.count / step) }, (_, row) => row * step);
    const sampled = (values, factor = 1) => rows.map((row) => (Number.isFinite(values?.[row]) ? factor * values[row] : null));
    const column = (name, factor) => sampled(c[name], factor);
    const time = rows.map((row) => c.t[row]);
    this.gaps = frames.detailed;
    this.factor = speedUnit().factor;
    this.data = [[time, column("speed", this.factor)], [time, column("acceleration"), column("wished")], [time, sampled(frames.details?.columns.gap)]];
    this.build([time[0], time[time.length - 1]]);
  }

  /** Add a frame of a live drive. */
  add(frame) {
    if (this.data === null) {
      this.data = STRIPS.map(({ lines }) => [[], ...lines.map(() => [])]);
      this.build(null);
    }
    const times = this.data[0][0];
    if (times.length && frame.t - times[times.length - 1] < LIVE_PERIOD) return;
    STRIPS.forEach(({ lines }, strip) => {
      const columns = this.data[strip];
      columns[0].push(frame.t);
      lines.forEach(([, , value], row) => columns[row + 1].push(value(frame) ?? null));
      while (columns[0][0] < frame.t - LIVE_SPAN) columns.forEach((column) => column.shift());
    });
    if (frame.t - this.drawnAt < 2 * LIVE_PERIOD && frame.t >= this.drawnAt) return;
    this.drawnAt = frame.t;
    this.plots.forEach((plot, strip) => {
      plot.setData(this.data[strip], false);
      plot.setScale("x", { min: frame.t - LIVE_SPAN, max: frame.t });
    });
  }

  /** Show the line at a time [s]. */
  mark(time) {
    this.time = time;
    for (const plot of this.plots) plot.redraw(false, false);
  }

  /** Draw anew, in the present theme's colours. */
  build(range) {
    this.range = range;
    for (const plot of this.plots) plot.destroy();
    this.root.replaceChildren();
    this.plots = STRIPS.map((strip, index) => {
      const names = strip.lines.length > 1
        ? strip.lines.flatMap(([name, tint]) => [" ", tinted(name, tint)])
        : [];
      const box = element("figure", {}, element("figcaption", {}, element("b", {}, strip.title), ` [${strip.unit()}]`, ...names, this.lacking(strip)));
      this.root.append(box);
      return new uPlot(this.options(strip, box), this.data[index], box);
    });
  }

  /** What a strip's title says of a record whose gaps are not computed. */
  lacking(strip) {
    return strip.title === "gap ahead" ? { coming: " computing …", failed: " could not be computed" }[this.gaps] ?? "" : "";
  }

  options(strip, box) {
    const ink = colour("ink");
    const axis = { stroke: ink, grid: { stroke: colour("line"), width: 0.5 }, ticks: { show: false }, font: "14px system-ui, sans-serif" };
    return {
      width: Math.max(box.clientWidth - 12, 80),
      height: HEIGHT,
      legend: { show: false },
      cursor: { show: false },
      padding: [8, 8, 0, 0],
      scales: {
        x: { time: false, ...(this.range ? { min: this.range[0], max: this.range[1] } : {}) },
        y: { range: (plot, low, high) => spanned(low, high, strip.least) },
      },
      axes: [{ ...axis, size: 26 }, { ...axis, size: (plot, labels) => labelled(labels) }],
      series: [{}, ...strip.lines.map(([, tint]) => ({ stroke: colour(tint), width: 2, points: { show: false } }))],
      hooks: { draw: [(plot) => this.drawMark(plot)] },
    };
  }

  drawMark(plot) {
    if (this.time === undefined || this.range === null) return;
    const { ctx, bbox } = plot;
    const x = plot.valToPos(this.time, "x", true);
    ctx.save();
    ctx.strokeStyle = colour("ink");
    ctx.lineWidth = 2 * uPlot.pxRatio;
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    ctx.restore();
  }

  fit() {
    this.plots.forEach((plot) => {
      const width = Math.max(plot.root.parentElement.clientWidth - 12, 80);
      if (Math.abs(width - plot.width) > 1) plot.setSize({ width, height: HEIGHT });
    });
  }

  /** Show speeds in the unit that was chosen. */
  unitsChanged() {
    const ratio = speedUnit().factor / this.factor;
    this.factor = speedUnit().factor;
    if (this.data === null) return;
    this.data[0][1] = this.data[0][1].map((value) => (value === null ? null : ratio * value));
    this.build(this.range);
  }

  themeChanged() {
    if (this.data !== null) this.build(this.range);
  }
}

/** Return the ends of an axis of values from low to high, which spans `least` at least and, of none below 0, none. */
function spanned(low, high, least) {
  if (low === null || high === null) return [0, least];
  const half = 0.525 * Math.max(high - low, least);
  const begin = (low + high) / 2 - half;
  return low >= 0 && begin < 0 ? [0, 2 * half] : [begin, begin + 2 * half];
}

/** Return the room that labels need beside an axis [pixels]. */
function labelled(labels) {
  const longest = Math.max(0, ...(labels ?? []).map((label) => String(label ?? "").length));
  return Math.max(LEAST_ROOM, Math.ceil(LABEL_ROOM + LABEL_WIDTH * longest));
}

function tinted(name, tint) {
  const made = element("span", {}, `— ${name}`);
  made.style.color = `var(--${tint})`;
  return made;
}
