
// The crop: a box and a filter of floaters, as sliders and as a box that is drawn over the picture; and which way is up.
const everything = () => ({ box: null, faint: 0, large: null, alone: null });
let crop = everything();
let hints = null; // where sliders begin and end; null while there is nothing that can be cropped
let upWord = "guess", savedUp = null;
const AXES = ["x", "y", "z"];

// The box that the sliders of places run over: that of the scene with room around it.
function room() {
  const [min, max] = hints.box;
  const by = AXES.map((_, k) => 0.3 * (max[k] - min[k]));
  return [AXES.map((_, k) => min[k] - by[k]), AXES.map((_, k) => max[k] + by[k])];
}

// A threshold from `most` (slider at its end: none) down to the middle one, evenly in its logarithm, and back.
const threshold = (v, [middle, most]) => (v >= 100 ? null : most * (middle / most) ** (1 - v / 100));
const slider = (x, [middle, most]) => (x === null ? 100 : Math.max(0, 100 * (1 - Math.log(x / most) / Math.log(middle / most))));

function setHints(now) {
  hints = now || hints;
  $("crop-section").hidden = !hints;
  if (hints) showCrop();
}

function setCrop(now) {
  crop = { box: now.box, faint: now.faint, large: now.large, alone: now.alone };
  savedUp = now.up;
  if (hints) showCrop();
}

function cropsNothing() {
  return crop.box === null && crop.faint === 0 && crop.large === null && crop.alone === null;
}

// Controls as the crop is.
function showCrop() {
  const [min, max] = room();
  const box = crop.box || hints.box;
  $("crop-box").checked = crop.box !== null;
  $("crop-sides").hidden = crop.box === null;
  for (const [k, axis] of AXES.entries()) {
    for (const side of [0, 1]) $(axis + side).value = (1000 * (box[side][k] - min[k])) / (max[k] - min[k]);
    $(`${axis}-value`).textContent = `${short(box[0][k])} … ${short(box[1][k])}`;
  }
  $("faint").value = 100 * Math.sqrt(crop.faint);
  $("large").value = slider(crop.large, hints.large);
  $("alone").value = slider(crop.alone, hints.alone);
  $("faint-value").textContent = crop.faint > 0 ? short(crop.faint) : "–";
  $("large-value").textContent = crop.large === null ? "–" : short(crop.large);
  $("alone-value").textContent = crop.alone === null ? "–" : short(crop.alone);
  drawBox();
}

// The crop as the sliders are; each side keeps away from the other.
function readSides(event) {
  const [min, max] = room();
  const box = [0, 1].map((side) => AXES.map((axis, k) => min[k] + (Number($(axis + side).value) / 1000) * (max[k] - min[k])));
  for (let k = 0; k < 3; k++) {
    const gap = 0.005 * (max[k] - min[k]);
    if (box[1][k] - box[0][k] >= gap) continue;
    if (event.target.id === AXES[k] + 0) box[0][k] = box[1][k] - gap;
    else box[1][k] = box[0][k] + gap;
  }
  crop.box = box;
}

function cropChanged() {
  $("crop-note").textContent = "not saved";
  showCrop();
  changed();
}

function setUp(word) {
  if (!eye) return;
  const axis = (k, s) => [0, 1, 2].map((i) => (i === k ? s : 0));
  const sides = { "x": axis(0, 1), "-x": axis(0, -1), "y": axis(1, 1), "-y": axis(1, -1), "z": axis(2, 1), "-z": axis(2, -1) };
  const up = { ...sides, guess: scene.up, saved: savedUp, here: scaled(eye.axes[1], -1) }[word];
  if (!up) return;
  upWord = word;
  $("up").value = word;
  eye.level(up);
  moved();
}

// --- the box over the picture ---

function segment(a, b) {
  const depth = (p) => dot(add(p, eye.position, -1), eye.axes[2]);
  const [near, da, db] = [1e-3 * eye.radius, depth(a), depth(b)];
  if (da < near && db < near) return null;
  const cut = (from, to, d, e) => (d >= near ? from : add(from, add(to, from, -1), (near - d) / (e - d)));
  const ends = [cut(a, b, da, db), cut(b, a, db, da)].map((p) => place2(p));
  return ends[0] && ends[1] ? ends : null;
}

