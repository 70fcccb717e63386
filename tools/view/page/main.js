// The page. It has the camera and the settings; pictures come from the server (worker.js).
import {alongPath, between, Camera} from './camera.js';
import {Controls} from './controls.js';
import {lengthText, Overlay} from './overlay.js';
import {bytesText, countText, Stats} from './stats.js';
import {Tree} from './tree.js';
import {add, distance, dot, mix, scale, sub} from './vector.js';

const $ = (id) => document.getElementById(id);
const kSendMs = 8;      // least time between two views sent
const kProbeMs = 40;    // between two requests for the point under the cursor
const kRestMs = 70;     // time without a change after which the camera is at rest
const kEaseMs = 450;
const kMostPixels = 1 << 25;

const camera = new Camera();
const stage = $('stage');
const overlay = new Overlay($('marks'), $('axes'));
const stats = new Stats($('stats'));
const worker = new Worker('worker.js');
const reduced = matchMedia('(prefers-reduced-motion: reduce)').matches;

let scene = null;        // the server's "scene" message
let size = {width: 0, height: 0};  // of the picture, device pixels
let sequence = 0;
let sentAt = new Map();  // by number of a view: time of its input event
let viewTimer = 0, restTimer = 0, lastSent = 0, inputTime = null, isMoving = false, isConnected = false;
let cursor = null;       // {x, y} CSS pixels
let hover = null;        // {x, y, point}: the newest point under the cursor from the server
let depth = 1;           // along the view, of the last known point; used if the cursor is on the background
let animation = null;    // {from, to, start, ms} or {keys, start}
let picks = [];          // the last two
let pickId = 0, shotId = 0, you = 0, following = 0;
let playing = false;
let clip = {on: false, box: [-1, -1, -1, 1, 1, 1]};  // the clipping box: smallest, then largest coordinates

const settings = {show: 'texture', light: true, shadows: false, ssao: false, edl: false, edlStrength: 1, edlRadius: 1, samples: 4, background: '#20252d', full: false};
const shows = [...$('show').options].map((option) => option.value);

// --- Messages ---

const send = (message) => worker.postMessage({type: 'send', message});

function viewMessage() {
  return {type: 'view', seq: sequence, ...camera.pose(), width: size.width, height: size.height, ...settings, ...(clip.on ? {clip: clip.box} : {}), moving: isMoving, ...cursorPixel()};
}
function cursorPixel(at = cursor) {
  if (!at) return {};
  const x = Math.floor(at.x * size.width / stage.clientWidth), y = Math.floor(at.y * size.height / stage.clientHeight);
  return x >= 0 && y >= 0 && x < size.width && y < size.height ? {x, y} : {};
}

/// To be called when the view has changed. `time`: of the input event. `keepsHover`: the point under the cursor is the
/// same.
function changed(time, keepsHover = false) {
  if (!keepsHover) hover = null;
  inputTime ??= time === undefined ? performance.now() : time;
  drawOverlay();
  isMoving = true;
  clearTimeout(restTimer);
  restTimer = setTimeout(rest, kRestMs);
  if (viewTimer === 0) {
    const wait = kSendMs - (performance.now() - lastSent);
    if (wait <= 0) sendView();
    else viewTimer = setTimeout(() => { viewTimer = 0; sendView(); }, wait);
  }
}
function sendView() {
  if (!isConnected || !scene || size.width === 0) return;
  lastSent = performance.now();
  ++sequence;
  if (inputTime !== null) sentAt.set(sequence, inputTime + performance.timeOrigin);
  if (sentAt.size > 200) sentAt.delete(sentAt.keys().next().value);
  inputTime = null;
  document.documentElement.dataset.exact = exactSamples = 0;
  send(viewMessage());
}
function rest() {
  if (controls.isBusy && controls.pointers.size === 0) { restTimer = setTimeout(rest, kRestMs); return; }
  isMoving = false;
  clearTimeout(viewTimer);
  viewTimer = 0;
  inputTime = null;
  sendView();
  writeAddress();
}
/// To be called when something other than the camera has changed.
function refresh() {
  clearTimeout(restTimer);
  rest();
}

worker.onmessage = ({data}) => {
  switch (data.type) {
    case 'text': return heard(data.message);
    case 'frame': return shown(data);
    case 'state': return setState(data);
    case 'screenshot': return saveFile(new Blob([data.bytes], {type: 'image/png'}), `${baseName()}.png`);
    case 'trouble': return toast(data.message, true);
    case 'pixels': return pixelReaders.splice(0).forEach((resolve) => resolve(data));
  }
};

