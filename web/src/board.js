// A board with words before the driver's eyes, which a headset shows and no other picture. It hangs in the car's rig, so
// the head may turn away from it. Knows lines of text; not what they say.

import { CanvasTexture, LinearFilter, Mesh, MeshBasicMaterial, PlaneGeometry } from "three";

const SIZE = [0.44, 0.11]; //: [m]
const PLACE = [0, -0.22, -1]; //: right of, above and behind the eye [m]: 12 degrees below the horizon
const PIXELS = [1024, 256];
const FONTS = ["600 104px sans-serif", "64px sans-serif"]; //: of the two lines
const BASELINES = [112, 212]; //: of the two lines [pixels]
const [PAPER, ALARM, INK] = ["#10181d", "#8c1d18", "#f4f6f7"];

export class Board {
  constructor() {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = PIXELS;
    this.context = canvas.getContext("2d");
    this.texture = new CanvasTexture(canvas);
    this.texture.generateMipmaps = false;
    this.texture.minFilter = LinearFilter;
    // Nothing in the cockpit hides it.
    const material = new MeshBasicMaterial({ map: this.texture, depthTest: false, fog: false, toneMapped: false });
    this.mesh = new Mesh(new PlaneGeometry(...SIZE), material);
    this.mesh.position.set(...PLACE);
    this.mesh.lookAt(0, 0, 0);
    this.mesh.renderOrder = 100;
    this.mesh.visible = false;
    this.lines = [];
  }

  /** Show two lines of text; `alarm` says that they are a warning. */
  say(lines, alarm) {
    if (this.alarm === alarm && this.lines.every((line, at) => line === lines[at]) && this.lines.length === lines.length) return;
    [this.lines, this.alarm] = [[...lines], alarm];
    const { context } = this;
    context.fillStyle = alarm ? ALARM : PAPER;
    context.fillRect(0, 0, ...PIXELS);
    context.fillStyle = INK;
    context.textAlign = "center";
    lines.forEach((line, at) => {
      context.font = FONTS[at];
      context.fillText(line, PIXELS[0] / 2, BASELINES[at], PIXELS[0] - 40);
    });
    this.texture.needsUpdate = true;
  }

  dispose() {
    this.texture.dispose();
  }
}
