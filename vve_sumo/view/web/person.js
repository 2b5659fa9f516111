// The page of a real person in a live drive: it says where they are and that they are there, shows what comes towards
// them in the virtual street, and has a stop button. It computes nothing that decides on anything.

const ALIVE = 500; // between two signs of life [ms]
const RETRY = 500; // between two attempts to connect, and to ask for a stop [ms]
const SILENT = 1000; // without a message for so long the connection counts as lost [ms]
const RANGE = 60; // of the drawing: half its width [m]
const ASK = 1000; // between two positions that are asked for: some browsers tell only of those that differ [ms]
const DECIDED = { enableHighAccuracy: true, maximumAge: 0, timeout: 10000 }; // of the positions asked for

const FAULTS = {
  person_absent: "you have not been seen yet: wait where you stand",
  person_lost: "your place is lost: stand still, the car stops",
  person_near_lot: "you may be too near to the car's field: go away from it",
  person_not_in_field: "you have not said yet that you stand in your field",
  person_stop: "you asked for a stop: the drive is over",
  person_unreachable: "this page was not heard: the car stops",
};
const PRESENCE = {
  exact: ["good", "You are in the street"],
  area: ["good", "You are in the street, as an area"],
  warning: ["warn", "Your place is uncertain: stand still"],
  gone: ["bad", "You are not in the street"],
};

const find = (id) => document.getElementById(id);

class Person {
  constructor() {
    this.socket = null;
    this.hello = null;
    this.echo = 0;
    this.heard = -Infinity;
    this.entered = false; // the person has agreed
    this.taken = false; // the server has another page for this person, maybe this one's own before it was connected again
    this.stopping = false;
    this.asking = false; // for a stop, until it is heard
    this.compass = null;
    this.newest = -Infinity; // time of the newest position that was reported [ms]
    this.trouble = ""; // with the positions
    this.view = null;
    find("enter").addEventListener("click", () => this.enter());
    // At the press, not when the finger is lifted; a keyboard and what reads a page aloud give a click alone.
    for (const pressed of ["pointerdown", "click"]) find("stop").addEventListener(pressed, () => this.stop());
    setInterval(() => document.hidden || this.say({ type: "alive" }), ALIVE);
    document.addEventListener("visibilitychange", () => this.keepAwake());
    setInterval(() => this.look(), 100);
    this.connect();
  }

