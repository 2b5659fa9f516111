// A live drive: frames over a WebSocket, each acknowledged, so that no old one waits in between. When nothing new comes
// the page says so. The stop button needs neither the feed nor the token.

import { element, say } from "./elements.js";
import { DriveView } from "./drive.js";

const LOST = 0.3; // without a new frame for so long the feed is lost [s]; with one more look it is said within 0.5 s
const BEHIND = 0.5; // frames that are later than the promptest by more are old, not live [s]
const LOOK = 80; // between two looks at the feed [ms]
const NEXT = 2000; // between two attempts to find the next drive at this address [ms]
const RETRY = 500; // between two attempts to connect, and to ask for a stop [ms]
const HEARD = 2000; // after the last press, for which a page without a feed goes on asking [ms]
const AT_REST = new Set(["stopped", "disarmed"]); // states of the gateway in which no car moves any more
const STOPPABLE = new Set(["ready", "engaged"]); // states of the gateway in which a stop is still to come
const ASKED = "the gateway was asked to stop";
const AGES_KEPT = 2000; // ages of drawn frames that are kept for whoever measures

export class Live {
  constructor(page) {
    this.page = page;
    this.view = null;
    this.waiting = null;
    this.heard = -Infinity;
    this.newest = -Infinity;
    this.lead = Infinity;
    this.over = false; // the drive's process of the page has said that the drive is over
    this.ended = false; // the drive has said how it ended; the verdict is still to come
    this.asking = false; // a request to stop is on its way, or will be sent again
    this.pressed = -Infinity; // when the stop button or one of its keys was pressed last [ms]
    this.ages = [];
    this.feed = document.getElementById("feed");
    this.feed.hidden = false;
    this.button = document.getElementById("stop");
    this.button.hidden = false;
    // At the press: a button that has moved under the finger by the time it is lifted gets no click.
    for (const pressed of ["pointerdown", "click"]) this.button.addEventListener(pressed, () => this.stop());
    setInterval(() => this.look(), LOOK);
    this.connect();
    const draw = () => {
      requestAnimationFrame(draw);
      this.draw();
    };
    requestAnimationFrame(draw);
    this.look();
  }

  get views() {
    return this.view ? [this.view] : [];
  }

  connect() {
    const address = new URL("socket", document.baseURI);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    this.socket = socket;
    socket.addEventListener("message", ({ data }) => this.hear(socket, JSON.parse(data)));
    socket.addEventListener("close", ({ code, reason }) => {
      this.socket = null;
      this.closed = code === 1013 ? reason : "";
      setTimeout(() => this.connect(), this.over ? NEXT : RETRY);
    });
  }

  hear(socket, message) {
    const now = performance.now() / 1000;
    if (message.type === "scene") this.begin(message);
    else if (message.type === "actors") Object.assign(this.view.scene.actors, message.actors);
    else if (message.type === "event") this.happened(message.event);
    else if (message.type === "over") this.conclude(message.verdict);
    else if (message.type === "frame") {
      this.waiting = message;
      this.heard = now;
      // By how much the drive's clock is ahead of the page's, by the promptest frame.
      this.lead = Math.min(this.lead, now - message.frame.t);
      this.behind = now - message.frame.t - this.lead;
      socket.send(String(message.n));
    }
  }

  happened(event) {
    this.ended ||= event.kind === "end";
    this.view.addEvent(event);
  }

  /** Show what the drive came to; there is nothing left to stop. */
  conclude(verdict) {
    this.over = true;
    this.button.hidden = true;
    if (!this.waiting) return;
    this.view.show(this.waiting.frame, undefined, verdict ?? { outcome: "", passed: null, failed: [] });
    this.view.draw();
  }

  shownTime() {
    return this.view?.frame?.t ?? -Infinity;
  }

