// What stands on four wheels: saloon, van, truck and bus, each of a stated size; forward +X, the ground at 0.

import { CylinderGeometry } from "three";
import { Shape, moved } from "./shapes.js";

const PAINT = { painted: 1, gloss: 0.42 };
const GLASS = { gloss: 1 };
const [DARK, GLASS_TINT, TYRE, RIM, CHROME] = ["#191b1e", "#10161b", "#17181a", "#8d9297", "#b9bec2"];
const [HEADLIGHT, TAILLIGHT, PLATE] = ["#f3f6f4", "#a8121a", "#dfe0d8"];

/** Add four or more wheels whose outer sides are `z` to both sides, at places along the body. */
function wheels(shape, places, z, radius, width, fine) {
  for (const x of places) for (const side of [-1, 1]) (fine ? wheel : plainWheel)(shape, x, side * z, radius, width);
}

function wheel(shape, x, z, radius, width) {
  const side = Math.sign(z);
  const across = [Math.PI / 2, 0, 0];
  const disc = (share, deep, out) => [new CylinderGeometry(radius * share, radius * share, deep, 18), moved([x, radius, z + side * out], across)];
  shape.part(...disc(1, width, -width / 2), TYRE);
  shape.part(...disc(0.62, 0.02, 0.004), RIM, { gloss: 0.35 });
  shape.part(new CylinderGeometry(radius * 0.2, radius * 0.2, 0.03, 8), moved([x, radius, z + side * 0.008], across), DARK);
}

/** A wheel as an octagon, seen from outside. */
function plainWheel(shape, x, z, radius, width) {
  const ring = (r, at) => Array.from({ length: 8 }, (_, k) => [x + r * Math.cos((k * Math.PI) / 4), radius + r * Math.sin((k * Math.PI) / 4), at]);
  const turned = (corners) => (z > 0 ? corners : [...corners].reverse());
  const [outer, inner] = [ring(radius, z), ring(radius, z - Math.sign(z) * width)];
  shape.face(turned(outer), TYRE).face(turned(ring(radius * 0.6, z + Math.sign(z) * 0.01)), RIM);
  outer.forEach((corner, k) => shape.face(turned([inner[k], inner[(k + 1) % 8], outer[(k + 1) % 8], corner]), TYRE));
}

/** Add the dark hollows that wheels turn in, flush with the sides. */
function arches(shape, places, z, radius) {
  for (const x of places) for (const side of [-1, 1]) {
    const matrix = moved([x, radius * 0.93, side * (z - 0.012)], [Math.PI / 2, 0, 0]);
    shape.part(new CylinderGeometry(radius * 1.2, radius * 1.2, 0.04, 20), matrix, "#0b0c0d");
  }
}

/**
 * Add a body from cross-sections: `stations` from rear to front, each with x, the heights of sill, flank, belt line
 * and top, and half the width at each. Where `glazed` says so, the band over the belt line is glass.
 */
function body(shape, stations, glazed) {
  const ring = ({ x, heights, halves }) => heights.map((y, i) => [x, y, halves[i]]);
  for (let i = 0; i + 1 < stations.length; i++) {
    const [rear, front] = [ring(stations[i]), ring(stations[i + 1])];
    for (let band = 0; band + 1 < rear.length; band++) {
      const glass = band === 2 && glazed[i] === "side";
      const corners = [rear[band], front[band], front[band + 1], rear[band + 1]];
      shape.pair(corners, glass ? GLASS_TINT : "#ffffff", glass ? GLASS : PAINT);
    }
    const over = [rear.at(-1), front.at(-1), mirrored(front.at(-1)), mirrored(rear.at(-1))];
    const pane = glazed[i] === "pane" || stations[i].pane;
    shape.face(over, pane ? GLASS_TINT : "#ffffff", pane ? GLASS : PAINT);
  }
  for (const [station, forward] of [[stations[0], false], [stations.at(-1), true]]) end(shape, ring(station), forward);
}

const mirrored = ([x, y, z]) => [x, y, -z];

/** Close the body at its rear or front end. */
function end(shape, ring, forward) {
  for (let band = 0; band + 1 < ring.length; band++) {
    const quad = [ring[band], ring[band + 1], mirrored(ring[band + 1]), mirrored(ring[band])];
    shape.face(forward ? quad.reverse() : quad, "#ffffff", PAINT);
  }
}

