// All actors: each kind one geometry, drawn once for all of it, finer near the camera. Nothing is kept from picture to
// picture, so that the same frame always gives the same picture.

import { Color, Group, Sphere, Vector3 } from "three";
import { cyclist, motorcyclist, pedestrian } from "./people.js";
import { Lot, shadowRow, shadows } from "./instances.js";
import { LONGEST_PREDICTION } from "./frame_of_reference.js";
import { bodyMaterial, hashedText } from "./shading.js";
import { Shape } from "./shapes.js";
import { bus, saloon, truck, van } from "./vehicles.js";

//: size of each model as it is made, along, up, across [m]; how far a limb swings [rad]; metres of a whole gait
const KINDS = {
  passenger: { make: saloon, size: [4.87, 1.48, 1.86] },
  van: { make: van, size: [5.5, 2.4, 2.0] },
  truck: { make: truck, size: [8.5, 3.4, 2.5] },
  bus: { make: bus, size: [12, 3.1, 2.55] },
  motorcycle: { make: motorcyclist, size: [2.1, 1.5, 0.8] },
  bicycle: { make: cyclist, size: [1.75, 1.75, 0.65] },
  pedestrian: { make: pedestrian, size: [0.5, 1.75, 0.56], swing: 0.4, gait: 1.5 },
  child: { make: pedestrian, size: [0.5, 1.75, 0.56], swing: 0.45, gait: 1.0 },
};
//: what a body is called where pixels are named by what they show
const CALLED = { motorcycle: "two_wheeler", bicycle: "two_wheeler", pedestrian: "person", child: "person" };
const SAME = { car: "passenger", other: "passenger", taxi: "passenger", delivery: "van", coach: "bus", trailer: "truck", moped: "motorcycle" };
//: how high a body stands whose height nobody says [m]; people and what they ride keep theirs
const HEIGHTS = { passenger: 1.5, van: 2.3, truck: 3.4, bus: 3.1, motorcycle: 1.5, bicycle: 1.75, pedestrian: 1.75, child: 1.2 };
const PAINTS = ["#c9ccce", "#8e9499", "#43494f", "#26292d", "#7b2a2c", "#e9e9e6", "#5d6a5f", "#a89a80", "#35505f", "#b9b3a6"];
const LIVERIES = ["#e4e4df", "#d9dcd6", "#b9c4c9", "#c9b27a"];
const CLOTHES = ["#8a3b3b", "#2f6f73", "#b98a34", "#50608a", "#6d5a7d", "#c4bcae", "#3d5c45", "#a35a2e"];
//: a body is fine within the first distance and plain within the second; beyond it is two blocks [m]
const LEVELS = [28, 80];
//: the same of pictures that programs look at
export const FINE_LEVELS = [70, 160];
//: bodies are left out beyond the first distance, their shadows beyond the second [m]
const [SEEN_WITHIN, SHADED_WITHIN] = [500, 90];

/** What kind of body an actor has, of those that can be drawn. */
export const kindOf = (actor) => (KINDS[actor?.kind] ? actor.kind : SAME[actor?.kind] ?? "passenger");

/** The colour of an actor's paint or clothes, by its name. */
export function paintOf(id, kind) {
  const worn = { pedestrian: CLOTHES, child: CLOTHES, bicycle: CLOTHES, motorcycle: CLOTHES, bus: LIVERIES, truck: LIVERIES }[kind] ?? PAINTS;
  return worn[Math.floor(hashedText(id) * worn.length)];
}

export class Fleet {
  /** `parked` are bodies {id, kind, x, y, heading, length, width, height} that always stand there; `levels` as LEVELS. */
  constructor(scene, reference, parked = [], levels = LEVELS) {
    this.levels = levels;
    this.scene = scene; // a live drive adds actors to it
    this.parked = parked;
    this.decoration = new Map(parked.map((one) => [one.id, one]));
    this.bodies = []; // those of the last picture; a body's label is its place among them, from 1

    this.reference = reference;
    this.group = new Group();
    this.lots = new Map();
    this.paints = new Map();
    this.shadows = shadows();
    this.group.add(this.shadows.mesh);
  }

