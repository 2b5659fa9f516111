// Draws pictures of a record without a screen: `vve-sumo render` opens this page in a headless browser, hands it scene and
// frames, and asks for one picture after the other. Only the times that it is given count: no clock is read.

import { Frames, unpacked, unzipped } from "./frames.js";
import { Street } from "./street.js";
import { createCamera, createWorld } from "./world.min.js";
import { drawCaption } from "./caption.js";

const STREET = "street";

class Pictures {
  async open(scene, frames, details, view, width, height) {
    this.frames = new Frames(unpacked(await unzipped(decoded(frames))));
    this.frames.addDetails(unpacked(await unzipped(decoded(details))));
    this.drawn = canvasOf(width, height);
    this.picture = canvasOf(width, height);
    this.view = view;
    if (view === STREET) {
      this.street = new Street(this.drawn, scene);
      return;
    }
    this.world = createWorld(this.drawn, scene, { antialias: true, preserve: true });
    this.world.view(view);
  }

  /** Draw the street at a drive time [s] and return the picture, in base64. */
  at(time, kind, quality) {
    const frame = this.frames.frame(this.frames.at(time));
    if (this.street) {
      this.street.draw(frame);
    } else {
      this.world.show(frame, time);
      this.world.draw();
    }
    const context = this.picture.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(this.drawn, 0, 0);
    drawCaption(context, frame, time);
    return this.picture.toDataURL(kind, quality).split(",")[1];
  }
}

/** The pictures of a camera on the car, without caption, and the truth beside them. */
class CameraRoll {
  async open(scene, frames, camera, look) {
    this.frames = frames && new Frames(unpacked(await unzipped(decoded(frames))));
    this.scene = scene;
    this.canvas = canvasOf(camera.columns, camera.rows);
    const map = new Float32Array(decoded(camera.map).buffer);
    this.camera = createCamera(this.canvas, scene, { ...camera, map }, { preserve: true, antialias: false, ...look });
  }

  /** Have more actors in the scene, by their names. */
  meet(actors) {
    Object.assign(this.scene.actors, actors);
  }

  /** Draw the street at a drive time [s] and return the picture, in base64. */
  at(time, kind, quality) {
    return this.drawn(this.frames.frame(this.frames.at(time)), time, kind, quality);
  }

  /** Draw a frame at a drive time [s] and return the picture, in base64. */
  drawn(frame, time, kind, quality) {
    this.camera.draw(frame, time);
    return this.canvas.toDataURL(kind, quality).split(",")[1];
  }

  /** The truth of the picture that was drawn last: columns in base64, and the bodies. */
  look() {
    const { kinds, owners, depths, ...others } = this.camera.look();
    return { kinds: encoded(kinds), owners: encoded(owners), depths: encoded(depths), ...others };
  }
}

function canvasOf(width, height) {
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width, height });
  document.body.append(canvas);
  return canvas;
}

const decoded = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

/** Numbers as bytes, in base64. */
function encoded(numbers) {
  const bytes = new Uint8Array(numbers.buffer);
  let text = "";
  for (let at = 0; at < bytes.length; at += 0x8000) text += String.fromCharCode(...bytes.subarray(at, at + 0x8000));
  return btoa(text);
}

globalThis.pictures = new Pictures();
globalThis.cameraRoll = new CameraRoll();
