// A sweep as a table: sorted by any column, filtered, any two columns plotted, a kept run opened. Only the rows in sight
// are elements of the page, so that a hundred thousand rows are as quick as a hundred.

import { colour, sized } from "./canvas.js";
import { element, number, say } from "./elements.js";
import { unpacked, unzipped } from "./frames.js";
import { readSweep } from "./source.js";

const ROW = 36; // height of a row [pixels]
const SPARE = 12; // rows above and below those in sight
const PAD = [64, 16, 48, 16]; // around the plot: left, right, bottom, top [pixels]
const OPERATORS = /^\s*([\w.\- ]+?)\s*(<=|>=|!=|=|<|>|~)\s*(.+?)\s*$/;

export class SweepTable {
  static async open(page, contents) {
    return new SweepTable(page, contents, unpacked(await unzipped(await readSweep())));
  }

  constructor(page, contents, { head, columns }) {
    this.page = page;
    this.kept = new Set(contents.kept);
    this.names = head.names;
    this.columns = head.names.map((name, index) => ({ name, unit: head.units[index], values: columns[`c${index}`], texts: head.texts[`c${index}`] }));
    this.byName = new Map(this.columns.map((column) => [column.name, column]));
    this.count = this.columns[0].values.length;
    this.order = Uint32Array.from({ length: this.count }, (_, row) => row);
    this.sorted = { name: null, down: false };
    page.titled(contents.title);
    this.build(head.plotted);
    this.apply();
  }

  build([across, up]) {
    const stage = document.getElementById("stage");
    this.filter = element("input", {
      type: "search", placeholder: "filter: stop_gap_m < 4, outcome = contact, …", "aria-label": "filter", oninput: () => this.apply(),
    });
    this.counted = element("output", { role: "status" });
    this.openButton = element("button", { type: "button", disabled: true, onclick: () => this.openRun() }, "open run");
    const choice = (label, chosen) => element("select", { "aria-label": label, onchange: () => this.drawPlot() },
      ...this.columns.map(({ name }) => element("option", { value: name, selected: name === chosen }, name)));
    this.across = choice("plotted to the right", across);
    this.up = choice("plotted upwards", up);
    this.canvas = element("canvas", { role: "img", "aria-label": "the two chosen columns against each other" });
    const heads = this.columns.map(({ name, unit }) => element("th", { scope: "col" },
      element("button", { type: "button", onclick: () => this.sortBy(name), title: unit ? `[${unit}]` : name }, name)));
    this.heads = heads;
    this.body = element("tbody");
    this.grid = element("div", { class: "grid", tabindex: "0", onscroll: () => this.fill() },
      element("table", {}, element("thead", {}, element("tr", {}, ...heads)), this.body));
    stage.replaceChildren(element("article", { class: "sweep" },
      element("div", { class: "tools" }, this.filter, this.counted, this.openButton), this.grid,
      element("div", { class: "plot-tools" }, this.up, "against", this.across), element("div", { class: "plot" }, this.canvas)));
    document.getElementById("turn").hidden = true;
    new ResizeObserver(() => { this.fill(); this.drawPlot(); }).observe(this.grid);
    this.canvas.addEventListener("click", (event) => this.chooseNear(event));
  }

  /** Return what a row says in a column: a number, a text, or null. */
  value(column, row) {
    const value = column.values[row];
    if (column.texts) return value < 0 ? null : column.texts[value];
    return Number.isFinite(value) ? value : null;
  }

  sortBy(name) {
    this.sorted = { name, down: this.sorted.name === name ? !this.sorted.down : false };
    this.heads.forEach((head, index) => {
      const own = this.columns[index].name === name;
      head.setAttribute("aria-sort", own ? (this.sorted.down ? "descending" : "ascending") : "none");
      head.firstChild.textContent = this.columns[index].name + (own ? (this.sorted.down ? " ▼" : " ▲") : "");
    });
    this.apply();
  }

