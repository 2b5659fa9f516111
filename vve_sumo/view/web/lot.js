// The lot from above, north up: its edge and margin, what stands in it, the car, and the ground that a stop would cover.

import { addBox, colour, line, rimmed, sized } from "./canvas.js";
import { say } from "./elements.js";

const PADDING = 26; // around the lot [pixels]
const CLOSE = 45; // half the side of the part that is shown close by [m]

export class Lot {
  constructor(canvas, words, scene) {
    this.canvas = canvas;
    this.words = words;
    this.scene = scene;
    this.close = false;
    const lot = scene.lot;
    if (!lot) return;
    this.ground = line(lot.outline, true);
    for (const hole of lot.holes) this.ground.addPath(line(hole, true));
    this.edges = lot.edges.map((edge) => line(edge, true));
    const xs = lot.outline.map(([x]) => x);
    const ys = lot.outline.map(([, y]) => y);
    this.box = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
    canvas.addEventListener("click", () => { this.close = !this.close; });
  }

  /** Draw one frame. */
  draw(frame) {
    if (!this.scene.lot) return;
    const { context, width, height, ratio } = sized(this.canvas);
    context.clearRect(0, 0, width, height);
    say(this.words, this.said(frame));
    const real = frame?.real ?? null;
    const view = this.close && real ? this.closeBy(real, width, height) : this.whole(width, height);
    context.save();
    context.setTransform(ratio * view.zoom, 0, 0, -ratio * view.zoom, ratio * view.left, ratio * view.top);
    context.fillStyle = colour("lot");
    context.fill(this.ground, "evenodd");
    context.lineWidth = 2 / view.zoom;
    context.strokeStyle = colour("edge");
    context.stroke(this.ground);
    context.lineWidth = 1 / view.zoom;
    context.setLineDash([6 / view.zoom, 4 / view.zoom]);
    for (const edge of this.edges) context.stroke(edge);
    context.setLineDash([]);
    if (frame?.footprint) this.drawFootprint(context, frame.footprint, view.zoom);
    if (real) this.drawCar(context, real, view.zoom);
    context.restore();
    rimmed(context, "N ↑", width - 12, height - 16, colour("ink"), colour("panel"), 15, "right");
  }

  said(frame) {
    if (!frame || frame.to_edge === null || frame.to_edge === undefined) return "the lot";
    return frame.to_edge > 0 ? `the lot: ${frame.to_edge.toFixed(1)} m to the edge` : "the lot: over the edge";
  }

  whole(width, height) {
    const [left, bottom, right, top] = this.box;
    const zoom = Math.min((width - 2 * PADDING) / (right - left), (height - 2 * PADDING) / (top - bottom));
    return {
      zoom,
      left: width / 2 - (zoom * (left + right)) / 2,
      top: height / 2 + PADDING / 3 + (zoom * (bottom + top)) / 2,
    };
  }

  closeBy(real, width, height) {
    const zoom = Math.min(width, height) / (2 * CLOSE);
    return { zoom, left: width / 2 - zoom * real.x, top: height / 2 + zoom * real.y };
  }

  drawFootprint(context, footprint, zoom) {
    const ground = line(footprint, true);
    context.fillStyle = colour("footprint");
    context.globalAlpha = 0.45;
    context.fill(ground);
    context.globalAlpha = 1;
    context.lineWidth = 1.5 / zoom;
    context.strokeStyle = colour("footprint");
    context.stroke(ground);
  }

  drawCar(context, real, zoom) {
    const ego = this.scene.ego;
    const middle = ego.length / 2 - ego.rear_overhang;
    const x = real.x + middle * Math.cos(real.heading);
    const y = real.y + middle * Math.sin(real.heading);
    const grown = Math.max(1, 11 / (ego.length * zoom));
    const body = new Path2D();
    addBox(body, x, y, real.heading, (grown * ego.length) / 2, (grown * ego.width) / 2);
    context.fillStyle = colour("ego");
    context.fill(body);
    context.lineWidth = 1.5 / zoom;
    context.strokeStyle = colour("paper");
    context.stroke(body);
  }
}
