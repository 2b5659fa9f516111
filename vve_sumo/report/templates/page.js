"use strict";
// What scripts add to the page: curves and points that show their values. Without them the page lacks nothing else.
(() => {
  const STEP = 10; // ticks or runs that an arrow key moves with Shift

  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const add = (parent, tag, text = "", name = "") => {
    const element = parent.appendChild(document.createElement(tag));
    element.textContent = text;
    if (name) element.className = name;
    return element;
  };
  const shown = (value, unit = "") =>
    value === null || value === undefined ? "none" : `${+value.toPrecision(5)}${unit ? `\u00a0${unit}` : ""}`;
  const width = (box) => Math.max(240, box.clientWidth);
  const titled = (column) => (column.unit ? `${column.label} [${column.unit}]` : column.label);

  function axis(column, size) {
    const ink = colour("--quiet");
    const line = { stroke: colour("--line"), width: 1 };
    const names = column && column.names;
    const values = names ? { splits: () => names.map((_, n) => n), values: (_, at) => at.map((n) => names[n]) } : {};
    return { stroke: ink, grid: line, ticks: line, font: "14px system-ui, sans-serif", size, ...values };
  }

  function remade(box, make) {
    // Colours are painted, so another colour scheme and another width are another painting.
    let painted = make();
    let seen = width(box);
    const again = () => { painted.forEach((one) => one.destroy()); painted = make(); };
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
    new ResizeObserver(() => { if (box.clientWidth && width(box) !== seen) { seen = width(box); again(); } }).observe(box);
    return { plots: () => painted, again };
  }

  function keys(box, moves) {
    box.tabIndex = 0;
    box.addEventListener("keydown", (event) => {
      const steps = event.shiftKey ? STEP : 1;
      if (event.key === "ArrowRight") moves.by(steps);
      else if (event.key === "ArrowLeft") moves.by(-steps);
      else if (event.key === "Escape") moves.all();
      else return;
      event.preventDefault();
    });
  }

  function whole(box, moves) {
    const button = add(box, "button", "Show all");
    button.type = "button";
    button.addEventListener("click", () => moves.all());
  }

  function curves(box, data) {
    const out = add(box, "output", "");
    const area = add(box, "div");
    area.setAttribute("role", "group");
    area.setAttribute("aria-label", "curves over time; the arrow keys move along them, Escape shows all");
    let at = null;
    const say = () => {
      if (at === null) { out.textContent = "no time is chosen"; return; }
      const parts = data.panels.flatMap((panel) =>
        panel.series.map((one) => `${one.label} ${shown(one.values[at], panel.unit)}`));
      const leader = data.leaders[data.leader[at]];
      out.textContent = `${shown(data.time[at], "s")}: ${parts.join(", ")}${leader ? `; ahead: ${leader}` : ""}`;
    };
    const panels = data.panels.map((panel) => {
      const place = add(area, "div", "", "panel");
      const head = add(place, "p");
      panel.series.forEach((one, n) => add(head, "span", `${one.label}${panel.unit ? ` [${panel.unit}]` : ""}`, n ? "key other" : "key"));
      return { ...panel, place };
    });
    const make = () => panels.map((panel) => new uPlot({
      width: width(area), height: 140, legend: { show: false },
      cursor: { sync: { key: "drive" }, y: false, drag: { x: true, y: false } },
      scales: {
        x: { time: false },
        y: { range: (_, low, high) => {
          const top = panel.most === null ? high : Math.min(high, panel.most);
          return uPlot.rangeNum(Math.min(low, top), top, 0.08, true);
        } },
      },
      axes: [axis(null, 28), { ...axis(null, 56), space: 24 }],
      series: [{}, ...panel.series.map((one, n) => ({
        label: one.label, stroke: colour(n ? "--second" : "--first"), width: 2, dash: n ? [6, 4] : undefined, points: { show: false },
      }))],
      hooks: { setCursor: [(plot) => { if (plot.cursor.idx !== null && plot.cursor.idx !== undefined) { at = plot.cursor.idx; say(); } }] },
    }, [data.time, ...panel.series.map((one) => one.values)], panel.place));
    const painted = remade(area, make);
    const moves = {
      by: (steps) => {
        at = Math.min(Math.max((at === null ? -1 : at) + steps, 0), data.time.length - 1);
        painted.plots().forEach((plot) => plot.setCursor({ left: plot.valToPos(data.time[at], "x"), top: 1 }, false));
        say();
      },
      all: () => painted.plots().forEach((plot) => plot.setScale("x", { min: data.time[0], max: data.time[data.time.length - 1] })),
    };
    keys(area, moves);
    whole(box, moves);
    say();
  }

  function points(box, data) {
    const choose = (label, columns) => {
      const select = add(add(box, "label", `${label} `), "select");
      columns.forEach((column, n) => { add(select, "option", titled(column)).value = n; });
      select.addEventListener("change", () => painted.again());
      return () => columns[select.value];
    };
    const y = choose("upwards:", data.y);
    const x = choose("to the right:", data.x);
    add(box, "p", "A filled dot met every criterion, a ring did not, a small ring was not judged. A run without the value upwards stands at the lower edge.");
    const out = add(box, "output", "no run is chosen");
    const area = add(box, "div", "", "panel");
    area.setAttribute("role", "group");
    area.setAttribute("aria-label", "runs; the arrow keys go from run to run, Escape shows all");
    let order = [], at = null, ring = null, height = () => null;
    const say = (plot) => {
      const run = order[at];
      const values = [...data.x, ...data.y].map((column) => {
        const value = column.values[run];
        return `${column.label} ${column.names ? column.names[value] : shown(value, column.unit)}`;
      });
      out.textContent = `run ${data.key[run]}, seed ${data.seed[run]}: ${data.text[run]}. ${values.join(", ")}`;
      ring = ring && ring.isConnected ? ring : add(plot.over, "div", "", "ring");
      ring.style.left = `${plot.valToPos(x().values[run], "x")}px`;
      ring.style.top = `${plot.valToPos(height(run), "y")}px`;
    };
    const nearest = (plot) => {
      const { left, top } = plot.cursor;
      if (left === undefined || left < 0) return;
      let best = Infinity, found = null;
      order.forEach((run, n) => {
        const far = Math.hypot(plot.valToPos(x().values[run], "x") - left, plot.valToPos(height(run), "y") - top);
        if (far < best) { best = far; found = n; }
      });
      if (found !== null) { at = found; say(plot); }
    };
    const make = () => {
      const across = x().values, up = y().values;
      const known = up.filter((value) => value !== null);
      const least = known.reduce((a, b) => Math.min(a, b), Infinity), greatest = known.reduce((a, b) => Math.max(a, b), -Infinity);
      // A run that drove through an obstacle has no gap, and is the one to be seen.
      const edge = known.length ? least - 0.08 * (greatest - least || 1) : 0;
      height = (n) => (up[n] === null ? edge : up[n]);
      order = data.key.map((_, n) => n).filter((n) => across[n] !== null).sort((a, b) => across[a] - across[b]);
      at = null;
      const where = (judged) => order.map((n) => (data.passed[n] === judged ? height(n) : null));
      const dots = (size, line, fill) => ({
        paths: () => null, stroke: line, points: { show: true, size, stroke: line, fill, width: 2 },
      });
      const wide = (low, high) => [low - 0.05 * (high - low || 1), high + 0.05 * (high - low || 1)];
      return [new uPlot({
        width: width(area), height: 380, legend: { show: false },
        cursor: { points: { show: false }, drag: { x: true, y: true, uni: 20 } },
        scales: { x: { time: false, range: (_, low, high) => wide(low, high) }, y: { range: (_, low, high) => wide(low, high) } },
        axes: [{ ...axis(x(), 34), label: titled(x()), labelFont: "14px system-ui, sans-serif", labelSize: 24 },
          { ...axis(y(), 60), label: titled(y()), labelFont: "14px system-ui, sans-serif", labelSize: 24 }],
        series: [{}, dots(8, colour("--first"), colour("--first")), dots(11, colour("--bad"), "transparent"), dots(6, colour("--quiet"), "transparent")],
        hooks: { setCursor: [nearest] },
      }, [order.map((n) => across[n]), where(true), where(false), where(null)], area)];
    };
    const painted = remade(area, make);
    const moves = {
      by: (steps) => {
        at = Math.min(Math.max((at === null ? -1 : at) + steps, 0), order.length - 1);
        say(painted.plots()[0]);
      },
      all: () => painted.again(),
    };
    keys(area, moves);
    whole(box, moves);
    if (data.key.length < data.runs) add(box, "p", `${data.key.length} of ${data.runs} runs are drawn: all that failed, collided or had an error, the extremes, and others at random.`);
  }

  function chart() {
    const box = document.getElementById("chart"), held = document.getElementById("data");
    if (!box || !held) return;
    const data = JSON.parse(held.textContent);
    const make = () => { if (box.hidden) { box.hidden = false; (data.kind === "curves" ? curves : points)(box, data); } };
    // A folded section has no width to draw to.
    const section = box.closest("details");
    if (section.open) make();
    section.addEventListener("toggle", () => { if (section.open) make(); });
  }

  function cues() {
    const measured = new ResizeObserver((entries) => entries.forEach(({ target }) =>
      target.classList.toggle("wide", target.scrollWidth > target.clientWidth + 1)));
    document.querySelectorAll(".scroll").forEach((one) => measured.observe(one));
  }

  function paper() {
    let folded = [];
    addEventListener("beforeprint", () => {
      folded = [...document.querySelectorAll("details:not([open], .term, .words)")];
      folded.forEach((one) => { one.open = true; });
    });
    addEventListener("afterprint", () => { folded.forEach((one) => { one.open = false; }); });
  }

  chart();
  cues();
  paper();
})();