function heard(message) {
  switch (message.type) {
    case 'scene': return opened(message);
    case 'loading': return cover('Loading the scene', message.file);
    case 'error': return toast(message.message, true);
    case 'point':
      showPlace(message.point);
      if (message.point) controls.found(message.point);
      if (probeSequence !== sequence) return;  // the view has changed since
      hover = message.point ? {x: (message.x + 0.5) * stage.clientWidth / size.width, y: (message.y + 0.5) * stage.clientHeight / size.height, point: message.point} : null;
      return seen(message.point);
    case 'pick': return picked(message);
    case 'nodes': return loadTree(message);
    case 'viewers': return setViewers(message);
    case 'camera':
      if (message.viewer !== following) return;
      animation = null;
      camera.set(message);
      return changed();
  }
}

let exactSamples = 0;  // samples per side of the picture on the screen; 0: it is not exact, or shows an older view
function shown({head, bytes, decodeMs, shown: time}) {
  const input = sentAt.get(head.seq);
  for (const key of sentAt.keys()) if (key <= head.seq) sentAt.delete(key);
  stats.note({head, bytes, decodeMs, latency: input === undefined ? undefined : time - input, shown: time});
  if (head.point) {
    if (head.seq === sequence && cursor) hover = {...cursor, point: head.point};
    seen(head.point);
    showPlace(head.point);
  }
  const badge = $('exact');
  badge.className = head.exact ? 'badge exact' : 'badge';
  const hides = tree.hidden.size + tree.only.size > 0;
  badge.textContent = head.exact ? (head.samples > 1 ? `exact, ${head.samples}×${head.samples} samples` : 'exact') + (hides ? ', nodes hidden' : '')
    : head.leftBytes ? `loading, ${bytesText(head.leftBytes)} to come`
    : head.scale < 1 ? `moving, ${Math.round(100 * head.scale)}%` : 'moving';
  if ($('cover').className !== 'gone') uncover();
  document.documentElement.dataset.frame = head.frame;  // used by tests
  exactSamples = head.exact && head.seq === sequence ? head.samples : 0;
  document.documentElement.dataset.exact = exactSamples;
}

function seen(point) {
  const along = point ? dot(sub(point, camera.eye), camera.forward) : 0;
  if (along > 0) depth = along;
}
function showPlace(point) {
  $('place').textContent = point ? point.map((value) => lengthText(value)).join('  ') : '';
}

// --- Connecting ---

const storageKey = `scree-token:${location.pathname}`;
const kStates = {
  unreachable: ['No server', 'Is scree view still running, and is the tunnel open? The page tries again by itself.'],
  lost: ['Disconnected', 'The connection broke. The page tries again by itself.'],
  ended: ['The server has ended', 'Start scree view again with the same port; the page asks for the new address.'],
  slow: ['Disconnected', 'The connection was too slow for the pictures. The page tries again by itself.'],
  busy: ['Disconnected', 'This page sent too many messages. It tries again by itself.'],
  refused: ['Disconnected', 'The server did not understand this page; reload it.'],
  full: ['The server is full', 'The server has as many viewers as it allows (--viewers).'],
};

function setState({state, reason}) {
  isConnected = state === 'open';
  document.documentElement.dataset.state = reason ?? state;
  if (state === 'connecting') {
    isConnected = true;  // the worker sends nothing before the socket is open
    if (!scene) cover('Connecting', location.host);
    return;
  }
  if (reason === 'token') return askForToken('This address has no valid token', 'Open the address that scree view printed, or paste it here.');
  const [title, text] = kStates[reason];
  cover(title, text, {spin: reason !== 'full' && reason !== 'refused', button: true});
}
function askForToken(title, text) {
  cover(title, text, {spin: false, form: true});
  $('token-input').focus();
}
function cover(title, text, {spin = true, form = false, button = false} = {}) {
  $('cover-title').textContent = title;
  $('cover-text').textContent = text;
  $('spinner').hidden = !spin;
  $('token-form').hidden = !form;
  $('cover-button').hidden = !button;
  $('cover').className = '';
}
const uncover = () => { $('cover').className = 'gone'; };

function connect(token) {
  localStorage.setItem(storageKey, token);
  worker.postMessage({type: 'connect', token});
}
$('token-form').addEventListener('submit', (event) => {
  event.preventDefault();
  const token = /[0-9a-f]{32}/.exec($('token-input').value)?.[0];
  if (token) connect(token);
  else toast('There is no token in this text.', true);
});
$('cover-button').addEventListener('click', () => connect(localStorage.getItem(storageKey) ?? ''));

function opened(message) {
  const isFirst = !scene || scene.file !== message.file;
  scene = message;
  $('scene-name').textContent = scene.name;
  $('scene-facts').textContent = `${countText(scene.triangles)} triangles in ${countText(scene.instances)} instances, on ${scene.drawnOn}`;
  document.title = `${scene.name} – scree view`;
  camera.size = scene.boxMin ? Math.max(distance(scene.boxMin, scene.boxMax), 1e-9) : 1;
  if (isFirst) {
    clip = {on: false, box: wholeBox()};
    settings.shadows = scene.shadows;
    if (!readAddress()) camera.set(homePose());
    settings.shadows &&= scene.canCastShadows;
    fillCameras();
    readBookmarks();
  }
  if (tree.hidden.size || tree.only.size) send({type: 'hide', hidden: [...tree.hidden], only: [...tree.only]});
  if ($('tree-part').open) needTree(true);
  depth = distance(camera.eye, camera.target);
  showSettings();
  showClip();
  drawOverlay();
  refresh();
}

