// The ego: its body, seen from outside, and its cockpit, seen from the driver's seat. Both stand on the rear axle.

import { CylinderGeometry, Group, Mesh, TorusGeometry } from "three";
import { shadowRow, shadows } from "./instances.js";
import { bodyMaterial } from "./shading.js";
import { Shape, moved } from "./shapes.js";
import { saloon } from "./vehicles.js";

export const PAINT = "#0072b2"; //: the ego's colour in every picture
const [COCKPIT, SEAM, LEATHER] = ["#33373b", "#1d2022", "#26292c"];
//: of the seat's occupant where a scene says nothing: before, left of and over the rear axle [m]
const EYE = [1.25, 0.37, 1.22];
const SIZE = { length: 4.87, width: 1.85, height: 1.48, rear_overhang: 1.0 };

export class Ego {
  constructor(described = {}) {
    const size = { ...SIZE, ...Object.fromEntries(Object.entries(described).filter(([, value]) => value != null)) };
    this.eye = size.eye ?? EYE;
    this.steeringRatio = size.steering_ratio ?? 15;
    this.group = new Group();
    this.group.rotation.order = "YXZ";
    this.outside = new Mesh(saloon(true), bodyMaterial({ coat: PAINT }));
    this.outside.userData.kind = "ego";
    this.outside.scale.set(size.length / 4.87, size.height / 1.48, size.width / 1.86);
    this.outside.position.x = size.length / 2 - size.rear_overhang;
    this.shadow = shadows();
    this.size = size;
    this.inside = new Group();
    this.inside.add(new Mesh(cockpit(this.eye, size), bodyMaterial({ coat: PAINT })));
    this.wheel = new Group();
    this.wheel.add(new Mesh(steeringWheel(), bodyMaterial()));
    const column = new Group();
    const [forward, left, up] = this.eye;
    column.position.set(forward + 0.47, up - 0.36, -left);
    column.rotation.z = -0.42;
    column.add(this.wheel);
    this.inside.add(column);
    // First of all: what the cockpit hides need not be shaded.
    this.inside.traverse((one) => {
      one.renderOrder = -20;
    });
    this.group.add(this.outside, this.inside);
  }

  /** Stand at a place of the scene with a heading [rad] and the road wheels turned [rad, left positive]. */
  stand([X, Y, Z], heading, steering) {
    this.group.position.set(X, Y, Z);
    this.group.rotation.y = heading;
    // The wheel's axle points at the driver, along -X: left is counter-clockwise as the driver sees it.
    this.wheel.rotation.x = -(steering ?? 0) * this.steeringRatio;
    this.group.updateMatrixWorld(true);
    const { length, width, rear_overhang: overhang } = this.size;
    const [c, s, ahead] = [Math.cos(heading), Math.sin(heading), length / 2 - overhang];
    this.shadow.clear();
    this.shadow.add(shadowRow(X + c * ahead, Z - s * ahead, c, s, length + 0.4, width + 0.4));
    this.shadow.commit();
  }

  /** Show the cockpit, or else the body from outside. */
  seenFromInside(inside) {
    this.inside.visible = inside;
    this.outside.visible = !inside;
  }
}

/** Bonnet, dashboard, pillars, roof's edge, mirror and doors, about an eye [forward, left, up] from the rear axle. */
function cockpit([forward, left, up], { length, width, rear_overhang: overhang }) {
  const shape = new Shape();
  const nose = length - overhang;
  const half = width / 2;
  // From here on: forward of the eye, over the eye, right of the car's middle.
  const at = (x, y, z) => [forward + x, up + y, z];
  const [cowl, tip] = [1.05, nose - forward];
  bonnet(shape, at, cowl, tip, half);
  shape.face([at(0.62, -0.3, half), at(0.62, -0.3, -half), at(cowl, -0.235, -half), at(cowl, -0.235, half)].reverse(), COCKPIT, { gloss: 0.05 });
  shape.face([at(0.62, -0.3, half), at(0.56, -0.75, half), at(0.56, -0.75, -half), at(0.62, -0.3, -half)].reverse(), LEATHER);
  hood(shape, at, -left);
  for (const side of [-1, 1]) {
    pillar(shape, at, side, half);
    shape.block(at(0.1, -0.35, side * (half - 0.03)), [2.0, 0.18, 0.12], COCKPIT);
    shape.block(at(0.5, -0.16, side * (half + 0.15)), [0.12, 0.15, 0.22], "#ffffff", { painted: 1, gloss: 0.4 }, 0.85);
    shape.block(at(0.435, -0.16, side * (half + 0.15)), [0.01, 0.12, 0.19], "#8fa3ae", { gloss: 0.9 });
  }
  shape.face([at(0.38, 0.2, half - 0.16), at(0.38, 0.2, -half + 0.16), at(-0.4, 0.24, -half + 0.16), at(-0.4, 0.24, half - 0.16)], "#8d8b86");
  shape.block(at(0.6, 0.24, 0), [0.02, 0.12, 0.03], SEAM);
  shape.block(at(0.58, 0.16, 0), [0.04, 0.06, 0.22], LEATHER, {}, 0.95);
  shape.block(at(0.558, 0.16, 0), [0.004, 0.048, 0.2], "#9fb3bd", { gloss: 0.5 });
  return shape.geometry(0.5);
}

