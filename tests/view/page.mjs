// Uses the page of scree view as a person would: node page.mjs PROGRAM SCENE FOLDER SUNNY_SCENE. Prints a line per check.
// Exit code 1 if one fails, 77 if there is no browser.
import assert from 'node:assert/strict';
import {readFileSync, writeFileSync} from 'node:fs';
import {connect, createServer} from 'node:net';
import {join} from 'node:path';

const [program, scene, folder, sunny] = process.argv.slice(2);
const {browserPath, changes, decode, launch, open, pixels, render, rests, serve} = await import('./browser.mjs').catch((error) => {
  console.log(`playwright-core is not installed (npm ci --prefix tests/view): ${error.code}`);
  process.exit(77);
});
if (!browserPath) {
  console.log('there is no Chromium (chromium-headless-shell; scripts/setup installs it where the system has it)');
  process.exit(77);
}

const browser = await launch();
let server = await serve(program, scene);
let failed = 0;
async function check(name, body) {
  try {
    await body();
    console.log(`ok: ${name}`);
  } catch (error) {
    ++failed;
    console.log(`FAILED: ${name}: ${error.stack}`);
  }
}
const differs = (a, b) => {
  let count = 0;
  for (let i = 0; i < a.length; i += 4) if (a[i] !== b[i] || a[i + 1] !== b[i + 1] || a[i + 2] !== b[i + 2]) ++count;
  return count;
};
/// The address of the view; the page writes it every 350 ms at most.
const addressOf = async (page) => {
  await page.waitForTimeout(500);
  return page.evaluate(() => location.hash);
};
/// Checks that the picture at rest equals the picture of the command that the page copies to the clipboard.
async function isExact(page, samples) {
  await page.evaluate((samples) => scree.set({samples}), samples);
  await rests(page, samples);
  const shown = await pixels(page);
  const command = await page.evaluate(() => scree.command());
  const file = join(folder, 'render.png');
  render(program, command, file);
  const rendered = await decode(page, readFileSync(file));
  assert.equal(shown.bytes.length, rendered.length, 'sizes');
  assert.equal(differs(shown.bytes, rendered), 0, 'pixels differ from scree render');
  assert.ok(differs(shown.bytes, Buffer.alloc(shown.bytes.length)) > 0);
}