// --- Size ---

new ResizeObserver(([entry]) => {
  const exact = entry.devicePixelContentBoxSize?.[0];
  // The exact size differs from the rounded one by at most a pixel, unless the browser emulates another screen.
  const side = (css, pixels) => Math.abs(pixels - css * devicePixelRatio) <= 1 ? pixels : Math.round(css * devicePixelRatio);
  const width = side(entry.contentRect.width, exact?.inlineSize), height = side(entry.contentRect.height, exact?.blockSize);
  const shrink = Math.min(1, 8192 / Math.max(width, height), Math.sqrt(kMostPixels / (width * height)));
  size = {width: Math.max(1, Math.floor(width * shrink)), height: Math.max(1, Math.floor(height * shrink))};
  drawOverlay();
  clearTimeout(resizeTimer);
  resizeTimer = setTimeout(refresh, sequence === 0 ? 0 : 100);
}).observe(stage);
let resizeTimer = 0;

// --- Moving ---

const aspect = () => stage.clientWidth / stage.clientHeight;

function pointUnder(x, y) {
  if (hover && Math.hypot(hover.x - x, hover.y - y) < 4) return hover.point;
  return camera.pointAt(x / stage.clientWidth, y / stage.clientHeight, aspect(), Math.max(depth, 1e-6 * camera.size));
}

const controls = new Controls(stage, {
  camera,
  begin() {
    stopAnimation();
    if (following) follow(0);
  },
  changed,
  ended() { clearTimeout(restTimer); restTimer = setTimeout(rest, 20); },
  pointUnder,
  probe,
  pivot(point) { overlay.pivot = point; drawOverlay(); },
  hover(x, y) {
    cursor = {x, y};
    probe(x, y);
  },
  click(x, y, event) { pick(x, y, event.shiftKey); },
  doubleClick(x, y) {
    wantsGo = {x, y};
    pick(x, y, false);
  },
  speed(speed) { toast(`Speed × ${lengthText(speed)}`); },
});

let probeTimer = 0, lastProbe = 0, probeSequence = 0;
function probe(x, y) {
  cursor = {x, y};
  if (probeTimer !== 0) return;
  const wait = Math.max(0, kProbeMs - (performance.now() - lastProbe));
  probeTimer = setTimeout(() => {
    probeTimer = 0;
    lastProbe = performance.now();
    const at = cursorPixel();
    probeSequence = sequence;
    if (isConnected && scene && at.x !== undefined) send({type: 'probe', ...at});
  }, wait);
}

function ease(to, ms = kEaseMs) {
  stopAnimation();
  animation = {from: camera.pose(), to, start: performance.now(), ms: reduced ? 0 : ms};
  requestAnimationFrame(animate);
}
function stopAnimation() {
  animation = null;
  if (playing) setPlaying(false);
}
function animate(time) {
  if (!animation) return;
  if (animation.keys) {
    const seconds = (time - animation.start) / 1000;
    camera.set(alongPath(animation.keys, seconds));
    if (seconds >= animation.keys.at(-1).t) stopAnimation();
  } else {
    const t = animation.ms > 0 ? Math.min(1, Math.max(0, (time - animation.start) / animation.ms)) : 1;
    camera.set(t === 1 ? animation.to : between(animation.from, animation.to, t * t * (3 - 2 * t)));
    if (t === 1) animation = null;
  }
  depth = Math.max(distance(camera.eye, camera.target), 1e-9);
  showFov();
  changed(time);
  if (animation) requestAnimationFrame(animate);
}

/// The panel's share of the picture's width.
function covered() {
  const panel = $('panel').getBoundingClientRect();
  return panel.width > 0 && panel.width < 0.4 * stage.clientWidth ? (stage.clientWidth - panel.left) / stage.clientWidth : 0;
}
const frame = (points, direction) => camera.framing(points, aspect(), covered(), direction && scale(direction, 1 / Math.hypot(...direction)));
/// The eight corners of the scene's box.
function sceneBox() {
  const {boxMin: low = [-1, -1, -1], boxMax: high = [1, 1, 1]} = scene;
  return [...Array(8).keys()].map((k) => [0, 1, 2].map((axis) => (k >> axis & 1 ? high : low)[axis]));
}
const pickedBox = () => picks.at(-1)?.box ?? sceneBox();