const station = (x, sill, flank, belt, top, halves) => ({ x, heights: [sill, flank, belt, top], halves });

//: a saloon's cross-sections
const SALOON = [
  station(-2.43, 0.27, 0.52, 0.8, 0.9, [0.7, 0.78, 0.74, 0.66]),
  station(-2.37, 0.22, 0.53, 0.9, 0.97, [0.79, 0.87, 0.82, 0.74]),
  station(-2.1, 0.2, 0.55, 0.96, 1.03, [0.84, 0.912, 0.86, 0.78]),
  station(-1.72, 0.19, 0.56, 0.98, 1.06, [0.86, 0.92, 0.87, 0.77]),
  station(-1.0, 0.19, 0.56, 0.97, 1.4, [0.865, 0.925, 0.885, 0.63]),
  station(-0.35, 0.19, 0.56, 0.95, 1.475, [0.865, 0.925, 0.885, 0.65]),
  station(0.35, 0.19, 0.56, 0.94, 1.44, [0.865, 0.925, 0.885, 0.64]),
  station(1.2, 0.19, 0.56, 0.93, 0.985, [0.865, 0.925, 0.875, 0.74]),
  station(1.9, 0.19, 0.55, 0.86, 0.92, [0.86, 0.918, 0.855, 0.7]),
  station(2.26, 0.19, 0.53, 0.77, 0.83, [0.82, 0.89, 0.82, 0.66]),
  station(2.4, 0.2, 0.5, 0.69, 0.74, [0.75, 0.82, 0.76, 0.6]),
  station(2.435, 0.24, 0.48, 0.63, 0.67, [0.68, 0.74, 0.7, 0.54]),
];

/** A saloon of 4.87 m x 1.85 m x 1.48 m: the size of the shipped vehicle models. */
export function saloon(fine) {
  const shape = new Shape();
  body(shape, SALOON, { 3: "pane", 4: "side", 5: "side", 6: "pane" });
  quarterWindows(shape);
  wheels(shape, [-1.43, 1.42], 0.93, 0.335, 0.21, fine);
  arches(shape, [-1.43, 1.42], 0.926, 0.335);
  shape.block([0, 0.21, 0], [4.66, 0.13, 1.66], DARK, {}, 0.98);
  if (fine) trim(shape);
  face(shape);
  return shape.geometry(0.62);
}

/** The triangular panes before and behind a saloon's doors, over the flat sides of the wind-screen and rear window. */
function quarterWindows(shape) {
  shape.pair([[-1.6, 1.075, 0.862], [-1.0, 1.0, 0.889], [-1.0, 1.36, 0.68]], GLASS_TINT, GLASS);
  shape.pair([[0.35, 0.97, 0.889], [1.02, 0.965, 0.878], [0.35, 1.4, 0.67]], GLASS_TINT, GLASS);
}

const LAMP = { glow: 0.35, gloss: 0.6 };
const REAR_LAMP = { glow: 0.5, gloss: 0.4 };

/** The lamps, grille, intake, bumper and plates of a saloon. */
function face(shape) {
  patch(shape, 9, 1, [0.35, 1], [0.3, 0.95], HEADLIGHT, LAMP);
  patch(shape, 10, 1, [0, 1], [0.28, 0.97], HEADLIGHT, LAMP);
  shape.pair([[2.441, 0.53, 0.44], [2.441, 0.53, 0.725], [2.441, 0.625, 0.7], [2.441, 0.625, 0.46]].reverse(), HEADLIGHT, LAMP);
  shape.face([[2.442, 0.5, 0.4], [2.442, 0.5, -0.4], [2.442, 0.62, -0.42], [2.442, 0.62, 0.42]], "#111315", { gloss: 0.4 });
  shape.face([[2.444, 0.62, 0.42], [2.444, 0.62, -0.42], [2.444, 0.64, -0.42], [2.444, 0.64, 0.42]], CHROME, { gloss: 0.8 });
  shape.face([[2.447, 0.41, 0.26], [2.447, 0.41, -0.26], [2.447, 0.52, -0.26], [2.447, 0.52, 0.26]], PLATE);
  shape.face([[2.441, 0.22, 0.66], [2.441, 0.22, -0.66], [2.441, 0.36, -0.7], [2.441, 0.36, 0.7]], DARK);
  patch(shape, 10, 0, [0, 1], [-0.1, 0.5], DARK, {});
  patch(shape, 1, 1, [0, 0.55], [0.42, 0.92], TAILLIGHT, REAR_LAMP);
  patch(shape, 0, 1, [0, 1], [0.4, 0.95], TAILLIGHT, REAR_LAMP);
  shape.pair([[-2.436, 0.66, 0.4], [-2.436, 0.66, 0.757], [-2.436, 0.79, 0.742], [-2.436, 0.79, 0.42]], TAILLIGHT, REAR_LAMP);
  shape.face([[-2.438, 0.22, -0.69], [-2.438, 0.22, 0.69], [-2.438, 0.38, 0.74], [-2.438, 0.38, -0.74]], DARK);
  patch(shape, 0, 0, [0, 1], [-0.1, 0.44], DARK, {});
  shape.face([[-2.441, 0.62, -0.26], [-2.441, 0.62, 0.26], [-2.441, 0.73, 0.26], [-2.441, 0.73, -0.26]], PLATE);
}

