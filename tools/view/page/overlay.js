// Draws over the picture: the pivot, picks and their boxes, a measured distance, the axes.
import {cross, dot, sub} from './vector.js';

const kSpace = 'http://www.w3.org/2000/svg';
const kEdges = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

export const lengthText = (value) => Math.abs(value) >= 1e15 || (Math.abs(value) < 1e-3 && value !== 0) ? value.toExponential(3)
  : Math.abs(value) >= 1e5 ? value.toFixed(0) : Number(value.toPrecision(5)).toString();
/// A coordinate in a scene of this size, to about a millionth of the size.
export const coordinateText = (value, size) => String(Number(value.toFixed(Math.max(0, Math.ceil(6 - Math.log10(size))))));

export class Overlay {
  constructor(svg, axes) {
    this.svg = svg;
    this.axes = axes.getContext('2d');
    this.pivot = null;
    this.picks = [];  // {point, box}: at most two; the box of the last is drawn
    this.isMeasured = false;
    this.clip = null;  // the clipping box: its smallest, then its largest coordinates, six numbers
    this.grab = null;  // called with the number of a side of the box, 0 to 5, and the event that begins its drag
  }

  /// The position of the handle of side 0 to 5: the middle of its face.
  sideAt(side) {
    const middle = [0, 1, 2].map((axis) => (this.clip[axis] + this.clip[axis + 3]) / 2);
    middle[side % 3] = this.clip[side];
    return middle;
  }

  draw(camera, width, height) {
    this.svg.replaceChildren();
    this.drawAxes(camera);
    const aspect = width / height;
    const near = 1e-7 * camera.size;
    const place = (point) => {
      const {x, y, depth} = camera.project(point, aspect);
      return {x: x * width, y: y * height, depth};
    };
    const drawBox = (box, name) => {
      const corners = box.map(place);
      let path = '';
      for (const [a, b] of kEdges)
        if (corners[a].depth > near && corners[b].depth > near)
          path += `M${clip(corners[a].x)} ${clip(corners[a].y)}L${clip(corners[b].x)} ${clip(corners[b].y)}`;
      if (path) this.add('path', {class: name, d: path});
    };
    const last = this.picks[this.picks.length - 1];
    if (last?.box) drawBox(last.box, 'box');
    if (this.clip) {
      drawBox([...Array(8).keys()].map((k) => [0, 1, 2].map((axis) => this.clip[axis + (k >> axis & 1 ? 3 : 0)])), 'clip');
      for (let side = 0; side < 6; ++side) {
        const at = place(this.sideAt(side));
        if (at.depth <= near) continue;
        const dot = this.add('circle', {class: `handle axis${side % 3}`, 'data-side': side, cx: at.x, cy: at.y, r: 6});
        dot.addEventListener('pointerdown', (event) => this.grab?.(side, event));
      }
    }
    const dots = this.picks.map((pick) => place(pick.point));
    if (this.isMeasured && dots.length === 2 && dots.every((dot) => dot.depth > near)) {
      this.add('line', {class: 'measure', x1: dots[0].x, y1: dots[0].y, x2: dots[1].x, y2: dots[1].y});
      const d = sub(this.picks[0].point, this.picks[1].point);
      const text = this.add('text', {x: (dots[0].x + dots[1].x) / 2 + 8, y: (dots[0].y + dots[1].y) / 2 - 6});
      text.textContent = lengthText(Math.sqrt(dot(d, d)));
    }
    for (const dot of this.isMeasured ? dots : dots.slice(-1))
      if (dot.depth > near) this.add('circle', {class: 'dot', cx: dot.x, cy: dot.y, r: 4.5});
    if (this.pivot) {
      const at = place(this.pivot);
      if (at.depth > near) {
        this.add('circle', {class: 'ring', cx: at.x, cy: at.y, r: 9});
        this.add('circle', {class: 'dot', cx: at.x, cy: at.y, r: 2.5});
      }
    }
  }

  add(name, attributes) {
    const element = document.createElementNS(kSpace, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return this.svg.appendChild(element);
  }

  drawAxes(camera) {
    const g = this.axes, right = camera.right, up = cross(right, camera.forward), forward = camera.forward;
    g.clearRect(0, 0, 144, 144);
    const axes = [['X', [1, 0, 0], '#ef7277'], ['Y', [0, 1, 0], '#7ccf7a'], ['Z', [0, 0, 1], '#6ea8f5']]
      .map(([name, axis, colour]) => ({name, colour, x: 72 + 48 * dot(axis, right), y: 72 - 48 * dot(axis, up), depth: dot(axis, forward)}))
      .sort((a, b) => b.depth - a.depth);
    g.lineWidth = 4;
    g.lineCap = 'round';
    g.font = '600 22px system-ui, "DejaVu Sans", sans-serif';
    g.textAlign = 'center';
    g.textBaseline = 'middle';
    for (const {name, colour, x, y, depth} of axes) {
      g.globalAlpha = depth > 0.2 ? 0.55 : 1;
      g.strokeStyle = g.fillStyle = colour;
      g.beginPath();
      g.moveTo(72, 72);
      g.lineTo(x, y);
      g.stroke();
      g.beginPath();
      g.arc(x, y, 14, 0, 7);
      g.fill();
      g.fillStyle = '#14181e';
      g.fillText(name, x, y + 1);
    }
    g.globalAlpha = 1;
  }
}

const clip = (value) => Math.max(-1e5, Math.min(1e5, value)).toFixed(1);