function homePose() {
  const isZ = Math.abs(camera.worldUp[2]) === 1;
  return frame(sceneBox(), isZ ? [-0.47, 0.81, -0.34] : sub(scene.home.target, scene.home.eye));
}
function axisPose(axis) {
  const isZ = Math.abs(camera.worldUp[2]) === 1;
  const up = camera.worldUp, front = isZ ? [0, -1, 0] : [0, 0, 1], right = [1, 0, 0];
  const from = {front, back: scale(front, -1), right, left: scale(right, -1), top: up, bottom: scale(up, -1)}[axis];
  const isSteep = axis === 'top' || axis === 'bottom';
  return frame(pickedBox(), isSteep ? add(scale(from, -1), scale(front, -2e-3)) : scale(from, -1));
}

function drawOverlay() { overlay.draw(camera, stage.clientWidth, stage.clientHeight); }

// --- Picking ---

let wantsGo = null;

function pick(x, y, isMeasured) {
  const at = cursorPixel({x, y});
  if (!scene || at.x === undefined) return;
  overlay.isMeasured = isMeasured;
  send({type: 'pick', id: ++pickId, ...at});
}
function picked(message) {
  if (message.id !== pickId) return;
  if (wantsGo) {
    wantsGo = null;
    if (!message.hit) return;
    // Flies half the way to the point, which moves to the middle of the picture.
    const eye = mix(camera.eye, message.point, 0.5);
    return ease({...camera.pose(), eye, target: message.point});
  }
  if (!message.hit) return unpick();
  picks = [...picks, message].slice(-2);
  overlay.picks = picks;
  showPick();
  tree.reveal(message.node);
  drawOverlay();
}
function unpick() {
  picks = [];
  overlay.picks = [];
  tree.picked = -1;
  tree.draw();
  showPick();
  drawOverlay();
}
function showPick() {
  const last = picks.at(-1);
  $('picked').hidden = $('picked-buttons').hidden = !last;
  $('picked-hint').hidden = Boolean(last);
  if (!last) return;
  const named = (number, name) => name ? `${name} (${number})` : `${number}`;
  const box = last.box, side = (k) => distance(box[0], box[1 << k]);
  const rows = [['Node', named(last.node, last.nodeName)], ['Mesh', named(last.mesh, last.meshName)], ['Triangle', `${last.triangle}`],
    ['Material', last.material === undefined ? 'default' : named(last.material, last.materialName)], ['Instance', `${last.instance}`],
    ['Point', last.point.map(lengthText).join(', ')], ['Distance', lengthText(distance(last.point, camera.eye))],
    ['Box', [0, 1, 2].map((k) => lengthText(side(k))).join(' × ')]];
  if (overlay.isMeasured && picks.length === 2) {
    const d = sub(picks[1].point, picks[0].point);
    rows.push(['Measured', lengthText(Math.hypot(...d))], ['Along X, Y, Z', d.map(lengthText).join(', ')]);
  }
  $('picked').replaceChildren(...rows.flatMap(([name, value]) => [element('dt', name), element('dd', value)]));
}

// --- Nodes ---

const tree = new Tree($('tree'), $('tree-search'), {
  changed(hidden, only) {
    if (hidden.length + only.length > 1000) return toast('At most 1000 nodes can be hidden one by one.', true);
    send({type: 'hide', hidden, only});
    $('tree-count').textContent = hidden.length || only.length ? 'some hidden' : treeCount();
    refresh();
  },
});
$('tree').addEventListener('click', (event) => event.target.focus?.());
const treeCount = () => tree.isLoaded ? countText(tree.names.length) : '';
function needTree(again) {
  if (scene && (again || !tree.isLoaded)) send({type: 'nodes'});
}
$('tree-part').addEventListener('toggle', () => { if ($('tree-part').open) needTree(false); });
function loadTree(message) {
  tree.load(message);
  $('tree-count').textContent = treeCount();
  if (message.total > message.names.length) {
    $('tree-hint').hidden = false;
    $('tree-hint').textContent = `The first ${countText(message.names.length)} of ${countText(message.total)} nodes.`;
  }
  if (picks.length > 0) tree.reveal(picks.at(-1).node);
}

// --- Viewers ---

function setViewers({you: number, viewers}) {
  you = number;
  if (following && !viewers.includes(following)) follow(0);
  $('viewers-part').hidden = viewers.length < 2;
  $('viewers-count').textContent = `${viewers.length}`;
  fill($('viewers'), viewers.map((viewer) => ({
    text: viewer === you ? `Viewer ${viewer}, this page` : following === viewer ? `Viewer ${viewer}: following` : `Follow viewer ${viewer}`,
    pressed: following === viewer,
    click: viewer === you ? () => {} : () => follow(following === viewer ? 0 : viewer),
  })));
  lastViewers = {you, viewers};
}
let lastViewers = null;
function follow(viewer) {
  following = viewer;
  send({type: 'follow', viewer});
  if (viewer) toast(`Following viewer ${viewer}; move to stop.`);
  if (lastViewers) setViewers(lastViewers);
}

// --- The clipping box ---

