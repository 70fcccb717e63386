// The page. It has the camera and the settings; pictures come from the server (worker.js).
import {addressOf, commandOf, kDefaults, readAddress} from './address.js';
import {alongPath, between, Camera, clamped, kFarthest} from './camera.js';
import {ClipBox} from './clip_box.js';
import {Controls} from './controls.js';
import {$, copy, element, fill, saveFile, store, stored, toast} from './elements.js';
import {coordinateText, lengthText, Overlay} from './overlay.js';
import {Bookmarks, KeyPath} from './saved_views.js';
import {bytesText, counted, countText, Stats} from './stats.js';
import {Tree} from './tree.js';
import {add, distance, dot, mix, scale, sub} from './vector.js';

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
const shotSamples = new Map();  // by number of a screenshot: the samples that were chosen
let pickId = 0, shotId = 0, you = 0, following = 0;
let playing = false;

const settings = {...kDefaults};
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

/// The time until the next view may be sent, at most 0 if it may be sent now.
const waitMs = () => kSendMs - (performance.now() - lastSent);

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
    const wait = waitMs();
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
  writeAddressSoon();
}
/// To be called when something other than the camera has changed.
function refresh() {
  clearTimeout(restTimer);
  const wait = waitMs();
  if (wait <= 0) rest();
  else restTimer = setTimeout(rest, wait);
}