/** Paint a part of both sides of the body: from one cross-section to the next, of one band, by shares of both. */
function patch(shape, from, band, [rear, front], [low, high], colour, look) {
  const ring = ({ x, heights, halves }) => [band, band + 1].map((i) => [x, heights[i], halves[i]]);
  const [back, ahead] = [ring(SALOON[from]), ring(SALOON[from + 1])];
  const between = (a, b, share) => a.map((value, k) => value + share * (b[k] - value));
  const at = (along, up) => between(between(back[0], back[1], up), between(ahead[0], ahead[1], up), along);
  // In front of the paint by as much as pictures from afar tell apart.
  const out = ([x, y, z]) => [x + Math.sign(x) * 0.006, y, z + 0.008];
  shape.pair([at(rear, low), at(front, low), at(front, high), at(rear, high)].map(out), colour, look);
}

/** What is seen of a saloon only from near: mirrors, pillars, seams of the doors, handles. */
function trim(shape) {
  for (const side of [-1, 1]) {
    shape.block([0.92, 1.0, side * 0.98], [0.12, 0.13, 0.2], "#ffffff", PAINT, 0.8);
    shape.block([0.86, 1.0, side * 0.98], [0.01, 0.1, 0.17], "#3b4650", GLASS);
  }
  shape.pair([[-0.36, 0.95, 0.894], [-0.28, 0.95, 0.894], [-0.28, 1.46, 0.664], [-0.36, 1.465, 0.664]], "#101214");
  for (const x of [-0.33, 0.72, -1.12]) {
    shape.pair([[x, 0.4, 0.905], [x + 0.014, 0.4, 0.905], [x + 0.014, 0.93, 0.903], [x, 0.93, 0.903]], "#101214");
  }
  for (const x of [-0.18, -0.98]) shape.pair([[x, 0.8, 0.917], [x + 0.17, 0.8, 0.917], [x + 0.17, 0.83, 0.915], [x, 0.83, 0.915]], CHROME, { gloss: 0.8 });
}

/** A van of 5.5 m x 2.0 m x 2.4 m. */
export function van(fine) {
  const shape = new Shape();
  const stations = [
    station(-2.75, 0.4, 0.6, 1.35, 2.32, [0.92, 0.96, 0.96, 0.82]),
    station(-2.6, 0.3, 0.6, 1.35, 2.38, [0.95, 0.99, 0.98, 0.84]),
    station(0.7, 0.28, 0.6, 1.35, 2.4, [0.95, 0.99, 0.98, 0.84]),
    station(1.35, 0.28, 0.6, 1.33, 2.25, [0.95, 0.99, 0.98, 0.8]),
    station(2.05, 0.29, 0.6, 1.25, 1.32, [0.94, 0.99, 0.93, 0.82]),
    station(2.6, 0.32, 0.58, 1.0, 1.08, [0.85, 0.92, 0.84, 0.72]),
    station(2.75, 0.4, 0.56, 0.85, 0.9, [0.72, 0.78, 0.72, 0.62]),
  ];
  body(shape, stations, { 2: "side", 3: "pane" });
  shape.pair([[1.35, 1.36, 0.985], [1.9, 1.3, 0.945], [1.35, 2.2, 0.82]], GLASS_TINT, GLASS);
  shape.face([[-2.76, 1.45, -0.75], [-2.76, 1.45, 0.75], [-2.755, 2.1, 0.68], [-2.755, 2.1, -0.68]], GLASS_TINT, GLASS);
  shape.pair([[2.62, 0.72, 0.88], [2.74, 0.7, 0.66], [2.7, 0.86, 0.66], [2.58, 0.9, 0.86]], HEADLIGHT, { glow: 0.35 });
  shape.pair([[-2.765, 0.75, 0.78], [-2.72, 0.75, 0.97], [-2.72, 1.3, 0.97], [-2.765, 1.3, 0.84]], TAILLIGHT, { glow: 0.5 });
  wheels(shape, [-1.75, 1.75], 0.995, 0.36, 0.22, fine);
  if (fine) arches(shape, [-1.75, 1.75], 0.985, 0.36);
  if (fine) for (const side of [-1, 1]) shape.block([1.6, 1.45, side * 1.1], [0.14, 0.3, 0.2], DARK);
  return shape.geometry(0.6);
}