/// The scene's box, enlarged by a thousandth so that surfaces in its faces are inside.
function wholeBox() {
  const {boxMin: low = [-1, -1, -1], boxMax: high = [1, 1, 1]} = scene, more = 1e-3 * camera.size;
  return [...low.map((value) => value - more), ...high.map((value) => value + more)];
}
const clipInputs = [0, 1, 2, 3, 4, 5].map((side) => {
  const row = element('label', ''), name = element('span', `${'XYZ'[side % 3]} ${side < 3 ? 'from' : 'to'}`);
  const slider = element('input', ''), number = element('input', '');
  row.className = 'row';
  Object.assign(slider, {type: 'range', min: 0, max: 1000, step: 1});
  Object.assign(number, {type: 'number', step: 'any'});
  slider.setAttribute('aria-label', name.textContent);
  number.setAttribute('aria-label', `${name.textContent}, number`);
  slider.addEventListener('input', () => {
    const whole = wholeBox(), axis = side % 3;
    moveSide(side, whole[axis] + slider.value / 1000 * (whole[axis + 3] - whole[axis]));
  });
  number.addEventListener('change', () => moveSide(side, number.valueAsNumber));
  row.append(name, slider, number);
  $('clip-sides').append(row);
  return {slider, number};
});
function showClip() {
  overlay.clip = clip.on ? clip.box : null;
  $('clip').checked = clip.on;
  const whole = wholeBox();
  clipInputs.forEach(({slider, number}, side) => {
    const axis = side % 3;
    slider.value = 1000 * (clip.box[side] - whole[axis]) / (whole[axis + 3] - whole[axis]);
    number.value = Number(clip.box[side].toPrecision(6));
  });
}
/// Moves a side, 0 to 5, at most to the opposite side. `time`: as for changed().
function moveSide(side, value, time) {
  if (Number.isFinite(value)) {
    const opposite = clip.box[(side + 3) % 6];
    clip.box[side] = side < 3 ? Math.min(value, opposite) : Math.max(value, opposite);
    clip.on = true;
  }
  showClip();
  changed(time);
}
function setClip(on, box = clip.box) {
  clip = {on, box: [...box]};
  showClip();
  drawOverlay();
  refresh();
}
$('clip').addEventListener('change', (event) => { if (scene) setClip(event.target.checked); });
overlay.grab = (side, down) => {
  down.stopPropagation();
  down.preventDefault();
  const at = overlay.sideAt(side), start = clip.box[side], axis = side % 3;
  const screen = (point) => {
    const {x, y} = camera.project(point, aspect());
    return [x * stage.clientWidth, y * stage.clientHeight];
  };
  const step = 0.01 * Math.max(depth, 1e-3 * camera.size);
  const [x, y] = screen(at), [stepX, stepY] = screen(at.map((value, k) => value + (k === axis ? step : 0)));
  const along = [(stepX - x) / step, (stepY - y) / step], squared = along[0] ** 2 + along[1] ** 2;
  const move = (event) => {
    const moved = (event.clientX - down.clientX) * along[0] + (event.clientY - down.clientY) * along[1];
    if (squared > 1e-12) moveSide(side, start + moved / squared, event.timeStamp);
  };
  const end = () => {
    removeEventListener('pointermove', move);
    removeEventListener('pointerup', end);
    removeEventListener('pointercancel', end);
  };
  addEventListener('pointermove', move);
  addEventListener('pointerup', end);
  addEventListener('pointercancel', end);
};

// --- Settings ---

function showSettings() {
  $('show').value = settings.show;
  for (const name of ['light', 'shadows', 'ssao', 'edl', 'full']) $(name).checked = settings[name];
  $('shadows').disabled = !scene?.canCastShadows;
  $('shadows-hint').textContent = scene?.whyNoShadows ?? '';
  $('shadows-hint').hidden = !scene?.whyNoShadows;
  $('edl-strength').value = settings.edlStrength;
  $('edl-radius').value = settings.edlRadius;
  $('background').value = settings.background;
  $('z-up').checked = Math.abs(camera.worldUp[2]) === 1;
  for (const row of document.querySelectorAll('[data-needs=edl]')) row.hidden = !settings.edl;
  for (const button of $('samples').children) button.setAttribute('aria-checked', String(Number(button.dataset.value) === settings.samples));
  showFov();
}
function showFov() {
  $('fov').value = camera.fov;
  $('fov-text').textContent = `${Math.round(camera.fov)}°`;
}
function set(changes) {
  Object.assign(settings, changes);
  showSettings();
  refresh();
}
$('show').addEventListener('change', (event) => set({show: event.target.value}));
for (const name of ['light', 'shadows', 'ssao', 'edl', 'full']) $(name).addEventListener('change', (event) => set({[name]: event.target.checked}));
$('edl-strength').addEventListener('input', (event) => set({edlStrength: Number(event.target.value)}));
$('edl-radius').addEventListener('input', (event) => set({edlRadius: Number(event.target.value)}));
$('background').addEventListener('input', (event) => set({background: event.target.value}));
$('samples').addEventListener('click', (event) => { if (event.target.dataset.value) set({samples: Number(event.target.dataset.value)}); });
$('fov').addEventListener('input', (event) => { camera.fov = Number(event.target.value); showFov(); changed(event.timeStamp); });
$('z-up').addEventListener('change', (event) => {
  camera.worldUp = event.target.checked ? [0, 0, 1] : [0, 1, 0];
  if (scene) ease(homePose());
});

