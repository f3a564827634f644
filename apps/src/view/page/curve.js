
// The curve of a training: rows of [step, loss, PSNR in training, PSNR held out], drawn as SVG.
const SVG = "http://www.w3.org/2000/svg";
function part(name, attributes, text) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== undefined) node.textContent = text;
  return node;
}

function short(x) {
  if (x === 0) return "0";
  const size = Math.abs(x);
  return size >= 1000 || size < 0.001 ? x.toExponential(1) : String(Number(x.toPrecision(3)));
}

function drawCurve(place, rows, kind) {
  const width = Math.max(place.clientWidth, 160), height = 108, left = 34, bottom = 16, top = 6;
  const column = kind === "loss" ? 1 : 2;
  const of = (row) => (kind === "loss" ? Math.log10(Math.max(row[1], 1e-12)) : row[column]);
  const line = rows.filter((row) => row[column] !== null);
  const held = kind === "psnr" ? rows.filter((row) => row[3] !== null) : [];
  const values = line.map(of).concat(held.map((row) => row[3])).filter(Number.isFinite).sort((a, b) => a - b);
  const svg = part("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `Curve of ${kind}` });
  place.replaceChildren(svg);
  if (values.length === 0) return;
  // The first steps are far from all others: they may leave the picture.
  const low = kind === "loss" ? values[0] : values[Math.floor(values.length * 0.02)];
  const high = kind === "loss" ? values[Math.ceil((values.length - 1) * 0.98)] : values[values.length - 1];
  const span = Math.max(high - low, kind === "loss" ? 0.1 : 0.5);
  const last = Math.max(...rows.map((row) => row[0]), 1);
  const x = (step) => left + (step / last) * (width - left - 4);
  const y = (value) => top + (1 - Math.min(Math.max((value - low) / span, 0), 1)) * (height - top - bottom);
  for (const share of [0, 0.5, 1]) {
    const value = low + share * span;
    const shown = kind === "loss" ? short(10 ** value) : value.toFixed(1);
    svg.append(part("line", { x1: left, x2: width, y1: y(value), y2: y(value) }));
    svg.append(part("text", { x: left - 5, y: y(value) + 3.5, "text-anchor": "end" }, shown));
  }
  const points = line.map((row) => `${x(row[0]).toFixed(1)} ${y(of(row)).toFixed(1)}`);
  // One point alone would draw nothing.
  if (points.length === 1) points.push(points[0]);
  if (points.length) svg.append(part("path", { d: `M${points.join("L")}` }));
  for (const row of held) svg.append(part("circle", { cx: x(row[0]), cy: y(row[3]), r: 2.6 }));
  svg.append(part("text", { x: left, y: height - 2 }, "0"));
  svg.append(part("text", { x: width, y: height - 2, "text-anchor": "end" }, `step ${last}`));
}
