// Saved views: bookmarks, which the browser keeps, and the keys of a camera path.
import {$, fill, saveFile, toast} from './elements.js';
import {distance} from './vector.js';

const isVector = (v) => Array.isArray(v) && v.length === 3 && v.every(Number.isFinite);
const isPose = (pose) => pose && isVector(pose.eye) && isVector(pose.target) && isVector(pose.up) && pose.fov > 0 && pose.fov < 180 && distance(pose.eye, pose.target) > 0;

export class Bookmarks {
  /// `page`: {pose(), go(pose)}.
  constructor(page) {
    this.page = page;
    this.all = [];
    this.at = -1;
  }

  /// `key`: names the scene in the browser's storage.
  read(key) {
    this.key = key;
    try { this.all = JSON.parse(localStorage.getItem(key) ?? '[]').filter(isPose); } catch { this.all = []; }
    this.show();
  }
  show() {
    localStorage.setItem(this.key, JSON.stringify(this.all));
    fill($('bookmarks'), this.all.map((bookmark, i) => ({
      text: bookmark.name, pressed: i === this.at, click: () => this.go(i),
      remove: () => { this.all.splice(i, 1); this.at = -1; this.show(); },
    })), 'none yet: B adds this view');
  }
  add() {
    const number = 1 + Math.max(0, ...this.all.map((bookmark) => Number(/\d+$/.exec(bookmark.name)?.[0] ?? 0)));
    this.at = this.all.push({name: `View ${number}`, ...this.page.pose()}) - 1;
    this.show();
    toast(`Bookmark “View ${number}”`);
  }
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
    this.keys.splice(i, 1);
    const [first] = this.keys;
    this.keys = this.keys.map((key) => ({...key, t: key.t - first.t}));
    this.show();
  }
  clear() {
    this.keys = [];
    this.show();
  }
  save(name) {
    if (this.keys.length === 0) return toast('The path has no keys.');
    saveFile(new Blob([JSON.stringify({format: 'scree camera path', version: 1, keys: this.keys}, null, 1)], {type: 'application/json'}), name);
  }
  async load(input) {
    try {
      const read = JSON.parse(await input.files[0].text());
      if (read.format !== 'scree camera path' || !read.keys.every((key) => isPose(key) && Number.isFinite(key.t) && key.t >= 0)) throw new Error();
      this.keys = read.keys.sort((a, b) => a.t - b.t);
      this.show();
    } catch {
      toast('This file holds no path of scree view.', true);
    }
    input.value = '';
  }
}
