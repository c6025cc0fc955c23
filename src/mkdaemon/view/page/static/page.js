// The page: takes what the server says to show, and shows it. What is decided about it is decided there.

import {Plot, extend} from "/plots.js";
import {Scene} from "/scene.js";

const TOKEN = document.querySelector("meta[name=page-token]").content;
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16, 64];
const EVENTS = 200; // lines kept
const ANSWER = 6000; // an answer is shown so long [ms]
const GONE = 2000; // without a word from the server for so long the page says so [ms]
const TRAIL = 1500; // points drawn
const SEEK = 250; // between two places that are asked for [ms]
const LEAP = 5, LONG_LEAP = 30; // with an arrow key [s]
const QUESTIONS = {abort: ["Abort the manoeuvre?", "Abort now"], release: ["Release the aircraft?", "Release now"]};
const sticks = (column, name, colour) => [
  {series: "sticks", column, name, colour}, {series: "sticks", column: column + 4, colour, dashed: true},
];
const PLOTS = [
  {id: "error", digits: 0, title: "error", unit: "cm", least: 10, lines: [
    {series: "error", column: 1, name: "level", colour: "--one"}, {series: "error", column: 2, name: "height", colour: "--two"}]},
  {id: "height", digits: 2, title: "height", unit: "m", least: 0.5, lines: [
    {series: "height", column: 1, name: "seen", colour: "--one"}, {series: "goal", column: 1, name: "goal", colour: "--four", dashed: true},
    {series: "barometer", column: 1, name: "baro", colour: "--two"}]},
  {id: "sticks", digits: 0, title: "sticks", unit: "counts", hint: "dashed: before the limiter", least: 20, lines: [
    ...sticks(1, "pitch", "--one"), ...sticks(2, "roll", "--two"), ...sticks(3, "yaw", "--three"), ...sticks(4, "throttle", "--four")]},
  {id: "latency", digits: 0, title: "latency", unit: "ms", least: 20, lines: [
    {series: "latency", column: 1, name: "last", colour: "--one"}, {series: "latency", column: 2, name: "p50", colour: "--four"},
    {series: "latency", column: 3, name: "p99", colour: "--two", dashed: true}]},
];

const get = (id) => document.getElementById(id);
const scene = new Scene(get("world"), get("labels"));
const plots = PLOTS.map((about) => new Plot(get("plots"), about));
const kept = {series: {}, tags: [], cameras: new Map(), shown: null, heard: 0};
let stream = null, vehicle = "", isDue = false;

function listen(wanted) {
  if (stream) stream.close();
  forget();
  get("events").replaceChildren();
  stream = new EventSource(`/stream?vehicle=${encodeURIComponent(wanted)}`);
  stream.onmessage = (message) => take(JSON.parse(message.data));
  stream.onopen = () => { forget(); get("events").replaceChildren(); };
}

function forget() {
  kept.series = {};
  kept.tags = [];
  kept.cameras.clear();
  get("cameras").replaceChildren();
}

function take(shown) {
  kept.heard = performance.now();
  document.body.classList.remove("gone");
  showVehicles(shown.vehicles);
  if (!shown.vehicle) {
    say(get("verdict"), "No vehicle: no daemon is running, and no recording is played", "unknown");
    return;
  }
  vehicle = shown.vehicle;
  if (shown.is_anew) { kept.series = {}; get("events").replaceChildren(); }
  for (const [name, points] of Object.entries(shown.series)) extend(kept.series[name] ??= [], points);
  if (shown.shapes) kept.tags = shown.shapes.tags;
  kept.shown = shown;
  say(get("verdict"), shown.verdict.text, shown.verdict.tone);
  get("verdict").title = shown.verdict.text;
  get("kind").textContent = shown.is_played ? "recording" : "live";
  document.title = `${shown.vehicle}: ${shown.verdict.text}`;
  showOffers(shown.offers);
  showLarge(shown.large);
  get("alarms").replaceChildren(...shown.alarms.map((alarm) => Object.assign(document.createElement("li"), {textContent: alarm.text})));
  [...get("alarms").children].forEach((line, k) => { line.dataset.tone = shown.alarms[k].tone; });
  showLines(shown.lines);
  if ("flight" in shown) showFlight(shown.flight, shown.play.length);
  showPlay(shown.play, shown.now);
  for (const event of shown.events) showEvent(event);
  for (const camera of shown.cameras) showCamera(camera);
  redraw();
}