// --- Saved views: address, command, bookmarks, paths ---

function writeAddress() {
  if (!scene) return;
  const pose = camera.pose(), short = (v) => v.map((value) => Number(value.toPrecision(12))).join(',');
  const parts = [`v=1`, `e=${short(pose.eye)}`, `t=${short(pose.target)}`, `u=${pose.up.join(',')}`, `f=${Number(pose.fov.toPrecision(6))}`, `m=${settings.show}`];
  const flags = ['shadows', 'ssao', 'edl'].filter((name) => settings[name]).concat(settings.light ? [] : ['unlit']);
  if (flags.length) parts.push(`o=${flags.join(',')}`);
  if (clip.on) parts.push(`c=${short(clip.box)}`);
  history.replaceState(null, '', `#${parts.join('&')}`);
}
/// Sets the view of the address. Returns false if there is none.
function readAddress() {
  const hash = firstHash;
  const vector = (name) => {
    const values = (hash.get(name) ?? '').split(',').map(Number);
    return values.length === 3 && values.every(Number.isFinite) ? values : null;
  };
  if (shows.includes(hash.get('m'))) settings.show = hash.get('m');
  const flags = (hash.get('o') ?? '').split(',');
  if (hash.has('v')) settings.shadows = flags.includes('shadows');
  settings.ssao = flags.includes('ssao');
  settings.edl = flags.includes('edl');
  settings.light = !flags.includes('unlit');
  const box = (hash.get('c') ?? '').split(',').map(Number);
  if (box.length === 6 && box.every(Number.isFinite) && [0, 1, 2].every((axis) => box[axis] <= box[axis + 3])) clip = {on: true, box};
  const eye = vector('e'), target = vector('t'), up = vector('u'), fov = Number(hash.get('f'));
  if (!eye || !target || distance(eye, target) === 0) return false;
  camera.set({eye, target, up: up ?? [0, 1, 0], fov: fov > 0.1 && fov < 179 ? fov : 45});
  return true;
}

