// The street in a headset, by WebXR. The headset turns and moves the camera within the car's rig; the car moves the rig.

import { Vector3 } from "three";

const UP = new Vector3(0, 1, 0);
const HELD = 700; // for which a trigger, a pinch or a tap is held until it asks for a stop [ms]

export class Headset {
  /** `seat` is the group within the rig that holds the camera: where the headset's origin is in the car. */
  constructor(renderer, seat) {
    this.renderer = renderer;
    this.seat = seat;
  }

  /** Whether the browser has a headset; only a page over HTTPS or from this computer is told so. */
  static async isThere() {
    return (await navigator.xr?.isSessionSupported("immersive-vr").catch(() => false)) ?? false;
  }

  /**
   * Begin a session, drawing with `draw` at the headset's rate until it ends; return it. A trigger, a pinch or a tap puts
   * the head, where it is then, to the driver's eye, looking ahead. A grip that is pressed calls `stop` at once, and so
   * does what is held for HELD: hands and phones have no grip.
   */
  async begin(draw, stop) {
    const { xr } = this.renderer;
    // "local": its origin is where the head is at the start, which is the driver's eye.
    const session = await navigator.xr.requestSession("immersive-vr");
    const [start, head] = await Promise.all(["local", "viewer"].map((type) => session.requestReferenceSpace(type)));
    xr.enabled = true;
    xr.setReferenceSpaceType("local");
    const held = new Map();
    let stopped = false;
    session.addEventListener("squeezestart", stop);
    session.addEventListener("selectstart", ({ inputSource }) => {
      stopped = false;
      held.set(inputSource, setTimeout(() => {
        stopped = true;
        stop();
      }, HELD));
    });
    session.addEventListener("selectend", ({ inputSource }) => clearTimeout(held.get(inputSource)));
    session.addEventListener("select", ({ frame }) => {
      const pose = frame.getPose(head, start);
      if (pose && !stopped) this.#sit(pose.transform);
    });
    // The headset's own button has moved the origin to the head: there is nothing left to make up for.
    start.addEventListener("reset", () => this.#sitAtTheOrigin());
    session.addEventListener("end", () => {
      held.forEach(clearTimeout);
      this.renderer.setAnimationLoop(null);
      xr.enabled = false;
      this.#sitAtTheOrigin();
    });
    await xr.setSession(session);
    this.renderer.setAnimationLoop(draw);
    return session;
  }

  /** Have a head with this pose be at the eye, turned ahead on the level: one that is bent down looks down still. */
  #sit({ position, orientation: { x, y, z, w } }) {
    // The angle about the upright axis at which the head's own axis ahead points.
    const yaw = Math.atan2(2 * (x * z + w * y), 1 - 2 * (x * x + y * y));
    this.seat.quaternion.setFromAxisAngle(UP, -yaw);
    this.seat.position.set(-position.x, -position.y, -position.z).applyQuaternion(this.seat.quaternion);
    this.seat.updateMatrixWorld(true);
  }

  #sitAtTheOrigin() {
    this.seat.quaternion.identity();
    this.seat.position.set(0, 0, 0);
    this.seat.updateMatrixWorld(true);
  }
}
