// The street from above: lanes, path, sensors, traffic and the ego, to scale. Draws a scene and one frame of it.

import { addBox, colour, line, rimmed, sized } from "./canvas.js";

const TILE = 120; // lanes are kept by squares of this size [m]
const ZOOMS = [0.15, 16]; // pixels a metre
const AHEAD = [18, 2.7, 75]; // metres shown ahead: at rest, more for each m/s, at most
const EGO_PLACE = 0.68; // of the canvas's height, with the heading up
const GAP_SHOWN = 100; // a gap longer than this is not drawn [m]
const MARK_ZOOM = 1.5; // lane marks are drawn from this many pixels a metre on
const OLD_READING = 1.5; // a reading that was measured longer ago is not shown [s]; the radar's latency is at most a second
const OUTLINED = 250; // with more actors than this in sight none has an outline

const PERSON = 0.35; // half the width of the mark in the middle of a person's area [m]
const WIDE = new Set(["area", "warning"]); // how somebody is there as an area

const SENSED = 4; // colours of sensors; after the last they begin again

/** What the colours of bodies and of each sensor's readings mean: name of the colour, words, how it is drawn. */
export function legendOf(scene) {
  const sensors = scene.sensors;
  return [
    ["seen", "detected", "fill"],
    ["occluded", "hidden", "rim"],
    ["missed", "missed", "fill"],
    ["outside", "out of view", "fill"],
    ...sensors.map(({ name, shape }, n) => [sensedColour(n), `measured by ${name}`, shape === "boxes" ? "rim" : "dot"]),
    ...(scene.people.length ? [["person", "holds the person with 95 %", "rim"]] : []),
    ...(sensors.some((sensor) => sensor.names_actors) ? [["false", "false alarm", "rim"]] : []),
  ];
}

const sensedColour = (n) => `sensed${n % SENSED}`;