/** A rigid truck of 8.5 m x 2.5 m x 3.4 m. */
export function truck(fine) {
  const shape = new Shape();
  shape.block([-1.05, 2.15, 0], [6.3, 2.5, 2.5], "#e4e6e6", { gloss: 0.15 });
  shape.block([-1.05, 0.72, 0], [6.2, 0.3, 1.1], DARK);
  shape.block([3.25, 1.05, 0], [2.0, 0.95, 2.4], "#ffffff", PAINT);
  shape.block([3.2, 2.15, 0], [1.85, 1.3, 2.35], "#ffffff", PAINT, 0.9);
  shape.face([[4.155, 1.6, 1.05], [4.155, 1.6, -1.05], [4.06, 2.6, -0.98], [4.06, 2.6, 0.98]], GLASS_TINT, GLASS);
  shape.pair([[2.75, 1.65, 1.19], [3.85, 1.65, 1.19], [3.8, 2.5, 1.1], [2.8, 2.5, 1.1]], GLASS_TINT, GLASS);
  shape.pair([[4.255, 0.75, 1.1], [4.255, 0.75, 0.75], [4.255, 0.95, 0.75], [4.255, 0.95, 1.1]], HEADLIGHT, { glow: 0.35 });
  shape.pair([[-4.22, 0.75, 0.8], [-4.22, 0.75, 1.15], [-4.22, 0.95, 1.15], [-4.22, 0.95, 0.8]], TAILLIGHT, { glow: 0.5 });
  wheels(shape, [-2.9, -1.75, 3.2], 1.22, 0.48, 0.32, fine);
  return shape.geometry(0.4);
}

/** A city bus of 12 m x 2.55 m x 3.1 m. */
export function bus(fine) {
  const shape = new Shape();
  shape.block([0, 0.75, 0], [11.9, 0.85, 2.5], "#ffffff", PAINT);
  shape.block([0, 1.8, 0], [11.95, 1.25, 2.5], GLASS_TINT, GLASS);
  shape.block([0, 2.75, 0], [11.95, 0.66, 2.5], "#ffffff", PAINT, 0.97);
  if (fine) for (const x of [-5.85, -3.9, -1.95, 0.0, 1.95, 3.9, 5.75]) {
    for (const side of [-1, 1]) shape.block([x, 1.8, side * 1.25], [0.12, 1.25, 0.03], "#ffffff", PAINT);
  }
  shape.face([[6.0, 2.5, 0.8], [6.0, 2.5, -0.8], [6.0, 2.8, -0.8], [6.0, 2.8, 0.8]], "#e9a13a", { glow: 0.5 });
  shape.pair([[5.97, 0.55, 1.15], [5.97, 0.55, 0.8], [5.97, 0.75, 0.8], [5.97, 0.75, 1.15]], HEADLIGHT, { glow: 0.35 });
  shape.pair([[-5.98, 0.6, 0.85], [-5.98, 0.6, 1.15], [-5.98, 1.0, 1.15], [-5.98, 1.0, 0.85]], TAILLIGHT, { glow: 0.5 });
  wheels(shape, [-3.3, 3.3], 1.262, 0.48, 0.3, fine);
  return shape.geometry(0.4);
}