// Place on the page, pixels.
function place2(point) {
  const at = eye.project(point, ...tangents());
  return at && [((at[0] + 1) / 2) * canvas.clientWidth, ((at[1] + 1) / 2) * canvas.clientHeight];
}

const corner = (i) => AXES.map((_, k) => crop.box[(i >> k) & 1][k]);
const middle = () => scaled(add(crop.box[0], crop.box[1]), 0.5);
const face = (k, side) => AXES.map((_, i) => (i === k ? crop.box[side][k] : middle()[i]));

function drawBox() {
  const svg = $("box");
  const isSeen = eye && crop.box !== null && !isOfPhoto();
  svg.toggleAttribute("hidden", !isSeen);
  if (!isSeen) return;
  if (!svg.children.length) {
    for (let i = 0; i < 12; i++) svg.append(part("line", {}));
    for (let i = 0; i < 6; i++) svg.append(part("circle", { r: 7, "data-axis": i >> 1, "data-side": i & 1 }));
  }
  svg.setAttribute("viewBox", `0 0 ${canvas.clientWidth} ${canvas.clientHeight}`);
  let next = 0;
  for (let i = 0; i < 8; i++) {
    for (let k = 0; k < 3; k++) {
      if (i & (1 << k)) continue;
      const line = svg.children[next++], ends = segment(corner(i), corner(i | (1 << k)));
      line.toggleAttribute("hidden", !ends);
      if (ends) for (const [name, value] of Object.entries({ x1: ends[0][0], y1: ends[0][1], x2: ends[1][0], y2: ends[1][1] })) line.setAttribute(name, value.toFixed(1));
    }
  }
  for (let i = 0; i < 6; i++) {
    const circle = svg.children[12 + i], at = place2(face(i >> 1, i & 1));
    circle.toggleAttribute("hidden", !at);
    if (at) [circle.cx.baseVal.value, circle.cy.baseVal.value] = at;
  }
}

// A handle follows the hand along its axis.
let held = null;
$("box").addEventListener("pointerdown", (event) => {
  const { axis, side } = event.target.dataset;
  if (axis === undefined) return;
  held = { k: Number(axis), side: Number(side), at: [event.clientX, event.clientY] };
  event.target.setPointerCapture(event.pointerId);
  event.stopPropagation();
});
$("box").addEventListener("pointermove", (event) => {
  if (!held) return;
  const { k, side, at } = held;
  const [min, max] = room();
  const unitOf = 0.01 * (max[k] - min[k]);
  const from = face(k, side), to = from.slice();
  to[k] += unitOf;
  const [a, b] = [place2(from), place2(to)];
  if (!a || !b) return;
  const way = [b[0] - a[0], b[1] - a[1]], square = way[0] ** 2 + way[1] ** 2;
  if (square < 1e-3) return;
  const by = (((event.clientX - at[0]) * way[0] + (event.clientY - at[1]) * way[1]) / square) * unitOf;
  const gap = 0.005 * (max[k] - min[k]);
  const box = crop.box.map((side) => side.slice());
  box[side][k] = side ? Math.max(box[1][k] + by, box[0][k] + gap) : Math.min(box[0][k] + by, box[1][k] - gap);
  crop.box = box;
  held.at = [event.clientX, event.clientY];
  cropChanged();
});
for (const kind of ["pointerup", "pointercancel"]) $("box").addEventListener(kind, () => (held = null));

$("crop-box").onchange = () => {
  crop.box = $("crop-box").checked ? hints.box.map((side) => side.slice()) : null;
  cropChanged();
};
for (const axis of AXES) {
  for (const side of [0, 1]) {
    $(axis + side).oninput = (event) => {
      readSides(event);
      cropChanged();
    };
  }
}
$("faint").oninput = () => {
  crop.faint = (Number($("faint").value) / 100) ** 2;
  cropChanged();
};
for (const kind of ["large", "alone"]) {
  $(kind).oninput = () => {
    crop[kind] = threshold(Number($(kind).value), hints[kind]);
    cropChanged();
  };
}
$("crop-clear").onclick = () => {
  crop = everything();
  cropChanged();
};
$("crop-save").onclick = () => send({ type: "save", crop: { ...crop, up: upWord === "guess" ? null : eye.up } });
$("up").onchange = () => setUp($("up").value);