export class Street {
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    this.factor = 1;
    this.zoom = 5;
    this.northUp = false;
    this.shift = [0, 0];
    this.tiles = tiled(scene.lanes);
    this.path = line(scene.path);
    this.listen();
  }

  /** Zoom by a factor; how much is in sight also follows the speed. */
  zoomBy(factor) {
    this.factor = Math.min(Math.max(this.factor * factor, 0.02), 8);
  }

  /** Pixels a metre for a speed [m/s] on a canvas of a height. */
  zoomAt(speed, height) {
    const ahead = Math.min(AHEAD[0] + AHEAD[1] * Math.max(speed, 0), AHEAD[2]);
    const zoom = (this.factor * height * EGO_PLACE) / ahead;
    return Math.min(Math.max(zoom, ZOOMS[0]), ZOOMS[1]);
  }

  listen() {
    const fingers = new Map();
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoomBy(Math.exp(-event.deltaY / 500));
    }, { passive: false });
    this.canvas.addEventListener("pointerdown", (event) => {
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      this.canvas.setPointerCapture(event.pointerId);
    });
    for (const kind of ["pointerup", "pointercancel"]) {
      this.canvas.addEventListener(kind, (event) => fingers.delete(event.pointerId));
    }
    this.canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY];
      const others = [...fingers].filter(([id]) => id !== event.pointerId);
      if (others.length) {
        const other = others[0][1];
        const far = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]);
        this.zoomBy(far(now) / Math.max(far(before), 1));
      } else {
        this.shift = [this.shift[0] + now[0] - before[0], this.shift[1] + now[1] - before[1]];
      }
      fingers.set(event.pointerId, now);
    });
    this.canvas.addEventListener("dblclick", () => { this.shift = [0, 0]; });
  }

  /** Draw one frame; null before the first. */
  draw(newest) {
    const frame = withoutOldReadings(newest);
    const { context, width, height, ratio } = sized(this.canvas);
    context.fillStyle = colour("ground");
    context.fillRect(0, 0, width, height);
    const ego = frame?.ego ?? this.lastEgo ?? startOf(this.scene);
    this.lastEgo = ego;
    this.zoom = this.zoomAt(ego.speed ?? 0, height);
    const turn = this.northUp ? 0 : Math.PI / 2 - ego.heading;
    const place = [width / 2 + this.shift[0], height * (this.northUp ? 0.5 : EGO_PLACE) + this.shift[1]];
    const cos = this.zoom * Math.cos(turn);
    const sin = this.zoom * Math.sin(turn);
    const view = {
      // Screen y grows downwards: x' = cos x - sin y, y' = -(sin x + cos y), about the ego.
      screen: (x, y) => [
        place[0] + cos * (x - ego.x) - sin * (y - ego.y),
        place[1] - sin * (x - ego.x) - cos * (y - ego.y),
      ],
      reach: Math.hypot(width, height) / this.zoom + Math.hypot(...this.shift) / this.zoom,
      ego,
      width,
      height,
    };
    context.save();
    context.setTransform(
      ratio * cos, -ratio * sin, -ratio * sin, -ratio * cos,
      ratio * (place[0] - cos * ego.x + sin * ego.y), ratio * (place[1] + sin * ego.x + cos * ego.y),
    );
    this.drawRoad(context, view);
    this.drawWay(context);
    if (frame?.commanded) this.drawCommanded(context, frame.commanded);
    if (frame?.ego) this.drawViews(context, ego);
    if (frame) {
      this.drawTraffic(context, frame, view);
      this.drawPeople(context, frame);
    }
    this.drawEgo(context, ego, Boolean(frame?.ego));
    if (frame) this.drawSensed(context, frame);
    context.restore();
    if (frame?.ego) this.drawGap(context, frame, view);
    if (frame) this.drawNames(context, frame, view);
    this.drawScale(context, width, height);
  }

  drawRoad(context, view) {
    const near = this.tiles.filter((tile) => Math.hypot(tile.x - view.ego.x, tile.y - view.ego.y) < view.reach + tile.reach);
    context.lineCap = "butt";
    context.lineJoin = "round";
    const strokes = (kind, name, grown) => {
      context.strokeStyle = colour(name);
      for (const tile of near) {
        for (const [width, path] of tile.kinds[kind] ?? []) {
          context.lineWidth = width + grown;
          context.stroke(path);
        }
      }
    };
    const marked = this.zoom >= MARK_ZOOM;
    strokes("foot", "foot", 0);
    if (marked) strokes("road", "mark", Math.max(0.15, 1.5 / this.zoom));
    strokes("junction", "junction", 0.1);
    strokes("road", "road", marked ? -Math.max(0.15, 1.5 / this.zoom) : 0);
    if (marked) {
      context.setLineDash([0.6, 0.6]);
      strokes("crossing", "crossing", -0.4);
      context.setLineDash([]);
    }
  }

  drawWay(context) {
    context.lineWidth = Math.max(0.28, 2 / this.zoom);
    context.strokeStyle = colour("path");
    context.stroke(this.path);
    const stop = this.scene.stop_line;
    if (!stop) return;
    const across = [-Math.sin(stop.heading) * 2.2, Math.cos(stop.heading) * 2.2];
    context.lineWidth = Math.max(0.5, 3 / this.zoom);
    context.strokeStyle = colour("stopline");
    context.beginPath();
    context.moveTo(stop.x - across[0], stop.y - across[1]);
    context.lineTo(stop.x + across[0], stop.y + across[1]);
    context.stroke();
  }

  /** The path that the controller means to drive from here. */
  drawCommanded(context, points) {
    context.lineWidth = Math.max(0.12, 1.5 / this.zoom);
    context.strokeStyle = colour("ego");
    context.stroke(line(points));
  }

  drawViews(context, ego) {
    context.fillStyle = colour("view");
    context.strokeStyle = colour("view");
    context.lineWidth = 1 / this.zoom;
    const [cos, sin] = [Math.cos(ego.heading), Math.sin(ego.heading)];
    for (const { view, sectors } of this.scene.sensors) {
      if (view === null) continue;
      const x = ego.x + view.forward * cos - view.left * sin;
      const y = ego.y + view.forward * sin + view.left * cos;
      const heading = ego.heading + view.yaw;
      for (const { range, half_angle: half } of sectors) {
        context.beginPath();
        context.moveTo(x, y);
        context.arc(x, y, range, heading - half, heading + half);
        context.closePath();
        context.globalAlpha = 0.07;
        context.fill();
        context.globalAlpha = 0.45;
        context.stroke();
      }
    }
    context.globalAlpha = 1;
  }

  drawTraffic(context, frame, view) {
    const { id, x, y, heading } = frame.actors;
    const seen = new Set(frame.sensed.flatMap((reading) => reading.seen));
    const why = whyUnseen(frame);
    const wide = new Map(frame.people.filter(({ presence }) => WIDE.has(presence)).map((one) => [one.id, one]));
    const areas = { seen: new Path2D(), occluded: new Path2D(), missed: new Path2D(), outside: new Path2D() };
    const paths = { seen: new Path2D(), occluded: new Path2D(), missed: new Path2D(), outside: new Path2D() };
    const noses = new Path2D();
    let drawn = 0;
    for (let row = 0; row < id.length; row += 1) {
      if (Math.hypot(x[row] - view.ego.x, y[row] - view.ego.y) > view.reach) continue;
      const body = this.scene.actors[id[row]] ?? { length: 4.5, width: 1.8 };
      const kind = seen.has(id[row]) ? "seen" : (why.get(id[row]) ?? "outside");
      if (wide.has(id[row])) {
        const { length, width } = wide.get(id[row]);
        addBox(areas[kind], x[row], y[row], heading[row], length / 2, width / 2);
        continue;
      }
      const least = (body.length > 1.3 ? 4 : 11) / this.zoom;
      const half = [Math.max(body.length, least) / 2, Math.max(body.width, least) / 2];
      addBox(paths[kind], x[row], y[row], heading[row], ...half);
      if (body.length > 1) nose(noses, x[row], y[row], heading[row], ...half);
      drawn += 1;
    }
    this.drawAreas(context, areas);
    for (const kind of ["outside", "missed", "seen"]) {
      context.fillStyle = colour(kind);
      context.fill(paths[kind]);
    }
    if (this.zoom > 2.5) {
      context.fillStyle = colour("paper");
      context.globalAlpha = 0.55;
      context.fill(noses);
      context.globalAlpha = 1;
    }
    context.lineWidth = Math.max(0.25, 2 / this.zoom);
    context.strokeStyle = colour("occluded");
    context.setLineDash([Math.max(0.6, 5 / this.zoom), Math.max(0.4, 3 / this.zoom)]);
    context.stroke(paths.occluded);
    context.setLineDash([]);
    if (drawn < OUTLINED) {
      context.lineWidth = Math.max(0.12, 1.5 / this.zoom);
      context.strokeStyle = colour("paper");
      for (const kind of ["outside", "missed", "seen"]) context.stroke(paths[kind]);
    }
  }

  /** The boxes that sensors meet where somebody is there as an area, in the colours of bodies but not solid. */
  drawAreas(context, areas) {
    context.lineWidth = Math.max(0.12, 2 / this.zoom);
    for (const [kind, path] of Object.entries(areas)) {
      context.fillStyle = colour(kind);
      context.strokeStyle = colour(kind);
      context.globalAlpha = 0.22;
      context.fill(path);
      context.globalAlpha = 1;
      context.stroke(path);
    }
  }

  /** Of each real person the circle of uncertainty, and a mark in its middle; of one who is gone the circle alone. */
  drawPeople(context, { people }) {
    context.lineWidth = Math.max(0.15, 2.5 / this.zoom);
    for (const { presence, x, y, radius } of people) {
      if (x === null || radius === null) continue;
      const gone = presence === "gone";
      context.strokeStyle = colour(gone || presence === "warning" ? "false" : "person");
      context.setLineDash(gone ? [0.8, 0.8] : []);
      context.beginPath();
      context.arc(x, y, Math.max(radius, 3 / this.zoom), 0, 2 * Math.PI);
      context.stroke();
      context.setLineDash([]);
      if (!WIDE.has(presence)) continue;
      const half = Math.max(PERSON, 4 / this.zoom);
      context.fillStyle = context.strokeStyle;
      context.beginPath();
      context.arc(x, y, half, 0, 2 * Math.PI);
      context.fill();
    }
  }

  /** Beside each real person how they are there, how large the circle is, and how old the newest position. */
  drawNames(context, { people }, view) {
    for (const one of people) {
      if (one.x === null || one.radius === null) continue;
      const bad = one.presence === "gone" || one.presence === "warning";
      const [x, y] = view.screen(one.x, one.y);
      rimmed(context, personInWords(one), x, y - one.radius * this.zoom - 12, colour(bad ? "false" : "ink"), colour("paper"), 15, "center");
    }
  }

  drawEgo(context, ego, known) {
    const shape = this.scene.ego;
    const middle = shape.length / 2 - shape.rear_overhang;
    const cos = Math.cos(ego.heading);
    const sin = Math.sin(ego.heading);
    const at = (forward, left) => [ego.x + forward * cos - left * sin, ego.y + forward * sin + left * cos];
    const wheels = new Path2D();
    for (const [forward, turn] of [[0, 0], [shape.wheelbase, ego.steering ?? 0]]) {
      for (const side of [-1, 1]) {
        addBox(wheels, ...at(forward, side * (shape.width / 2 - 0.12)), ego.heading + turn, 0.33, 0.13);
      }
    }
    context.fillStyle = colour("ink");
    context.fill(wheels);
    const body = new Path2D();
    const half = [Math.max(shape.length, 8 / this.zoom) / 2, Math.max(shape.width, 5 / this.zoom) / 2];
    addBox(body, ...at(middle, 0), ego.heading, ...half);
    context.globalAlpha = known ? 1 : 0.35;
    context.fillStyle = colour("ego");
    context.fill(body);
    context.lineWidth = Math.max(0.15, 2 / this.zoom);
    context.strokeStyle = colour("paper");
    context.stroke(body);
    const glass = new Path2D();
    addBox(glass, ...at(middle + 0.12 * shape.length, 0), ego.heading, 0.1 * shape.length, 0.4 * shape.width);
    context.fillStyle = colour("paper");
    context.fill(glass);
    context.globalAlpha = 1;
  }

  drawSensed(context, frame) {
    frame.sensed.forEach((reading, n) => {
      const { shape, names_actors: named } = this.scene.sensors[n];
      const shapes = shape === "boxes" ? boxesOf(reading, named) : pointsOf(reading, Math.max(0.22, 3.5 / this.zoom), named);
      context.lineWidth = Math.max(0.1, 2 / this.zoom);
      context.fillStyle = colour(sensedColour(n));
      if (shape === "boxes") {
        context.strokeStyle = colour(sensedColour(n));
        context.stroke(shapes.known);
      } else {
        if (shape === "rays") {
          context.strokeStyle = colour(sensedColour(n));
          context.stroke(raysOf(reading));
        }
        context.fill(shapes.known);
        context.strokeStyle = colour("paper");
        context.stroke(shapes.known);
      }
      context.strokeStyle = colour("false");
      context.stroke(shapes.unknown);
    });
  }

  drawGap(context, frame, view) {
    const { ego } = view;
    if (frame.gap === null || frame.gap > GAP_SHOWN) return;
    const shape = this.scene.ego;
    const begin = shape.length - shape.rear_overhang;
    const place = view.screen(
      ego.x + (begin + Math.max(frame.gap, 0) / 2) * Math.cos(ego.heading) - 2.4 * Math.sin(ego.heading),
      ego.y + (begin + Math.max(frame.gap, 0) / 2) * Math.sin(ego.heading) + 2.4 * Math.cos(ego.heading),
    );
    rimmed(context, `${frame.gap.toFixed(1)} m`, ...place, colour("ink"), colour("paper"), 20, "right");
  }

  drawScale(context, width, height) {
    const wanted = 110 / this.zoom;
    const unit = 10 ** Math.floor(Math.log10(wanted));
    const length = [5, 2, 1].map((part) => part * unit).find((one) => one <= wanted) ?? unit;
    const [right, bottom] = [width - 14, height - 14];
    context.lineWidth = 3;
    context.strokeStyle = colour("ink");
    context.beginPath();
    context.moveTo(right, bottom);
    context.lineTo(right - length * this.zoom, bottom);
    context.stroke();
    rimmed(context, `${length} m`, right, bottom - 14, colour("ink"), colour("ground"), 15, "right");
  }
}