  begin({ drive, scene }) {
    if (this.view && drive !== this.drive) {
      // The next drive at the same address: its street is another, and so is its clock.
      this.hear = () => {};
      location.reload();
      return;
    }
    this.drive = drive;
    if (this.view) {
      Object.assign(this.view.scene.actors, scene.actors);
      const missed = scene.events.filter(({ time }) => time > this.view.lastEvent);
      for (const event of missed) this.happened(event);
      return;
    }
    document.getElementById("stage").replaceChildren();
    this.view = new DriveView(document.getElementById("stage"), scene);
    // In a headset's session the browser may draw nothing else.
    this.view.seats.onPicture = () => {
      this.draw();
      return this.lost && !this.resting ? "NO LIVE DATA" : "";
    };
    this.view.seats.onStop = () => this.stop();
    this.page.titled(scene.title);
  }

  draw() {
    if (!this.view) return;
    const message = this.waiting;
    if (message && message.frame.t > this.shownTime()) {
      this.view.show(message.frame, () => performance.now() / 1000 - this.lead);
      this.view.strips.add(message.frame);
      this.view.draw();
      // Only what has been drawn is shown.
      this.newest = this.heard;
      this.ages.push(performance.timeOrigin + performance.now() - 1000 * message.wall);
      if (this.ages.length > AGES_KEPT) this.ages.shift();
    } else if (this.page.moved() || this.view.seats.inSpace) {
      this.view.draw();
    }
  }

  /** For how long nothing newer than what is shown has come [s]. */
  get silent() {
    return performance.now() / 1000 - this.newest;
  }

  /** Whether what is shown is old. */
  get lost() {
    return !(this.silent < LOST) || this.behind > BEHIND;
  }

  /** Whether the drive has ended and its car stands: what is shown of it is no older than it looks. */
  get resting() {
    return this.over || (this.ended && AT_REST.has(this.view?.frame?.state));
  }

  /** Say whether what is shown is live. */
  look() {
    const { resting } = this;
    const lost = this.lost && !resting;
    this.view?.stale(lost);
    if (this.over) return this.tell("over", "drive over: waiting for the next one");
    if (resting) return this.tell("over", "drive ended: its verdict is to come");
    if (!lost) return this.tell("live", "● live");
    if (this.newest === -Infinity) return this.tell("wait", this.closed || "waiting for the drive");
    const age = Math.max(this.silent, this.behind ?? 0);
    return this.tell("lost", `NO LIVE DATA for ${age.toFixed(1)} s: what is shown is old`);
  }

  tell(kind, text) {
    this.feed.dataset.kind = kind;
    say(this.feed, text);
  }

  /**
   * Ask the gateway to stop, again and again until it is seen to stop. A page without a feed cannot see that: there it is
   * enough to be heard for a while after the last press.
   */
  async stop() {
    this.pressed = performance.now();
    if (this.asking) return;
    this.asking = true;
    this.label("asking to stop …");
    for (;;) {
      const begun = performance.now();
      try {
        // An older browser's request has no time limit, and goes out all the same.
        const answer = await fetch(new URL("/stop", location.href), { method: "POST", signal: AbortSignal.timeout?.(1000) });
        this.label(answer.ok ? ASKED : `not taken: ${(await answer.text()).slice(0, 80)}`);
        const live = this.feed.dataset.kind === "live";
        const enough = live ? !STOPPABLE.has(this.view.frame?.state) : begun - this.pressed > HEARD;
        if (answer.ok && enough) break;
      } catch {
        this.label("nobody hears this button: the driver brakes");
      }
      if (this.over) break;
      await new Promise((done) => setTimeout(done, RETRY));
    }
    this.asking = false;
    // In the headset the gateway's own state says the rest.
    if (this.view) this.view.seats.asked = "";
  }

  label(text) {
    if (this.view) this.view.seats.asked = text;
    this.button.replaceChildren("STOP", element("small", {}, text));
  }

  key(event) {
    if (event.key === " " || event.key === "Escape" || event.key.toLowerCase() === "s") {
      this.stop();
      return true;
    }
    return false;
  }

  get keys() {
    return [["space, s, Esc", "stop"]];
  }

  /** Ages of the frames when they were drawn [ms], for a page on the drive's own machine. */
  get freshness() {
    return this.ages;
  }
}
