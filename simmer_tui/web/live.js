"use strict";
// Feeds the player of this page with what the simulator sends, and takes what a person does to it.
// Text of the run is only ever set as text, never as markup.
(() => {
  const NEWEST = 14; // events listed
  const DRIVES = [
    ["turn_left", "⟲", "turn left"], ["forward", "▲", "forward"], ["turn_right", "⟳", "turn right"],
    ["sideways_left", "◀", "left"], ["back", "▼", "back"], ["sideways_right", "▶", "right"],
  ];
  const WORD = /^#([A-Za-z0-9_-]{16,})$/;
  const word = takenWord();
  const title = document.querySelector("h1"), about = document.querySelector("p.run");
  const events = document.querySelector(".columns .card ul"), side = events.closest(".card").parentElement;
  const state = made("span", { class: "state", role: "status" }, "connecting");
  let socket = null, player = null, id = null, over = false, tries = 0, drive = null;

  // The word is kept here alone: not in the address, which others may see.
  function takenWord() {
    const found = WORD.exec(location.hash);
    if (found) history.replaceState(null, "", location.pathname);
    return found ? found[1] : "";
  }

  function made(name, attributes = {}, ...children) {
    const element = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) {
      if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
      else element.setAttribute(key, value);
    }
    element.append(...children);
    return element;
  }

  function say(text, kind) {
    state.textContent = text;
    state.className = `state ${kind}`;
  }

  // -- the connection ----------------------------------------------------------------------------

  function connect() {
    socket = new WebSocket(`${location.protocol === "https:" ? "wss:" : "ws:"}//${location.host}/live`);
    socket.addEventListener("open", () => send({ word }));
    socket.addEventListener("message", (event) => take(JSON.parse(event.data)));
    socket.addEventListener("close", (event) => {
      if (over) return;
      if (event.code === 4401) say("open the link that the simulator shows: this one has no word, or a wrong one", "bad");
      else {
        say("no connection: trying again", "bad");
        setTimeout(connect, Math.min(500 * 2 ** tries++, 5000));
      }
    });
  }

  function send(message) {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
    else if (drive) drive.told.textContent = "not sent: there is no connection";
  }

  function take(message) {
    if (message.role === "drive" && !drive) addDrive(message.keys, message.buttons);
    if (message.told !== undefined) drive.told.textContent = message.told;
    if (message.run) begin(message.run, message.news);
    else if (message.news) player.take(message.news);
    if (message.verdict !== undefined) judge(message.verdict, message.moment);
    if (message.news && (message.run || message.news.marks.length)) listEvents();
    if (message.over) {
      over = true;
      player?.finish();
      say("the run is over", "plain");
      // Nothing is live any more, and nobody takes what is pressed.
      title.textContent = document.title = title.textContent.replace(/, live$/, "");
      document.querySelector(".golive")?.remove();
      document.querySelector(".drive")?.remove();
    }
  }

  function begin(run, news) {
    if (id !== null && run.id !== id) {
      // The simulator was restarted: another run, perhaps another maze. A link's word holds no longer.
      location.reload();
      return;
    }
    tries = 0;
    id = run.id;
    say("live", "good");
    if (player) player.take(news, true);
    else player = simmerPlayer({ ...run, ...news, moment: null }, run.live);
  }

  // -- what is shown beside the maze -------------------------------------------------------------

  function judge(verdict, moment) {
    document.querySelector(".verdict")?.remove();
    player.setMoment(moment === null ? null : moment / 1000);
    title.hidden = Boolean(verdict);
    if (!verdict) return;
    const [sentence, ...lines] = verdict.lines;
    const why = made("details", {}, made("summary", {}, "Why"), ...lines.map((line) => made("p", {}, line)));
    about.after(made("div", { class: `verdict ${verdict.tone}`, role: "status" },
      made("div", { class: "sign", "aria-hidden": "true" }, verdict.sign),
      made("div", {}, made("h1", {}, verdict.headline), made("p", {}, sentence), ...(lines.length ? [why] : []))));
  }

  function listEvents() {
    const newest = player.run.marks.slice(-NEWEST).reverse();
    if (!newest.length) return;
    events.replaceChildren(...newest.map((mark) => made("li", { class: mark.kind },
      made("button", { type: "button", title: "show this moment", onclick: () => player.seek(mark.t) }, `${mark.t.toFixed(1)} s`),
      ` ${mark.text}`)));
  }

  // -- driving -----------------------------------------------------------------------------------

  function addDrive(keys, buttons) {
    const press = (key, fine) => {
      drive.told.textContent = "";
      send({ key, fine: Boolean(fine) });
    };
    const pressed = (name, label, about, kind) => made("button",
      { type: "button", class: kind, title: about, onclick: (event) => press(name, event.shiftKey) }, label);
    const line = made("input", { type: "text", maxlength: 200, autocomplete: "off", autocapitalize: "off", spellcheck: "false",
      "aria-label": "command or order", placeholder: "a command: u1, d1-3" });
    const given = made("form", { onsubmit: (event) => {
      event.preventDefault();
      drive.told.textContent = "";
      if (line.value.trim()) send({ line: line.value });
      line.value = "";
    } }, line, made("button", {}, "Give"));
    const pad = made("div", { class: "pad", tabindex: 0, role: "group", "aria-label": "keys that drive, while this has the focus" },
      ...DRIVES.map(([name, sign, word]) => pressed(name, `${sign} ${word}`, word, "")),
      pressed("stop", "■ Stop", "stop the robot", "stop"), ...Object.entries(buttons).map(([name, label]) => pressed(name, label, label, "wide")));
    drive = { told: made("p", { class: "told", role: "status" }) };
    const signs = { ArrowUp: "↑", ArrowDown: "↓", ArrowLeft: "←", ArrowRight: "→", " ": "space" };
    const keysOf = (...names) => Object.entries(keys).filter(([, [name, fine]]) => names.includes(name) && !fine)
      .map(([key]) => signs[key] || key);
    const driving = keysOf(...DRIVES.map(([name]) => name)).join(" "), stopping = keysOf("stop").join(" and ");
    const panel = made("div", { class: "card drive" }, made("h2", {}, "Drive"), given, drive.told, pad,
      made("p", { class: "note" }, `With the focus here keys drive: ${driving} (with Shift finely); to stop: ${stopping}.`));
    // What is pressed here is not for the player.
    panel.addEventListener("keydown", (event) => {
      event.stopPropagation();
      if (event.target === line || event.ctrlKey || event.altKey || event.metaKey) return;
      const isButton = event.target.tagName === "BUTTON" && event.key === " ";
      const meaning = isButton ? null : keys[event.shiftKey && event.key.length > 1 ? `shift+${event.key}` : event.key];
      if (!meaning) return;
      event.preventDefault();
      if (!event.repeat) press(...meaning);
    });
    side.prepend(panel);
  }

  // Another link, opened where this page is already.
  addEventListener("hashchange", () => WORD.test(location.hash) && location.reload());
  about.prepend(state, " ");
  connect();
})();
