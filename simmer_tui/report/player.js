"use strict";
// Plays the run of this page. The pictures of maze and sensors are there already, drawn for paper too;
// this moves the robot in the first (its group "live" is in inches of the maze's frame) and a line
// through time across the second. Text of the run is only ever set as text, never as markup.
// With `live` the recording grows by what `take` is given: { pace, lag } are the simulated seconds a second
// at which the newest is approached, and the most real seconds that what is shown may be behind it.
function simmerPlayer(recording, live) {
  const SVG = "http://www.w3.org/2000/svg";
  const PLAYBACK_RATES = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16, 32];
  const FRESH = 1.2; // simulated seconds for which a reading's rays are seen
  const FAR = 18; // inches of a ray that met nothing
  const DIGITS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/", NO_ECHO = 4095; // of a range in a scan
  const SIGNS = { contact: "✕", goal: "◆", failed: "◆", refused: "?", pause: "‖", person: "●", fault: "!" };

  const page = document.documentElement;
  const maze = document.querySelector(".maze svg"), layer = maze.querySelector(".live");
  const strips = document.querySelector(".strips svg");
  const run = { ...recording, moment: recording.moment === null ? null : recording.moment / 1000 };
  let now = 0, playbackRate = 1, playing = false, following = Boolean(live), over = false, last = 0, lastFollowed = 0, nextTrail = 0, drawnBelief, drawnScans;
  const arrivals = []; // of a run that continues: until when, and since when by the clock of this page

  // -- the recording ---------------------------------------------------------------------------

  function sums(differences, scale) {
    let sum = 0;
    return differences.map((each) => (sum += each) / scale);
  }

  const number = (value) => (value === null ? NaN : Number(value.replace ? value.replace("inf", "Infinity") : value));

  function append(items, more) {
    for (const each of more) items.push(each); // by hand: as arguments there may be too many of them
  }

  function clear() {
    for (const name of ["t", "x", "y", "h", "beliefs", "blocks", "marks", "commands"]) run[name] = [];
    run.boards = new Map(); // what each has shown
    run.sensors.forEach((sensor) => Object.assign(sensor, { readings: [], scans: [] }));
    drawnScans = [];
    run.one_in = 1;
    run.heat = null; // of a grid that the log has without its cells, the map before is shown
    nextTrail = 0;
    drawnBelief = undefined;
  }

  // Takes in what is new; the first time that is all of it.
  function add(data) {
    const { frames, readings } = data;
    run.begin = data.begin / 1000;
    run.end = data.end / 1000;
    if (data.drop) {
      const kept = run.t.length - data.drop;
      for (const column of [run.t, run.x, run.y, run.h]) column.length = kept;
      if (nextTrail > kept) nextTrail = 0;
    }
    append(run.t, sums(frames.t, 1000));
    append(run.x, sums(frames.x, 100));
    append(run.y, sums(frames.y, 100));
    append(run.h, sums(frames.h, 10));
    sums(readings.t, 1000).forEach((t, i) =>
      run.sensors[readings.sensor[i]].readings.push({
        t, taken: t - readings.took[i] / 1000, value: number(readings.value[i]), true: number(readings.true[i]),
      }));
    for (; run.one_in < data.one_in; run.one_in *= 2) run.beliefs.forEach((belief) => (belief.cloud = everySecond(belief.cloud)));
    append(run.beliefs, data.beliefs.map(([t, x, y, h, off, turn, spread, note, cloud, grid]) => {
      if (!grid) run.heat = null;
      else if (grid.length > 8) run.heat = { bounds: grid.slice(0, 4), rows: grid[8], columns: grid[9], runs: grid[10] };
      return {
        t: t / 1000, x: x / 100, y: y / 100, h: h / 10, off: number(off), turn: number(turn), spread: number(spread), note, cloud,
        headed: !grid || Boolean(grid[4]), numbers: grid && grid.slice(5, 8), heat: run.heat,
      };
    }));
    for (const [sensor, t, begin, span, first, turn, ranges] of data.scans) {
      run.sensors[sensor].scans.push({ t: t / 1000, begin: begin / 1000, span: span / 1000, first: first / 10, turn, ranges });
    }
    append(run.blocks, data.blocks.map(([t, held, x, y, h]) => ({ t: t / 1000, held, x: x / 100, y: y / 100, h: h / 10 })));
    for (const [t, board, pin, led, displays] of data.displays) {
      if (!run.boards.has(board)) run.boards.set(board, []);
      run.boards.get(board).push({ t: t / 1000, pin, led, displays });
    }
    append(run.marks, data.marks.map(([t, kind, text, x, y]) => ({ t: t / 1000, kind, text, x, y })));
    run.marks.sort((a, b) => a.t - b.t);
    append(run.commands, data.commands.map(([t, text]) => ({ t: t / 1000, text })));
    run.doing = data.doing && { t: data.doing[0] / 1000, text: data.doing[1] };
    forget(data.since / 1000);
  }

  const everySecond = (cloud) => cloud.filter((_, i) => i % 4 < 2); // pairs of x and y

  // What is older than the recording has is let go here, too; of the block its last place before that stays.
  function forget(since) {
    const before = (items, t) => placeOf(items, t - 1e-6, (each) => each.t);
    const drop = (items, count) => count > 0 && items.splice(0, count);
    for (const items of [...run.sensors.flatMap((sensor) => [sensor.readings, sensor.scans]), run.beliefs, run.marks]) drop(items, before(items, run.begin) + 1);
    for (const items of [run.blocks, ...run.boards.values()]) drop(items, before(items, run.begin));
    drop(run.commands, before(run.commands, since));
    const gone = placeOf(run.t, since - 1e-6) + 1;
    if (gone <= 0) return;
    for (const column of [run.t, run.x, run.y, run.h]) column.splice(0, gone);
    nextTrail = 0;
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

  clear();
  add(recording);
  now = run.begin;

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
  drawn("rect", drawn("clipPath", layer, "", { id: "inside" }), "", { width, height });
  // Walls keep their colour, also where a grid's cells lie across their edges.
  drawn("path", drawn("clipPath", layer, "", { id: "open" }), "", { d: run.open.map(([x, y]) => `M${x} ${y}h${run.cell}v${run.cell}h${-run.cell}z`).join("") });
  const heatLayer = drawn("g", layer, "heat", { "clip-path": "url(#open)" });
  const heats = ["b", "c", "d"].map((level) => drawn("path", heatLayer, `heat-${level}`));
  // The colours of the legend's scale of time; a run that goes on has no such scale.
  const trailLayer = drawn("g", layer, run.shades ? "ramp fixed" : "");
  const trails = (run.shades || [""]).map((color) => drawn("path", trailLayer, "trail", color ? { style: `stroke: ${color}` } : {}));
  const cloud = drawn("path", layer, "cloud");
  // With a rim in the colour of the page, since dots on walls are as dark as these.
  const scans = ["scans rim", "scans"].map((kind) => drawn("path", layer, kind)), rays = drawn("g", layer, "rays");
  const half = run.block / 2;
  const block = drawn("rect", layer, "block", { x: -half, y: -half, width: run.block, height: run.block });
  const spread = drawn("circle", drawn("g", layer, "", { "clip-path": "url(#inside)" }), "spread"), believed = body(layer, "believed"), robot = body(layer, "robot");
  const touches = drawn("g", layer, "touches");
  // A sign alone is named by its title.
  const button = (label, title, action, kind = "") =>
    element("button", { type: "button", title, class: kind, onclick: action, ...(/[a-z]/i.test(label) ? {} : { "aria-label": title }) }, label);
  const play = button("▶ Play", "space", playOrPause, "play");
  const goLive = button("● Live", "l: what happens now", follow, "golive");
  const decided = button("deciding moment", "m: the moment that decided", toMoment);
  const earlier = button("◂ event", "N, or shift and n", () => toMark(-1)), later = button("event ▸", "n", () => toMark(1));
  const clock = element("output", { class: "clock" }), words = element("p", { class: "words" });
  const boards = element("div", { class: "boards" });
  const happened = element("p", { class: "happened" }), tip = element("div", { class: "tip", hidden: "" });
  const slider = element("input", {
    type: "range", min: run.begin, max: run.end, step: 0.01, "aria-label": "time",
    oninput: () => seek(Number(slider.value)),
  });
  const rates = element("select", { title: "playback rate: [ and ]", "aria-label": "playback rate", onchange: () => (playbackRate = Number(rates.value)) },
    ...PLAYBACK_RATES.map((each) => element("option", { value: each }, `${each}×`)));
  const marks = element("div", { class: "marks" }), markSigns = new Map();
  const sensorChips = element("div", { class: "chips" }), chips = new Map();
  const readings = element("details", {}, element("summary", {}, "All readings"), sensorChips);
  readings.open = innerWidth > 700; // on a phone they would push the reasons out of sight
  const cursor = strips && run.clock ? drawn("path", strips, "cursor") : null;

  // The run's moments. Those of one time have a tick there, and a link as near to it as the others let it be.
  const moments = [];
  for (const [t, text, isCause] of run.moments || []) {
    const label = `${(t / 1000).toFixed(1)} s`, said = isCause ? `${text} (the cause)` : text;
    const same = moments[moments.length - 1];
    if (t / 1000 < run.begin) continue;
    if (same?.label === label) Object.assign(same, { said: `${same.said}; ${said}`, isCause: same.isCause || isCause });
    else moments.push({ t: t / 1000, label, said, isCause });
  }
  for (const moment of moments) {
    const { t, label, said, isCause } = moment, kind = isCause ? "cause" : "";
    moment.tick = element("i", { class: kind, style: `--t: ${t}` });
    moment.link = element("a", { class: kind, href: `#t=${t.toFixed(2)}`, title: `${label}: ${said}` }, label);
  }
  const momentBar = element("nav", { class: "moments", "aria-label": "moments of the run" }, ...moments.flatMap(({ tick, link }) => [tick, link]));
  momentBar.hidden = !moments.length;

  const figure = document.querySelector(".maze"), legend = figure.nextElementSibling;
  figure.after(
    element("div", { class: "controls" },
      element("div", { class: "timeline" }, marks, slider, momentBar),
      element("div", { class: "buttons" }, play, rates, clock, ...(live ? [goLive] : []), decided, earlier, later,
        ...(live ? [] : [button("whole path", "w", wholeWay)]), button("light / dark", "d", changeTheme))));
  (legend?.matches(".legend") ? legend : document.querySelector(".controls")).after(
    element("div", { class: "now" }, words, happened, boards, readings,
      element("details", { class: "keys" }, element("summary", {}, "Keys and colours"),
        (live ? "L returns to what happens now. " : "") +
        "Space plays, arrows 1 s (with shift 10 s), [ ] playback rate, n N events, c C contacts, m the moment that decided, home end, " +
        (live ? "" : "w whole path, ") + "d dark. A click on the path or on the sensors goes there. Solid is the robot, dashed where it believes to " +
        "be. A line ends where a sensor saw something, its light cone where there is something. Dots are the scan of a lidar. Grey beside a reading is the " +
        "truth.")),
    tip);

  // Brings the clock, its marks and the sensors up to date with the recording.
  function furnish() {
    slider.min = run.begin;
    slider.max = run.end;
    for (const each of [marks, momentBar]) set(each, { style: `--begin: ${run.begin}; --span: ${run.end - run.begin || 1}` });
    for (const [mark, sign] of markSigns) {
      if (mark.t >= run.begin && run.marks.includes(mark)) continue;
      sign.remove();
      markSigns.delete(mark);
    }
    for (const mark of run.marks) {
      if (markSigns.has(mark)) continue;
      const sign = button(SIGNS[mark.kind], `${mark.t.toFixed(1)} s: ${mark.text}`, () => seek(mark.t), mark.kind);
      sign.tabIndex = -1;
      sign.style.setProperty("--t", mark.t);
      markSigns.set(mark, sign);
      marks.append(sign);
    }
    for (const sensor of run.sensors) {
      if (chips.has(sensor) || !sensor.readings.length) continue;
      const value = element("b"), truth = element("i");
      const box = element("span", { class: "chip", title: [sensor.name, sensor.unit].filter(Boolean).join(", ") }, element("span", {}, sensor.code), value, truth);
      chips.set(sensor, { value, truth, box });
      sensorChips.append(...run.sensors.filter((each) => chips.has(each)).map((each) => chips.get(each).box));
    }
    decided.hidden = run.moment === null;
  }

  // -- a moment --------------------------------------------------------------------------------

  function show() {
    page.classList.add("at-moment");
    const pose = poseAt(now), belief = latest(run.beliefs, now) || null, command = run.doing && run.doing.t <= now + 1e-9 ? run.doing : latest(run.commands, now);
    set(robot, { transform: `translate(${pose.x} ${pose.y}) rotate(${pose.h})`, "data-time": now.toFixed(4) });
    showTrail(pose);
    showBlock(pose);
    showBelief(belief);
    showRays();
    showScans();
    showTouches();
    showBoards();
    for (const [sensor, { value, truth, box }] of chips) showChip(latest(sensor.readings, now), sensor, value, truth, box);
    clock.textContent = `${now.toFixed(2)} / ${run.end.toFixed(1)} s`;
    const told = [`at (${pose.x.toFixed(2)}, ${pose.y.toFixed(2)}) heading ${angle(pose.h)}°`];
    if (command) told.push(`last movement ${command.text}`);
    if (belief) {
      const doubt = Number.isFinite(belief.spread) ? `, spread ${belief.spread.toFixed(1)} in` : "";
      const turn = belief.headed ? ` and ${belief.turn.toFixed(0).replace(/^-0$/, "0")}°` : "";
      told.push(`belief off ${belief.off.toFixed(1)} in${turn}${doubt}`);
      if (belief.numbers) {
        const [best, truth] = belief.numbers.map(share);
        told.push(`best cell ${best}, true cell ${truth}, entropy ${belief.numbers[2].toFixed(1)} bit`);
      }
      if (belief.note) told.push(belief.note);
    }
    if (run.limit !== null) told.push(`${Math.max(run.limit - now, 0).toFixed(0)} s left`);
    words.textContent = told.join("  ·  ");
    const mark = latest(run.marks, now);
    happened.textContent = mark ? `${mark.t.toFixed(1)} s: ${mark.text}` : "";
    happened.className = `happened ${mark && now - mark.t < 2 ? "fresh " + mark.kind : ""}`;
    slider.value = now;
    earlier.disabled = !run.marks.length || run.marks[0].t >= now - 1e-6;
    later.disabled = !run.marks.length || run.marks[run.marks.length - 1].t <= now + 1e-6;
    const newest = latest(moments, now + 0.006); // an address has hundredths of a second
    for (const each of moments) each.link.toggleAttribute("aria-current", each === newest);
    if (cursor) {
      const { left, right, end, top } = run.clock, x = left + (now / end) * (right - left);
      set(cursor, { d: `M${x.toFixed(1)} ${top}V${top + run.clock.of.length * run.clock.step}` });
    }
  }

  // Links that would cover each other are moved apart, in their order.
  function layMoments() {
    const room = momentBar.clientWidth, gap = 3, wide = moments.map(({ link }) => link.offsetWidth);
    const isTight = wide.reduce((sum, each) => sum + each + gap, -gap) > room;
    momentBar.classList.toggle("tight", isTight);
    if (isTight || !room) return;
    const lefts = [];
    moments.forEach(({ tick }, i) => (lefts[i] = Math.max(tick.offsetLeft - wide[i] / 2, i ? lefts[i - 1] + wide[i - 1] + gap : 0)));
    for (let i = moments.length - 1, right = room; i >= 0; right = lefts[i--] - gap) lefts[i] = Math.min(lefts[i], right - wide[i]);
    moments.forEach(({ link }, i) => (link.style.left = `${lefts[i]}px`));
  }

  const share = (value) => (value > 0 && value < 1 ? "less than 1 %" : `${value.toFixed(0)} %`);
  // Not wrapped, as in the log, so that it can be compared with a compass and a gyroscope.
  const angle = (heading) => heading.toFixed(1).replace(/^-0.0$/, "0.0");

  // Place of the colour of a part of the path.
  const shadeAt = (t) => (trails.length < 2 ? 0 : Math.round(Math.min(run.path_end ? t / run.path_end : 0, 1) * (trails.length - 1)));

  let trailTexts = [], trailsDrawn = [];
  function showTrail(pose) {
    const until = placeOf(run.t, now) + 1;
    if (until < nextTrail || !nextTrail) [nextTrail, trailTexts] = [0, trails.map(() => "")];
    const part = (texts, i, x, y, t) => {
      const shade = shadeAt((run.t[i] + t) / 2);
      texts[shade] += `${texts[shade] ? "" : `M${run.x[i].toFixed(2)} ${run.y[i].toFixed(2)}`}L${x.toFixed(2)} ${y.toFixed(2)}`;
    };
    for (; nextTrail < until; nextTrail++) {
      if (nextTrail) part(trailTexts, nextTrail - 1, run.x[nextTrail], run.y[nextTrail], run.t[nextTrail]);
    }
    const texts = [...trailTexts];
    if (until) part(texts, until - 1, pose.x, pose.y, now);
    texts.forEach((text, i) => text === trailsDrawn[i] || set(trails[i], { d: text }));
    trailsDrawn = texts;
  }

  let boardsShown = [];
  function showBoards() {
    const shown = [...run.boards].map(([name, items]) => [name, latest(items, now)]).filter(([, item]) => item);
    if (shown.length === boardsShown.length && shown.every(([, item], i) => item === boardsShown[i])) return;
    boardsShown = shown.map(([, item]) => item);
    boards.replaceChildren(...shown.map(([name, { pin, led, displays }]) =>
      element("div", {}, element("span", {}, `${name}  ·  LED ${pin} ${led ? "on" : "off"}`),
        ...displays.map((rows) => element("pre", {}, rows.join("\n"))))));
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
    if (belief === drawnBelief) return; // null: there is none; undefined: nothing was drawn yet
    drawnBelief = belief;
    for (const each of [believed, spread, cloud]) each.style.display = belief ? "" : "none";
    showHeat(belief && belief.heat);
    if (!belief) return;
    set(believed, { transform: `translate(${belief.x} ${belief.y}) rotate(${belief.h})` });
    believed.classList.toggle("headless", !belief.headed);
    set(spread, { cx: belief.x, cy: belief.y, r: !belief.numbers && Number.isFinite(belief.spread) ? Math.min(belief.spread, 200) : 0 });
    let dots = "";
    for (let i = 0; i < belief.cloud.length; i += 2) dots += `M${belief.cloud[i] / 10} ${belief.cloud[i + 1] / 10}h0`;
    set(cloud, { d: dots });
  }

  // The map of a grid: runs of cells by level, row by row from the top left; "a" is ruled out.
  function showHeat(heat) {
    const paths = { b: "", c: "", d: "" };
    if (heat) {
      const [x0, y0, x1, y1] = heat.bounds, { columns, rows } = heat;
      const wide = (x1 - x0) / columns, high = (y1 - y0) / rows;
      let at = 0;
      for (const [, level, count] of heat.runs.matchAll(/([a-d])(\d*)/g)) {
        for (let left = Number(count || 1); left > 0;) {
          const column = at % columns, length = Math.min(left, columns - column);
          if (level !== "a") paths[level] += `M${x0 + column * wide} ${y1 - Math.floor(at / columns) * high}h${length * wide}v${-high}h${-length * wide}z`;
          at += length;
          left -= length;
        }
      }
    }
    heats.forEach((path, i) => set(path, { d: paths["bcd"[i]] }));
  }

  // A line with a dot at its end is the reported range, a light cone the true one.
  function showRays() {
    rays.replaceChildren();
    for (const sensor of run.sensors) {
      const reading = sensor.kind && sensor.kind !== "scan" && latest(sensor.readings, now);
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

  // A dot where each beam of a lidar's newest scan ended, from where the robot was when it was sent.
  function showScans() {
    const newest = run.sensors.flatMap((sensor) => latest(sensor.scans, now) || []);
    if (newest.length === drawnScans.length && newest.every((scan, i) => scan === drawnScans[i])) return;
    drawnScans = newest;
    let dots = "";
    for (const sensor of run.sensors) {
      const scan = latest(sensor.scans, now), rays = scan ? scan.ranges.length / 2 : 0;
      for (let i = 0; i < rays; i++) {
        const range = 64 * DIGITS.indexOf(scan.ranges[2 * i]) + DIGITS.indexOf(scan.ranges[2 * i + 1]);
        if (range === NO_ECHO) continue;
        const pose = poseAt(scan.begin + (scan.span * i) / rays), [x, y] = placed(pose, sensor.at[0], sensor.at[1]);
        const [tipX, tipY] = placed({ x, y, h: pose.h + scan.first + i * scan.turn }, range * run.step, 0);
        dots += `M${tipX.toFixed(2)} ${tipY.toFixed(2)}h0`;
      }
    }
    for (const path of scans) set(path, { d: dots });
  }

  const shown = (value) => (Number.isFinite(value) ? String(Number(value.toFixed(2))) : Number.isNaN(value) ? "–" : "nothing");

  // Age of a reading that is old, seconds; -1 while it still holds. The limits are those of the terminal: 1 in, 5 degrees,
  // or 2 s in which the robot has moved.
  function ageOf(reading) {
    const then = poseAt(reading.taken), here = poseAt(now), age = now - reading.t;
    const away = Math.hypot(here.x - then.x, here.y - then.y), turned = Math.abs(((here.h - then.h + 540) % 360 + 360) % 360 - 180);
    return away > 1 || turned > 5 || (age > 2 && away + turned > 0) ? Math.max(age, 0) : -1;
  }

  function showChip(reading, sensor, value, truth, box) {
    box.classList.toggle("fresh", Boolean(reading) && now - reading.t < FRESH);
    const age = reading ? ageOf(reading) : -1;
    box.classList.toggle("old", age >= 0);
    box.dataset.age = age >= 1 ? `${Math.round(age)} s ago` : "";
    value.textContent = reading ? shown(reading.value) : "";
    const differs = reading && !sensor.counts && shown(reading.true) !== shown(reading.value);
    truth.textContent = differs ? shown(reading.true) : "";
  }

  // -- the clock -------------------------------------------------------------------------------

  function seek(t) {
    setFollowing(false);
    go(t);
  }

  function go(t) {
    now = Math.min(Math.max(t, run.begin), run.end);
    if (playing && now >= run.end) {
      setPlaying(false);
      if (live && !over) setFollowing(true);
    }
    show();
  }

  function setPlaying(on) {
    if (on && now >= run.end) now = run.begin;
    const stops = playing && !on;
    playing = on;
    if (on) {
      setFollowing(false);
      last = performance.now();
      requestAnimationFrame(tick);
    } else if (stops) remember();
    play.textContent = on || following ? "‖ Pause" : "▶ Play";
  }

  function tick(time) {
    if (!playing) return;
    go(now + (playbackRate * Math.max(time - last, 0)) / 1000);
    last = time;
    requestAnimationFrame(tick);
  }

  // -- a run that continues ------------------------------------------------------------------------

  function setFollowing(on) {
    following = Boolean(live) && on;
    goLive.classList.toggle("on", following);
    goLive.setAttribute("aria-pressed", following);
    if (!playing) play.textContent = following ? "‖ Pause" : "▶ Play";
  }

  function follow() {
    if (!live) return;
    setPlaying(false);
    setFollowing(true);
    now = run.end;
    show();
  }

  function playOrPause() {
    if (following) setFollowing(false);
    else setPlaying(!playing);
  }

  // Approaches the newest at a pace that can be watched. Nothing is shown later than `lag` after it came.
  function followOn(time) {
    const passed = Math.max(time - lastFollowed, 0) / 1000;
    lastFollowed = time;
    if (following && now < run.end) {
      while (arrivals.length && arrivals[0].end <= now) arrivals.shift();
      let shown = now + live.pace * passed;
      for (const { end, came } of arrivals) {
        const left = live.lag - (time - came) / 1000;
        shown = Math.max(shown, left <= passed ? end : now + ((end - now) * passed) / left);
      }
      go(Math.min(shown, run.end));
    }
    if (following && over && now >= run.end) setFollowing(false);
    requestAnimationFrame(followOn);
  }

  // Adds the news of a run that continues. With `isFull` they are the whole run.
  function take(data, isFull = false) {
    if (isFull) clear();
    add(data);
    const came = performance.now();
    if (!arrivals.length || arrivals[arrivals.length - 1].end < run.end) arrivals.push({ end: run.end, came });
    while (arrivals.length > 1 && came - arrivals[1].came > live.lag * 1000) arrivals.shift(); // of a page that nobody looks at
    furnish();
    if (!following) show();
  }

  function toMoment() {
    if (run.moment !== null) seek(run.moment);
  }

  function remember() {
    if (live) return; // its time means nothing to who opens it later
    try {
      history.replaceState(null, "", `#t=${now.toFixed(2)}`);
    } catch { /* a page within another has no address of its own */ }
  }

  function faster(step) {
    playbackRate = PLAYBACK_RATES[Math.min(Math.max(PLAYBACK_RATES.indexOf(playbackRate) + step, 0), PLAYBACK_RATES.length - 1)];
    rates.value = playbackRate;
  }

  function toMark(step, kind) {
    const found = run.marks.filter((mark) => !kind || mark.kind === kind);
    const mark = step > 0 ? found.find((each) => each.t > now + 1e-6) : found.findLast((each) => each.t < now - 1e-6);
    if (mark) seek(mark.t);
  }

  function wholeWay() {
    if (live) return;
    setPlaying(false);
    page.classList.remove("at-moment");
    clock.textContent = `${run.end.toFixed(1)} s`;
    words.textContent = "The whole path. Play it, or click on it to see a moment.";
    happened.textContent = "";
    for (const { value, truth, box } of chips.values()) {
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
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(layer.getScreenCTM().inverse());
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
    if (belief) text += `: off ${belief.off.toFixed(2)} in` + (belief.headed ? ` and ${belief.turn.toFixed(1).replace(/^-0.0$/, "0.0")}°` : "");
    tell(event, text);
  }

  if (cursor) for (const name of ["pointermove", "click"]) strips.addEventListener(name, onStrips);
  for (const each of [maze, strips]) if (each) each.addEventListener("pointerleave", () => (tip.hidden = true));

  const KEYS = {
    " ": playOrPause, "[": () => faster(-1), "]": () => faster(1),
    ArrowLeft: (event) => seek(now - (event.shiftKey ? 10 : 1)), ArrowRight: (event) => seek(now + (event.shiftKey ? 10 : 1)),
    Home: () => seek(run.begin), End: () => (live ? follow() : seek(run.end)), n: () => toMark(1), N: () => toMark(-1),
    c: () => toMark(1, "contact"), C: () => toMark(-1, "contact"), w: wholeWay, d: changeTheme, m: toMoment, l: follow,
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target === rates || !KEYS[event.key]) return;
    if (event.key === " " && ["BUTTON", "SUMMARY"].includes(event.target.tagName)) return; // they are pressed
    event.preventDefault();
    KEYS[event.key](event);
  });

  function fromAddress() {
    const found = /^#t=([0-9.]+)$/.exec(location.hash);
    if (!found) return;
    setPlaying(false);
    seek(Number(found[1]));
  }

  // A link leads there also when its time is the address already.
  document.addEventListener("click", (event) => {
    const link = event.target.closest("a[href^='#t=']");
    if (!link) return;
    setPlaying(false);
    seek(Number(link.hash.slice(3)));
  });
  if (moments.length) new ResizeObserver(layMoments).observe(momentBar);

  // Older browsers print no more of what is folded than its title.
  addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((each) => (each.open = true)));
  rates.value = playbackRate;
  page.classList.add("playable");
  furnish();
  slider.value = now;
  if (live) {
    follow();
    requestAnimationFrame(followOn);
  } else {
    if (run.end > run.begin) seek(run.moment);
    else wholeWay();
    addEventListener("hashchange", fromAddress);
    fromAddress();
  }
  return { run, take, seek, finish: () => (over = true), setMoment: (t) => { run.moment = t; furnish(); } };
}

{
  const recorded = document.getElementById("recording");
  if (recorded) simmerPlayer(JSON.parse(recorded.textContent));
}
