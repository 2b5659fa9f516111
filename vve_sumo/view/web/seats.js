// Where the street is seen from: drawn from above, or in three dimensions from the driver's seat, from behind the car, from
// above, and in a headset. The third dimension is loaded when it is first asked for.

import { element, number } from "./elements.js";
import { whyNone } from "./gauges.js";
import { speedUnit } from "./units.js";

const SEATS = [["map", "map"], ["driver", "driver"], ["chase", "behind"], ["above", "above"]];
const TURN = 0.005; // of the head by the finger or mouse [rad a pixel]
const NECK = [1.9, 0.8]; // the head turns no farther to the side and up [rad]
const OLD_PICTURES = 30; // pictures in a row of an old street after which a headset shows it no longer

export class Seats {
  /** Add the buttons and the canvas of the third dimension to the box of the street's canvas. */
  constructor(box, map, scene) {
    this.box = box;
    this.map = map;
    this.scene = scene;
    this.seat = "map";
    this.world = null;
    this.head = { yaw: 0, pitch: 0 };
    // Called for every picture in a headset; returns why the street is not that of the present, nothing where it is.
    this.onPicture = null;
    // Asks for a stop; a replay has nothing to stop. `asked` says what becomes of it while that is not known.
    this.onStop = null;
    this.asked = "";
    // A page that is one file has no other to load.
    if (document.getElementById("vve-data")) return;
    this.buttons = SEATS.map(([seat, text]) => element("button", {
      type: "button", "aria-pressed": String(seat === "map"), title: `see the street: ${text} (v)`, onclick: () => this.sit(seat),
    }, text));
    box.append(element("div", { class: "seats", role: "group", "aria-label": "where the street is seen from" }, ...this.buttons));
  }

  /** Whether the street is shown in three dimensions. */
  get inSpace() {
    return this.seat !== "map" && this.world !== null;
  }

  /** See the street from the next seat. */
  next() {
    const at = SEATS.findIndex(([seat]) => seat === this.seat);
    return this.sit(SEATS[(at + 1) % SEATS.length][0]);
  }

  /** See the street from a seat: "map", "driver", "chase", "above". */
  async sit(seat) {
    if (!this.buttons) return;
    this.seat = seat;
    this.buttons.forEach((button, at) => button.setAttribute("aria-pressed", String(SEATS[at][0] === seat)));
    if (seat !== "map") await (this.loading ??= this.load());
    if (this.world === null) return;
    this.canvas.hidden = this.seat === "map";
    this.box.classList.toggle("space", this.seat !== "map");
    this.turn(-this.head.yaw, -this.head.pitch);
    if (this.seat !== "map") this.world.view(this.seat);
    this.draw();
  }

  async load() {
    try {
      const { createWorld, headsetIsThere } = await import("./world.min.js");
      this.canvas = element("canvas", { class: "world", role: "img", "aria-label": "the street in three dimensions" });
      this.map.canvas.after(this.canvas);
      this.world = createWorld(this.canvas, this.scene, { pixelRatio: Math.min(devicePixelRatio, 1.5) });
      this.listen();
      new ResizeObserver(() => this.fit()).observe(this.box);
      this.fit();
      if (await headsetIsThere()) this.offerHeadset();
    } catch (error) {
      console.warn("the street cannot be shown in three dimensions", error);
      this.box.querySelector(".seats").replaceChildren("no WebGL: the map only");
      this.seat = "map";
    }
  }

  fit() {
    if (this.box.clientWidth && this.box.clientHeight) this.world.resize(this.box.clientWidth, this.box.clientHeight);
    this.draw();
  }

  /** Turn the head as the finger drags; a double click looks ahead again. */
  listen() {
    this.canvas.addEventListener("pointerdown", ({ pointerId }) => this.canvas.setPointerCapture(pointerId));
    this.canvas.addEventListener("pointermove", ({ buttons, movementX, movementY }) => {
      if (buttons) this.turn(movementX * TURN, movementY * TURN);
    });
    this.canvas.addEventListener("dblclick", () => this.turn(-this.head.yaw, -this.head.pitch));
  }

  turn(yaw, pitch) {
    const within = (value, most) => Math.min(Math.max(value, -most), most);
    this.head = { yaw: within(this.head.yaw + yaw, NECK[0]), pitch: within(this.head.pitch + pitch, NECK[1]) };
    this.world.look(this.head);
  }

  offerHeadset() {
    const button = element("button", { type: "button", title: "see the street in the headset" }, "headset");
    button.addEventListener("click", async () => {
      if (this.seat === "map") await this.sit("driver");
      this.old = 0;
      this.session = await this.world.session(() => this.picture(), () => this.onStop?.());
      this.session.addEventListener("end", () => { this.session = null; });
    });
    this.box.querySelector(".seats").append(button);
  }

  /**
   * Have the headset's next picture. A street that stands still while the car moves would make its passenger sick: it is
   * hidden while nothing new comes, and the session goes on.
   */
  picture() {
    const why = this.onPicture?.() ?? "";
    this.old = why ? this.old + 1 : 0;
    this.world.hide(this.old > OLD_PICTURES);
    if (!this.frame) return;
    if (this.world.hidden) this.world.tell([why, this.asked || "the street is hidden"], true);
    else this.world.tell(this.asked ? [wordsOf(this.frame)[0], this.asked] : wordsOf(this.frame), this.asked !== "");
    this.world.show(this.frame, this.clock());
  }

  /** Have a frame from now on; `clock` gives the drive time that is displayed [s]. */
  show(frame, clock) {
    this.frame = frame;
    this.clock = clock;
  }

  /** Draw in three dimensions, where that is shown. */
  draw() {
    if (!this.inSpace || !this.frame || this.session?.visibilityState === "visible") return;
    this.world.show(this.frame, this.clock());
    this.world.draw();
  }
}

/** What a frame's board in the headset says: speed and gap, and what the car does. */
function wordsOf(frame) {
  const { name, factor } = speedUnit();
  const speed = `${number(frame.ego ? factor * frame.ego.speed : null, 0)} ${name}`;
  const gap = frame.gap === null ? whyNone(frame, "nothing ahead") : `gap ${number(frame.gap)} m`;
  return [`${speed}   ${gap}`, frame.contact ? `contact with ${frame.contact.replaceAll("+", ", ")}` : frame.said.split(": ")[0]];
}