function redraw() {
  if (isDue) return;
  isDue = true;
  requestAnimationFrame(() => {
    isDue = false;
    const shown = kept.shown;
    if (!shown) return;
    showFrame(shown.scene);
    scene.draw(shown.scene, kept.tags, (kept.series.trail || []).slice(-TRAIL), [...kept.cameras.values()]);
    for (const plot of plots) plot.draw(kept.series, shown.now);
  });
}

// -- words ------------------------------------------------------------------------------------------------------------

function say(place, text, tone) {
  if (place.textContent !== text) place.textContent = text;
  place.dataset.tone = tone;
}

function ageWords(age) {
  if (age === null) return "";
  return age < 0.995 ? `${age.toFixed(1)} s` : age < 100 ? `${age.toFixed(0)} s` : `${(age / 60).toFixed(0)} min`;
}

function showLines(lines) {
  const table = get("lines");
  if (table.rows.length !== lines.length) {
    table.replaceChildren(...lines.map(() => {
      const row = document.createElement("tr");
      for (const [kind, name] of [["th", "name"], ["td", "text"], ["td", "age"]]) {
        row.append(Object.assign(document.createElement(kind), {className: name}));
      }
      return row;
    }));
  }
  lines.forEach((line, k) => {
    const row = table.rows[k], [name, text, age] = row.children;
    row.dataset.line = line.id;
    row.classList.toggle("stale", line.is_stale);
    say(name, line.name, "");
    say(text, line.text, line.tone);
    say(age, ageWords(line.age), "");
  });
}

function showFrame(shown) {
  const frame = get("frame");
  frame.dataset.stale = shown.aircraft && shown.aircraft.is_stale ? "yes" : "no";
  frame.textContent = scene.works ? shown.caption : "this browser has no WebGL: the scene cannot be drawn";
}

function showOffers(offers) {
  for (const name of ["abort", "release"]) {
    const button = get(name), {meaning, why_not} = offers[name];
    button.disabled = why_not !== "";
    button.title = why_not || meaning;
    get(`${name}-meaning`).textContent = meaning;
  }
}

function showLarge(facts) {
  get("large").replaceChildren(...facts.map((fact) => {
    const box = document.createElement("div"), number = document.createElement("b"), name = document.createElement("span");
    box.dataset.fact = fact.id;
    say(number, fact.text, fact.tone);
    name.textContent = fact.name;
    box.append(number, name);
    return box;
  }));
}

function showEvent(event) {
  const line = document.createElement("li"), time = document.createElement("time"), text = document.createElement("span");
  line.dataset.tone = event.tone;
  time.textContent = new Date(event.wall * 1000).toLocaleTimeString([], {hour12: false});
  text.textContent = event.text;
  line.append(time, text);
  if (event.fix) line.append(Object.assign(document.createElement("span"), {className: "fix", textContent: event.fix}));
  const list = get("events");
  list.prepend(line);
  while (list.children.length > EVENTS) list.lastChild.remove();
}

function showVehicles(vehicles) {
  const chooser = get("vehicle");
  const labels = vehicles.map((one) => `${one.id}${one.is_here ? "" : " (gone)"}`);
  if (labels.join() !== [...chooser.options].map((option) => option.textContent).join()) {
    chooser.replaceChildren(...vehicles.map((one, k) => new Option(labels[k], one.id)));
  }
  if (document.activeElement !== chooser) chooser.value = vehicle || "";
}

// -- cameras ----------------------------------------------------------------------------------------------------------

function showCamera(camera) {
  let known = kept.cameras.get(camera.name);
  if (!known) {
    const box = document.createElement("div"), canvas = document.createElement("canvas");
    const title = document.createElement("p"), note = document.createElement("p");
    box.className = "camera";
    box.dataset.camera = camera.name;
    title.className = "title";
    note.className = "note";
    box.append(canvas, title, note);
    get("cameras").append(box);
    known = {name: camera.name, box, title, note, screen: canvas, picture: null, sequence: null, isLoading: false, drawn: 0};
    kept.cameras.set(camera.name, known);
  }
  known.frustum = camera.frustum;
  known.latest = camera;
  known.title.textContent = camera.caption;
  known.box.classList.toggle("stale", camera.is_stale);
  known.note.textContent = camera.note;
  if (camera.image === null) drawCamera(known, camera);
  else if (camera.image.sequence !== known.sequence && !known.isLoading) load(known, camera);
}

