"use strict";
// Plays the run of this page. The pictures of maze and sensors are there already, drawn for paper too;
// this moves the robot in the first (its group "live" is in inches of the maze's frame) and a line
// through time across the second. Text of the run is only ever set as text, never as markup.
(() => {
  const SVG = "http://www.w3.org/2000/svg";
  const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16, 32];
  const FRESH = 1.2; // simulated seconds for which a reading's rays are seen
  const FAR = 18; // inches of a ray that met nothing
  const SIGNS = { contact: "✕", goal: "◆", failed: "◆", refused: "?", pause: "‖", person: "●", fault: "!" };

  const page = document.documentElement;
  const maze = document.querySelector(".maze svg"), live = maze.querySelector(".live");
  const strips = document.querySelector(".strips svg");
  const run = unpacked(JSON.parse(document.getElementById("recording").textContent));
  let now = run.begin, speed = 1, playing = false, last = 0, nextTrail = 0, drawnBelief = -1;

  // -- the recording ---------------------------------------------------------------------------

  function sums(differences, scale) {
    let sum = 0;
    return differences.map((each) => (sum += each) / scale);
  }

  function unpacked(data) {
    const { frames, readings } = data;
    data.begin /= 1000;
    data.end /= 1000;
    data.t = sums(frames.t, 1000);
    data.x = sums(frames.x, 100);
    data.y = sums(frames.y, 100);
    data.h = sums(frames.h, 10);
    const number = (value) => (value === null ? NaN : Number(value.replace ? value.replace("inf", "Infinity") : value));
    data.sensors.forEach((sensor) => (sensor.readings = []));
    sums(readings.t, 1000).forEach((t, i) =>
      data.sensors[readings.sensor[i]].readings.push({
        t, taken: t - readings.took[i] / 1000, value: number(readings.value[i]), true: number(readings.true[i]),
      }));
    data.beliefs = data.beliefs.map(([t, x, y, h, off, turn, spread, note, cloud]) =>
      ({ t: t / 1000, x: x / 100, y: y / 100, h: h / 10, off: number(off), turn: number(turn), spread: number(spread), note, cloud }));
    data.blocks = data.blocks.map(([t, held, x, y, h]) => ({ t: t / 1000, held, x: x / 100, y: y / 100, h: h / 10 }));
    data.marks = data.marks.map(([t, kind, text, x, y]) => ({ t: t / 1000, kind, text, x, y })).sort((a, b) => a.t - b.t);
    data.commands = data.commands.map(([t, text]) => ({ t: t / 1000, text }));
    return data;
  }

  // The place of the last of some times that is not after t; -1 for none.
  function placeOf(times, t, time = (each) => each) {
    let low = 0, high = times.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (time(times[middle]) <= t + 1e-9) low = middle + 1;
      else high = middle;
    }
    return low - 1;
  }

  const latest = (items, t) => items[placeOf(items, t, (each) => each.t)];

  function poseAt(t) {
    const i = placeOf(run.t, t), j = i + 1;
    if (i < 0) return { x: run.x[0], y: run.y[0], h: run.h[0] };
    const part = j < run.t.length ? (t - run.t[i]) / (run.t[j] - run.t[i]) : 0;
    const at = (column) => column[i] + (part ? part * (column[j] - column[i]) : 0);
    return { x: at(run.x), y: at(run.y), h: at(run.h) };
  }

  // A place of the robot's frame in the maze's.
  function placed(pose, x, y) {
    const a = (pose.h * Math.PI) / 180;
    return [pose.x + x * Math.cos(a) - y * Math.sin(a), pose.y + x * Math.sin(a) + y * Math.cos(a)];
  }

  // -- elements --------------------------------------------------------------------------------

  function element(name, attributes = {}, ...children) {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) {
      if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
      else made.setAttribute(key, value);
    }
    made.append(...children);
    return made;
  }

  function drawn(name, parent, kind, attributes = {}) {
    const made = document.createElementNS(SVG, name);
    set(made, { class: kind, ...attributes });
    parent.append(made);
    return made;
  }

  function set(target, attributes) {
    for (const [key, value] of Object.entries(attributes)) target.setAttribute(key, value);
  }

  function body(parent, kind) {
    const group = drawn("g", parent, kind);
    if (run.radius !== null) drawn("circle", group, "body", { r: run.radius });
    else drawn("polygon", group, "body", { points: run.vertices.join(" ") });
    drawn("path", group, "nose", { d: `M0 0H${run.front}` });
    return group;
  }

  const [width, height] = run.maze;
  drawn("rect", drawn("clipPath", live, "", { id: "inside" }), "", { width, height });
  const trail = drawn("path", live, "trail"), cloud = drawn("path", live, "cloud");
  const rays = drawn("g", live, "rays");
  const half = run.block / 2;
  const block = drawn("rect", live, "block", { x: -half, y: -half, width: run.block, height: run.block });
  const spread = drawn("circle", drawn("g", live, "", { "clip-path": "url(#inside)" }), "spread"), believed = body(live, "believed"), robot = body(live, "robot");
  const touches = drawn("g", live, "touches");
  const button = (label, title, action, kind = "") => element("button", { type: "button", title, class: kind, onclick: action }, label);
  const play = button("▶ Play", "space", () => setPlaying(!playing), "play");
  const clock = element("output", { class: "clock" }), words = element("p", { class: "words" });
  const happened = element("p", { class: "happened" }), tip = element("div", { class: "tip", hidden: "" });
  const slider = element("input", {
    type: "range", min: run.begin, max: run.end, step: 0.01, "aria-label": "time",
    oninput: () => seek(Number(slider.value)),
  });
  const speeds = element("select", { title: "speed: [ and ]", onchange: () => (speed = Number(speeds.value)) },
    ...SPEEDS.map((each) => element("option", { value: each }, `${each}×`)));
  const marks = element("div", { class: "marks" }, ...run.marks.map((mark) => {
    const sign = button(SIGNS[mark.kind], `${mark.t.toFixed(1)} s: ${mark.text}`, () => seek(mark.t), mark.kind);
    sign.tabIndex = -1;
    sign.style.left = `calc(8px + ${(mark.t - run.begin) / (run.end - run.begin || 1)} * (100% - 16px))`;
    return sign;
  }));
  const chips = run.sensors.filter((sensor) => sensor.readings.length).map((sensor) => {
    const value = element("b"), truth = element("i");
    return { sensor, value, truth, box: element("span", { class: "chip", title: sensor.name }, element("span", {}, sensor.code), value, truth) };
  });
  const cursor = strips && run.clock ? drawn("path", strips, "cursor") : null;

  document.querySelector(".maze").after(
    element("div", { class: "controls" },
      element("div", { class: "timeline" }, marks, slider),
      element("div", { class: "buttons" }, play, speeds, clock,
        button("◂ event", "N, or shift and n", () => toMark(-1)), button("event ▸", "n", () => toMark(1)),
        button("whole way", "w", wholeWay), button("light / dark", "d", changeTheme))),
    element("div", { class: "now" }, words, happened, element("div", { class: "chips" }, ...chips.map((each) => each.box)),
      element("p", { class: "keys" }, "Keys: space plays, arrows 1 s (with shift 10 s), [ ] speed, n N events, c C contacts, " +
        "home end, w whole way, d dark. A click on the way or on the sensors goes there. Green is the robot, violet where it " +
        "believes to be; an orange line ends where a sensor saw something, its light cone where there is something. Grey " +
        "beside a reading is the truth.")),
    tip);

  // -- a moment --------------------------------------------------------------------------------

  function show() {
    page.classList.add("at-moment");
    const pose = poseAt(now), belief = latest(run.beliefs, now), command = latest(run.commands, now);
    set(robot, { transform: `translate(${pose.x} ${pose.y}) rotate(${pose.h})` });
    showTrail(pose);
    showBlock(pose);
    showBelief(belief);
    showRays();
    showTouches();
    for (const { sensor, value, truth, box } of chips) showChip(latest(sensor.readings, now), sensor, value, truth, box);
    clock.textContent = `${now.toFixed(2)} / ${run.end.toFixed(1)} s`;
    const told = [`at (${pose.x.toFixed(2)}, ${pose.y.toFixed(2)}) heading ${angle(pose.h)}°`];
    if (command) told.push(`last movement ${command.text}`);
    if (belief) {
      const doubt = Number.isFinite(belief.spread) ? `, spread ${belief.spread.toFixed(1)} in` : "";
      told.push(`belief off ${belief.off.toFixed(1)} in and ${belief.turn.toFixed(0)}°${doubt}`);
      if (belief.note) told.push(belief.note);
    }
    if (run.limit !== null) told.push(`${Math.max(run.limit - now, 0).toFixed(0)} s left`);
    words.textContent = told.join("  ·  ");
    const mark = latest(run.marks, now);
    happened.textContent = mark ? `${mark.t.toFixed(1)} s: ${mark.text}` : "";
    happened.className = `happened ${mark && now - mark.t < 2 ? "fresh " + mark.kind : ""}`;
    slider.value = now;
    if (cursor) {
      const { left, right, end, top } = run.clock, x = left + (now / end) * (right - left);
      set(cursor, { d: `M${x.toFixed(1)} ${top}V${top + run.clock.of.length * run.clock.step}` });
    }
  }

  const angle = (heading) => (((heading % 360) + 360) % 360).toFixed(1);

  let trailText = "";
  function showTrail(pose) {
    const until = placeOf(run.t, now) + 1;
    if (until < nextTrail) [nextTrail, trailText] = [0, ""];
    for (; nextTrail < until; nextTrail++) {
      trailText += `${nextTrail ? "L" : "M"}${run.x[nextTrail].toFixed(2)} ${run.y[nextTrail].toFixed(2)}`;
    }
    set(trail, { d: trailText ? `${trailText}L${pose.x} ${pose.y}` : "" });
  }

  let touched = "";
  function showTouches() {
    const past = run.marks.filter((mark) => mark.kind === "contact" && mark.x !== undefined && mark.t <= now + 1e-9);
    const old = past.filter((mark) => now - mark.t >= FRESH).length;
    if (touched === `${old} ${past.length}`) return;
    touched = `${old} ${past.length}`;
    touches.replaceChildren();
    past.forEach(({ x, y }, i) => {
      const kind = i < old ? "touch" : "touch fresh";
      drawn("path", touches, kind, { d: `M${x - 0.6} ${y - 0.6}l1.2 1.2m0 -1.2l-1.2 1.2` });
      if (i >= old) drawn("circle", touches, kind, { cx: x, cy: y, r: 1.6 });
    });
  }

  function showBlock(pose) {
    const told = latest(run.blocks, now) || run.blocks[0];
    const [x, y] = told.held ? placed(pose, told.x, told.y) : [told.x, told.y];
    set(block, { transform: `translate(${x} ${y}) rotate(${told.held ? pose.h + told.h : told.h})` });
    block.classList.toggle("held", Boolean(told.held));
  }

  function showBelief(belief) {
    const place = belief ? run.beliefs.indexOf(belief) : -1;
    if (place === drawnBelief) return;
    drawnBelief = place;
    for (const each of [believed, spread, cloud]) each.style.display = belief ? "" : "none";
    if (!belief) return;
    set(believed, { transform: `translate(${belief.x} ${belief.y}) rotate(${belief.h})` });
    set(spread, { cx: belief.x, cy: belief.y, r: Number.isFinite(belief.spread) ? Math.min(belief.spread, 200) : 0 });
    let dots = "";
    for (let i = 0; i < belief.cloud.length; i += 2) dots += `M${belief.cloud[i] / 10} ${belief.cloud[i + 1] / 10}h0`;
    set(cloud, { d: dots });
  }

  // What a sensor was told stands as a line with a dot at its end, what was true as a light cone.
  function showRays() {
    rays.replaceChildren();
    for (const sensor of run.sensors) {
      const reading = sensor.kind && latest(sensor.readings, now);
      if (!reading || now - reading.t > FRESH) continue;
      const pose = poseAt(reading.taken), [x, y] = placed(pose, sensor.at[0], sensor.at[1]);
      const style = { opacity: (1 - 0.8 * (now - reading.t) / FRESH).toFixed(2) };
      if (sensor.kind === "yes") {
        drawn("circle", rays, reading.value ? "spot on" : "spot", { cx: x, cy: y, r: 0.45, ...style });
        continue;
      }
      const bearing = pose.h + sensor.at[2], end = (length, turn = 0) => placed({ x, y, h: bearing + turn }, length, 0);
      const sees = Number.isFinite(reading.true) ? reading.true : FAR, wide = Math.min(sensor.view, 180) / 2;
      const cone = [-1, -0.5, 0, 0.5, 1].map((side) => end(sees, side * wide).join(" ")).join("L");
      drawn("path", rays, "cone", { d: `M${x} ${y}L${cone}Z`, ...style });
      const hit = Number.isFinite(reading.value), [tipX, tipY] = end(hit ? reading.value : FAR);
      drawn("path", rays, hit ? "ray" : "ray none", { d: `M${x} ${y}L${tipX} ${tipY}`, ...style });
      if (hit) drawn("circle", rays, "hit", { cx: tipX, cy: tipY, r: 0.5, ...style });
    }
  }

  const shown = (value) => (Number.isFinite(value) ? String(Number(value.toFixed(2))) : Number.isNaN(value) ? "–" : "nothing");

  function showChip(reading, sensor, value, truth, box) {
    box.classList.toggle("fresh", Boolean(reading) && now - reading.t < FRESH);
    value.textContent = reading ? shown(reading.value) : "";
    const differs = reading && !sensor.counts && shown(reading.true) !== shown(reading.value);
    truth.textContent = differs ? shown(reading.true) : "";
  }

  // -- the clock -------------------------------------------------------------------------------

  function seek(t) {
    now = Math.min(Math.max(t, run.begin), run.end);
    if (now >= run.end) setPlaying(false);
    show();
  }

  function setPlaying(on) {
    if (on && now >= run.end) now = run.begin;
    const stops = playing && !on;
    playing = on;
    play.textContent = on ? "‖ Pause" : "▶ Play";
    if (on) {
      last = performance.now();
      requestAnimationFrame(tick);
    } else if (stops) remember();
  }

  function tick(time) {
    if (!playing) return;
    seek(now + (speed * Math.max(time - last, 0)) / 1000);
    last = time;
    requestAnimationFrame(tick);
  }

  function remember() {
    try {
      history.replaceState(null, "", `#t=${now.toFixed(2)}`);
    } catch { /* a page within another has no address of its own */ }
  }

  function faster(step) {
    speed = SPEEDS[Math.min(Math.max(SPEEDS.indexOf(speed) + step, 0), SPEEDS.length - 1)];
    speeds.value = speed;
  }

  function toMark(step, kind) {
    const found = run.marks.filter((mark) => !kind || mark.kind === kind);
    const mark = step > 0 ? found.find((each) => each.t > now + 1e-6) : found.findLast((each) => each.t < now - 1e-6);
    if (mark) seek(mark.t);
  }

  function wholeWay() {
    setPlaying(false);
    page.classList.remove("at-moment");
    clock.textContent = `${run.end.toFixed(1)} s`;
    words.textContent = "The whole way. Play it, or click on it to see a moment.";
    happened.textContent = "";
    for (const { value, truth, box } of chips) {
      value.textContent = truth.textContent = "";
      box.classList.remove("fresh");
    }
  }

  function changeTheme() {
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    page.dataset.theme = (page.dataset.theme || (dark ? "dark" : "light")) === "dark" ? "light" : "dark";
  }

  // -- pointer and keys ------------------------------------------------------------------------

  function tell(event, text) {
    tip.hidden = !text;
    tip.textContent = text;
    tip.style.left = `${Math.min(event.pageX + 14, page.clientWidth - 250)}px`;
    tip.style.top = `${event.pageY + 14}px`;
  }

  // When the robot was nearest to the pointer, if it was within two inches of it.
  function timeOnWay(event) {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(live.getScreenCTM().inverse());
    let best = 2, found = null;
    for (let i = 0; i < run.t.length; i++) {
      const j = Math.min(i + 1, run.t.length - 1), dx = run.x[j] - run.x[i], dy = run.y[j] - run.y[i];
      const length = dx * dx + dy * dy;
      const part = length ? Math.min(Math.max(((at.x - run.x[i]) * dx + (at.y - run.y[i]) * dy) / length, 0), 1) : 0;
      const off = Math.hypot(at.x - run.x[i] - part * dx, at.y - run.y[i] - part * dy);
      if (off < best - 1e-6) [best, found] = [off, run.t[i] + part * (run.t[j] - run.t[i])];
    }
    return found;
  }

  maze.addEventListener("pointermove", (event) => {
    const t = timeOnWay(event), pose = t === null ? null : poseAt(t);
    tell(event, pose ? `${t.toFixed(2)} s: (${pose.x.toFixed(1)}, ${pose.y.toFixed(1)}) heading ${angle(pose.h)}°` : "");
  });
  maze.addEventListener("click", (event) => {
    const t = timeOnWay(event);
    if (t !== null) seek(t);
  });

  function onStrips(event) {
    const { left, right, end, top, step, of } = run.clock;
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(strips.getScreenCTM().inverse());
    const t = Math.min(Math.max(((at.x - left) / (right - left)) * end, 0), end);
    if (event.type === "click" || event.buttons & 1) seek(t);
    const code = of[Math.floor((at.y - top) / step)], sensor = run.sensors.find((each) => each.code === code);
    const reading = sensor && latest(sensor.readings, t), belief = code === "belief" && latest(run.beliefs, t);
    let text = `${t.toFixed(2)} s`;
    if (reading) text += `: ${code} ${shown(reading.value)} ${sensor.unit}` + (sensor.counts ? "" : `, true ${shown(reading.true)}`);
    if (belief) text += `: off ${belief.off.toFixed(2)} in and ${belief.turn.toFixed(1)}°`;
    tell(event, text);
  }

  if (cursor) for (const name of ["pointermove", "click"]) strips.addEventListener(name, onStrips);
  for (const each of [maze, strips]) if (each) each.addEventListener("pointerleave", () => (tip.hidden = true));

  const KEYS = {
    " ": () => setPlaying(!playing), "[": () => faster(-1), "]": () => faster(1),
    ArrowLeft: (event) => seek(now - (event.shiftKey ? 10 : 1)), ArrowRight: (event) => seek(now + (event.shiftKey ? 10 : 1)),
    Home: () => seek(run.begin), End: () => seek(run.end), n: () => toMark(1), N: () => toMark(-1),
    c: () => toMark(1, "contact"), C: () => toMark(-1, "contact"), w: wholeWay, d: changeTheme,
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target === speeds || !KEYS[event.key]) return;
    if (event.key === " " && event.target.tagName === "BUTTON" && event.target !== play) return;
    event.preventDefault();
    KEYS[event.key](event);
  });

  function fromAddress() {
    const found = /^#t=([0-9.]+)$/.exec(location.hash);
    if (!found) return;
    setPlaying(false);
    seek(Number(found[1]));
  }

  speeds.value = speed;
  slider.value = now;
  page.classList.add("playable");
  wholeWay();
  addEventListener("hashchange", fromAddress);
  fromAddress();
})();
