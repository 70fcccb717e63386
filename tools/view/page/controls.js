// Moves the camera by mouse, touch and held keys. There are no modes.
import {add, distance, dot, scale, sub} from './vector.js';

const kOrbitTurn = Math.PI;  // radians for a drag across the picture's height
const kNotch = 0.85;         // factor of the distance per notch of the wheel
const kClickPixels = 4;      // a press that moves less than this is a click
const kDoubleMs = 350;
const kFlySeconds = 2;  // time of a flight to the point under the cursor
const kFlyKeys = {KeyW: [0, 0, 1], KeyS: [0, 0, -1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyE: [0, 1, 0], KeyQ: [0, -1, 0],
  ArrowUp: [0, 0, 1], ArrowDown: [0, 0, -1], ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0]};

/// `host`: {camera, aspect(), begin(), changed(time, keepsHover), ended(), pointUnder(x, y), probe(x, y), click(x, y,
/// event), doubleClick(x, y), hover(x, y), pivot(point or null)}. Coordinates are in CSS pixels of the stage.
export class Controls {
  constructor(stage, host) {
    this.stage = stage;
    this.host = host;
    this.pointers = new Map();
    this.held = new Set();
    this.speed = 1;     // of flying; the wheel changes it
    this.zoomLeft = 0;  // wheel notches that are not applied yet
    this.zoomPoint = null;
    this.frame = 0;
    this.lastTime = 0;
    this.lastClick = {time: -1e9, x: 0, y: 0};
    stage.addEventListener('pointerdown', (event) => this.down(event));
    stage.addEventListener('pointermove', (event) => this.moved(event));
    for (const type of ['pointerup', 'pointercancel']) stage.addEventListener(type, (event) => this.up(event));
    stage.addEventListener('wheel', (event) => this.wheel(event), {passive: false});
    stage.addEventListener('contextmenu', (event) => event.preventDefault());
    addEventListener('keyup', (event) => this.held.delete(event.code));
    addEventListener('blur', () => this.held.clear());
  }

  get isBusy() { return this.pointers.size > 0 || this.zoomLeft !== 0 || this.held.size > 0; }

  /// Whether the key was handled.
  key(event) {
    if (!(event.code in kFlyKeys) || event.ctrlKey || event.metaKey || event.altKey) return false;
    this.held.add(event.code);
    this.fast = event.shiftKey;
    this.run();
    return true;
  }

  down(event) {
    this.stage.focus({preventScroll: true});
    try { this.stage.setPointerCapture(event.pointerId); } catch { /* a synthetic pointer of a test */ }
    this.pointers.set(event.pointerId, {x: event.clientX, y: event.clientY, startX: event.clientX, startY: event.clientY});
    this.isClick = this.pointers.size === 1;
    this.host.begin();
    this.grab(event);
  }

  /// Begins a drag. A change of the number of fingers begins another drag.
  grab(event) {
    const {x, y} = this.middle();
    this.pivot = this.host.pointUnder(x, y);
    this.host.probe(x, y);
    const fingers = event.pointerType === 'touch' ? this.pointers.size : 0;
    const flies = this.held.size > 0;
    if (fingers === 3 || event.altKey || flies) this.drag = 'looks';
    else if (fingers === 2 || event.button === 2 || event.button === 1 || event.ctrlKey || event.metaKey) this.drag = 'pans';
    else this.drag = 'orbits';
    this.spread = this.fingerSpread();
    this.stage.className = '';
  }

  /// Receives the answer to a probe. The current drag then turns around this point.
  found(point) {
    if (this.pointers.size > 0) this.pivot = point;
    if (this.zoomLeft !== 0) this.zoomPoint = point;
  }

  middle() {
    let x = 0, y = 0;
    for (const pointer of this.pointers.values()) { x += pointer.x; y += pointer.y; }
    return {x: x / this.pointers.size, y: y / this.pointers.size};
  }
  fingerSpread() {
    if (this.pointers.size < 2) return 0;
    const [a, b] = this.pointers.values();
    return Math.hypot(a.x - b.x, a.y - b.y);
  }

  moved(event) {
    const pointer = this.pointers.get(event.pointerId);
    if (!pointer) return this.host.hover(event.clientX, event.clientY);
    const before = this.middle();
    pointer.x = event.clientX;
    pointer.y = event.clientY;
    const after = this.middle();
    const farthest = Math.hypot(pointer.x - pointer.startX, pointer.y - pointer.startY);
    if (this.isClick && farthest < kClickPixels) return;
    if (this.isClick) {
      this.isClick = false;
      this.stage.className = this.drag;
      if (this.drag === 'orbits') this.host.pivot(this.pivot);
    }
    this.dragged(after.x - before.x, after.y - before.y, after);
    this.host.changed(event.timeStamp);
  }

