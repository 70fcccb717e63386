// The scene's nodes as a list of rows. Only visible rows exist as elements, so 100,000 nodes are as fast as ten.
import {countText} from './stats.js';

const kRow = 24;

export class Tree {
  /// `on`: {changed(hidden, only)}: the page returns whether it accepts these sets.
  constructor(box, search, on) {
    this.box = box;
    this.space = box.querySelector('#tree-space');
    this.rows = box.querySelector('#tree-rows');
    this.search = search;
    this.on = on;
    this.forget();
    box.addEventListener('scroll', () => this.draw());
    search.addEventListener('input', () => this.list());
  }

  /// To be called when the scene is another one.
  forget() {
    this.names = [];
    this.roots = [];
    this.hidden = new Set();
    this.only = new Set();
    this.open = new Set();
    this.picked = -1;
    this.list();
  }

  get isLoaded() { return this.names.length > 0; }

  load({names, parents, triangles}) {
    this.names = names;
    this.parents = parents.map((parent) => parent - 1);
    this.triangles = [...triangles];
    this.children = names.map(() => []);
    this.roots = [];
    this.parents.forEach((parent, node) => (parent < 0 ? this.roots : this.children[parent]).push(node));
    for (let node = names.length - 1; node >= 0; --node)  // parents come before their children
      if (this.parents[node] >= 0) this.triangles[this.parents[node]] += this.triangles[node];
    if (names.length <= 40) names.forEach((name, node) => this.open.add(node));
    this.roots.forEach((root) => this.open.add(root));
    this.list();
  }

  name(node) { return this.names[node] || `node ${node}`; }

  /// Finds the nodes that have a row, and their depths.
  list() {
    const words = this.search.value.trim().toLowerCase();
    this.listed = [];
    if (words) {
      for (let node = 0; node < this.names.length; ++node)
        if (this.name(node).toLowerCase().includes(words)) this.listed.push([node, 0]);
    } else {
      const stack = this.roots.map((root) => [root, 0]).reverse();
      while (stack.length > 0) {
        const [node, depth] = stack.pop();
        this.listed.push([node, depth]);
        if (this.open.has(node)) for (let i = this.children[node].length - 1; i >= 0; --i) stack.push([this.children[node][i], depth + 1]);
      }
    }
    this.space.style.height = `${this.listed.length * kRow}px`;
    this.draw();
  }

  /// Whether the node or an ancestor is hidden, or other nodes are shown alone.
  isOff(node) {
    let only = this.only.size === 0;
    for (let n = node; n >= 0; n = this.parents[n]) {
      if (this.hidden.has(n)) return true;
      only ||= this.only.has(n);
    }
    return !only;
  }

  draw() {
    const first = Math.max(0, Math.floor(this.box.scrollTop / kRow) - 4);
    const count = Math.ceil(this.box.clientHeight / kRow) + 8;
    this.rows.style.transform = `translateY(${first * kRow}px)`;
    this.rows.replaceChildren(...this.listed.slice(first, first + count).map(([node, depth]) => this.row(node, depth)));
  }

  row(node, depth) {
    const row = document.createElement('div');
    row.className = `node${this.isOff(node) ? ' off' : ''}${node === this.picked ? ' picked' : ''}`;
    row.style.paddingLeft = `${6 + 12 * Math.min(depth, 10)}px`;
    row.setAttribute('role', 'treeitem');
    const part = (tag, name, text, title, click) => {
      const element = document.createElement(tag);
      element.className = name;
      element.textContent = text;
      if (title) element.title = title;
      if (click) element.addEventListener('click', (event) => { event.stopPropagation(); click(event); });
      row.append(element);
    };
    const hasChildren = this.children[node].length > 0 && !this.search.value.trim();
    part('span', 'fold', hasChildren ? (this.open.has(node) ? '▾' : '▸') : '', '', () => this.fold(node));
    part('span', 'name', this.name(node), this.name(node));
    part('span', 'size', this.triangles[node] ? countText(this.triangles[node]) : '', `${this.triangles[node]} triangle${this.triangles[node] === 1 ? '' : 's'}`);
    part('button', 'only', '◎', 'Show this alone', () => this.isolate(node));
    part('button', 'eye', this.hidden.has(node) ? '○' : '●', this.hidden.has(node) ? 'Show' : 'Hide', () => this.toggle(node));
    return row;
  }

  fold(node) {
    if (!this.open.delete(node)) this.open.add(node);
    this.list();
  }
  toggle(node) {
    const hidden = new Set(this.hidden);
    if (!hidden.delete(node)) hidden.add(node);
    this.change(hidden, this.only);
  }
  isolate(node) {
    const isAlone = this.only.size === 1 && this.only.has(node), hidden = new Set(this.hidden);
    if (!isAlone) hidden.delete(node);
    this.change(hidden, new Set(isAlone ? [] : [node]));
  }
  showAll() { this.change(new Set(), new Set()); }
  change(hidden, only) {
    if (!this.on.changed([...hidden], [...only])) return;
    Object.assign(this, {hidden, only});
    this.draw();
  }

  /// Opens the node's ancestors and scrolls to it.
  reveal(node) {
    this.picked = node;
    if (!this.isLoaded || node >= this.names.length) return;
    for (let n = this.parents[node]; n >= 0; n = this.parents[n]) this.open.add(n);
    this.list();
    const place = this.listed.findIndex(([other]) => other === node) * kRow;
    if (place < this.box.scrollTop || place > this.box.scrollTop + this.box.clientHeight - kRow)
      this.box.scrollTop = place - this.box.clientHeight / 2;
    this.draw();
  }
}