  connect() {
    const address = new URL("socket", location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    this.socket = new WebSocket(address);
    this.socket.addEventListener("message", (event) => this.take(JSON.parse(event.data)));
    this.socket.addEventListener("close", () => setTimeout(() => this.connect(), RETRY));
  }

  take(message) {
    this.heard = performance.now();
    if (message.type === "hello") {
      this.greet(message);
    } else if (message.type === "taken") {
      this.taken = true;
      this.trouble = "another phone says that it is this person";
      setTimeout(() => this.acknowledge(), RETRY);
    } else if (message.type === "status") {
      this.echo = message.n;
      this.view = message.view;
      if (this.taken && this.view !== null) {
        this.taken = false;
        this.trouble = "";
      }
    }
  }

  greet(hello) {
    const changed = this.hello === null || this.hello.digest !== hello.digest;
    this.hello = hello;
    if (changed) {
      this.entered = false;
      find("consent").textContent = hello.consent;
      find("who").replaceChildren(...hello.people.map((person) => new Option(person.id, person.id)));
      find("who-label").hidden = hello.people.length === 1;
      find("enter").disabled = false;
      document.documentElement.dataset.ready = "";
    } else if (this.entered) {
      this.acknowledge(); // the same page, connected again
    }
  }

  async enter() {
    find("trouble").textContent = "";
    await this.askForCompass();
    this.entered = true;
    this.acknowledge();
    const own = this.hello.people.find((person) => person.id === find("who").value);
    if (own.phone) {
      const take = (position) => this.report(position);
      const fail = (error) => {
        if (!this.taken) this.trouble = `no position: ${error.message}`;
      };
      navigator.geolocation.watchPosition(take, fail, DECIDED);
      setInterval(() => navigator.geolocation.getCurrentPosition(take, fail, DECIDED), ASK);
    }
    this.keepAwake();
  }

  // A browser lets go of the screen when the page is hidden.
  keepAwake() {
    if (this.entered && !document.hidden) navigator.wakeLock?.request("screen").catch(() => {});
  }

  // Some browsers ask the person, others never say where the phone points.
  async askForCompass() {
    const kind = globalThis.DeviceOrientationEvent;
    if (typeof kind?.requestPermission === "function") {
      await kind.requestPermission().catch(() => {});
    }
    const turned = screen.orientation?.angle ?? 0;
    addEventListener("deviceorientationabsolute", (event) => {
      this.compass = event.alpha === null ? null : (720 - event.alpha + turned) % 360;
    });
    addEventListener("deviceorientation", (event) => {
      if (typeof event.webkitCompassHeading === "number") {
        this.compass = (event.webkitCompassHeading + turned) % 360;
      }
    });
  }

  acknowledge() {
    this.say({ type: "entered", consent: this.hello.digest });
  }

  report(position) {
    if (this.taken || position.timestamp <= this.newest) return;
    this.newest = position.timestamp;
    this.trouble = "";
    const { latitude, longitude, accuracy, heading } = position.coords;
    const moves = Number.isFinite(heading) ? heading : null;
    this.say({
      type: "position", timestamp: position.timestamp, sent: Date.now(), latitude, longitude, accuracy,
      heading: moves, compass: this.compass,
    });
  }

  // Every press asks: a page stays open from one drive to the next.
  stop() {
    this.stopping = true;
    if (this.asking) this.say({ type: "stop" });
    else this.askForStop();
  }

  // Again and again until the drive says that it has heard it.
  askForStop() {
    this.asking = true;
    this.say({ type: "stop" });
    setTimeout(() => {
      this.asking = false;
      if (!this.view?.faults.includes("person_stop")) this.askForStop();
    }, RETRY);
  }

  say(message) {
    if (this.taken && !["entered", "stop"].includes(message.type)) return;
    if (this.entered && this.socket.readyState === WebSocket.OPEN) {
      this.socket.send(JSON.stringify({ ...message, person: find("who").value, echo: this.echo }));
    }
  }

  look() {
    find("ask").hidden = this.entered;
    find("walk").hidden = !this.entered;
    if (!this.entered) return;
    const connected = performance.now() - this.heard < SILENT;
    const [kind, words] = this.words(connected);
    const presence = find("presence");
    if (presence.dataset.kind !== kind && kind === "bad") navigator.vibrate?.([300, 100, 300]);
    presence.dataset.kind = kind;
    presence.textContent = words;
    const why = connected && this.view ? this.view.faults.map((code) => FAULTS[code] ?? code) : [];
    find("why").textContent = [...why, this.trouble].filter(Boolean).join("; ");
    find("car").textContent = connected ? carWords(this.view?.car) : "";
    find("numbers").textContent = connected && this.view ? numberWords(this.view) : "";
    draw(find("around"), connected ? this.view : null);
  }

  words(connected) {
    if (!connected) return ["bad", "Not connected: stand still, the car stops"];
    if (this.stopping) return ["bad", "You asked for a stop"];
    if (this.view === null) return ["warn", "Waiting"];
    if (this.view.faults.length > 0) return ["bad", PRESENCE[this.view.presence][1]];
    return PRESENCE[this.view.presence];
  }
}

function carWords(car) {
  if (!car) return "The car is not in the street yet";
  const arrives = car.arrives === null ? "" : `, here in ${car.arrives.toFixed(0)} s`;
  return `The car: ${car.gap.toFixed(0)} m away${arrives}`;
}

function numberWords(view) {
  const known = view.radius === null ? "place unknown" : `place known to ${view.radius.toFixed(0)} m`;
  const age = view.age === null ? "" : `, ${view.age.toFixed(1)} s old`;
  const lot = view.distance === null ? "" : `; at least ${view.distance.toFixed(0)} m from the real car's field`;
  return `${known}${age}${lot}`;
}

// North up, the person in the middle.
function draw(canvas, view) {
  const pen = canvas.getContext("2d");
  const scale = canvas.width / (2 * RANGE);
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.clearRect(0, 0, canvas.width, canvas.height);
  if (!view || view.x === null) return;
  pen.setTransform(scale, 0, 0, -scale, canvas.width / 2, canvas.height / 2);
  pen.translate(-view.x, -view.y);
  for (const [, x, y, heading, length, width] of view.bodies) box(pen, x, y, heading, length, width, "#6b737a");
  if (view.car) {
    const [, x, y, heading, length, width] = view.car.body;
    box(pen, x, y, heading, length, width, "#c40016");
  }
  pen.fillStyle = "rgba(0, 114, 178, 0.25)";
  disc(pen, view.x, view.y, view.radius);
  pen.fillStyle = "#0072b2";
  disc(pen, view.x, view.y, 0.7);
}

function disc(pen, x, y, radius) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fill();
}

function box(pen, x, y, heading, length, width, colour) {
  pen.save();
  pen.translate(x, y);
  pen.rotate(heading);
  pen.fillStyle = colour;
  pen.fillRect(-length / 2, -width / 2, length, width);
  pen.restore();
}

globalThis.vvePerson = new Person();
