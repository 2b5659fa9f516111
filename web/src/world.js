// The virtual street in three dimensions, as the driver, the passenger or somebody outside sees it. Draws a frame at a
// display time, both passed in: no clock is read here, and the same two always give the same picture.

import { Frustum, Group, LinearSRGBColorSpace, Matrix4, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { Areas } from "./areas.js";
import { Board } from "./board.js";
import { CameraPictures } from "./camera_pictures.js";
import { Ego } from "./ego.js";
import { FINE_LEVELS, Fleet } from "./fleet.js";
import { predicted, referenceOf } from "./frame_of_reference.js";
import { Headset } from "./headset.js";
import { setLight } from "./light.js";
import { street } from "./street.js";
import { Signals, buildings, sky } from "./surroundings.js";
import { Trees } from "./trees.js";

const FAR = 1100; //: [m]
const NEAR = 0.1; //: before a camera that is mounted on the car [m]
const TILES_WITHIN = 480; //: what is farther stands in the haze [m]
//: of each view: where the camera hangs forward, left and over the rear axle [m], how far it looks down [rad], its angle [deg]
const VIEWS = {
  driver: { down: 0.045, angle: 46, near: 0.05 },
  chase: { from: [-7.2, 0, 3.0], down: 0.2, angle: 48, near: 0.5 },
  above: { from: [-4, 0, 58], down: 1.2, angle: 46, near: 5 },
};
const MOUNTED = "mounted"; //: the view of a camera that is mounted on the car

class World {
  #scene = new Scene();
  #rig = new Group();
  #seat = new Group();
  #view = "driver";
  #head = { yaw: 0, pitch: 0 };
  #last = null;
  #outside = [];

  constructor(canvas, scene, { pixelRatio = 1, antialias = !drawnBySoftware(), preserve = false, dressed = false, fine = false, time, rain } = {}) {
    this.light = setLight(time, rain);
    this.reference = referenceOf(scene);
    this.renderer = new WebGLRenderer({ canvas, antialias, preserveDrawingBuffer: preserve });
    this.renderer.outputColorSpace = LinearSRGBColorSpace;
    this.renderer.setPixelRatio(pixelRatio);
    this.renderer.info.autoReset = true;
    this.camera = new PerspectiveCamera(VIEWS.driver.angle, 16 / 9, VIEWS.driver.near, FAR);
    this.camera.rotation.order = "YXZ";
    const { group, surface, neighbourhood } = street(scene, this.reference, dressed);
    const built = buildings(scene, this.reference);
    this.trees = new Trees(scene, surface, this.reference, { detail: dressed, taken: (x, y) => neighbourhood?.taken(x, y) });
    this.tiles = [...group.children, ...built.children];
    this.ego = new Ego(scene.ego);
    this.fleet = new Fleet(scene, this.reference, neighbourhood?.parked, fine ? FINE_LEVELS : undefined);
    this.lamps = neighbourhood?.lamps ?? [];
    this.signals = new Signals(scene, this.reference);
    this.areas = new Areas(this.reference);
    this.board = new Board();
    // The rig is the car's: the head turns the camera within it, and a headset does likewise.
    this.#seat.add(this.camera);
    this.#rig.add(this.#seat, this.board.mesh);
    this.#outside = [sky(), group, built, this.trees.group, this.signals.group, this.fleet.group, this.areas.group, this.ego.shadow.mesh];
    this.#scene.add(...this.#outside, this.ego.group, this.#rig);
    for (const tile of this.tiles) tile.geometry.computeBoundingSphere();
    this.headset = new Headset(this.renderer, this.#seat);
    this.view("driver");
    this.resize(canvas.clientWidth || canvas.width, canvas.clientHeight || canvas.height);
  }

  /** Have the canvas be so large [CSS pixels]. */
  resize(width, height) {
    if (this.renderer.xr.isPresenting) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
  }

  /** Look from the driver's seat, from behind the car, or from above it: "driver", "chase", "above". */
  view(name) {
    if (!VIEWS[name]) throw new Error(`no view ${name}: there are ${Object.keys(VIEWS).join(", ")}`);
    this.#view = name;
    const { angle, near } = VIEWS[name];
    Object.assign(this.camera, { fov: angle, near });
    this.camera.updateProjectionMatrix();
    this.ego.seenFromInside(name === "driver");
    if (this.#last) this.show(...this.#last);
  }

  /**
   * Look from a camera on the car: forward, left and up of the rear axle [m]; yaw to the left, pitch down, roll to the
   * right [rad]; `slopes` {left, right, top, bottom} are those of the picture's edges to the right and down.
   */
  mount({ x, y, z, yaw, pitch, roll }, { left, right, top, bottom }) {
    this.#view = MOUNTED;
    this.mounted = { from: [x, y, z], down: pitch, yaw, roll };
    this.camera.projectionMatrix.makePerspective(left * NEAR, right * NEAR, -top * NEAR, -bottom * NEAR, NEAR, FAR);
    this.camera.projectionMatrixInverse.copy(this.camera.projectionMatrix).invert();
    this.ego.seenFromInside(false);
    this.areas.group.visible = false;
  }

  /** Turn the head against the car: to the left and up [rad]; a headset does it by itself. */
  look({ yaw, pitch }) {
    this.#head = { yaw, pitch };
    if (this.#last) this.show(...this.#last);
  }

  /**
   * Have the street be as a frame says, predicted to `displayTime` [s of drive time] with constant speed and yaw rate.
   * The frame's ego is the rear axle on the ground; without a pose the camera stays where it was.
   */
  show(frame, displayTime) {
    this.#last = [frame, displayTime];
    const ahead = displayTime - frame.t;
    const { ego } = frame;
    if ([ego?.x, ego?.y, ego?.heading].every(Number.isFinite)) this.#place(predicted(ego, ahead), ego.steering);
    const eye = new Vector3().setFromMatrixPosition(this.camera.matrixWorld);
    // A head in a headset may have turned by the time of the picture: nothing on any side is left out.
    const view = this.renderer.xr.isPresenting ? null : frustumOf(this.camera);
    this.fleet.show(frame.actors, ahead, eye, view);
    this.trees.show(eye, view);
    this.signals.show(frame.signals);
    this.areas.show(frame.people);
    if (this.light.lit) this.#lightUp(eye);
  }

  /** Have the nearest street lamps and headlights light the picture. */
  #lightUp(eye) {
    const { lamps, beams } = this.light.uniforms;
    const nearest = (list, count) => list.map((one) => [Math.hypot(one[0] - eye.x, one[1] - eye.z), one]).sort((a, b) => a[0] - b[0]).slice(0, count);
    const placed = this.lamps.map(({ x, y }) => this.reference.place(x, y)).map(([X, , Z]) => [X, Z]);
    const near = nearest(placed, lamps.value.length);
    lamps.value.forEach((lamp, i) => lamp.set(near[i]?.[1][0] ?? 0, 6.9, near[i]?.[1][1] ?? 0, near[i] ? 40 : 0));
    const driven = this.fleet.bodies.filter(({ kind, speed }) => speed > 0.5 && kind !== "pedestrian" && kind !== "child" && kind !== "bicycle");
    const fronts = driven.map(({ x, y, heading, length }) => this.#front(x, y, heading, length / 2));
    const { length, rear_overhang: overhang } = this.ego.size;
    const { x, z } = this.ego.group.position;
    const own = this.reference.back(x, 0, z);
    const cars = [this.#front(own.x, own.y, this.ego.group.rotation.y, length - overhang), ...nearest(fronts, beams.value.length - 1).map((one) => one[1])];
    beams.value.forEach((beam, i) => beam.set(...(cars[i] ?? [0, 0, 0, 0])));
  }

  #front(x, y, heading, ahead) {
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    const [X, , Z] = this.reference.place(x + ahead * c, y + ahead * s);
    return [X, Z, c, s];
  }

  #place({ x, y, heading }, steering) {
    const { from, down, yaw = 0, roll = 0 } = this.#view === MOUNTED ? this.mounted : VIEWS[this.#view];
    const [forward, left, up] = from ?? this.ego.eye;
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    const place = this.reference.place(x, y);
    this.ego.stand(place, heading, steering);
    this.#rig.position.set(...this.reference.place(x + c * forward - s * left, y + s * forward + c * left, up));
    // A camera of three.js looks along -Z, a car along +X.
    this.#rig.rotation.y = heading - Math.PI / 2;
    if (!this.renderer.xr.isPresenting) {
      this.camera.position.set(0, 0, 0);
      this.camera.rotation.set(this.#head.pitch - down, this.#head.yaw + yaw, -roll);
    }
    this.#rig.updateMatrixWorld(true);
  }

  /** Draw what was shown last. */
  draw() {
    const eye = new Vector3().setFromMatrixPosition(this.camera.matrixWorld);
    const far = ({ geometry: { boundingSphere: sphere } }) => sphere.center.distanceTo(eye) - sphere.radius;
    for (const tile of this.tiles) tile.visible = far(tile) < TILES_WITHIN;
    this.renderer.render(this.#scene, this.camera);
  }

  /** Everything that is drawn, for who draws it in another way. */
  get scene() {
    return this.#scene;
  }

  /**
   * The camera as the scene has it, read back from its matrix: place on the map {x, y} and height [m], heading
   * counter-clockwise from east and pitch [rad]; `car` is the same of the rear axle's pose that it hangs on.
   */
  cameraPose() {
    const ahead = new Vector3(0, 0, -1).transformDirection(this.camera.matrixWorld);
    const at = this.reference.back(...new Vector3().setFromMatrixPosition(this.camera.matrixWorld).toArray());
    const car = this.ego.group;
    const front = new Vector3(1, 0, 0).transformDirection(car.matrixWorld);
    const { x, y } = this.reference.back(...new Vector3().setFromMatrixPosition(car.matrixWorld).toArray());
    const heading = Math.atan2(-ahead.z, ahead.x);
    return { ...at, heading, pitch: Math.asin(ahead.y), car: { x, y, heading: Math.atan2(-front.z, front.x) } };
  }

  /**
   * Show the street in a headset until its session ends; call it from a click. `next` is called for every picture with
   * the time until it is displayed unknown: it shows the newest frame. `stop` is called when who wears the headset asks
   * for a stop. Returns the WebXR session.
   */
  async session(next, stop) {
    const session = await this.headset.begin(() => {
      next();
      this.draw();
    }, stop);
    this.board.mesh.visible = true;
    session.addEventListener("end", () => {
      this.board.mesh.visible = false;
      this.hide(false);
    });
    return session;
  }

  /** Leave the car alone in the dark, or show the street again. */
  hide(hidden) {
    for (const one of this.#outside) one.visible = !hidden;
  }

  /** Whether the street is hidden. */
  get hidden() {
    return !this.#outside[0].visible;
  }

  /** Write two lines before the eyes of whoever wears the headset; `alarm` says that they are a warning. */
  tell(lines, alarm = false) {
    this.board.say(lines, alarm);
  }

  /** What the last picture took: triangles, draws, bodies of actors. */
  get cost() {
    const { triangles, calls } = this.renderer.info.render;
    return { triangles, calls, actors: this.fleet.drawn };
  }

  /** Give everything back that the graphics card holds. */
  dispose() {
    this.fleet.dispose();
    this.signals.dispose();
    this.areas.dispose();
    this.board.dispose();
    this.#scene.traverse((one) => {
      one.geometry?.dispose();
      one.material?.dispose();
    });
    this.renderer.dispose();
  }
}

/** Whether the browser has no graphics card, and smooth edges would cost half of the pictures a second. */
function drawnBySoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const names = gl?.getExtension("WEBGL_debug_renderer_info");
  const renderer = String(names ? gl.getParameter(names.UNMASKED_RENDERER_WEBGL) : "");
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(renderer);
}

function frustumOf({ projectionMatrix, matrixWorldInverse }) {
  return new Frustum().setFromProjectionMatrix(new Matrix4().multiplyMatrices(projectionMatrix, matrixWorldInverse));
}

/**
 * Return the world of a scene on a canvas; throws where the browser has no WebGL. Options: `pixelRatio` of the canvas,
 * `antialias` for smooth edges (by default where there is a graphics card), `preserve` for who copies the picture.
 */
export const createWorld = (canvas, scene, options) => new World(canvas, scene, options);
export const createCamera = (canvas, scene, camera, options) => new CameraPictures(new World(canvas, scene, { ...options, fine: true, dressed: options?.dressed ?? true }), camera);
export const headsetIsThere = () => Headset.isThere();