function load(known, camera) {
  const picture = new Image();
  known.isLoading = true;
  known.sequence = camera.image.sequence;
  picture.onload = () => { known.isLoading = false; known.picture = picture; drawCamera(known, known.latest); redraw(); };
  picture.onerror = () => { known.isLoading = false; };
  picture.src = `/image?vehicle=${encodeURIComponent(vehicle)}&camera=${encodeURIComponent(camera.name)}&n=${camera.image.sequence}`;
}

function drawCamera(known, camera) {
  const [wide, tall] = camera.size[0] ? camera.size : [640, 480];
  const screen = known.screen;
  if (screen.width !== wide || screen.height !== tall) { screen.width = wide; screen.height = tall; }
  const pen = screen.getContext("2d");
  pen.fillStyle = "#000";
  pen.fillRect(0, 0, wide, tall);
  if (known.picture) pen.drawImage(known.picture, 0, 0, wide, tall);
  pen.lineWidth = Math.max(2, wide / 220);
  pen.font = `bold ${wide / 32}px sans-serif`;
  for (const outline of camera.outlines) {
    pen.strokeStyle = pen.fillStyle = outline.how === "decoded" ? "#2be36b" : "#39b8ff";
    pen.setLineDash(outline.how === "decoded" ? [] : [pen.lineWidth * 3, pen.lineWidth * 2]);
    pen.beginPath();
    outline.corners.forEach(([x, y]) => pen.lineTo(x + 0.5, y + 0.5));
    pen.closePath();
    pen.stroke();
    if (outline.id !== null) pen.fillText(String(outline.id), outline.corners[1][0] + 6, outline.corners[1][1]);
  }
  known.box.dataset.outlines = camera.outlines.length;
  if (known.picture) { known.canvas = screen; known.drawn += 1; }
}

// -- a recording --------------------------------------------------------------------------------------------------------

function showPlay(play, now) {
  get("play").hidden = get("timeline").hidden = play === null;
  if (play === null) return;
  const isOver = play.state === "stopped", word = {paused: "go on", ended: "again"}[play.state] ?? "pause";
  say(get("pause"), word, "");
  for (const id of ["pause", "step", "speed", "seek"]) get(id).disabled = isOver;
  const place = play.state === "playing" ? Math.min(Math.max(now - play.zero, 0), play.length) : play.place;
  get("seek").max = play.length || 1;
  if (!sought.isAsked && sought.wanted === null) get("seek").value = place;
  get("place").textContent = `${(sought.wanted ?? place).toFixed(1)} of ${play.length.toFixed(1)} s${play.state === "playing" ? "" : `, ${play.state}`}`;
  get("place").title = play.file;
  const chooser = get("speed");
  if (document.activeElement === chooser) return;
  const speeds = [...new Set([...SPEEDS, play.speed])].sort((a, b) => a - b);
  if (chooser.options.length !== speeds.length) chooser.replaceChildren(...speeds.map((one) => new Option(`× ${one}`, one)));
  chooser.value = play.speed;
}

// What was flown and what happened, over the slider.
function showFlight(flight, length) {
  const share = (at) => `${(100 * Math.min(Math.max(at / (length || 1), 0), 1)).toFixed(3)}%`;
  const parts = flight ? flight.parts : [], marks = flight ? flight.marks : [];
  get("parts").replaceChildren(...parts.filter((part) => part.text).map((part) => {
    const end = parts[parts.indexOf(part) + 1]?.begin ?? length;
    const box = Object.assign(document.createElement("b"), {textContent: part.text, title: part.text});
    box.style.left = share(part.begin);
    box.style.width = share(end - part.begin);
    return box;
  }));
  get("marks").replaceChildren(...marks.map((mark) => {
    const tick = Object.assign(document.createElement("i"), {title: `${mark.at.toFixed(1)} s: ${mark.text}`});
    tick.dataset.tone = mark.tone;
    tick.style.left = share(mark.at);
    tick.addEventListener("click", () => seek(mark.at));
    return tick;
  }));
}

