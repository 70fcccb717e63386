// The camera: its pose and its movements. It stays upright. The server receives eye, target, up and field of view.
import {add, cross, distance, dot, length, mix, normalize, rotate, scale, sub} from './vector.js';

const kSteepest = 89.9 * Math.PI / 180;  // above and below the horizon
const kClosest = 1e-6;                   // distance to a surface, relative to the scene's size

// The server refuses views beyond these limits (tools/view/message.h).
export const kFarthest = 1e15;  // of each coordinate
export const kFov = [0.001, 179.9];
export const clamped = (value, low, high) => Math.max(low, Math.min(high, value));

export class Camera {
  constructor() {
    this.eye = [0, 0, 3];
    this.target = [0, 0, 0];
    this.worldUp = [0, 1, 0];
    this.fov = 45;
    this.size = 1;  // diagonal of the scene's box
    this.isFlown = false;
  }

  get forward() { return normalize(sub(this.target, this.eye)); }
  get right() {
    const side = cross(this.forward, this.worldUp);
    return length(side) > 1e-9 ? normalize(side) : [1, 0, 0];
  }
  get up() { return cross(this.right, this.forward); }
  get pitch() { return Math.asin(Math.max(-1, Math.min(1, dot(this.forward, this.worldUp)))); }

  pose() { return {eye: [...this.eye], target: [...this.target], up: [...this.worldUp], fov: this.fov}; }
  set(pose) {
    this.place([...pose.eye], [...pose.target]);
    if (pose.up) this.worldUp = nearestAxis(pose.up);
    if (pose.fov) this.fov = clamped(pose.fov, ...kFov);
    this.isFlown = false;
    this.unroll();
  }
  /// A pose that may be rolled, until stand().
  fly({eye, target, up, fov}) {
    this.place([...eye], [...target]);
    this.fov = clamped(fov, ...kFov);
    this.isFlown = true;
    if (length(cross(this.forward, normalize(up))) > 1e-9) this.worldUp = normalize(up);
    else this.unroll();
  }
  stand() { if (this.isFlown) this.set(this.pose()); }
  /// Every movement ends here. The camera stays where it is if the new place has no direction or is too far away.
  place(eye, target) {
    if (!(distance(eye, target) > 1e-300) || ![...eye, ...target].every((value) => Math.abs(value) <= kFarthest)) return;
    this.eye = eye;
    this.target = target;
  }
  /// A view straight up or down needs another way to find the direction to the right.
  unroll() {
    const pitch = this.pitch;
    if (Math.abs(pitch) <= kSteepest + 1e-9) return;
    const side = Math.abs(this.worldUp[1]) > 0.5 ? [0, 0, -1] : [0, 1, 0];
    const reach = distance(this.eye, this.target);
    const direction = add(scale(this.worldUp, Math.sign(pitch) * Math.sin(kSteepest)), scale(side, Math.cos(kSteepest)));
    this.place(this.eye, add(this.eye, scale(direction, reach)));
  }

  /// Unit vector through a point of the picture; x and y from 0 to 1 from the top left.
  ray(x, y, aspect) {
    const tan = Math.tan(this.fov * Math.PI / 360);
    return normalize(add(this.forward, add(scale(this.right, (2 * x - 1) * tan * aspect), scale(this.up, (1 - 2 * y) * tan))));
  }
  /// The position of a point in the picture. depth is along the view direction; it is 0 or negative behind the eye.
  project(point, aspect) {
    const tan = Math.tan(this.fov * Math.PI / 360), d = sub(point, this.eye);
    const depth = dot(d, this.forward);
    return {x: 0.5 + dot(d, this.right) / (2 * depth * tan * aspect), y: 0.5 - dot(d, this.up) / (2 * depth * tan), depth};
  }
  /// The point at a depth along the view, under a point of the picture.
  pointAt(x, y, aspect, depth) {
    const ray = this.ray(x, y, aspect);
    return add(this.eye, scale(ray, depth / dot(ray, this.forward)));
  }