const quoted = (word) => /^[\w./:=,@%+-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`;
function command() {
  const pose = camera.pose(), vector = (v) => v.map((value) => String(value)).join(',');
  const words = ['scree', 'render', scene.file, '--size', `${size.width}x${size.height}`, `--eye=${vector(pose.eye)}`, `--target=${vector(pose.target)}`,
    `--up=${vector(pose.up)}`, '--fov', String(pose.fov), '--samples', String(exactSamples || settings.samples), '--show', settings.show, '--background', settings.background];
  if (scene.scene) words.push('--scene', scene.scene);
  words.push(...(settings.light ? scene.light : ['--no-light']));
  if (settings.light && settings.shadows) words.push('--shadows', ...(scene.shadowSize ? ['--shadow-size', String(scene.shadowSize)] : []));
  if (settings.ssao) words.push('--ssao');
  if (settings.edl) words.push('--edl', '--edl-strength', String(settings.edlStrength), '--edl-radius', String(settings.edlRadius));
  if (clip.on) words.push(`--clip-box=${vector(clip.box)}`);
  words.push('-o', `${baseName()}.png`);
  return words.map(quoted).join(' ');
}
const baseName = () => scene.name.replace(/\.scree$/, '');

async function copy(text, what) {
  try {
    await navigator.clipboard.writeText(text);
    toast(`${what} copied.`);
  } catch {  // an insecure context has no clipboard
    const area = document.body.appendChild(element('textarea', text));
    area.select();
    toast(document.execCommand('copy') ? `${what} copied.` : text);
    area.remove();
  }
}
function saveFile(blob, name) {
  const link = element('a', '');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  toast(`${name}: ${bytesText(blob.size)}`);
}

let bookmarks = [], bookmarkAt = -1, keys = [];
const bookmarkKey = () => `scree-bookmarks:${scene.file}:${scene.scene}`;
function readBookmarks() {
  try { bookmarks = JSON.parse(localStorage.getItem(bookmarkKey()) ?? '[]').filter(isPose); } catch { bookmarks = []; }
  showBookmarks();
}
const isVector = (v) => Array.isArray(v) && v.length === 3 && v.every(Number.isFinite);
const isPose = (pose) => pose && isVector(pose.eye) && isVector(pose.target) && isVector(pose.up) && pose.fov > 0 && pose.fov < 180 && distance(pose.eye, pose.target) > 0;
function showBookmarks() {
  localStorage.setItem(bookmarkKey(), JSON.stringify(bookmarks));
  fill($('bookmarks'), bookmarks.map((bookmark, i) => ({
    text: bookmark.name, pressed: i === bookmarkAt, click: () => goToBookmark(i),
    remove: () => { bookmarks.splice(i, 1); bookmarkAt = -1; showBookmarks(); },
  })), 'none yet: B adds this view');
}
function addBookmark() {
  const number = 1 + Math.max(0, ...bookmarks.map((bookmark) => Number(/\d+$/.exec(bookmark.name)?.[0] ?? 0)));
  bookmarkAt = bookmarks.push({name: `View ${number}`, ...camera.pose()}) - 1;
  showBookmarks();
  toast(`Bookmark “View ${number}”`);
}
function goToBookmark(i) {
  if (bookmarks.length === 0) return toast('No bookmarks yet: B adds this view.');
  bookmarkAt = (i + bookmarks.length) % bookmarks.length;
  ease(bookmarks[bookmarkAt], 700);
  showBookmarks();
}
function fillCameras() {
  $('cameras-part').hidden = scene.cameras.length === 0;
  fill($('cameras'), scene.cameras.map((named) => ({text: named.name, click: () => ease(named, 700)})));
}

function showKeys() {
  fill($('keys'), keys.map((key, i) => ({
    text: `${key.t.toFixed(1)} s`, click: () => ease(key, 700),
    remove: () => { keys.splice(i, 1); if (keys.length) keys = keys.map((other) => ({...other, t: other.t - keys[0].t})); showKeys(); },
  })), 'none yet: K adds this view');
  $('play').disabled = keys.length < 2;
}
function addKey() {
  const seconds = Math.max(0.1, Number($('key-seconds').value) || 2);
  keys.push({t: keys.length ? keys.at(-1).t + seconds : 0, ...camera.pose()});
  showKeys();
  toast(`Key ${keys.length} of the path`);
}
function setPlaying(on) {
  playing = on;
  $('play').textContent = on ? 'Stop' : 'Play';
}
function play() {
  if (playing) return stopAnimation();
  if (keys.length < 2) return toast('A path needs two keys: K adds this view.');
  stopAnimation();
  animation = {keys, start: performance.now()};
  setPlaying(true);
  requestAnimationFrame(animate);
}
$('path-file').addEventListener('change', async ({target}) => {
  try {
    const read = JSON.parse(await target.files[0].text());
    if (read.format !== 'scree camera path' || !read.keys.every((key) => isPose(key) && Number.isFinite(key.t) && key.t >= 0)) throw new Error();
    keys = read.keys.sort((a, b) => a.t - b.t);
    showKeys();
  } catch {
    toast('This file holds no path of scree view.', true);
  }
  target.value = '';
});

// --- Actions of buttons and keys ---

const actions = {
  home: () => ease(homePose()),
  focus: () => ease(picks.length ? frame(pickedBox()) : homePose()),
  bookmark: addBookmark,
  link: () => { writeAddress(); copy(location.href, 'Link'); },
  command: () => copy(command(), tree.hidden.size + tree.only.size > 0 ? 'Command, which draws the hidden nodes too,' : 'Command'),
  stats: () => toggle('stats', 'stats', () => stats.draw()),
  panel: () => toggle('panel', 'panel'),
  help: () => $('help').open ? $('help').close() : $('help').showModal(),
  axis: (button) => ease(axisPose(button.dataset.axis)),
  unpick,
  'clip-reset': () => setClip(clip.on, wholeBox()),
  hide: () => { if (picks.length) tree.toggle(picks.at(-1).node); },
  isolate: () => { if (picks.length) tree.isolate(picks.at(-1).node); },
  'show-all': () => tree.showAll(),
  key: addKey,
  play,
  'save-path': () => keys.length ? saveFile(new Blob([JSON.stringify({format: 'scree camera path', version: 1, keys}, null, 1)], {type: 'application/json'}), `${baseName()}-path.json`) : toast('The path has no keys.'),
  'load-path': () => $('path-file').click(),
  'clear-path': () => { keys = []; showKeys(); },
  screenshot() {
    const [width, height] = $('shot-size').value === 'view' ? [size.width, size.height] : $('shot-size').value.split('x').map(Number);
    send({type: 'screenshot', id: ++shotId, width, height, samples: Number($('shot-samples').value)});
    toast(`Rendering ${width} × ${height}…`);
  },
};
function toggle(id, action, then) {
  $(id).hidden = !$(id).hidden;
  document.querySelector(`#tools [data-do=${action}]`).setAttribute('aria-pressed', String(!$(id).hidden));
  if (!$(id).hidden) then?.();
}
document.addEventListener('click', (event) => {
  const button = event.target.closest?.('[data-do]');
  if (!button || (!scene && !['help', 'panel', 'stats'].includes(button.dataset.do))) return;
  actions[button.dataset.do](button);
  button.blur();
});