/** The lanes by squares of the map: for each, what is drawn of every kind, by width. */
function tiled(lanes) {
  const tiles = new Map();
  for (const { kind, width, points } of lanes) {
    const middle = points[points.length >> 1];
    const key = `${Math.floor(middle[0] / TILE)},${Math.floor(middle[1] / TILE)}`;
    if (!tiles.has(key)) tiles.set(key, { lanes: [] });
    tiles.get(key).lanes.push({ kind, width: width ?? 3.2, points });
  }
  return [...tiles.values()].map(({ lanes: own }) => {
    const kinds = {};
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (const { kind, width, points } of own) {
      const shown = kind === "other" ? "road" : kind;
      kinds[shown] ??= new Map();
      if (!kinds[shown].has(width)) kinds[shown].set(width, new Path2D());
      kinds[shown].get(width).addPath(line(points));
      for (const [x, y] of points) {
        box[0] = Math.min(box[0], x);
        box[1] = Math.min(box[1], y);
        box[2] = Math.max(box[2], x);
        box[3] = Math.max(box[3], y);
      }
    }
    return { kinds, x: (box[0] + box[2]) / 2, y: (box[1] + box[3]) / 2, reach: Math.hypot(box[2] - box[0], box[3] - box[1]) / 2 };
  });
}