  /** Filter and sort anew. */
  apply() {
    const tests = this.filter.value.split(",").filter((part) => part.trim()).map((part) => this.test(part));
    this.filter.setCustomValidity(tests.includes(null) ? "not understood" : "");
    const wanted = tests.filter(Boolean);
    const rows = [];
    for (let row = 0; row < this.count; row += 1) {
      if (wanted.every((test) => test(row))) rows.push(row);
    }
    this.order = sortedRows(rows, this.byName.get(this.sorted.name), this.sorted.down);
    say(this.counted, `${this.order.length} of ${this.count} runs`);
    this.grid.scrollTop = 0;
    this.fill();
    this.drawPlot();
  }

  /** Return the test that a part of the filter asks for: a comparison, or text that any column holds; null for none. */
  test(part) {
    const [, name, sign, wanted] = OPERATORS.exec(part) ?? [];
    const column = this.byName.get(name);
    if (!column) {
      const text = part.trim().toLowerCase();
      const textual = this.columns.filter(({ texts }) => texts);
      return name ? null : (row) => textual.some((one) => String(this.value(one, row) ?? "").toLowerCase().includes(text));
    }
    const limit = Number(wanted);
    const compare = {
      "<": (value) => value < limit, ">": (value) => value > limit, "<=": (value) => value <= limit, ">=": (value) => value >= limit,
      "=": (value) => (column.texts ? value === wanted : value === limit),
      "!=": (value) => (column.texts ? value !== wanted : value !== limit),
      "~": (value) => String(value).toLowerCase().includes(wanted.toLowerCase()),
    }[sign];
    return (row) => {
      const value = this.value(column, row);
      return value !== null && compare(value);
    };
  }

  /** Put the rows in sight into the table. */
  fill() {
    const first = Math.max(0, Math.floor(this.grid.scrollTop / ROW) - SPARE);
    const last = Math.min(this.order.length, Math.ceil((this.grid.scrollTop + this.grid.clientHeight) / ROW) + SPARE);
    const rows = [];
    for (let at = first; at < last; at += 1) rows.push(this.row(this.order[at]));
    this.body.replaceChildren(this.spacer(first), ...rows, this.spacer(this.order.length - last));
  }

  spacer(rows) {
    const cell = element("td", { colspan: this.columns.length });
    cell.style.height = `${rows * ROW}px`;
    return element("tr", { class: "spacer", hidden: rows === 0 }, cell);
  }

  row(row) {
    const made = element("tr", { class: row === this.chosen ? "chosen" : null, onclick: () => this.choose(row), ondblclick: () => this.openRun() });
    for (const column of this.columns) {
      const value = this.value(column, row);
      made.append(typeof value === "number"
        ? element("td", { class: "number" }, Number.isInteger(value) ? String(value) : number(value, 3))
        : element("td", {}, value ?? "–"));
    }
    return made;
  }

  choose(row) {
    this.chosen = row;
    this.openButton.disabled = !this.kept.has(this.keyOf(row));
    this.openButton.title = this.openButton.disabled ? "the record of this run was not kept" : "";
    this.fill();
    this.drawPlot();
  }

  keyOf(row) {
    return this.value(this.byName.get("key"), row);
  }

  openRun() {
    if (this.chosen === undefined || !this.kept.has(this.keyOf(this.chosen))) return;
    location.assign(new URL(`?run=${encodeURIComponent(this.keyOf(this.chosen))}`, document.baseURI));
  }

  /** Place of the rows' points on the canvas. */
  points(width, height) {
    const axes = [axis(this.byName.get(this.across.value), this.order), axis(this.byName.get(this.up.value), this.order)];
    const [left, right, bottom, top] = PAD;
    return {
      axes,
      x: (row) => left + axes[0].share(row) * (width - left - right),
      y: (row) => height - bottom - axes[1].share(row) * (height - bottom - top),
    };
  }

