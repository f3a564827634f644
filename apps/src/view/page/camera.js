
// The camera: a position, three axes (right, down, forward) and a pivot to turn around, world units.
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const unit = (a) => scaled(a, 1 / Math.max(Math.hypot(...a), 1e-12));

// `v` turned by `angle` around the unit vector `axis` (Rodrigues).
function turned(v, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(add(scaled(v, c), cross(axis, v), s), axis, dot(axis, v) * (1 - c));
}

// Axes of a camera-to-world quaternion, w first.
function axesOf([w, x, y, z]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
    [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
    [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
  ];
}

// The quaternion of three axes, by the largest of its squares.
function wxyzOf([x, y, z]) {
  const squares = [1 + x[0] + y[1] + z[2], 1 + x[0] - y[1] - z[2], 1 - x[0] + y[1] - z[2], 1 - x[0] - y[1] + z[2]];
  const largest = squares.indexOf(Math.max(...squares));
  const rows = [
    [squares[0], y[2] - z[1], z[0] - x[2], x[1] - y[0]],
    [y[2] - z[1], squares[1], x[1] + y[0], z[0] + x[2]],
    [z[0] - x[2], x[1] + y[0], squares[2], y[2] + z[1]],
    [x[1] - y[0], z[0] + x[2], y[2] + z[1], squares[3]],
  ];
  const q = rows[largest], n = Math.hypot(...q);
  return q.map((v) => v / n);
}

class Eye {
  constructor(up, radius) {
    this.up = unit(up);
    this.radius = radius;
    this.position = [0, 0, 0];
    this.axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    this.pivot = [0, 0, 1];
  }

  // Stand where a photo was taken, to turn around what is in its middle, as far away as `pivot` is.
  stand(photo, pivot) {
    this.position = photo.position.slice();
    this.axes = axesOf(photo.wxyz);
    const depth = dot(add(pivot, this.position, -1), this.axes[2]);
    this.pivot = add(this.position, this.axes[2], depth > 0.05 * this.radius ? depth : this.radius);
  }

  // Radians around up, and around the camera's right.
  orbit(yaw, pitch) {
    this.rotate(this.up, yaw);
    const forward = turned(this.axes[2], this.axes[0], pitch);
    const before = Math.abs(dot(this.axes[2], this.up)), after = Math.abs(dot(forward, this.up));
    // Not over the pole, where left and right change sides; but back from there.
    if (after < 0.997 || after < before) this.rotate(this.axes[0], pitch);
  }

  rotate(axis, angle) {
    this.position = add(this.pivot, turned(add(this.position, this.pivot, -1), axis, angle));
    const forward = unit(turned(this.axes[2], axis, angle));
    const down = turned(this.axes[1], axis, angle);
    const right = unit(cross(down, forward));
    this.axes = [right, cross(forward, right), forward];
  }

  // Another direction is up: the camera stays, and stands upright.
  level(up) {
    this.up = unit(up);
    const forward = this.axes[2], right = cross(forward, this.up);
    if (Math.hypot(...right) < 1e-3) return;
    this.axes = [unit(right), cross(forward, unit(right)), forward];
  }

  distance() {
    return Math.max(Math.abs(dot(add(this.pivot, this.position, -1), this.axes[2])), 0.05 * this.radius);
  }

  // Right and down, world units; the pivot comes along.
  pan(right, down) {
    const by = add(scaled(this.axes[0], right), this.axes[1], down);
    this.position = add(this.position, by);
    this.pivot = add(this.pivot, by);
  }

  // The distance to the pivot times `factor`, not through it.
  zoom(factor) {
    const depth = dot(add(this.pivot, this.position, -1), this.axes[2]);
    let by = this.distance() * (1 - factor);
    if (depth > 0 && by > 0) by = Math.min(by, depth - 0.02 * this.radius);
    this.position = add(this.position, this.axes[2], by);
  }

  fly(right, down, forward) {
    this.pan(right, down);
    this.position = add(this.position, this.axes[2], forward);
    this.pivot = add(this.pivot, this.axes[2], forward);
  }

  // Place in the picture, -1..1 from the middle, or null behind the camera.
  project(point, tanX, tanY) {
    const v = add(point, this.position, -1), z = dot(v, this.axes[2]);
    return z <= 1e-9 ? null : [dot(v, this.axes[0]) / z / tanX, dot(v, this.axes[1]) / z / tanY];
  }
}
