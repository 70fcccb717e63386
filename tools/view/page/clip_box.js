// The clipping box: its inputs in the panel, and its sides, which can be dragged in the picture.
import {clamped, kFarthest} from './camera.js';
import {$, element} from './elements.js';

export class ClipBox {
  /// `page`: {changed(time), refresh(), whole(), place(point), step(), text(coordinate)}: the view has changed by a drag
  /// or at once; the scene's box; a point's place on the stage in CSS pixels; a short length that shows there; a number.
  constructor(overlay, page) {
    this.overlay = overlay;
    this.page = page;
    this.on = false;
    this.box = [-1, -1, -1, 1, 1, 1];  // smallest, then largest coordinates
    this.inputs = [0, 1, 2, 3, 4, 5].map((side) => this.addInputs(side));
    overlay.grab = (side, down) => this.drag(side, down);
  }

  addInputs(side) {
    const row = element('label', ''), name = element('span', `${'XYZ'[side % 3]} ${side < 3 ? 'from' : 'to'}`);
    const slider = element('input', ''), number = element('input', '');
    row.className = 'row';
    Object.assign(slider, {type: 'range', min: 0, max: 1000, step: 1});
    Object.assign(number, {type: 'number', step: 'any'});
    slider.setAttribute('aria-label', name.textContent);
    number.setAttribute('aria-label', `${name.textContent}, number`);
    slider.addEventListener('input', () => {
      const whole = this.page.whole(), axis = side % 3;
      this.moveSide(side, whole[axis] + slider.value / 1000 * (whole[axis + 3] - whole[axis]));
    });
    number.addEventListener('change', () => this.moveSide(side, number.valueAsNumber));
    row.append(name, slider, number);
    $('clip-sides').append(row);
    return {slider, number};
  }

  show() {
    this.overlay.clip = this.on ? this.box : null;
    $('clip').checked = this.on;
    const whole = this.page.whole();
    this.inputs.forEach(({slider, number}, side) => {
      const axis = side % 3;
      slider.value = 1000 * (this.box[side] - whole[axis]) / (whole[axis + 3] - whole[axis]);
      number.value = this.page.text(this.box[side]);
    });
  }

  set(on, box = this.box) {
    this.on = on;
    this.box = [...box];
    this.show();
    this.page.refresh();
  }

  /// Moves a side, 0 to 5, at most to the opposite side. `time`: of the input event.
  moveSide(side, value, time) {
    if (Number.isFinite(value)) {
      const opposite = this.box[(side + 3) % 6];
      this.box[side] = side < 3 ? clamped(value, -kFarthest, opposite) : clamped(value, opposite, kFarthest);
      this.on = true;
    }
    this.show();
    this.page.changed(time);
  }

  drag(side, down) {
    down.stopPropagation();
    down.preventDefault();
    const at = this.overlay.sideAt(side), start = this.box[side], axis = side % 3, step = this.page.step();
    const [x, y] = this.page.place(at), [stepX, stepY] = this.page.place(at.map((value, k) => value + (k === axis ? step : 0)));
    const along = [(stepX - x) / step, (stepY - y) / step], squared = along[0] ** 2 + along[1] ** 2;
    const move = (event) => {
      if (event.pointerId !== down.pointerId) return;
      const moved = (event.clientX - down.clientX) * along[0] + (event.clientY - down.clientY) * along[1];
      if (squared > 1e-12) this.moveSide(side, start + moved / squared, event.timeStamp);
    };
    const end = (event) => {
      if (event.pointerId !== down.pointerId) return;
      removeEventListener('pointermove', move);
      removeEventListener('pointerup', end);
      removeEventListener('pointercancel', end);
    };
    addEventListener('pointermove', move);
    addEventListener('pointerup', end);
    addEventListener('pointercancel', end);
  }
}