const page = await open(browser, server.url);
await check('the page loads and shows a picture', async () => {
  await rests(page);
  assert.equal(await page.evaluate(() => location.hash.includes('token')), false, 'the token stays in the address');
  assert.match(await page.textContent('#scene-facts'), /triangles/);
  assert.equal(await page.evaluate(() => document.getElementById('cover').className), 'gone');
});
await check('the picture at rest is that of scree render', () => isExact(page, 1));
await check('more samples arrive, equal to those of scree render', async () => {
  await changes(page, () => page.setViewportSize({width: 240, height: 140}));  // few pixels, for slow machines
  await isExact(page, 4);
  await changes(page, () => page.setViewportSize({width: 800, height: 450}));
  await rests(page);
});
await check('a drag turns the view, and the picture becomes exact again', async () => {
  const before = await pixels(page), eye = await page.evaluate(() => scree.camera.eye);
  await page.mouse.move(400, 225);
  await page.mouse.down();
  await changes(page, () => page.mouse.move(460, 245, {steps: 6}));
  await page.mouse.up();
  assert.notDeepEqual(await page.evaluate(() => scree.camera.eye), eye);
  await isExact(page, 1);
  assert.ok(differs(before.bytes, (await pixels(page)).bytes) > 100);
});
await check('the wheel moves the camera nearer, and the point under the cursor stays in place', async () => {
  const project = () => page.evaluate((point) => {
    const at = scree.camera.project(point, innerWidth / innerHeight);
    return [at.x * innerWidth, at.y * innerHeight, at.depth];
  }, point);
  await page.mouse.move(380, 215);
  await page.waitForTimeout(150);
  await page.mouse.click(380, 215);
  await page.waitForSelector('#picked dd');
  const text = await page.textContent('#picked');
  const point = /Point([-\d., e+]+)/.exec(text)[1].split(',').map(Number);
  const before = await project();
  await page.mouse.wheel(0, -200);
  await page.waitForTimeout(600);
  const after = await project();
  assert.ok(after[2] < 0.9 * before[2], 'not nearer');
  assert.ok(Math.hypot(after[0] - before[0], after[1] - before[1]) < 2, 'the point has moved');
});
await check('keys: shading, help, panel, bookmarks', async () => {
  await page.keyboard.press('v');
  assert.equal(await page.inputValue('#show'), 'color');
  await isExact(page, 1);
  await page.keyboard.press('?');
  assert.ok(await page.isVisible('#help'));
  await page.keyboard.press('Escape');
  await page.keyboard.press('Tab');
  assert.ok(!await page.isVisible('#panel'));
  await page.keyboard.press('Tab');
  await page.keyboard.press('b');
  const eye = await page.evaluate(() => scree.camera.eye);
  await page.keyboard.press('h');
  await page.waitForTimeout(700);
  await page.keyboard.press(']');
  await page.waitForFunction((end) => end.every((value, i) => scree.camera.eye[i] === value), eye);
});
await check('hidden nodes are not drawn, and all of them can be shown again', async () => {
  await rests(page);
  const before = await pixels(page);
  await page.click('#tree-part > summary');
  await page.hover('.node >> nth=0');
  await changes(page, () => page.click('.node >> nth=0 >> .eye'));
  await rests(page);
  assert.ok(differs(before.bytes, (await pixels(page)).bytes) > 100);
  await changes(page, () => page.click('[data-do=show-all]'));
  await isExact(page, 1);
});
await check('a clipping box cuts as in scree render, by its switch, sliders, handles and the address', async () => {
  await page.keyboard.press('h');
  await page.waitForTimeout(700);
  await rests(page);
  const before = await pixels(page);
  await page.click('#clip-part > summary');
  await page.check('#clip');
  assert.equal(await page.locator('#marks .handle').count(), 6);
  await isExact(page, 1);
  assert.equal(differs(before.bytes, (await pixels(page)).bytes), 0, 'the box of the scene cuts something');
  const middle = await page.evaluate(() => scree.clip().box.slice(0, 3).map((low, axis) => (low + scree.clip().box[axis + 3]) / 2));
  await changes(page, () => page.locator('#clip-sides input[type=range]').nth(3).fill('500'));
  const cut = await page.evaluate(() => scree.clip().box);
  assert.ok(Math.abs(cut[3] - middle[0]) < 0.01 * (cut[3] - cut[0]), 'the slider is not in the middle');
  assert.match(await page.evaluate(() => scree.command()), /--clip-box=/);
  await isExact(page, 1);
  const half = await pixels(page);
  assert.ok(differs(before.bytes, half.bytes) > 100, 'nothing is cut');
  const handle = async (side) => {
    const box = await page.locator(`#marks .handle[data-side="${side}"]`).boundingBox();
    return [box.x + box.width / 2, box.y + box.height / 2];
  };
  const from = await handle(3), to = await handle(0);
  const eye = await page.evaluate(() => scree.camera.eye);
  await page.mouse.move(...from);
  await page.mouse.down();
  await changes(page, () => page.mouse.move(from[0] + (to[0] - from[0]) / 3, from[1] + (to[1] - from[1]) / 3, {steps: 5}));
  await page.mouse.up();
  const dragged = await page.evaluate(() => scree.clip().box);
  const share = (cut[3] - dragged[3]) / (cut[3] - cut[0]);
  assert.ok(share > 0.1 && share < 0.6, `a third of the way moves the face by ${share} of it`);
  assert.deepEqual(dragged.filter((_, side) => side !== 3), cut.filter((_, side) => side !== 3));
  assert.deepEqual(await page.evaluate(() => scree.camera.eye), eye, 'the camera moved too');
  await isExact(page, 1);
  const fingers = await page.evaluate(() => {
    const handle = document.querySelector('#marks .handle[data-side="3"]'), {x, y} = handle.getBoundingClientRect(), before = scree.clip().box[3], sides = [];
    for (const [type, pointerId, moved] of [['down', 11, 0], ['move', 12, 90], ['up', 12, 90], ['move', 11, 30], ['move', 11, 0], ['up', 11, 0], ['move', 11, 90]]) {
      (type === 'down' ? handle : document.body).dispatchEvent(new PointerEvent(`pointer${type}`, {pointerId, clientX: x + moved, clientY: y, bubbles: true}));
      sides.push(scree.clip().box[3] !== before);
    }
    return sides;
  });
  assert.deepEqual(fingers, [false, false, false, true, false, false, false], 'another finger moves the side, or ends the drag');
  const address = await addressOf(page);
  assert.match(address, /&c=/);
  const other = await open(browser, server.url + '&' + address.slice(1));
  await rests(other);
  const read = await other.evaluate(() => scree.clip());
  assert.ok(read.on && read.box.every((value, i) => Math.abs(value - dragged[i]) < 1e-9 * (1 + Math.abs(value))), 'the address has another box');
  await other.context().close();
  await page.click('[data-do=clip-reset]');
  await changes(page, () => page.uncheck('#clip'));
  await isExact(page, 1);
  assert.equal(await page.locator('#marks .handle').count(), 0);
  assert.equal(differs(before.bytes, (await pixels(page)).bytes), 0, 'the cut part is not drawn again');
});
await check('the sun casts the shadows of scree render, by its switch and by the address', async () => {
  assert.ok(await page.isDisabled('#shadows'));
  assert.match(await page.textContent('#shadows-hint'), /no directional light/);
  const served = await serve(program, sunny, ['--light', 'scene', '--exposure', '-0.5', '--blend-layers', '3']);
  const small = {viewport: {width: 730, height: 250}};
  const lit = await open(browser, served.url, small);
  await rests(lit);
  await isExact(lit, 1);  // more samples may have arrived
  const before = await pixels(lit);
  assert.ok(!await lit.isVisible('#shadows-hint'));
  await changes(lit, () => lit.check('#shadows'));
  await isExact(lit, 1);
  const shadowed = await pixels(lit);
  assert.ok(differs(before.bytes, shadowed.bytes) > 300, 'no shadows');
  assert.match(await lit.evaluate(() => scree.command()), /--light scene --exposure -0.5 --blend-layers 3 --shadows/);
  const address = await addressOf(lit);
  assert.match(address, /o=shadows/);
  const other = await open(browser, served.url + '&' + address.slice(1), small);
  await rests(other);
  await isExact(other, 1);  // more samples may have arrived
  assert.ok(await other.isChecked('#shadows'));
  assert.equal(differs((await pixels(other)).bytes, shadowed.bytes), 0, 'the address has other shadows');
  await other.context().close();
  await changes(lit, () => lit.uncheck('#shadows'));
  await isExact(lit, 1);
  assert.equal(differs(before.bytes, (await pixels(lit)).bytes), 0, 'the shadows stay');
  await changes(lit, () => lit.uncheck('#light'));
  assert.match(await lit.evaluate(() => scree.command()), /--no-light --blend-layers 3 /);
  await isExact(lit, 1);
  assert.deepEqual(lit.problems, []);
  await lit.context().close();
  await served.end();
});
await check('pictures of another size and for a screen with small pixels are exact', async () => {
  await changes(page, () => page.setViewportSize({width: 500, height: 400}));
  await isExact(page, 1);
  const fine = await open(browser, server.url, {viewport: {width: 301, height: 200}, deviceScaleFactor: 2});
  await rests(fine);
  const shown = await pixels(fine);
  assert.deepEqual([shown.width, shown.height], [602, 400]);
  await isExact(fine, 1);
  await fine.context().close();
});
await check('a path file is flown as scree render --path draws it, and saved with its name and fps, and other files are refused', async () => {
  const keys = [{t: 0, eye: [0, 0, 4], target: [0, 0, 0], fov: 20}, {t: 1, eye: [1, 1, 4], target: [0, 0, 0], up: [1, 2, 0], fov: 20},
    {t: 2, matrix: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 3, 1], fov: 80, name: 'last but one'}, {t: 3, eye: [0, 0, 3], target: [0.5, 0, 0], fov: 80}];
  const file = {format: 'scree camera path', version: 1, name: 'a flight', fps: 2, keys};
  const load = (text) => page.setInputFiles('#path-file', {name: 'path.json', mimeType: 'application/json', buffer: Buffer.from(text)});
  await load(JSON.stringify(file));
  await page.waitForFunction(() => scree.path.keys.length === 4);
  writeFileSync(join(folder, 'path.json'), JSON.stringify(file));
  const command = (await page.evaluate(() => scree.command())).replace(/--(eye|target|up)=\S+|--fov \S+|--samples \d/g, '');
  render(program, `${command} --path '${join(folder, 'path.json').replaceAll("'", "'\\''")}'`, join(folder, 'path%d.png'));
  for (const time of [0.5, 2.5]) {  // seconds
    const fov = await page.evaluate(async (time) => {
      const {alongPath} = await import(new URL('camera.js', location.href).href);
      scree.camera.fly(alongPath(scree.path.keys, time));
      scree.set({samples: 1});
      return scree.camera.fov;
    }, time);
    assert.equal(fov, time < 1 ? 20 : 80);
    await rests(page);
    assert.equal(differs((await pixels(page)).bytes, await decode(page, readFileSync(join(folder, `path${2 * time}.png`)))), 0, `${time} s`);
  }
  for (const [text, reason] of [['{', /not JSON/], [JSON.stringify({...file, version: 2}), /version/], [JSON.stringify({...file, keys: []}), /no keys/],
    [JSON.stringify({...file, keys: [keys[1], {...keys[3], t: 1}]}), /key 1 is not later/], [JSON.stringify({...file, keys: [{...keys[0], fov: '45'}]}), /key 0 fov/],
    [JSON.stringify({...file, keys: [{...keys[0], eye: [1e16, 0, 0]}]}), /key 0 eye/]]) {
    await load(text);
    await page.locator('.toast', {hasText: reason}).waitFor();
  }
  assert.equal(await page.evaluate(() => scree.path.keys.length), 4);
  const [download] = await Promise.all([page.waitForEvent('download'), page.evaluate(() => document.querySelector('[data-do=save-path]').click())]);
  const saved = JSON.parse(readFileSync(await download.path(), 'utf8'));
  assert.deepEqual([saved.name, saved.fps, saved.keys.length], ['a flight', 2, 4]);
});
await check('Space acts on the focused control, and otherwise plays the path', async () => {
  const press = async (selector, key) => {
    await page.focus(selector);
    await page.keyboard.press(key);
    assert.equal(await page.textContent('#play'), 'Play', selector);
  };
  await press('#ssao', 'Space');
  assert.ok(await page.isChecked('#ssao'));
  await press('#ssao', 'Space');
  await press('#samples button:nth-child(2)', 'Space');
  assert.equal(await page.evaluate(() => scree.settings.samples), 2);
  await press('#samples button:nth-child(1)', 'Enter');
  assert.equal(await page.evaluate(() => scree.settings.samples), 1);
  await press('#picked-part > summary', 'Space');
  assert.ok(!await page.evaluate(() => document.getElementById('picked-part').open));
  await press('#tools [data-do=stats]', 'Space');
  await press('#tools [data-do=stats]', 'Enter');
  assert.ok(!await page.isVisible('#stats'));
  await page.focus('#stage');
  for (const text of ['Stop', 'Play']) {
    await page.keyboard.press('Space');
    assert.equal(await page.textContent('#play'), text);
  }
});
await check('two pages have their own cameras, and one can follow the other', async () => {
  const other = await open(browser, server.url);
  await rests(other);
  const mine = await page.evaluate(() => scree.camera.eye);
  await other.evaluate(() => scree.go({...scree.camera.pose(), eye: scree.camera.eye.map((value) => 1.5 * value)}));
  await rests(other);
  assert.deepEqual(await page.evaluate(() => scree.camera.eye), mine);
  await page.evaluate(() => { document.getElementById('viewers-part').open = true; });
  const follow = '#viewers li button:has-text("Follow")', following = page.locator('#viewers [aria-pressed=true]');
  await page.focus('#stage');
  await page.keyboard.press('Space');
  assert.equal(await page.textContent('#play'), 'Stop');
  await page.click(follow);
  const theirs = await other.evaluate(() => scree.camera.eye);
  await page.waitForFunction((eye) => Math.hypot(...scree.camera.eye.map((value, i) => value - eye[i])) < 1e-9, theirs);
  await other.evaluate(() => scree.go({...scree.camera.pose(), eye: scree.camera.eye.map((value) => 1.1 * value)}));
  const later = await other.evaluate(() => scree.camera.eye);
  await page.waitForFunction((eye) => Math.hypot(...scree.camera.eye.map((value, i) => value - eye[i])) < 1e-9, later);
  assert.equal(await page.textContent('#play'), 'Play', 'the path goes on');
  await page.focus('#stage');
  for (const key of ['h', 'f', '1', ']', 'w', 'Space']) {
    await page.keyboard.press(key);
    assert.equal(await following.count(), 0, key);
    await page.click(follow);
    await page.focus('#stage');
    assert.equal(await following.count(), 1);
  }
  await page.keyboard.press('h');
  await other.context().close();
});
await check('views stay within the limits of the server', async () => {
  await page.locator('#clip-sides input[type=number]').nth(3).fill('1e300');
  await changes(page, () => page.keyboard.press('Enter'));
  assert.equal(await page.evaluate(() => scree.clip().box[3]), 1e15);
  await page.click('[data-do=clip-reset]');
  await page.uncheck('#clip');
  const most = await page.evaluate(() => {
    const {camera} = scree, before = camera.pose(), far = [];
    const note = () => far.push(...camera.eye, ...camera.target);
    for (let i = 0; i < 100; ++i) camera.zoom([0, 0, 0], 10), note();
    for (let i = 0; i < 100; ++i) camera.move([3e13, 0, 0]), note();
    camera.orbit([-9e14, 0, 0], 2, 0), note();
    scree.set({});
    scree.go({...before, eye: [1e16, 0, 0]}), note();
    scree.go(before);
    return far.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
  });
  assert.ok(most > 1e14 && most <= 1e15, `${most}`);
  await rests(page);
  assert.equal(await page.evaluate(() => document.documentElement.dataset.state), 'open');
});
await check('a fast slider does not send more views than the server accepts, and its last value is drawn', async () => {
  await page.evaluate(() => {
    const slider = document.getElementById('edl-strength');
    window.states = [];
    new MutationObserver(() => states.push(document.documentElement.dataset.state)).observe(document.documentElement, {attributeFilter: ['data-state']});
    scree.set({edl: true});
    for (let i = 1; i <= 400; ++i) {
      slider.value = i % 2 + 1;
      slider.dispatchEvent(new Event('input'));
    }
  });
  await isExact(page, 1);
  assert.deepEqual(await page.evaluate(() => states), []);
  assert.equal(await page.evaluate(() => scree.settings.edlStrength), 1);
  await page.evaluate(() => scree.set({edl: false, edlStrength: 1}));
});
await check('at most 1000 nodes can be hidden one by one, also after a reconnection', async () => {
  await page.evaluate(() => {
    const {tree} = scree, all = [...Array(1100).keys()];
    tree.load({names: all.map(String), parents: all.map(() => 0), triangles: all});
    tree.change(new Set(all.slice(0, 1000)), new Set());
    tree.toggle(1000);
  });
  assert.equal(await page.evaluate(() => scree.tree.hidden.size), 1000);
  await page.locator('.toast.bad', {hasText: '1000 nodes'}).waitFor();
  await page.evaluate(() => { scree.tree.isolate(1001); document.documentElement.dataset.exact = 0; scree.drop(); });
  await rests(page);
  await page.waitForFunction(() => scree.tree.names.length < 1000);  // the open list is loaded again
  await changes(page, () => page.click('[data-do=show-all]'));
});
await check('a link in the same tab shows its view, also an old link, but no numbers beyond the limits', async () => {
  const go = async (hash) => {
    await changes(page, () => page.evaluate((hash) => { location.hash = hash; }, hash));
    return page.evaluate(() => ({...scree.camera.pose(), show: scree.settings.show}));
  };
  const first = await go('v=1&e=0.1,0.2,3&t=0,0.30000000000000004,0&u=0,1,0&f=179.5&m=color&o=edl');
  assert.deepEqual(first, {eye: [0.1, 0.2, 3], target: [0, 0.30000000000000004, 0], up: [0, 1, 0], fov: 179.5, show: 'color'});
  for (const eye of ['1e16,0,3', ',,', '0,0,x']) assert.deepEqual((await go(`v=1&e=${eye}&t=0,0,0&m=color`)).eye, first.eye);
  const {show, ...last} = await go('e=0,0,3&t=0,0,0&f=180&m=texture');
  assert.deepEqual([last, show], [{eye: [0, 0, 3], target: [0, 0, 0], up: [0, 1, 0], fov: 45}, 'texture']);
});
await check('a link shows the same view', async () => {
  await page.evaluate(() => {
    scree.set({edl: true, edlStrength: 2.5, edlRadius: 3, samples: 2, background: '#102030'});
    scree.go({...scree.camera.pose(), eye: [0.1 + 0.2, 1 / 3, 3], fov: 50 / 3});
  });
  await page.waitForFunction(() => location.hash.includes('e=0.30000000000000004'));
  await rests(page);
  const hash = await addressOf(page);
  const again = await page.context().newPage();
  await again.goto(server.url.replace(/#.*/, hash));
  await rests(again);
  const view = (of) => of.evaluate(() => [scree.camera.pose(), scree.settings]);
  assert.deepEqual(await view(again), await view(page));
  assert.equal(await again.inputValue('#show'), await page.inputValue('#show'));
  await again.close();
  await page.evaluate(() => scree.set({edlStrength: 1, edlRadius: 1, samples: 4, background: '#20252d'}));
  assert.doesNotMatch(await addressOf(page), /&[bdrs]=/);
});
await check('two tabs have the same bookmarks', async () => {
  const other = await page.context().newPage();
  await other.goto(server.url.replace(/#.*/, ''));
  await rests(other);
  const count = await page.locator('#bookmarks li').count();
  const haveBoth = async (count) => {
    for (const tab of [page, other]) await tab.waitForFunction((count) => document.querySelectorAll('#bookmarks li').length === count, count);
  };
  await page.keyboard.press('b');
  await haveBoth(count + 1);
  await other.keyboard.press('b');
  await haveBoth(count + 2);
  await page.evaluate(() => document.querySelector('#bookmarks [title=Remove]').click());
  await haveBoth(count + 1);
  await other.close();
});
await check('a wrong token is explained, and the right one can be pasted and stays', async () => {
  const plain = server.url.replace(/#.*/, ''), wrong = `${plain}#token=${'0'.repeat(32)}`;
  const lost = await open(browser, wrong);
  await lost.waitForSelector('#token-form:visible');
  assert.match(await lost.textContent('#cover'), /token/);
  await lost.fill('#token-input', server.url);
  await lost.click('#token-form button');
  await rests(lost);
  const hostile = await lost.context().newPage(), later = await lost.context().newPage();
  await hostile.goto(wrong);
  await hostile.waitForSelector('#token-form:visible');
  await later.goto(plain);
  await rests(later);
  await lost.context().close();
});
await check('the page works in a browser that blocks its storage, or has no space left', async () => {
  for (const block of [() => Object.defineProperty(window, 'localStorage', {get() { throw new DOMException('', 'SecurityError'); }}),
    () => { Storage.prototype.setItem = () => { throw new DOMException('', 'QuotaExceededError'); }; }]) {
    const blocked = await open(browser, 'about:blank');
    await blocked.addInitScript(block);
    await blocked.goto(server.url);
    await rests(blocked);
    await blocked.keyboard.press('b');
    await blocked.locator('.toast.bad', {hasText: 'does not store'}).waitFor();
    assert.equal(await blocked.locator('#bookmarks li').count(), 1);
    assert.deepEqual(blocked.problems, []);
    await blocked.context().close();
  }
});
await check('a server with another scene: its address in the same tab connects, and the page forgets the old nodes', async () => {
  const served = await serve(program, sunny);
  let port = new URL(server.url).port;
  const sockets = [], relay = createServer((near) => {
    const far = connect(port, '127.0.0.1');
    sockets.push(near);
    near.pipe(far).pipe(near);
    for (const socket of [near, far]) socket.on('error', () => {}).on('close', () => { near.destroy(); far.destroy(); });
  });
  await new Promise((resolve) => relay.listen(0, '127.0.0.1', resolve));
  const moved = await open(browser, server.url.replace(port, relay.address().port));
  await rests(moved);
  await moved.mouse.click(300, 225);
  await moved.waitForSelector('#picked dd');
  await moved.click('#tree-part > summary');
  await moved.hover('.node >> nth=0');
  await changes(moved, () => moved.click('.node >> nth=0 >> .eye'));
  const names = await moved.evaluate(() => scree.tree.names);
  port = new URL(served.url).port;
  for (const socket of sockets) socket.destroy();
  await moved.waitForSelector('#token-form:visible');
  await moved.evaluate((hash) => { document.documentElement.dataset.exact = 0; location.hash = hash; }, new URL(served.url).hash);
  await rests(moved);
  await moved.waitForFunction(() => scree.tree.isLoaded);
  assert.equal(await moved.evaluate(() => location.hash.includes('token')), false, 'the token stays in the address');
  assert.notDeepEqual(await moved.evaluate(() => scree.tree.names), names);
  assert.equal(await moved.evaluate(() => scree.tree.hidden.size), 0);
  assert.ok(!await moved.isVisible('#picked'));
  await moved.context().close();
  relay.close();
  await served.end();
});
await check('a broken connection is restored', async () => {
  await page.evaluate(() => { document.documentElement.dataset.exact = 0; scree.drop(); });
  await rests(page);
  assert.equal(await page.evaluate(() => document.getElementById('cover').className), 'gone');
  await page.evaluate(() => { for (let i = 0; i < 3; ++i) document.getElementById('cover-button').click(); });
  await page.waitForFunction(() => document.getElementById('viewers-count').textContent === '1');
});
await check('a double click without a connection does not turn a later click into a flight', async () => {
  const cut = await open(browser, server.url);
  await rests(cut);
  await cut.evaluate(() => {
    document.documentElement.dataset.exact = 0;
    scree.drop();
    for (const type of ['pointerdown', 'pointerup', 'pointerdown', 'pointerup'])
      document.getElementById('stage').dispatchEvent(new PointerEvent(type, {pointerId: 1, clientX: 300, clientY: 225, bubbles: true}));
  });
  await rests(cut);
  const eye = await cut.evaluate(() => scree.camera.eye);
  await cut.mouse.click(300, 225);
  await cut.waitForSelector('#picked dd', {timeout: 5000});
  assert.deepEqual(await cut.evaluate(() => scree.camera.eye), eye);
  await cut.context().close();
});
await check('a page that the server does not understand waits until it is told to connect', async () => {
  await page.evaluate(() => scree.send({type: 'nonsense'}));
  await page.waitForFunction(() => document.documentElement.dataset.state === 'refused');
  await page.waitForTimeout(400);  // the first retry of other reasons comes after 250 ms
  assert.equal(await page.evaluate(() => document.documentElement.dataset.state), 'refused');
  await page.evaluate(() => { document.documentElement.dataset.exact = 0; document.getElementById('cover-button').click(); });
  await rests(page);
});
await check('the server ends in time, and the page reports it', async () => {
  const started = Date.now();
  assert.equal(await server.end(), 0);
  assert.ok(Date.now() - started < 1000, `${Date.now() - started} ms`);
  // A connection that was just made may end before the server's farewell; the next attempt finds no server.
  await page.waitForFunction(() => document.getElementById('cover').className === '' && /ended|No server/.test(document.getElementById('cover').textContent));
});
await check('the page had no errors', async () => {
  // A browser's message about a closed connection does not count as an error of the page.
  assert.deepEqual(page.problems.filter((problem) => !/WebSocket connection to/.test(problem)), []);
});
await browser.close();
process.exit(failed ? 1 : 0);