/** The bonnet, curved down to its tip and to its sides. */
function bonnet(shape, at, cowl, tip, half) {
  const [rows, columns] = [8, 10];
  const point = (i, j) => {
    const [u, v] = [i / rows, (j / columns) * 2 - 1];
    const drop = 0.285 + 0.06 * u + 0.16 * u ** 3 + 0.05 * v * v + 0.1 * v ** 6;
    return at(cowl - 0.1 + u * (tip - cowl + 0.05), -drop, v * (half - 0.06 - 0.1 * u * u));
  };
  for (let i = 0; i < rows; i++) {
    for (let j = 0; j < columns; j++) {
      shape.face([point(i, j), point(i, j + 1), point(i + 1, j + 1), point(i + 1, j)], "#ffffff", { painted: 1, gloss: 0.4 });
    }
  }
}

/** The cover over the instruments, and their face, before the driver. */
function hood(shape, at, z) {
  shape.block(at(0.66, -0.245, z), [0.22, 0.05, 0.42], SEAM, {}, 0.85);
  shape.face([at(0.575, -0.36, z - 0.19), at(0.575, -0.36, z + 0.19), at(0.6, -0.265, z + 0.17), at(0.6, -0.265, z - 0.17)].reverse(), "#0d1a22", { glow: 0.4 });
  shape.block(at(0.63, -0.36, 0.04), [0.03, 0.17, 0.32], SEAM, {}, 0.97);
  shape.face([at(0.613, -0.435, -0.1), at(0.613, -0.435, 0.18), at(0.613, -0.29, 0.18), at(0.613, -0.29, -0.1)], "#15313f", { glow: 0.35 });
}

/** A pillar beside the wind-screen, from the dashboard's corner to the roof. */
function pillar(shape, at, side, half) {
  const [foot, top] = [[0.98, -0.26, half - 0.07], [0.3, 0.21, half - 0.19]];
  const [thick, deep] = [0.05, 0.06];
  const ring = ([x, y, z]) => [[x + deep, y, z], [x - deep, y, z], [x - deep, y, z - thick], [x + deep, y, z - thick]];
  const [low, high] = [ring(foot), ring(top)].map((corners) => corners.map(([x, y, z]) => at(x, y, side * z)));
  for (let i = 0; i < 4; i++) {
    const j = (i + 1) % 4;
    const quad = [low[i], low[j], high[j], high[i]];
    // Seen from both sides of the glass.
    shape.face(quad, COCKPIT).face([...quad].reverse(), COCKPIT);
  }
}

/** A steering wheel about the axis X, its face towards -X. */
function steeringWheel() {
  const shape = new Shape();
  const facing = [0, Math.PI / 2, 0];
  shape.part(new TorusGeometry(0.185, 0.016, 10, 40), moved([0, 0, 0], facing), LEATHER, { gloss: 0.12 });
  shape.part(new CylinderGeometry(0.062, 0.075, 0.04, 20), moved([0.01, -0.01, 0], [0, 0, Math.PI / 2]), "#222528", { gloss: 0.1 });
  for (const z of [-1, 1]) shape.block([0.005, -0.005, z * 0.12], [0.022, 0.05, 0.13], "#222528");
  shape.block([0.005, -0.12, 0], [0.022, 0.13, 0.045], "#222528");
  return shape.geometry(0.5);
}
