// The page: finds out what it is to show, and shows it. Keys, theme and the help belong to every kind of page.

import { themeChanged } from "./canvas.js";
import { element } from "./elements.js";
import { Live } from "./live.js";
import { Replay } from "./replay.js";
import { readContents, readRecord } from "./source.js";
import { SweepTable } from "./table.js";
import { otherSpeedUnit, switchSpeedUnit } from "./units.js";

const COMMON_KEYS = [["+ −", "nearer or farther"], ["n", "north up, or the car's heading up"], ["v", "the map, or the street in three dimensions"], ["u", "speeds in km/h or mph"], ["d", "day or night"], ["?", "this list"]];

class Page {
  constructor() {
    this.shown = null;
    this.hasMoved = false;
    const night = matchMedia("(prefers-color-scheme: dark)").matches;
    this.theme(night ? "night" : "day");
    document.getElementById("theme").addEventListener("click", () => this.switchTheme());
    document.getElementById("turn").addEventListener("click", () => this.switchNorth());
    document.getElementById("units").textContent = otherSpeedUnit();
    document.getElementById("units").addEventListener("click", () => this.switchUnits());
    document.getElementById("help-button").addEventListener("click", () => this.help());
    document.addEventListener("keydown", (event) => this.key(event));
    for (const kind of ["wheel", "pointermove", "dblclick", "click"]) {
      document.addEventListener(kind, () => { this.hasMoved = true; }, { passive: true });
    }
    addEventListener("resize", () => { this.hasMoved = true; });
  }

  async open() {
    try {
      const contents = await readContents();
      if (contents.kind === "live") this.shown = new Live(this);
      else if (contents.kind === "sweep") this.shown = await SweepTable.open(this, contents);
      else this.shown = await Replay.open(this, await Promise.all(contents.records.map((key) => readRecord(key))));
    } catch (error) {
      document.getElementById("stage").replaceChildren(element("p", { class: "message" }, String(error.message ?? error)));
      throw error;
    }
    document.documentElement.dataset.ready = "";
  }

  titled(title) {
    document.getElementById("title").textContent = title;
    document.title = title;
  }

  /** Whether something that is drawn may have moved without a new frame; asks once. */
  moved() {
    const moved = this.hasMoved;
    this.hasMoved = false;
    return moved;
  }

  theme(name) {
    document.documentElement.dataset.theme = name;
    document.getElementById("theme").textContent = name === "night" ? "day" : "night";
    themeChanged();
    this.shown?.views?.forEach((view) => view.themeChanged());
    this.shown?.themeChanged?.();
  }

  switchTheme() {
    this.theme(document.documentElement.dataset.theme === "night" ? "day" : "night");
  }

  switchUnits() {
    switchSpeedUnit();
    document.getElementById("units").textContent = otherSpeedUnit();
    this.shown?.views?.forEach((view) => view.unitsChanged());
  }

  switchNorth() {
    this.northUp = !this.northUp;
    document.getElementById("turn").setAttribute("aria-pressed", String(this.northUp));
    this.shown?.views?.forEach((view) => { view.street.northUp = this.northUp; });
    this.hasMoved = true;
  }

  zoom(factor) {
    this.shown?.views?.forEach((view) => view.street.zoomBy(factor));
    this.hasMoved = true;
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName)) return;
    const live = this.shown instanceof Live;
    // A key that stops the car does so wherever the focus is, whatever lies over the page.
    if (event.key === " " && event.target.tagName === "BUTTON" && !live) return;
    if (event.key === "Escape" && !live) {
      document.getElementById("help").close();
      return;
    }
    const common = {
      "+": () => this.zoom(1.25), "=": () => this.zoom(1.25), "-": () => this.zoom(0.8),
      n: () => this.switchNorth(), v: () => this.shown?.views?.forEach((view) => view.seats.next()), d: () => this.switchTheme(), u: () => this.switchUnits(), "?": () => this.help(),
    }[event.key];
    if (common) common();
    else if (!this.shown?.key?.(event)) return;
    event.preventDefault();
  }

  help() {
    const rows = [...(this.shown?.keys ?? []), ...COMMON_KEYS].map(([keys, what]) => element("tr", {},
      element("td", {}, ...keys.split(" ").flatMap((key) => [element("kbd", {}, key), " "])), element("td", {}, what)));
    const dialog = document.getElementById("help");
    dialog.replaceChildren(
      element("h2", {}, "Keys and touch"), element("table", {}, element("tbody", {}, ...rows)),
      element("p", {}, "Two fingers or the wheel zoom the street, one finger moves it, a double tap puts it back. A tap on the lot shows the car close by."),
      element("form", { method: "dialog" }, element("button", {}, "close")));
    // Not modal: nothing may lie between a finger and the stop button.
    dialog.show();
  }
}

const page = new Page();
globalThis.vveSumo = page;
page.open();