  /// Turns around `pivot`, as if the scene was dragged to the right and down by these angles in radians.
  orbit(pivot, yaw, pitch) { this.turn(pivot, -yaw, -pitch); }
  /// Turns the view around the eye.
  look(yaw, pitch) { this.turn(this.eye, -yaw, -pitch); }
  turn(pivot, yaw, pitch) {
    const now = this.pitch;
    const wanted = Math.max(-kSteepest, Math.min(kSteepest, now + pitch));
    const right = this.right;
    const turned = (v) => rotate(rotate(v, right, wanted - now), this.worldUp, yaw);
    const eye = add(pivot, turned(sub(this.eye, pivot)));
    this.place(eye, add(eye, turned(sub(this.target, this.eye))));
  }
  move(offset) { this.place(add(this.eye, offset), add(this.target, offset)); }
  /// Multiplies the eye's distance from the point by `factor`, but keeps a least distance. The point keeps its position
  /// in the picture.
  zoom(point, factor) {
    let reach = sub(point, this.eye);
    const closest = kClosest * this.size;
    if (length(reach) < closest && factor < 1) reach = scale(this.forward, closest);  // passes through the surface
    this.move(scale(reach, 1 - factor));
    this.reach(Math.max(closest, dot(sub(point, this.eye), this.forward)));
  }
  /// Sets the target's distance; the view stays the same.
  reach(distanceToTarget) {
    this.place(this.eye, add(this.eye, scale(this.forward, distanceToTarget)));
  }
  /// The pose in the given direction that shows all points, centred in the part of the picture that a panel leaves
  /// free. The panel covers the share `covered` of the width, on the right.
  framing(points, aspect, covered = 0, direction = this.forward) {
    const view = new Camera();
    Object.assign(view, {eye: scale(direction, -1), target: [0, 0, 0], worldUp: this.worldUp});
    view.unroll();
    const {forward, right, up} = view;
    const tan = Math.tan(this.fov * Math.PI / 360), kMargin = 0.92;
    let center = mix(bound(points, Math.min), bound(points, Math.max), 0.5), reach = 0;
    // Near points are drawn larger, so the middle of the picture is not that of the box.
    for (let round = 0; round < 6; ++round) {
      reach = 2 * kClosest * this.size;
      const places = points.map((point) => sub(point, center)).map((d) => [dot(d, right), dot(d, up), dot(d, forward)]);
      for (const [x, y, z] of places)
        reach = Math.max(reach, Math.abs(x) / (kMargin * tan * aspect * (1 - covered)) - z, Math.abs(y) / (kMargin * tan) - z);
      const middle = (axis) => {
        const seen = places.map((place) => place[axis] / (place[2] + reach));
        return reach * (Math.min(...seen) + Math.max(...seen)) / 2;
      };
      if (round < 5) center = add(center, add(scale(right, middle(0)), scale(up, middle(1))));
    }
    const aside = scale(right, reach * tan * aspect * covered);
    return {eye: add(sub(center, scale(forward, reach)), aside), target: add(center, aside), up: [...this.worldUp], fov: this.fov};
  }
}

const bound = (points, choose) => [0, 1, 2].map((axis) => choose(...points.map((point) => point[axis])));

function nearestAxis(up) {
  // A camera of the file may be rolled. The page uses the axis nearest to its up vector.
  const axes = [[0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, -1], [1, 0, 0], [-1, 0, 0]];
  const unit = normalize(up);
  if (dot(unit, [0, 1, 0]) > 0.3) return [0, 1, 0];
  return axes.reduce((best, axis) => dot(axis, unit) > dot(best, unit) + 1e-9 ? axis : best);
}

/// Interpolates from one pose to another; t from 0 to 1. The distance to the target changes by a constant factor per
/// time, so that a flight from a whole city to a small part does not end too fast.
export function between(a, b, t) {
  const from = distance(a.eye, a.target), to = distance(b.eye, b.target);
  const reach = from > 0 && to > 0 ? from * Math.pow(to / from, t) : from + (to - from) * t;
  // The target moves in proportion to the change of the distance, so that its speed in the picture is even.
  const share = Math.abs(from - to) > 1e-9 * Math.max(from, to) ? (from - reach) / (from - to) : t;
  const target = mix(a.target, b.target, share);
  const back = slerp(normalize(sub(a.eye, a.target)), normalize(sub(b.eye, b.target)), t);
  return {target, eye: add(target, scale(back, reach)), up: b.up ?? a.up, fov: a.fov + (b.fov - a.fov) * t};
}

function slerp(a, b, t) {
  const angle = Math.acos(Math.max(-1, Math.min(1, dot(a, b))));
  if (angle < 1e-6) return a;
  if (angle > Math.PI - 1e-3) {
    const side = normalize(cross(a, Math.abs(a[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0]));
    return rotate(a, side, Math.PI * t);
  }
  return add(scale(a, Math.sin((1 - t) * angle) / Math.sin(angle)), scale(b, Math.sin(t * angle) / Math.sin(angle)));
}

/// The pose at `time` of a path of keys {t, eye, target, up, fov} in order of t: Catmull-Rom curves as in
/// tools/render/camera_path.cpp.
export function alongPath(keys, time) {
  if (keys.length === 1 || time <= keys[0].t) return keys[0];
  if (time >= keys[keys.length - 1].t) return keys[keys.length - 1];
  let i = 0;
  while (keys[i + 1].t <= time) ++i;
  const t = (time - keys[i].t) / (keys[i + 1].t - keys[i].t);
  const key = (n) => keys[Math.max(0, Math.min(keys.length - 1, n))];
  const curve = (pick) => {
    const [a, b, c, d] = [pick(key(i - 1)), pick(key(i)), pick(key(i + 1)), pick(key(i + 2))];
    const at = (p, q, r, s) => 0.5 * (2 * q + (r - p) * t + (2 * p - 5 * q + 4 * r - s) * t * t + (3 * q - p - 3 * r + s) * t * t * t);
    return typeof a === 'number' ? at(a, b, c, d) : a.map((unused, axis) => at(a[axis], b[axis], c[axis], d[axis]));
  };
  const fovOf = (choose) => keys.reduce((fov, k) => choose(fov, k.fov), keys[0].fov);
  return {eye: curve((k) => k.eye), target: curve((k) => k.target), up: curve((k) => k.up), fov: clamped(curve((k) => k.fov), fovOf(Math.min), fovOf(Math.max))};
}