  #lot(kind, far) {
    const level = this.levels.filter((within) => far > within).length;
    const key = `${kind} ${level}`;
    if (!this.lots.has(key)) {
      const { make, size } = KINDS[kind];
      const lot = new Lot(level < 2 ? make(level === 0) : blocks(size), bodyMaterial({ instanced: true }), 0, CALLED[kind] ?? "vehicle");
      this.lots.set(key, lot);
      this.group.add(lot.mesh);
    }
    return this.lots.get(key);
  }

  /**
   * Have the actors of a frame stand where they are `ahead` seconds after it, as far as a camera at `eye` sees them;
   * `view` is its frustum, null for all sides.
   */
  show({ id, x, y, heading, speed }, ahead, eye, view) {
    const time = Math.min(Math.max(ahead, -LONGEST_PREDICTION), LONGEST_PREDICTION);
    for (const lot of this.lots.values()) lot.clear();
    this.shadows.clear();
    this.bodies = [];
    for (let i = 0; i < id.length; i++) {
      if (x[i] === null || y[i] === null || heading[i] === null) continue;
      const [c, s, v] = [Math.cos(heading[i]), Math.sin(heading[i]), speed[i] ?? 0];
      this.#stand(id[i], x[i] + c * v * time, y[i] + s * v * time, c, s, v, view, eye);
    }
    for (const { id, x, y, heading } of this.parked) this.#stand(id, x, y, Math.cos(heading), Math.sin(heading), 0, view, eye);
    for (const lot of this.lots.values()) lot.commit();
    this.shadows.commit();
  }

  #stand(id, x, y, c, s, speed, view, eye) {
    const actor = this.decoration.get(id) ?? this.scene.actors?.[id];
    const kind = kindOf(actor);
    const { size, swing = 0, gait = 1 } = KINDS[kind];
    const long = actor?.length ?? size[0];
    const wide = actor?.width ?? size[2];
    const high = actor?.height ?? HEIGHTS[kind];
    const [X, , Z] = this.reference.place(x, y);
    const middle = new Vector3(X, high / 2, Z);
    const far = middle.distanceTo(eye);
    if (far > SEEN_WITHIN || view?.intersectsSphere(new Sphere(middle, 0.6 * Math.hypot(long, high, wide))) === false) return;
    const onFoot = kind === "pedestrian" || kind === "child";
    // A person is as deep and wide as people are: the box around one is a safety margin.
    const stretch = onFoot ? [high / size[1], high / size[1], high / size[1]] : [long / size[0], high / size[1], wide / size[2]];
    // The gait follows from the place, not from time: who stands still does not step.
    const phase = (((x * c + y * s) % gait) / gait) * 2 * Math.PI;
    const paint = this.#paint(id, kind);
    const row = [X, Z, c, s, ...stretch, phase, paint.r, paint.g, paint.b, speed > 0.1 ? swing : 0];
    this.bodies.push({ id, kind, x, y, heading: Math.atan2(s, c), length: long, width: wide, height: high, speed });
    this.#lot(kind, far).add(row, this.bodies.length);
    if (far < SHADED_WITHIN) this.shadows.add(onFoot ? shadowRow(X, Z, c, s, 0.9, 0.9, 0.45) : shadowRow(X, Z, c, s, long + 0.4, wide + 0.4));
  }

  #paint(id, kind) {
    if (!this.paints.has(id)) this.paints.set(id, new Color(paintOf(id, kind)));
    return this.paints.get(id);
  }

  /** How many bodies the last picture had. */
  get drawn() {
    return this.bodies.length;
  }

  dispose() {
    for (const lot of [...this.lots.values(), this.shadows]) lot.dispose();
  }
}

/** A body from far away: its lower half, and its upper half in glass. */
function blocks([along, up, across]) {
  const shape = new Shape();
  const thin = along < 2.5 ? 0.6 : 1;
  shape.block([0, 0.38 * up, 0], [along, 0.5 * up, across * thin], "#ffffff", { painted: 1, gloss: 0.3 });
  return shape.block([-0.04 * along, 0.8 * up, 0], [0.6 * along, 0.36 * up, 0.9 * across * thin], "#3c464d", { gloss: 0.5 }, 0.8).geometry();
}
