// The street in a headset, by WebXR. The headset turns and moves the camera within the car's rig; the car moves the rig.

export class Headset {
  constructor(renderer) {
    this.renderer = renderer;
  }

  /** Whether the browser has a headset; only a page over HTTPS or from this computer is told so. */
  static async isThere() {
    return (await navigator.xr?.isSessionSupported("immersive-vr").catch(() => false)) ?? false;
  }

  /** Begin a session, drawing with `draw` at the headset's rate until it ends; return it. */
  async begin(draw) {
    const { xr } = this.renderer;
    // "local": its origin is where the head is at the start, which is the driver's eye.
    const session = await navigator.xr.requestSession("immersive-vr");
    xr.enabled = true;
    xr.setReferenceSpaceType("local");
    session.addEventListener("end", () => {
      this.renderer.setAnimationLoop(null);
      xr.enabled = false;
    });
    await xr.setSession(session);
    this.renderer.setAnimationLoop(draw);
    return session;
  }
}