  dragged(dx, dy, at) {
    const camera = this.host.camera, height = this.stage.clientHeight;
    if (this.drag === 'looks') return camera.look(camera.fov * Math.PI / 180 * dx / height, camera.fov * Math.PI / 180 * dy / height);
    if (this.drag === 'orbits') return camera.orbit(this.pivot, kOrbitTurn * dx / height, kOrbitTurn * dy / height);
    const depth = Math.max(dot(sub(this.pivot, camera.eye), camera.forward), 1e-9 * camera.size);
    const unit = 2 * Math.tan(camera.fov * Math.PI / 360) * depth / height;
    camera.move(add(scale(camera.right, -dx * unit), scale(camera.up, dy * unit)));
    const spread = this.fingerSpread();
    if (spread > 0 && this.spread > 0) camera.zoom(this.host.pointUnder(at.x, at.y), Math.max(0.2, Math.min(5, this.spread / spread)));
    this.spread = spread;
  }

  up(event) {
    if (!this.pointers.delete(event.pointerId)) return;
    this.stage.className = '';
    if (this.pointers.size > 0) return this.grab(event);
    this.host.pivot(null);
    if (this.isClick && event.type === 'pointerup' && event.button === 0) this.clicked(event);
    this.host.ended();
  }

  clicked(event) {
    const {x, y, time} = this.lastClick;
    const isDouble = event.timeStamp - time < kDoubleMs && Math.hypot(event.clientX - x, event.clientY - y) < 4 * kClickPixels;
    this.lastClick = {time: isDouble ? -1e9 : event.timeStamp, x: event.clientX, y: event.clientY};
    if (isDouble) this.host.doubleClick(event.clientX, event.clientY);
    else this.host.click(event.clientX, event.clientY, event);
  }

  wheel(event) {
    event.preventDefault();
    const pixels = event.deltaY * [1, 33, 400][event.deltaMode];
    if (this.held.size > 0) {
      this.speed = Math.max(1e-3, Math.min(1e3, this.speed * Math.pow(1.2, -Math.sign(pixels))));
      return this.host.speed(this.speed);
    }
    this.host.begin();
    if (this.zoomLeft === 0) {
      this.zoomPoint = this.host.pointUnder(event.clientX, event.clientY);
      this.host.probe(event.clientX, event.clientY);
    }
    // Browsers report touchpad pinches as a wheel with Ctrl, in small steps.
    this.zoomLeft += Math.max(-6, Math.min(6, pixels / (event.ctrlKey ? 12 : 100)));
    this.inputTime = event.timeStamp;
    this.run();
  }

  run() {
    if (this.frame !== 0) return;
    this.lastTime = performance.now();
    this.frame = requestAnimationFrame((time) => this.step(time));
  }

  step(time) {
    const seconds = Math.min(0.1, Math.max(0.001, (time - this.lastTime) / 1000));
    this.lastTime = time;
    this.frame = 0;
    const camera = this.host.camera;
    const isActive = this.zoomLeft !== 0 || this.held.size > 0;
    if (this.zoomLeft !== 0) {
      const share = Math.abs(this.zoomLeft) < 0.02 ? 1 : 1 - Math.exp(-seconds / 0.05);
      const part = this.zoomLeft * share;
      this.zoomLeft = share === 1 ? 0 : this.zoomLeft - part;
      camera.zoom(this.zoomPoint, Math.pow(kNotch, -part));
    }
    if (this.held.size > 0) {
      const reach = Math.max(distance(this.host.pointUnder(this.stage.clientWidth / 2, this.stage.clientHeight / 2), camera.eye), 1e-5 * camera.size);
      const step = seconds * this.speed * (this.fast ? 4 : 1) * reach / kFlySeconds;
      for (const code of this.held) {
        const [x, y, z] = kFlyKeys[code];
        camera.move(add(add(scale(camera.right, x * step), scale(camera.worldUp, y * step)), scale(camera.forward, z * step)));
      }
    }
    if (isActive) this.host.changed(this.inputTime ?? time, this.held.size === 0);
    this.inputTime = undefined;
    if (this.zoomLeft !== 0 || this.held.size > 0) this.run();
    else this.host.ended();
  }
}