const letters = {KeyH: 'home', KeyF: 'focus', KeyB: 'bookmark', KeyP: 'link', KeyC: 'command', KeyG: 'screenshot', KeyK: 'key', Space: 'play', Backquote: 'stats', Tab: 'panel'};
const axes = {Digit1: ['front', 'back'], Digit3: ['right', 'left'], Digit7: ['top', 'bottom'], Numpad1: ['front', 'back'], Numpad3: ['right', 'left'], Numpad7: ['top', 'bottom']};
addEventListener('keydown', (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || $('help').open) return;
  if (event.target.matches?.('input:not([type=checkbox]):not([type=range]):not([type=color]), select, textarea')) {
    if (event.key === 'Escape') event.target.blur();
    return;
  }
  if (event.key === '?') return take(event, actions.help);
  if (!scene) return;
  if (event.code === 'Tab' && event.shiftKey) return;
  if (!event.repeat && letters[event.code]) return take(event, actions[letters[event.code]]);
  if (axes[event.code]) return take(event, () => ease(axisPose(axes[event.code][event.shiftKey ? 1 : 0])));
  if (event.repeat && !(event.code in {KeyW: 1, KeyA: 1, KeyS: 1, KeyD: 1, KeyQ: 1, KeyE: 1, ArrowUp: 1, ArrowDown: 1, ArrowLeft: 1, ArrowRight: 1})) return;
  switch (event.code) {
    case 'KeyV': return take(event, () => set({show: shows[(shows.indexOf(settings.show) + (event.shiftKey ? shows.length - 1 : 1)) % shows.length]}));
    case 'KeyL': return take(event, () => set({light: !settings.light}));
    case 'KeyO': return take(event, () => set({ssao: !settings.ssao}));
    case 'KeyI': return take(event, () => set({edl: !settings.edl}));
    case 'KeyX': return take(event, () => event.shiftKey ? tree.showAll() : actions.hide());
    case 'BracketLeft': return take(event, () => goToBookmark(bookmarkAt - 1));
    case 'BracketRight': return take(event, () => goToBookmark(bookmarkAt + 1));
    case 'KeyN': return take(event, () => { $('panel').hidden = false; $('tree-part').open = true; $('tree-search').focus(); });
    case 'Escape': return take(event, unpick);
  }
  if (!event.target.matches?.('input, select')) {
    if (controls.key(event)) {
      stopAnimation();
      if (following) follow(0);
      event.preventDefault();
    }
  }
});
function take(event, action) {
  event.preventDefault();
  action();
}

// --- Elements of the page ---

function element(name, text) {
  const made = document.createElement(name);
  made.textContent = text;
  return made;
}
function fill(list, rows, empty = 'none') {
  list.dataset.empty = empty;
  list.replaceChildren(...rows.map(({text, pressed, click, remove}) => {
    const row = element('li', ''), button = element('button', text);
    if (pressed !== undefined) button.setAttribute('aria-pressed', String(pressed));
    button.addEventListener('click', click);
    row.append(button);
    if (remove) {
      const cross = element('button', '×');
      cross.title = 'Remove';
      cross.addEventListener('click', remove);
      row.append(cross);
    }
    return row;
  }));
}
function toast(text, isBad = false) {
  const made = element('div', text);
  made.className = isBad ? 'toast bad' : 'toast';
  $('toasts').append(made);
  while ($('toasts').children.length > 3) $('toasts').firstChild.remove();
  setTimeout(() => made.remove(), isBad ? 6000 : 2200);
}

// --- Start ---

/// For tests, and for scripts in a browser's console.
const pixelReaders = [];
window.scree = {
  camera, settings, set, setClip, clip: () => clip, command, send: (message) => send(message), drop: () => worker.postMessage({type: 'drop'}),
  go(pose) { stopAnimation(); camera.set(pose); showFov(); changed(); },
  latencies: stats.latencies,
  rows: stats.rows,
  pixels: () => new Promise((resolve) => { pixelReaders.push(resolve); worker.postMessage({type: 'read'}); }),
};

const firstHash = new URLSearchParams(location.hash.slice(1));
const token = firstHash.get('token') ?? localStorage.getItem(storageKey);
if (firstHash.has('token')) history.replaceState(null, '', location.pathname);

const place = new URL('ws', location.href);
place.protocol = location.protocol === 'https:' ? 'wss:' : 'ws:';
place.hash = '';
const offscreen = $('picture').transferControlToOffscreen();
worker.postMessage({type: 'start', canvas: offscreen, address: place.href}, [offscreen]);
document.querySelector('#tools [data-do=panel]').setAttribute('aria-pressed', 'true');
if (innerWidth <= 720) actions.panel();
showSettings();
showKeys();
if (token) connect(token);
else askForToken('This address has no token', 'Open the address that scree view printed, or paste it here.');
addEventListener('pagehide', () => worker.terminate());
