// The frames of a record: takes the binary file of columns apart and gives one tick as an object, in the form in which
// a live drive sends it. Knows no page; the file's layout is defined in view/frames.py.

const MAGIC = "VVEF";
const KINDS = { f4: Float32Array, f8: Float64Array, i4: Int32Array };

/** Return what `bytes` are without gzip, as an ArrayBuffer. */
export async function unzipped(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

/** Return { head, columns } of an unzipped file of columns; throws where it is none. */
export function unpacked(buffer) {
  const view = new DataView(buffer);
  const magic = String.fromCharCode(...new Uint8Array(buffer, 0, 4));
  if (magic !== MAGIC) throw new Error(`not a file of frames: it begins with ${JSON.stringify(magic)}`);
  const length = view.getUint32(4, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
  const columns = {};
  for (const { name, kind, count, offset } of head.columns) {
    columns[name] = new KINDS[kind](buffer, 8 + length + offset, count);
  }
  return { head, columns };
}

const known = (value) => (Number.isFinite(value) ? value : null);

/** Return the index of the last entry of a rising array that is not greater than `value`; -1 where all are. */
export function lastNotAfter(rising, value) {
  let low = 0;
  let high = rising.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (rising[middle] <= value) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/** The frames of one record. */
export class Frames {
  constructor({ head, columns }) {
    this.texts = head.texts;
    this.stride = head.stride;
    this.signals = Object.entries(head.signals);
    this.columns = columns;
    this.times = columns.t;
    this.count = columns.t.length;
    this.details = null;
    this.detailed = "coming"; // what takes longer to compute: coming, there, or failed
  }

  /** Add what takes longer to compute: gaps, the lot's distances and footprints, why actors were not detected. */
  addDetails({ head, columns }) {
    this.details = { texts: head.texts, columns };
    this.detailed = "there";
  }

  /** Index of the tick at a drive time [s], the last one that is not after it. */
  at(time) {
    return Math.max(lastNotAfter(this.times, time + 1e-9), 0);
  }

  /** The frame of tick number k. */
  frame(k) {
    const c = this.columns;
    const text = (name) => this.texts[name][c[name][k]];
    return {
      t: c.t[k],
      state: text("state"),
      reason: text("reason"),
      said: text("said"),
      note: text("note"),
      contact: text("contact"),
      ego: Number.isFinite(c.x[k]) ? this.#ego(k) : null,
      s: known(c.s[k]),
      deviation: known(c.deviation[k]),
      real: Number.isFinite(c.real_x[k])
        ? { x: c.real_x[k], y: c.real_y[k], heading: c.real_heading[k] }
        : null,
      quality: text("quality"),
      actors: this.#actors(k),
      people: this.#people(k),
      sensed: this.#sensed(k),
      commanded: this.#commanded(k),
      latency: known(c.latency[k]),
      latencies: null,
      signals: this.#signals(c.t[k]),
      detailed: this.detailed,
      ...this.#detailed(k),
    };
  }

  #ego(k) {
    const c = this.columns;
    return {
      x: c.x[k],
      y: c.y[k],
      heading: c.heading[k],
      speed: known(c.speed[k]),
      acceleration: known(c.acceleration[k]),
      wished: known(c.wished[k]),
      granted: known(c.granted[k]),
      steering: known(c.steering[k]),
      wished_steering: known(c.wished_steering[k]),
      yaw_rate: known(c.yaw_rate[k]) ?? 0,
    };
  }

  #actors(k) {
    const c = this.columns;
    const kept = k - (k % this.stride);
    const begin = c.actor_first[kept];
    const end = c.actor_first[kept + 1];
    const slice = (name) => Array.from(c[name].subarray(begin, end));
    const codes = c.actor_code.subarray(begin, end);
    const actors = {
      id: Array.from(codes, (code) => this.texts.actor[code]),
      x: slice("actor_x"),
      y: slice("actor_y"),
      heading: slice("actor_heading"),
      speed: slice("actor_speed"),
    };
    if (k !== kept) advance(actors, c.t[k] - c.t[kept]);
    return actors;
  }

  /** Real people: how each is there, the circle that holds the true place with 95 %, and the box that sensors meet. */
  #people(k) {
    const c = this.columns;
    const people = [];
    for (let row = c.person_first[k]; row < c.person_first[k + 1]; row += 1) {
      const numbers = PERSON_NUMBERS.map((name) => [name, known(c[`person_${name}`][row])]);
      people.push({
        id: this.texts.person[c.person_code[row]],
        presence: this.texts.presence[c.person_presence[row]],
        ...Object.fromEntries(numbers),
      });
    }
    return people;
  }

  /** What each signal shows at a drive time [s]: a letter for each of its links; null where the record does not say. */
  #signals(time) {
    if (!this.signals.length) return null;
    return Object.fromEntries(this.signals.map(([name, [times, states]]) => [name, states[lastNotAfter(times, time + 1e-9)] ?? ""]));
  }

  /** The path that the command of tick number k carried, as points; null for none. */
  #commanded(k) {
    const c = this.columns;
    const place = lastNotAfter(c.commanded_tick, k);
    if (place < 0 || c.commanded_tick[place] !== k) return null;
    const points = [];
    for (let row = c.commanded_first[place]; row < c.commanded_first[place + 1]; row += 1) {
      points.push([c.commanded_x[row], c.commanded_y[row]]);
    }
    return points;
  }

  /** The newest reading of each sensor, in the order of the scene's. */
  #sensed(k) {
    const found = [];
    for (let n = 0; `sensed${n}_tick` in this.columns; n += 1) found.push(this.#reading(n, lastNotAfter(this.columns[`sensed${n}_tick`], k)));
    return found;
  }

  #reading(n, number) {
    if (number < 0) return { x: [], y: [], seen: [], measured: null, unseen: { id: [], why: [] } };
    const column = (name) => this.columns[`sensed${n}_${name}`];
    const [begin, end] = column("first").subarray(number, number + 2);
    const shapes = SHAPES.filter(column).map((name) => [name, Array.from(column(name).subarray(begin, end))]);
    return {
      ...Object.fromEntries(shapes),
      seen: Array.from(column("code").subarray(begin, end), (code) => (code < 0 ? "" : this.texts.actor[code])),
      measured: known(column("measured")[number]),
      unseen: this.#unseen(n, number),
    };
  }

  #unseen(n, number) {
    const unseen = { id: [], why: [] };
    if (this.details === null) return unseen;
    const { texts, columns } = this.details;
    const [begin, end] = columns[`unseen${n}_first`].subarray(number, number + 2);
    for (let row = begin; row < end; row += 1) {
      unseen.id.push(this.texts.actor[columns[`unseen${n}_code`][row]]);
      unseen.why.push(texts.why[columns[`unseen${n}_why`][row]]);
    }
    return unseen;
  }

  #detailed(k) {
    if (this.details === null) return { gap: null, to_edge: null, footprint: null };
    const { columns: c } = this.details;
    const place = lastNotAfter(c.footprint_tick, k);
    let footprint = null;
    if (place >= 0 && k - c.footprint_tick[place] < FOOTPRINT_LIFE) {
      footprint = [];
      for (let row = c.footprint_first[place]; row < c.footprint_first[place + 1]; row += 1) {
        footprint.push([c.footprint_x[row], c.footprint_y[row]]);
      }
      if (!footprint.length) footprint = null;
    }
    return { gap: known(c.gap[k]), to_edge: known(c.to_edge[k]), footprint };
  }
}

// What places a sensor's rows, as far as its shape has it.
const SHAPES = ["x", "y", "origin_x", "origin_y", "heading", "length", "width"];

// Numbers of a person; null where nobody knows.
const PERSON_NUMBERS = ["x", "y", "radius", "age", "heading", "length", "width"];

// Ticks for which a footprint is shown; view/details.py computes one this often.
const FOOTPRINT_LIFE = 25;

/** Move actors on along their headings by a time [s]. */
function advance(actors, time) {
  for (let row = 0; row < actors.id.length; row += 1) {
    actors.x[row] += actors.speed[row] * Math.cos(actors.heading[row]) * time;
    actors.y[row] += actors.speed[row] * Math.sin(actors.heading[row]) * time;
  }
}
