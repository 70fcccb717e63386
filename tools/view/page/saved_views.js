// Saved views: bookmarks, which the browser keeps, and the keys of a camera path.
import {$, fill, saveFile, store, stored, toast} from './elements.js';
import {kFarthest} from './camera.js';
import {distance} from './vector.js';

const isNumbers = (v, count) => Array.isArray(v) && v.length === count && v.every((value) => typeof value === 'number' && Math.abs(value) <= kFarthest);
const isWithin = (value, low, high) => typeof value === 'number' && value >= low && value < high;
const isPose = (pose) => pose && ['eye', 'target', 'up'].every((name) => isNumbers(pose[name], 3)) && isWithin(pose.fov, 1e-9, 180) && distance(pose.eye, pose.target) > 0;

function need(isRight, reason) {
  if (!isRight) throw new Error(reason);
}
/// The first member of `object` that is not one of `names`.
const unknownMember = (object, names) => Object.keys(object).find((name) => !names.includes(name));

/// Reads a path file: {name, fps, keys}, where name and fps are undefined if the file has none, and a key is
/// {t, eye, target, up, fov}.
/// Accepts what tools/render/camera_path.cpp accepts, if its keys have times. Throws an error with a short reason.
function readPath(text) {
  let path;
  try { path = JSON.parse(text); } catch { need(false, 'it is not JSON'); }
  need(path?.format === 'scree camera path', 'its format is not “scree camera path”');
  need(path.version === 1, 'its version is not 1');
  const unknown = unknownMember(path, ['format', 'version', 'fps', 'keys', 'name']);
  need(unknown === undefined, `it has an unknown member “${unknown}”`);
  need(path.fps === undefined || isWithin(path.fps, 1e-9, 1e6), 'its fps are not above 0 and below 1e6');
  need(Array.isArray(path.keys) && path.keys.length > 0, 'it has no keys');
  const keys = path.keys.map((key, i) => {
    try { return readKey(key); } catch ({message}) { throw new Error(`key ${i} ${message}`); }
  });
  const early = keys.findIndex((key, i) => i > 0 && key.t <= keys[i - 1].t);
  need(early < 0, `key ${early} is not later than the key before`);
  need(keys.at(-1).t * (path.fps ?? 30) < 1e7, 'it has more than 10000000 frames');
  return {name: path.name, fps: path.fps, keys};
}
function readKey(key) {
  need(key && typeof key === 'object' && !Array.isArray(key), 'is not an object');
  const unknown = unknownMember(key, ['t', 'eye', 'target', 'up', 'fov', 'matrix', 'name']);
  need(unknown === undefined, `has an unknown member “${unknown}”`);
  need(isWithin(key.t, 0, 1e9), key.t === undefined ? 'has no t' : 't is not from 0 to 1e9');
  const {matrix: m, up = [0, 1, 0], fov = 45, ...others} = key;
  need(isWithin(fov, 1e-9, 180), 'fov is not above 0 and below 180');
  if (m === undefined) {
    for (const [name, value] of [['eye', key.eye], ['target', key.target], ['up', up]]) need(isNumbers(value, 3), `${name} is not 3 numbers of at most 1e15`);
    return {...others, up, fov};
  }
  need(isNumbers(m, 16), 'matrix is not 16 numbers of at most 1e15');
  need(!['eye', 'target', 'up'].some((name) => name in key), 'has both matrix and eye, target or up');
  need(m[3] === 0 && m[7] === 0 && m[11] === 0 && m[15] === 1, 'matrix does not end with the row 0 0 0 1');
  const reach = Math.hypot(m[8], m[9], m[10]), eye = m.slice(12, 15);
  need(reach > 0, 'matrix has no direction');
  return {...others, eye, target: eye.map((value, axis) => value - m[8 + axis] / reach), up: m.slice(4, 7), fov};
}

export class Bookmarks {
  /// `page`: {pose(), go(pose)}.
  constructor(page) {
    this.page = page;
    this.all = [];
    this.at = -1;
    addEventListener('storage', ({key}) => { if (key === this.key) this.read(key); });  // another tab has changed the list
  }

  /// `key`: names the scene in the browser's storage.
  read(key) {
    this.key = key;
    this.at = -1;
    try { this.all = JSON.parse(stored(key) ?? '[]').filter(isPose); } catch { this.all = []; }
    this.show();
  }
  show() {
    fill($('bookmarks'), this.all.map((bookmark, i) => ({
      text: bookmark.name, pressed: i === this.at, click: () => this.go(i),
      remove: () => this.remove(i),
    })), 'none yet: B adds this view');
  }
  add() {
    const number = 1 + Math.max(0, ...this.all.map((bookmark) => Number(/\d+$/.exec(bookmark.name)?.[0] ?? 0)));
    this.at = this.all.push({name: `View ${number}`, ...this.page.pose()}) - 1;
    this.show();
    const isKept = this.keep();
    toast(`Bookmark “View ${number}”${isKept ? '' : '; the browser does not store it, so it is lost when the page is closed'}`, !isKept);
  }
  remove(i) {
    this.all.splice(i, 1);
    this.at = -1;
    this.show();
    this.keep();
  }
  /// Returns false if the browser does not store the list.
  keep() { return store(this.key, JSON.stringify(this.all)); }
  go(i) {
    if (this.all.length === 0) return toast('No bookmarks yet: B adds this view.');
    this.at = (i + this.all.length) % this.all.length;
    this.page.go(this.all[this.at]);
    this.show();
  }
}

export class KeyPath {
  /// `page`: {pose(), go(pose)}.
  constructor(page) {
    this.page = page;
    this.name = this.fps = undefined;  // of the file that was loaded
    this.keys = [];
    $('path-file').addEventListener('change', ({target}) => this.load(target));
    this.show();
  }

  show() {
    fill($('keys'), this.keys.map((key, i) => ({
      text: `${key.t.toFixed(1)} s`, click: () => this.page.go(key), remove: () => this.remove(i),
    })), 'none yet: K adds this view');
    $('play').disabled = this.keys.length < 2;
  }
  add() {
    const seconds = Math.max(0.1, Number($('key-seconds').value) || 2);
    this.keys.push({t: this.keys.length ? this.keys.at(-1).t + seconds : 0, ...this.page.pose()});
    this.show();
    toast(`Key ${this.keys.length} of the path`);
  }
  /// The first key that is left begins the path.
  remove(i) {
    if (this.keys.length === 1) return this.clear();
    this.keys.splice(i, 1);
    const [first] = this.keys;
    this.keys = this.keys.map((key) => ({...key, t: key.t - first.t}));
    this.show();
  }
  clear() {
    this.name = this.fps = undefined;
    this.keys = [];
    this.show();
  }
  save(fileName) {
    if (this.keys.length === 0) return toast('The path has no keys.');
    const {name, fps, keys} = this;
    saveFile(new Blob([JSON.stringify({format: 'scree camera path', version: 1, name, fps, keys}, null, 1)], {type: 'application/json'}), fileName);
  }
  async load(input) {
    try {
      need(input.files[0].size <= 16 << 20, 'it has more than 16 MiB');
      Object.assign(this, readPath(await input.files[0].text()));
      this.show();
    } catch ({message}) {
      toast(`This file holds no path of scree view: ${message}.`, true);
    }
    input.value = '';
  }
}