  drawPlot() {
    const { context, width, height } = sized(this.canvas);
    context.clearRect(0, 0, width, height);
    if (!this.order.length || width < 100) return;
    const { axes, x, y } = this.points(width, height);
    const [left, right, bottom, top] = PAD;
    context.strokeStyle = colour("line");
    context.lineWidth = 1;
    context.strokeRect(left, top, width - left - right, height - bottom - top);
    context.fillStyle = colour("first");
    context.globalAlpha = this.order.length > 3000 ? 0.35 : 0.8;
    const size = this.order.length > 3000 ? 2 : 5;
    for (const row of this.order) {
      const [across, up] = [x(row), y(row)];
      if (Number.isFinite(across + up)) context.fillRect(across - size / 2, up - size / 2, size, size);
    }
    context.globalAlpha = 1;
    if (this.chosen !== undefined && Number.isFinite(x(this.chosen) + y(this.chosen))) {
      context.strokeStyle = colour("second");
      context.lineWidth = 3;
      context.strokeRect(x(this.chosen) - 6, y(this.chosen) - 6, 12, 12);
    }
    context.fillStyle = colour("ink");
    context.font = "14px system-ui, sans-serif";
    context.textBaseline = "top";
    context.textAlign = "left";
    context.fillText(axes[0].low, left, height - bottom + 6);
    context.textAlign = "right";
    context.fillText(axes[0].high, width - right, height - bottom + 6);
    context.textAlign = "center";
    context.fillText(this.across.value, (left + width - right) / 2, height - bottom + 24);
    context.textAlign = "right";
    context.fillText(axes[1].high, left - 6, top);
    context.textBaseline = "bottom";
    context.fillText(axes[1].low, left - 6, height - bottom);
    context.save();
    context.translate(14, (top + height - bottom) / 2);
    context.rotate(-Math.PI / 2);
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillText(this.up.value, 0, 0);
    context.restore();
  }

  chooseNear(event) {
    const place = this.canvas.getBoundingClientRect();
    const { x, y } = this.points(place.width, place.height);
    let nearest = 20;
    let found;
    for (const row of this.order) {
      const far = Math.hypot(x(row) - event.clientX + place.left, y(row) - event.clientY + place.top);
      if (far < nearest) [nearest, found] = [far, row];
    }
    if (found === undefined) return;
    this.choose(found);
    this.grid.scrollTop = this.order.indexOf(found) * ROW - this.grid.clientHeight / 2;
  }

  themeChanged() {
    this.drawPlot();
  }
}

/** Return rows in the order of a column; rows without a value come last. */
export function sortedRows(rows, column, down) {
  const order = Uint32Array.from(rows);
  if (!column) return order;
  let rank = column.values;
  if (column.texts) {
    const places = new Map(column.texts.map((text, code) => [code, text]));
    const alphabetical = [...places].sort((a, b) => (a[1] < b[1] ? -1 : a[1] > b[1] ? 1 : 0)).map(([code]) => code);
    const place = new Float64Array(column.texts.length);
    alphabetical.forEach((code, at) => { place[code] = at; });
    rank = Float64Array.from(column.values, (code) => (code < 0 ? NaN : place[code]));
  }
  const sign = down ? -1 : 1;
  return order.sort((a, b) => {
    const [one, other] = [rank[a], rank[b]];
    if (Number.isNaN(one) || Number.isNaN(other)) return Number.isNaN(one) - Number.isNaN(other) || a - b;
    return sign * (one - other) || a - b;
  });
}

/** An axis of the plot over the rows shown: texts stand side by side in their order. */
function axis(column, rows) {
  let [low, high] = [Infinity, -Infinity];
  for (const row of rows) {
    const value = column.values[row];
    if (!Number.isFinite(value) || (column.texts && value < 0)) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  const span = high - low || 1;
  const words = (value) => (column.texts ? (column.texts[value] ?? "") : Number.isFinite(value) ? String(Number(value.toPrecision(4))) : "–");
  return { low: words(low), high: words(high), share: (row) => (column.texts && column.values[row] < 0 ? NaN : (column.values[row] - low) / span) };
}
