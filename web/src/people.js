// Who walks and rides: pedestrian, child, cyclist, motorcyclist; forward +X, the ground at 0. Legs and arms are limbs,
// which the shader swings about their joints.

import { CapsuleGeometry, CylinderGeometry, SphereGeometry, TorusGeometry } from "three";
import { Shape, moved } from "./shapes.js";

const COAT = { painted: 1 };
const [SKIN, TROUSERS, SHOE, HAIR, TYRE, STEEL] = ["#cfa384", "#2f3a4c", "#1d1d1f", "#33281f", "#17181a", "#7c838a"];
const ALONG_Z = [Math.PI / 2, 0, 0];

/** Add a rod from one point to another, open at its ends. */
function rod(shape, from, to, radius, colour, look = {}, segments = 5) {
  const [dx, dy, dz] = to.map((value, i) => value - from[i]);
  const long = Math.hypot(dx, dy, dz);
  const flat = Math.hypot(dx, dz);
  const middle = from.map((value, i) => (value + to[i]) / 2);
  const turn = [0, Math.atan2(-dz, dx), 0];
  // The cylinder stands along Y: lean it forward first, then turn it about Y.
  const matrix = moved(middle, turn).multiply(moved([0, 0, 0], [0, 0, -Math.atan2(flat, dy)]));
  return shape.part(rodOf(radius, long, segments), matrix, colour, look);
}

const rodOf = (radius, length, segments) => new CylinderGeometry(radius, radius, length, segments, 1, true);

/** A grown-up who walks, 0.5 m x 0.5 m x 1.75 m. */
export function pedestrian(fine) {
  const shape = new Shape();
  for (const side of [-1, 1]) {
    const [leg, arm] = [{ limb: side, joint: 0.9 }, { ...COAT, limb: -side * 0.8, joint: 1.4 }];
    // Hip, knee and ankle; shoulder, elbow and wrist, a little bent.
    tapered(shape, [[0, 0.9, side * 0.085, 0.088], [0.015, 0.5, side * 0.1, 0.068], [-0.02, 0.09, side * 0.105, 0.05]], TROUSERS, leg, fine);
    shoe(shape, side * 0.105, leg);
    tapered(shape, [[0, 1.43, side * 0.19, 0.066], [-0.02, 1.14, side * 0.235, 0.052], [0.05, 0.9, side * 0.235, 0.042]], "#ffffff", arm, fine);
    if (fine) shape.part(new SphereGeometry(0.05, 8, 6).scale(0.9, 1.3, 0.7), moved([0.065, 0.83, side * 0.235]), SKIN, { ...arm, painted: 0 });
  }
  // Hips, hem of the jacket, waist, chest, shoulders, neck: half depth and half width at each height.
  const rings = [[0.83, 0.13, 0.185], [0.87, 0.14, 0.195], [1.05, 0.12, 0.175], [1.28, 0.135, 0.205], [1.42, 0.11, 0.215], [1.475, 0.07, 0.1], [1.5, 0.055, 0.06]];
  lathed(shape, rings, "#ffffff", COAT, fine ? 14 : 7);
  head(shape, [0.01, 1.63, 0], fine);
  return shape.geometry(0.9);
}

/** Add rods from point to point [x, y, z, radius], each as thick at its ends as the points say, with round joints. */
function tapered(shape, points, colour, look, fine) {
  for (let i = 0; i + 1 < points.length; i++) {
    const [[x, y, z, r], [u, v, w, q]] = [points[i], points[i + 1]];
    const long = Math.hypot(u - x, v - y, w - z);
    const matrix = moved([(x + u) / 2, (y + v) / 2, (z + w) / 2], [Math.asin((z - w) / long), 0, Math.atan2(u - x, y - v)]);
    shape.part(new CylinderGeometry(r, q, long * 1.02, fine ? 9 : 5, 1, true), matrix, colour, look);
    if (fine) shape.part(new SphereGeometry(r, 9, 6), moved([x, y, z]), colour, look);
  }
}

/** Add a shoe whose sole is on the ground. */
function shoe(shape, z, look) {
  shape.block([0.045, 0.05, z], [0.27, 0.1, 0.1], SHOE, look, 0.82);
  shape.block([0.05, 0.012, z], [0.29, 0.024, 0.11], "#c9c7c2", look);
}

/** Add a body of ellipses about the axis Y: height, half depth and half width of each. */
function lathed(shape, rings, colour, look, around) {
  const point = ([y, deep, wide], k) => [deep * Math.cos((2 * Math.PI * k) / around), y, wide * Math.sin((2 * Math.PI * k) / around)];
  for (let i = 0; i + 1 < rings.length; i++) {
    for (let k = 0; k < around; k++) {
      shape.face([point(rings[i], k + 1), point(rings[i], k), point(rings[i + 1], k), point(rings[i + 1], k + 1)], colour, look);
    }
  }
}

/** Add a trunk that leans forward by an angle [rad]. */
function torso(shape, at, length, fine, lean = 0) {
  const trunk = new CapsuleGeometry(0.155, length, fine ? 3 : 1, fine ? 10 : 6);
  trunk.scale(0.72, 1, 1.18);
  shape.part(trunk, moved(at, [0, 0, -lean]), "#ffffff", COAT);
}