worker.onmessage = ({data}) => {
  switch (data.type) {
    case 'text': return heard(data.message);
    case 'frame': return shown(data);
    case 'state': return setState(data);
    case 'screenshot': return saveShot(data);
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
      stopAnimation();
      camera.fly(message);
      showFov();
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
  $('place').textContent = point ? point.map(pointText).join('  ') : '';
}
const pointText = (value) => coordinateText(value, camera.size);

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

let usedToken = '';  // of the newest attempt to connect; the browser keeps it once the server has accepted it

function setState({state, reason, token}) {
  isConnected = state === 'open';
  document.documentElement.dataset.state = reason ?? state;
  if (state === 'connecting') {
    usedToken = token;
    if (!scene) cover('Connecting', location.host);
    return;
  }
  if (isConnected) return void (following = 0);  // the server numbers viewers anew
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

const connect = (token) => worker.postMessage({type: 'connect', token});
$('token-form').addEventListener('submit', (event) => {
  event.preventDefault();
  const token = /[0-9a-f]{32}/.exec($('token-input').value)?.[0];
  if (token) connect(token);
  else toast('There is no token in this text.', true);
});
$('cover-button').addEventListener('click', () => connect(usedToken));

function opened(message) {
  store(storageKey, usedToken);
  const hasOther = (...names) => names.some((name) => scene?.[name] !== message[name]);
  const isFirst = hasOther('file', 'scene'), isOther = isFirst || hasOther('nodes', 'instances', 'triangles');
  scene = message;
  $('scene-name').textContent = scene.name;
  $('scene-facts').textContent = `${counted(scene.triangles, 'triangle')} in ${counted(scene.instances, 'instance')}, on ${scene.drawnOn}`;
  document.title = `${scene.name} – scree view`;
  camera.size = scene.boxMin ? Math.max(distance(scene.boxMin, scene.boxMax), 1e-9) : 1;
  if (isFirst) {
    takeOver();
    Object.assign(clip, {on: false, box: wholeBox()});
    settings.shadows = scene.shadows;
    camera.set(homePose());
    bookmarks.read(`scree-bookmarks:${scene.file}:${scene.scene}`);
  }
  if (isOther) {
    tree.forget();
    $('tree-count').textContent = '';
    unpick();
    fillCameras();
  }
  if (tree.hidden.size || tree.only.size) send({type: 'hide', hidden: [...tree.hidden], only: [...tree.only]});
  goToAddress();
  if ($('tree-part').open) needTree(true);  // the server answers only after a view
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
  begin: takeOver,
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
  doubleClick(x, y) { pick(x, y, false, true); },
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

/// `find`: returns the pose to go to.
function ease(find, ms = kEaseMs) {
  takeOver();
  const to = find();
  animation = {from: camera.pose(), to, start: performance.now(), ms: reduced ? 0 : ms};
  requestAnimationFrame(animate);
}
function stopAnimation() {
  animation = null;
  if (playing) setPlaying(false);
}
/// To be called before the user moves the camera.
function takeOver() {
  stopAnimation();
  if (following) follow(0);
  camera.stand();
}
function animate(time) {
  if (!animation) return;
  if (animation.keys) {
    const seconds = (time - animation.start) / 1000;
    camera.fly(alongPath(animation.keys, seconds));
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

let goId = 0;  // of the newest pick to whose point the camera goes; a pick without a connection is never answered

function pick(x, y, isMeasured, goes = false) {
  const at = cursorPixel({x, y});
  if (!scene || at.x === undefined) return;
  overlay.isMeasured = isMeasured;
  send({type: 'pick', id: ++pickId, ...at});
  if (goes) goId = pickId;
}
function picked(message) {
  if (message.id !== pickId) return;
  if (message.id === goId) {
    if (!message.hit) return;
    // Flies half the way to the point, which moves to the middle of the picture.
    const eye = mix(camera.eye, message.point, 0.5);
    return ease(() => ({...camera.pose(), eye, target: message.point}));
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
    ['Point', last.point.map(pointText).join(', ')], ['Distance', lengthText(distance(last.point, camera.eye))],
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
    if (hidden.length > 1000) return toast('At most 1000 nodes can be hidden one by one.', true);
    send({type: 'hide', hidden, only});
    $('tree-count').textContent = hidden.length || only.length ? 'some hidden' : treeCount();
    refresh();
    return true;
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
  $('tree-hint').hidden = message.total <= message.names.length;
  $('tree-hint').textContent = `The first ${countText(message.names.length)} of ${countText(message.total)} nodes.`;
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
  return [...low.map((value) => value - more), ...high.map((value) => value + more)].map((value) => clamped(value, -kFarthest, kFarthest));
}
const clip = new ClipBox(overlay, {
  changed,
  refresh() { drawOverlay(); refresh(); },
  whole: wholeBox,
  place(point) {
    const {x, y} = camera.project(point, aspect());
    return [x * stage.clientWidth, y * stage.clientHeight];
  },
  step: () => 0.01 * Math.max(depth, 1e-3 * camera.size),
  text: pointText,
});
$('clip').addEventListener('change', (event) => { if (scene) clip.set(event.target.checked); });

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
$('fov').addEventListener('input', (event) => { takeOver(); camera.fov = Number(event.target.value); showFov(); changed(event.timeStamp); });
$('z-up').addEventListener('change', (event) => {
  takeOver();
  camera.worldUp = event.target.checked ? [0, 0, 1] : [0, 1, 0];
  if (scene) ease(homePose);
});

// --- Saved views: address, command, bookmarks, paths ---

// Browsers refuse changes of the address that come too often: Safari more than 100 in 30 s.
const kAddressMs = 350;
let addressTimer = 0, addressTime = -Infinity;
function writeAddress() {
  clearTimeout(addressTimer);
  addressTime = performance.now();
  if (scene) history.replaceState(null, '', `#${addressOf(camera.pose(), settings, clip)}`);
}
function writeAddressSoon() {
  clearTimeout(addressTimer);
  addressTimer = setTimeout(writeAddress, Math.max(0, addressTime + kAddressMs - performance.now()));
}
/// Sets the view of the newest address, once, and shows the camera and all settings.
function goToAddress() {
  if (['v', 'e', 'm', 'o', 'c'].some((letter) => hash.has(letter))) {
    takeOver();
    const view = readAddress(hash, shows);
    Object.assign(settings, view.settings);
    Object.assign(clip, view.box ? {on: true, box: view.box} : {on: false});
    if (view.pose) camera.set(view.pose);
  }
  hash = new URLSearchParams();
  settings.shadows &&= scene.canCastShadows;
  depth = distance(camera.eye, camera.target);
  showSettings();
  clip.show();
  drawOverlay();
  refresh();
}
const command = () => commandOf(scene, size, camera.pose(), exactSamples || settings.samples, settings, clip, `${baseName()}.png`);
const baseName = () => scene.name.replace(/\.scree$/, '');

const poses = {pose: () => camera.pose(), go: (pose) => ease(() => pose, 700)};
const bookmarks = new Bookmarks(poses), path = new KeyPath(poses);
function fillCameras() {
  $('cameras-part').hidden = scene.cameras.length === 0;
  fill($('cameras'), scene.cameras.map((named) => ({text: named.name, click: () => poses.go(named)})));
}

function setPlaying(on) {
  playing = on;
  $('play').textContent = on ? 'Stop' : 'Play';
}
function play() {
  if (playing) return stopAnimation();
  if (path.keys.length < 2) return toast('A path needs two keys: K adds this view.');
  takeOver();
  animation = {keys: path.keys, start: performance.now()};
  setPlaying(true);
  requestAnimationFrame(animate);
}

// --- Actions of buttons and keys ---

const actions = {
  home: () => ease(homePose),
  focus: () => ease(() => picks.length ? frame(pickedBox()) : homePose()),
  bookmark: () => bookmarks.add(),
  link: () => { writeAddress(); copy(location.href, 'Link'); },
  command: () => copyCommand(command()),
  stats: () => toggle('stats', 'stats', () => stats.draw()),
  panel: () => toggle('panel', 'panel'),
  help: () => $('help').open ? $('help').close() : $('help').showModal(),
  axis: (button) => ease(() => axisPose(button.dataset.axis)),
  unpick,
  'clip-reset': () => clip.set(clip.on, wholeBox()),
  hide: () => { if (picks.length) tree.toggle(picks.at(-1).node); },
  isolate: () => { if (picks.length) tree.isolate(picks.at(-1).node); },
  'show-all': () => tree.showAll(),
  key: () => path.add(),
  play,
  'save-path': () => path.save(`${baseName()}-path.json`),
  'load-path': () => $('path-file').click(),
  'clear-path': () => path.clear(),
  screenshot() {
    if (!isConnected) return toast('There is no connection to the server.', true);
    const {width, height, samples} = chosenShot();
    send({type: 'screenshot', id: ++shotId, width, height, samples});
    shotSamples.set(shotId, samples);
    toast(`Rendering ${width} × ${height}…`);
  },
  'shot-command'() {
    const {samples, ...shot} = chosenShot();
    copyCommand(commandOf(scene, shot, camera.pose(), samples, settings, clip, `${baseName()}.png`));
  },
};
function chosenShot() {
  const [width, height] = $('shot-size').value === 'view' ? [size.width, size.height] : $('shot-size').value.split('x').map(Number);
  return {width, height, samples: Number($('shot-samples').value)};
}
function saveShot({head, bytes}) {
  const wanted = shotSamples.get(head.id), side = (samples) => samples > 1 ? `${samples}×${samples}` : '1';
  shotSamples.delete(head.id);
  saveFile(new Blob([bytes], {type: 'image/png'}), `${baseName()}.png`, head.samples < wanted ? `, with ${side(head.samples)} samples instead of ${side(wanted)}, which are too many for this size` : '');
}
const copyCommand = (text) => copy(text, tree.hidden.size + tree.only.size > 0 ? 'Command, which draws the hidden nodes too,' : 'Command');
function toggle(id, action, then) {
  $(id).hidden = !$(id).hidden;
  document.querySelector(`#tools [data-do=${action}]`).setAttribute('aria-pressed', String(!$(id).hidden));
  if (!$(id).hidden) then?.();
}
document.addEventListener('click', (event) => {
  const button = event.target.closest?.('[data-do]');
  if (!button || (!scene && !['help', 'panel', 'stats'].includes(button.dataset.do))) return;
  actions[button.dataset.do](button);
  if (event.detail > 0) button.blur();  // a key's click leaves the focus where it is
});

const letters = {KeyH: 'home', KeyF: 'focus', KeyB: 'bookmark', KeyP: 'link', KeyC: 'command', KeyG: 'screenshot', KeyK: 'key', Space: 'play', Backquote: 'stats', Tab: 'panel'};
const axes = {Digit1: ['front', 'back'], Digit3: ['right', 'left'], Digit7: ['top', 'bottom'], Numpad1: ['front', 'back'], Numpad3: ['right', 'left'], Numpad7: ['top', 'bottom']};
addEventListener('keydown', (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || $('help').open) return;
  if (event.target.matches?.('input:not([type=checkbox]):not([type=range]):not([type=color]), select, textarea')) {
    if (event.key === 'Escape') event.target.blur();
    return;
  }
  if (event.code === 'Space' && event.target.matches?.('button, summary, input')) return;
  if (event.key === '?') return take(event, actions.help);
  if (!scene) return;
  if (event.code === 'Tab' && event.shiftKey) return;
  if (!event.repeat && letters[event.code]) return take(event, actions[letters[event.code]]);
  if (axes[event.code]) return take(event, () => ease(() => axisPose(axes[event.code][event.shiftKey ? 1 : 0])));
  if (event.repeat && !(event.code in {KeyW: 1, KeyA: 1, KeyS: 1, KeyD: 1, KeyQ: 1, KeyE: 1, ArrowUp: 1, ArrowDown: 1, ArrowLeft: 1, ArrowRight: 1})) return;
  switch (event.code) {
    case 'KeyV': return take(event, () => set({show: shows[(shows.indexOf(settings.show) + (event.shiftKey ? shows.length - 1 : 1)) % shows.length]}));
    case 'KeyL': return take(event, () => set({light: !settings.light}));
    case 'KeyO': return take(event, () => set({ssao: !settings.ssao}));
    case 'KeyI': return take(event, () => set({edl: !settings.edl}));
    case 'KeyX': return take(event, () => event.shiftKey ? tree.showAll() : actions.hide());
    case 'BracketLeft': return take(event, () => bookmarks.go(bookmarks.at - 1));
    case 'BracketRight': return take(event, () => bookmarks.go(bookmarks.at + 1));
    case 'KeyN': return take(event, () => { $('panel').hidden = false; $('tree-part').open = true; $('tree-search').focus(); });
    case 'Escape': return take(event, unpick);
  }
  if (!event.target.matches?.('input, select')) {
    if (controls.key(event)) {
      takeOver();
      event.preventDefault();
    }
  }
});
function take(event, action) {
  event.preventDefault();
  action();
}

// --- Start ---

/// For tests, and for scripts in a browser's console.
const pixelReaders = [];
window.scree = {
  camera, settings, tree, path, set, setClip: (on, box) => clip.set(on, box), clip: () => ({on: clip.on, box: clip.box}), command, send: (message) => send(message), drop: () => worker.postMessage({type: 'drop'}),
  go(pose) { takeOver(); camera.set(pose); showFov(); changed(); },
  latencies: stats.latencies,
  rows: stats.rows,
  pixels: () => new Promise((resolve) => { pixelReaders.push(resolve); worker.postMessage({type: 'read'}); }),
};

let hash = new URLSearchParams();  // of the newest address, until its view is set
/// Returns the token of the address, which then no longer has it.
function takeToken() {
  hash = new URLSearchParams(location.hash.slice(1));
  if (hash.has('token')) history.replaceState(null, '', location.pathname);
  return hash.get('token');
}
addEventListener('hashchange', () => {
  const token = takeToken();
  if (token !== null) return connect(token);
  if (scene) goToAddress();
});
const token = takeToken() ?? stored(storageKey);

const place = new URL('ws', location.href);
place.protocol = location.protocol === 'https:' ? 'wss:' : 'ws:';
place.hash = '';
const offscreen = $('picture').transferControlToOffscreen();
worker.postMessage({type: 'start', canvas: offscreen, address: place.href}, [offscreen]);
document.querySelector('#tools [data-do=panel]').setAttribute('aria-pressed', 'true');
if (innerWidth <= 720) actions.panel();
showSettings();
if (token) connect(token);
else askForToken('This address has no token', 'Open the address that scree view printed, or paste it here.');
addEventListener('pagehide', () => worker.terminate());