const sought = {wanted: null, isAsked: false};

// Go to a place; while it is asked for, only the newest wish is kept.
async function seek(place) {
  const play = kept.shown?.play;
  if (!play) return;
  sought.wanted = Math.min(Math.max(place, 0), play.length);
  get("seek").value = sought.wanted;
  if (sought.isAsked) return;
  sought.isAsked = true;
  while (sought.wanted !== null) {
    const asked = sought.wanted, said = await ask("play", {action: "seek", place: asked});
    if (!said.is_done) tell("seek", said);
    await new Promise((done) => setTimeout(done, SEEK));
    if (sought.wanted === asked) sought.wanted = null;
  }
  sought.isAsked = false;
}

// -- what the page asks for ---------------------------------------------------------------------------------------------

async function ask(what, fields) {
  try {
    const reply = await fetch(`/${what}`, {method: "POST", headers: {"X-Page": TOKEN}, body: JSON.stringify({vehicle, ...fields})});
    return reply.ok ? await reply.json() : {is_done: false, text: await reply.text(), fix: ""};
  } catch {
    return {is_done: false, text: "mkctl view does not answer", fix: "use `mkctl release`, or the pilot's switch"};
  }
}

function tell(what, said) {
  const place = get("answer");
  place.textContent = [`${what}: ${said.text}`, said.fix].filter(Boolean).join(" → ");
  place.hidden = false;
  clearTimeout(place.timer);
  place.timer = setTimeout(() => { place.hidden = true; }, ANSWER);
}

for (const name of ["abort", "release"]) {
  get(name).addEventListener("click", () => {
    const [question, yes] = QUESTIONS[name], {meaning} = kept.shown.offers[name], dialog = get("confirm");
    dialog.querySelector("h1").textContent = `${vehicle}: ${question}`;
    dialog.querySelector("p").textContent = meaning;
    get("sure").textContent = yes;
    dialog.returnValue = "no";
    dialog.onclose = async () => { if (dialog.returnValue === "yes") tell(name, await ask(name, {})); };
    dialog.showModal();
  });
}
async function pause() {
  const state = kept.shown.play.state;
  if (state === "ended") { seek(0); return; }
  const said = await ask("play", {action: state === "paused" ? "go_on" : "pause"});
  if (!said.is_done) tell("pause", said);
}
get("pause").addEventListener("click", pause);
get("seek").addEventListener("input", (event) => seek(Number(event.target.value)));
document.addEventListener("keydown", (event) => {
  const place = Number(get("seek").value), leap = event.shiftKey ? LONG_LEAP : LEAP;
  const keys = {
    " ": pause, n: () => ask("play", {action: "step"}), ArrowLeft: () => seek(place - leap), ArrowRight: () => seek(place + leap),
    Home: () => seek(0), End: () => seek(Number(get("seek").max)),
  };
  const isModified = event.ctrlKey || event.altKey || event.metaKey;
  // A button that was clicked keeps the focus: it has the space bar, and leaves us the rest.
  const isElsewhere = isModified || event.target.closest(event.key === " " ? "select, button, dialog[open]" : "select, dialog[open]");
  if (isElsewhere || get("timeline").hidden || !(event.key in keys)) return;
  event.preventDefault();
  keys[event.key]();
});
get("step").addEventListener("click", () => ask("play", {action: "step"}));
get("speed").addEventListener("change", async (event) => {
  const said = await ask("play", {action: "speed", speed: Number(event.target.value)});
  event.target.blur();
  if (!said.is_done) tell("speed", said);
});
get("vehicle").addEventListener("change", (event) => { vehicle = event.target.value; event.target.blur(); listen(vehicle); });
window.addEventListener("resize", redraw);
setInterval(() => {
  if (performance.now() - kept.heard < GONE) return;
  document.body.classList.add("gone");
  for (const name of ["abort", "release"]) get(name).disabled = true;
  const age = kept.heard ? `: the values shown are ${ageWords((performance.now() - kept.heard) / 1000)} old` : "";
  say(get("verdict"), `mkctl view does not answer${age}`, "bad");
}, 500);
scene.listen(redraw);
listen("");