/** How somebody real is there, in a few words. */
function personInWords({ id, presence, radius, age }) {
  const how = { area: "an area, ", warning: "WARNING, ", gone: "GONE, " }[presence] ?? "";
  return `${id}: ${how}±${radius.toFixed(1)} m, ${age.toFixed(1)} s old`;
}

/** A sensor that sends nothing more has seen nothing of what the frame shows. */
function withoutOldReadings(frame) {
  if (!frame) return frame;
  const nothing = { x: [], y: [], seen: [], measured: null, unseen: { id: [], why: [] } };
  const old = ({ measured }) => measured === null || frame.t - measured >= OLD_READING;
  return { ...frame, sensed: frame.sensed.map((reading) => (old(reading) ? nothing : reading)) };
}

/** Why bodies were not seen by any sensor: missed where one had it in sight, else hidden. */
function whyUnseen(frame) {
  const found = new Map();
  for (const { unseen } of frame.sensed) {
    unseen.id.forEach((name, row) => { if (found.get(name) !== "missed") found.set(name, unseen.why[row]); });
  }
  return found;
}

/** Paths of a reading's points: of what it knows an actor of, and of the rest, where the sensor names actors. */
function pointsOf({ x, y, seen }, radius, named) {
  const paths = { known: new Path2D(), unknown: new Path2D() };
  for (let row = 0; row < x.length; row += 1) {
    const path = named && !seen[row] ? paths.unknown : paths.known;
    path.moveTo(x[row] + radius, y[row]);
    path.arc(x[row], y[row], radius, 0, 2 * Math.PI);
  }
  return paths;
}