function head(shape, [x, y, z], fine, covered = false) {
  const [around, up] = fine ? [12, 9] : [5, 4];
  shape.part(new CylinderGeometry(0.05, 0.055, 0.12, 6), moved([x - 0.01, y - 0.13, z]), SKIN);
  shape.part(new SphereGeometry(0.105, around, up).scale(0.95, 1.15, 0.82), moved([x, y, z]), SKIN);
  if (fine) shape.block([x + 0.1, y - 0.01, z], [0.04, 0.045, 0.03], SKIN);
  const cap = new SphereGeometry(covered ? 0.135 : 0.117, around, up, 0, 2 * Math.PI, 0, covered ? 1.75 : 1.5).scale(0.98, 1.12, 0.9);
  shape.part(cap, moved([x - 0.02, y + 0.015, z], [0, 0, 0.25]), covered ? "#d8dcdf" : HAIR, { gloss: covered ? 0.4 : 0 });
}

/** A rider's trunk, arms, head and legs over a seat; `lean` is how far the shoulders are before the hips [m]. */
function rider(shape, seat, lean, grip, pedal, fine, swings) {
  const shoulder = [seat[0] + lean, seat[1] + 0.5, 0];
  const back = rodded([seat[0], seat[1] + 0.05, 0], shoulder);
  torso(shape, back.middle, back.long * 0.55, fine, back.angle);
  for (const side of [-1, 1]) {
    rod(shape, [shoulder[0], shoulder[1] - 0.04, side * 0.19], [grip[0], grip[1], side * grip[2]], 0.048, "#ffffff", COAT);
    const knee = [seat[0] + 0.4, (seat[1] + pedal[1]) / 2 + 0.18 + side * swings * 0.1, side * 0.11];
    rod(shape, [seat[0], seat[1], side * 0.1], knee, 0.072, TROUSERS);
    rod(shape, knee, [pedal[0], pedal[1] + side * swings * 0.14, side * 0.12], 0.055, TROUSERS);
    shape.block([pedal[0] + 0.05, pedal[1] - 0.03 + side * swings * 0.14, side * 0.12], [0.24, 0.07, 0.09], SHOE);
  }
  head(shape, [shoulder[0] + 0.08, shoulder[1] + 0.23, 0], fine, true);
}

function rodded(from, to) {
  const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
  return { long: Math.hypot(dx, dy), middle: from.map((value, i) => (value + to[i]) / 2), angle: Math.atan2(dx, dy) };
}

/** A cyclist of 1.75 m x 0.6 m x 1.75 m. */
export function cyclist(fine) {
  const shape = new Shape();
  for (const x of [-0.53, 0.53]) {
    shape.part(new TorusGeometry(0.325, 0.022, fine ? 6 : 3, fine ? 24 : 10), moved([x, 0.345, 0]), TYRE);
    if (fine) for (let k = 0; k < 6; k++) {
      const [c, s] = [Math.cos((k * Math.PI) / 6) * 0.31, Math.sin((k * Math.PI) / 6) * 0.31];
      rod(shape, [x - c, 0.345 - s, 0], [x + c, 0.345 + s, 0], 0.004, STEEL, {}, 3);
    }
  }
  const frame = [[[-0.53, 0.345, 0], [-0.12, 0.3, 0]], [[-0.12, 0.3, 0], [-0.22, 0.86, 0]], [[-0.53, 0.345, 0], [-0.2, 0.78, 0]],
    [[-0.2, 0.78, 0], [0.36, 0.82, 0]], [[-0.12, 0.3, 0], [0.38, 0.72, 0]], [[0.53, 0.345, 0], [0.35, 0.98, 0]]];
  for (const [from, to] of frame) rod(shape, from, to, 0.018, "#b23a2e", { gloss: 0.3 });
  rod(shape, [0.35, 0.98, -0.24], [0.35, 0.98, 0.24], 0.014, TYRE);
  shape.block([-0.23, 0.9, 0], [0.26, 0.05, 0.14], TYRE);
  rider(shape, [-0.2, 0.95, 0], 0.32, [0.34, 1.0, 0.22], [-0.08, 0.32, 0], fine, 1);
  return shape.geometry();
}

/** A motorcyclist of 2.1 m x 0.8 m x 1.5 m. */
export function motorcyclist(fine) {
  const shape = new Shape();
  for (const x of [-0.7, 0.72]) {
    shape.part(new TorusGeometry(0.25, 0.07, fine ? 8 : 4, fine ? 22 : 10), moved([x, 0.32, 0]), TYRE);
    shape.part(new CylinderGeometry(0.17, 0.17, 0.06, 12), moved([x, 0.32, 0], ALONG_Z), STEEL, { gloss: 0.4 });
  }
  shape.block([0.02, 0.45, 0], [0.6, 0.34, 0.3], "#26282b", { gloss: 0.3 });
  shape.block([0.2, 0.78, 0], [0.5, 0.24, 0.28], "#ffffff", { painted: 1, gloss: 0.5 }, 0.75);
  shape.block([-0.4, 0.74, 0], [0.75, 0.1, 0.26], TYRE);
  rod(shape, [0.72, 0.32, 0.09], [0.42, 1.0, 0.09], 0.028, STEEL, { gloss: 0.5 });
  rod(shape, [0.72, 0.32, -0.09], [0.42, 1.0, -0.09], 0.028, STEEL, { gloss: 0.5 });
  rod(shape, [0.4, 1.02, -0.36], [0.4, 1.02, 0.36], 0.018, TYRE);
  shape.part(new SphereGeometry(0.1, fine ? 10 : 5, fine ? 8 : 4), moved([0.6, 0.88, 0]), "#f3f6f4", { glow: 0.3, gloss: 0.6 });
  shape.block([-0.83, 0.72, 0], [0.04, 0.08, 0.16], "#a8121a", { glow: 0.5 });
  rider(shape, [-0.32, 0.8, 0], 0.3, [0.38, 1.03, 0.3], [0.0, 0.34, 0], fine, 0);
  return shape.geometry();
}
