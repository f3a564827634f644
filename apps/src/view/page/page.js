
const $ = (id) => document.getElementById(id);
const canvas = $("view"), context = canvas.getContext("2d");

let socket = null; // the connection, where there is one
let scene = null; // what the server said of the scene
let eye = null;
let photo = null; // index of the photo whose camera we stand at; null once we have moved
let lastPhoto = 0;
let layer = "colour";
let background = null; // null: as trained
let frame = [0.5, 0.5]; // tangents of half the angles that must be seen across and down
let playing = false;
let wish = 0; // number of the last request
let shown = 0; // number of the last picture that arrived
let isDirty = false;
let rows = [], curveKind = "psnr";
const keys = new Set();
const arrivals = []; // when pictures came, for frames a second

// --- talking ---

function connect() {
  socket = new WebSocket(`ws://${location.host}/live`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = (event) => (typeof event.data === "string" ? hear(JSON.parse(event.data)) : see(event.data));
  socket.onclose = () => {
    socket = null;
    notice("The connection is lost. Trying again …", "Is the program still running?");
    setTimeout(connect, 1000);
  };
}

function hear(message) {
  if (message.type === "scene") welcome(message);
  else if (message.type === "waiting") wait(message);
  else if (message.type === "training") showTraining(message);
  else if (message.type === "picked") picked(message.point);
  else if (message.type === "fast") showFast(message);
  else if (message.type === "saved") $("crop-note").textContent = `saved in ${message.file}`;
  else if (message.type === "error") toast(message.message);
}

function send(message) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

// Tangents of half the angles of the canvas: the photo's frame fits in.
function tangents() {
  const aspect = canvas.width / canvas.height;
  const y = Math.min(Math.max(frame[1], frame[0] / aspect), 12);
  return [y * aspect, y];
}

function view() {
  return {
    width: Math.min(canvas.width, 4096), height: Math.min(canvas.height, 4096), position: eye.position,
    wxyz: wxyzOf(eye.axes), fov: 2 * Math.atan(tangents()[1]), time: Number($("time").value),
  };
}

function ask() {
  isDirty = false;
  if (!eye || !canvas.width || !canvas.height) return;
  const index = (id) => ($(id).value === "" ? null : Number($(id).value));
  const appearance = { from: index("from"), to: index("to"), blend: Number($("blend").value) };
  send({ type: "draw", id: ++wish, ...view(), layer, limit: Number($("limit").value), appearance, background, photo, crop });
}

// --- pictures ---

let decoding = 0, painted = 0;
async function see(bytes) {
  const data = new DataView(bytes), number = ++decoding;
  const id = data.getUint32(0, true), ms = data.getFloat32(8, true), quality = data.getUint8(24), drawer = data.getUint8(25);
  const range = [data.getFloat32(12, true), data.getFloat32(16, true)];
  const size = [data.getUint16(20, true), data.getUint16(22, true)];
  shown = id;
  arrivals.push(performance.now());
  let picture;
  try {
    picture = await createImageBitmap(new Blob([bytes.slice(28)]));
  } catch {
    return toast("A picture did not arrive whole.");
  }
  // Decoders may overtake each other.
  if (number < painted) return picture.close();
  painted = number;
  place(picture);
  picture.close();
  $("notice").hidden = true;
  document.body.dataset.quality = quality;
  document.body.dataset.pictures = number;
  document.body.dataset.drawer = drawer;
  document.body.dataset.size = size.join("x");
  status(size, ms, quality, drawer);
  $("layer-note").textContent = noteOfLayer(range);
}

// What the colours of a layer mean, where they do not speak for themselves.
const HINTS = {
  flow: "Where things go until the next of 60 frames: right red, down yellow, left cyan, up violet; white stands still, black is not known",
  background: "What stands still, without what moves before it",
};

// What they reach from and to.
function noteOfLayer(range) {
  if (layer === "depth" && range[1] > 0) return `${short(range[0])} bright … ${short(range[1])}`;
  if (layer === "flow" && range[1] > 0) return `full at ${short(range[1])} px a frame`;
  return noteOfPhoto();
}

function place(picture) {
  let [w, h] = [canvas.width, canvas.height];
  context.clearRect(0, 0, w, h);
  if (isOfPhoto()) {
    // Where the photo's frame is in what the camera sees.
    const [tanX, tanY] = tangents();
    [w, h] = [(w * frame[0]) / tanX, (h * frame[1]) / tanY];
  }
  context.imageSmoothingQuality = "high";
  context.drawImage(picture, (canvas.width - w) / 2, (canvas.height - h) / 2, w, h);
}

// What the system makes of a photo that it was trained on.
const isJudgement = (name) => name === "mask" || name === "uncertainty";
const isOfPhoto = () => layer === "photo" || isJudgement(layer);
const noteOfPhoto = () => (isOfPhoto() && photo !== null ? scene.photos[photo].name : "");

function status(size, ms, quality, drawer) {
  const now = performance.now();
  while (arrivals.length && now - arrivals[0] > 1500) arrivals.shift();
  const took = ms >= 1000 ? `${(ms / 1000).toFixed(1)} s` : `${Math.round(ms)} ms`;
  const moves = quality === 0 && arrivals.length > 2;
  const rate = ((arrivals.length - 1) * 1000) / Math.max(now - arrivals[0], 1);
  const word = moves ? `${rate.toFixed(rate < 10 ? 1 : 0)} fps` : quality === 2 ? "full" : "refining …";
  const by = drawer === 1 && scene.step ? " · cloud" : "";
  $("status").hidden = false;
  if (isOfPhoto()) $("status").textContent = `${size[0]} × ${size[1]}, ${layer}`;
  else $("status").innerHTML = `<b>${size[0]} × ${size[1]}</b> · ${took} · ${word}${by}`;
}

// The cloud that stands for a field while the camera moves.
function showFast(message) {
  setHints(message.hints);
  document.body.dataset.fast = message.state;
  const gaussians = message.count ? message.count.toLocaleString("en") : "";
  const quality = message.psnr ? `, ${message.psnr.toFixed(1)} dB from the field` : "";
  const ready = `While you move: a cloud of ${gaussians} Gaussians${quality}; at rest, the field itself. Cropped: the cloud alone.`;
  const text = {
    baking: `A cloud that is quick to draw is being baked; ${gaussians ? "the last one is shown until then" : "small pictures until then"}.`,
    ready: scene && scene.appearances.length ? `${ready} Another appearance gets its own cloud once it rests.`
      : scene && scene.moves ? `${ready} Another time gets its own cloud once it rests; small pictures until then.` : ready,
    failed: "The field could not be baked: small pictures while you move.",
    none: "Small pictures while you move, until a cloud is baked.",
  }[message.state];
  $("fast-note").hidden = !text;
  $("fast-note").textContent = text || "";
}

// --- the scene ---

function wait(message) {
  $("title").textContent = message.title;
  $("subtitle").textContent = "";
  const hint = "Train with --checkpoint-minutes\u00a00.2 for pictures early and often.";
  notice(message.message, message.message.startsWith("There is no checkpoint") ? hint : "");
}

function welcome(message) {
  // Another run may have taken the place of the one we knew.
  const isFirst = scene === null || JSON.stringify(scene.photos) !== JSON.stringify(message.photos);
  scene = message;
  document.body.classList.remove("empty");
  document.title = `${scene.title} · wildfield`;
  $("title").textContent = scene.title;
  $("subtitle").textContent = scene.step ? `${scene.subtitle} · step ${scene.step}` : scene.subtitle;
  $("notice").hidden = true;
  document.body.dataset.step = scene.step;
  if (!isFirst) {
    // The server forgets us with the connection, and draws again by itself with a new checkpoint.
    offerLayers();
    changed();
    return;
  }
  eye = new Eye(scene.crop.up || scene.up, scene.radius);
  setCrop(scene.crop);
  upWord = scene.crop.up ? "saved" : "guess";
  $("up").querySelector("[value=saved]").hidden = !scene.crop.up;
  $("up").value = upWord;
  const option = (value, text) => new Option(text, value);
  $("photo").replaceChildren(option("", "free"), ...scene.photos.map((p, i) => option(i, p.held_out ? `${p.name} (held out)` : p.name)));
  $("photos").hidden = scene.photos.length === 0;
  for (const id of ["from", "to"]) $(id).replaceChildren(option("", "mean of all"), ...scene.appearances.map((name, i) => option(i, name)));
  $("appearance-section").hidden = $("its-appearance").hidden = scene.appearances.length === 0;
  $("time-section").hidden = !scene.moves;
  offerLayers();
  const sizes = [200, 400, 800, 1200, 1600, 2400];
  $("limit").replaceChildren(...sizes.map((n) => option(n, `up to ${n} pixels`)));
  // Like the photos; pictures of a few hundred pixels look better a little larger.
  const like = scene.longest_side < 100 ? 200 : Math.min(Math.max(scene.longest_side, 400), 1200);
  $("limit").value = sizes.find((n) => n >= like);
  fit();
  reset();
  if (scene.pivot_is_guess) pick(0.5, 0.5);
}

// A button for each layer. Where things go may be known of one checkpoint and not of another.
function offerLayers() {
  if (!scene.layers.includes(layer)) layer = "colour";
  const offered = [...$("layer").children].map((button) => button.value);
  if (offered.join() === scene.layers.join()) return;
  $("layer").replaceChildren(...scene.layers.map((name) => {
    const button = document.createElement("button");
    Object.assign(button, { type: "button", value: name, textContent: name });
    return button;
  }));
}

function reset() {
  if (scene.photos.length) return stand(0);
  const back = unit(cross(scene.up, Math.abs(scene.up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
  const axes = [cross(scene.up.map((x) => -x), scaled(back, -1)), scene.up.map((x) => -x), scaled(back, -1)];
  stand({ position: add(scene.pivot, back, scene.radius), wxyz: wxyzOf(axes), tangents: [0.5, 0.5], time: 0 });
}

// Stand at the camera of a photo, by number, or at any other.
function stand(which) {
  const to = typeof which === "number" ? scene.photos[which] : which;
  photo = typeof which === "number" ? which : null;
  if (photo !== null) lastPhoto = photo;
  eye.stand(to, scene.pivot);
  // Views of a file are not photos: they stand as up is now.
  if (upWord !== "guess" && !scene.step) eye.level(eye.up);
  frame = to.tangents.slice();
  if (scene.moves) setTime(to.time);
  if (isJudgement(layer) && to.held_out) layer = "colour";
  changed();
}

function step(by) {
  if (!scene || !scene.photos.length) return;
  const n = scene.photos.length;
  stand((lastPhoto + (photo === null ? 0 : by) + n) % n);
}

// The camera has left the photo.
function moved() {
  photo = null;
  if (isOfPhoto()) layer = "colour";
  changed();
}

function changed() {
  isDirty = true;
  drawBox();
  $("photo").value = photo === null ? "" : photo;
  if (scene) $("photo-count").textContent = photo === null ? "" : `${photo + 1} of ${scene.photos.length}`;
  $("its-appearance").disabled = photo === null || (scene && photo >= scene.appearances.length);
  for (const button of $("layer").children) {
    button.setAttribute("aria-pressed", button.value === layer);
    const judges = isJudgement(button.value);
    button.disabled = (judges || button.value === "photo") && (photo === null || (judges && scene.photos[photo].held_out));
    button.title = button.disabled ? "At the camera of a photo only" : HINTS[button.value] || "";
  }
  const degrees = Math.round((360 / Math.PI) * Math.atan(frame[1]));
  $("fov").value = degrees;
  $("fov-value").textContent = `${degrees}°`;
  $("blend-value").textContent = $("from").value === $("to").value ? "" : `${Math.round(100 * $("blend").value)} %`;
  $("blend").disabled = $("from").value === $("to").value;
  $("time-value").textContent = Number($("time").value).toFixed(2);
}

function setTime(time) {
  $("time").value = time;
}

// --- training ---

function showTraining(message) {
  rows = message.rows;
  $("training").hidden = false;
  $("training").classList.toggle("over", !message.runs);
  document.body.classList.add("trains");
  const state = $("training-state");
  state.className = message.runs ? "runs" : "soft";
  const clock = (s) => {
    if (s < 60) return `${Math.round(s)} s`;
    return s < 3600 ? `${Math.floor(s / 60)} min ${Math.round(s % 60)} s` : `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
  };
  const isShort = message.of && message.step < message.of;
  if (message.runs) state.textContent = message.eta === null ? "running" : `${clock(message.eta)} to go`;
  else state.textContent = isShort ? "stopped" : "finished";
  $("training-facts").textContent = `step ${message.step}${message.of ? ` of ${message.of}` : ""} · ${clock(message.seconds)}`;
  $("training-bar").hidden = !message.runs || (!message.of && message.eta === null);
  const done = message.of ? message.step / message.of : message.seconds / Math.max(message.seconds + (message.eta || 0), 1e-9);
  $("training-bar").firstElementChild.style.width = `${100 * Math.min(done, 1)}%`;
  drawCurve($("curve"), rows, curveKind);
}

// --- notes ---

function notice(text, hint) {
  $("notice").hidden = false;
  $("notice-text").textContent = text;
  $("notice-hint").textContent = hint;
  $("status").hidden = true;
}

let toastTimer = 0;
function toast(text) {
  $("toast").hidden = false;
  $("toast").textContent = text;
  clearTimeout(toastTimer);
  toastTimer = setTimeout(() => ($("toast").hidden = true), 6000);
}

// --- hands ---

let pivotTimer = 0;
function showPivot() {
  const at = eye.project(eye.pivot, ...tangents());
  $("pivot").hidden = !at;
  if (!at) return;
  $("pivot").style.left = `${50 + 50 * at[0]}%`;
  $("pivot").style.top = `${50 + 50 * at[1]}%`;
  clearTimeout(pivotTimer);
  pivotTimer = setTimeout(() => ($("pivot").hidden = true), 700);
}

function pick(x, y) {
  send({ type: "pick", id: ++wish, ...view(), at: [x, y] });
}

function picked(point) {
  if (!point) return toast("There is nothing to turn around at this point.");
  eye.pivot = point;
  showPivot();
}

const pointers = new Map();
canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, [event.clientX, event.clientY]);
});
for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => pointers.delete(event.pointerId));
canvas.addEventListener("pointermove", (event) => {
  const old = pointers.get(event.pointerId);
  if (!old || !eye) return;
  const all = [...pointers.values()];
  const now = [event.clientX, event.clientY];
  const by = [now[0] - old[0], now[1] - old[1]];
  if (by[0] === 0 && by[1] === 0) return;
  const perPixel = (2 * tangents()[1] * eye.distance()) / canvas.clientHeight;
  if (all.length >= 2) {
    const [a, b] = all, between = () => Math.hypot(a[0] - b[0], a[1] - b[1]);
    const before = between();
    [old[0], old[1]] = now;
    eye.zoom(Math.min(Math.max(before / Math.max(between(), 1), 0.5), 2));
    // Each finger moves the middle by half of its way.
    eye.pan((-by[0] / 2) * perPixel, (-by[1] / 2) * perPixel);
  } else if (event.shiftKey || event.buttons & 6) {
    eye.pan(-by[0] * perPixel, -by[1] * perPixel);
  } else {
    eye.orbit(-by[0] * 0.0065, -by[1] * 0.0065);
    showPivot();
  }
  [old[0], old[1]] = now;
  moved();
});
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  if (!eye) return;
  const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
  const speed = event.ctrlKey ? 0.01 : 0.0012;
  eye.zoom(Math.exp(Math.min(Math.max(event.deltaY * lines * speed, -0.5), 0.5)));
  moved();
}, { passive: false });
canvas.addEventListener("dblclick", (event) => {
  if (!eye) return;
  const box = canvas.getBoundingClientRect();
  pick((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
});

const FLY = {
  KeyW: [0, 0, 1], ArrowUp: [0, 0, 1], KeyS: [0, 0, -1], ArrowDown: [0, 0, -1], KeyA: [-1, 0, 0], ArrowLeft: [-1, 0, 0],
  KeyD: [1, 0, 0], ArrowRight: [1, 0, 0], KeyQ: [0, 1, 0], KeyE: [0, -1, 0],
};
addEventListener("keydown", (event) => {
  const inField = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName);
  if (event.ctrlKey || event.altKey || event.metaKey || inField || !scene) return;
  if (event.code in FLY) keys.add(event.code);
  else if (event.code === "KeyR") reset();
  else if (event.code === "KeyN") step(1);
  else if (event.code === "KeyP") step(-1);
  else return;
  event.preventDefault();
});
addEventListener("keyup", (event) => keys.delete(event.code));
addEventListener("blur", () => keys.clear());

// --- controls ---

const toggle = () => {
  const isOpen = !document.body.classList.toggle("closed");
  $("toggle").setAttribute("aria-expanded", isOpen);
};
$("toggle").onclick = toggle;
$("previous").onclick = () => step(-1);
$("next").onclick = () => step(1);
$("reset").onclick = () => scene && reset();
$("photo").onchange = () => ($("photo").value === "" ? moved() : stand(Number($("photo").value)));
$("its-appearance").onclick = () => {
  $("from").value = photo;
  $("blend").value = 0;
  changed();
};
$("layer").onclick = (event) => {
  if (!event.target.value) return;
  layer = event.target.value;
  changed();
};
for (const id of ["from", "to", "blend", "limit"]) $(id).oninput = changed;
$("time").oninput = () => {
  play(false);
  changed();
};
$("play").onclick = () => play(!playing);
function play(on) {
  playing = on;
  $("play").textContent = on ? "❚❚" : "▶";
  $("play").setAttribute("aria-label", on ? "Stop" : "Play");
}
$("fov").oninput = () => {
  const wanted = Math.tan((Number($("fov").value) * Math.PI) / 360);
  frame = [(frame[0] * wanted) / frame[1], wanted];
  moved();
};
function behind(word) {
  const hex = $("colour").value;
  const own = [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);
  background = { trained: null, white: [1, 1, 1], black: [0, 0, 0], own }[word];
  for (const button of $("background").querySelectorAll("button")) button.setAttribute("aria-pressed", button.value === word);
  $("colour").parentElement.classList.toggle("on", word === "own");
  changed();
}
$("background").onclick = (event) => event.target.tagName === "BUTTON" && behind(event.target.value);
$("colour").oninput = () => behind("own");
$("curve-kind").onclick = (event) => {
  if (!event.target.value) return;
  curveKind = event.target.value;
  for (const button of $("curve-kind").children) button.setAttribute("aria-pressed", button.value === curveKind);
  drawCurve($("curve"), rows, curveKind);
};

// --- the loop ---

function fit() {
  const ratio = Math.min(devicePixelRatio || 1, 3);
  const [w, h] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
  if (!w || !h || (w === canvas.width && h === canvas.height)) return;
  // A new size empties a canvas: the old picture stays until there is another.
  const old = document.createElement("canvas");
  [old.width, old.height] = [canvas.width, canvas.height];
  old.getContext("2d").drawImage(canvas, 0, 0);
  [canvas.width, canvas.height] = [w, h];
  const share = Math.max(w / old.width, h / old.height);
  context.drawImage(old, (w - old.width * share) / 2, (h - old.height * share) / 2, old.width * share, old.height * share);
  isDirty = true;
  drawBox();
}
new ResizeObserver(fit).observe(canvas);
new ResizeObserver(() => drawCurve($("curve"), rows, curveKind)).observe($("curve"));

let before = performance.now();
function tick(now) {
  const seconds = Math.min((now - before) / 1000, 0.1);
  before = now;
  if (eye && keys.size) {
    const by = [...keys].reduce((sum, key) => add(sum, FLY[key]), [0, 0, 0]);
    const speed = 0.6 * eye.radius * seconds;
    if (by.some((x) => x !== 0)) {
      eye.fly(...scaled(by, speed));
      moved();
    }
  }
  // Four seconds from the first time step to the last.
  if (playing && eye) {
    setTime((Number($("time").value) + seconds / 4) % 1);
    changed();
  }
  if (isDirty) ask();
  requestAnimationFrame(tick);
}

if (matchMedia("(max-width: 700px)").matches) toggle();
notice("Connecting …", "");
connect();
requestAnimationFrame(tick);