/** Paths of a reading's boxes, as those of points. */
function boxesOf({ x, y, seen, heading = [], length = [], width = [] }, named) {
  const paths = { known: new Path2D(), unknown: new Path2D() };
  for (let row = 0; row < x.length; row += 1) {
    const path = named && !seen[row] ? paths.unknown : paths.known;
    addBox(path, x[row], y[row], heading[row], length[row] / 2, width[row] / 2);
  }
  return paths;
}

/** Path of the rays of a reading, from where they were measured. */
function raysOf({ x, y, origin_x: fromX = [], origin_y: fromY = [] }) {
  const path = new Path2D();
  for (let row = 0; row < x.length; row += 1) {
    path.moveTo(fromX[row], fromY[row]);
    path.lineTo(x[row], y[row]);
  }
  return path;
}

function nose(path, x, y, heading, halfLength, halfWidth) {
  const at = (forward, left) => [
    x + forward * Math.cos(heading) - left * Math.sin(heading),
    y + forward * Math.sin(heading) + left * Math.cos(heading),
  ];
  path.moveTo(...at(0.8 * halfLength, 0));
  path.lineTo(...at(0.35 * halfLength, 0.7 * halfWidth));
  path.lineTo(...at(0.35 * halfLength, -0.7 * halfWidth));
  path.closePath();
}

/** Where the path begins, for a drive that has no pose yet. */
function startOf(scene) {
  const [[x, y], next] = scene.path;
  return { x, y, heading: Math.atan2(next[1] - y, next[0] - x), steering: 0 };
}
