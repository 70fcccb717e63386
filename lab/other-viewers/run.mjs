#!/usr/bin/env node
// Draws glTF test models with scree, f3d and three.js from the same cameras and measures the differences of their
// pictures.
//
//     npm ci && xvfb-run -a -s '-screen 0 1600x1200x24' node run.mjs SCREE MODELS FOLDER [NAME-PATTERN]
//
// SCREE is the program. MODELS is a folder with the files of models.json. All pictures, rows.csv and sheet.png are
// written to FOLDER. Pictures of f3d and three.js that are already there are kept, so that a new version of scree is
// compared in a minute; delete them after a change of models.json or of the other programs.
// A model of models.json has a direction to the eye (`view`), and a `label` if it is on the sheet. Optional: `zoom`,
// `factors` (replace factors of its materials), `light` (of the sheet's picture), `only` (the lights of its rows:
// environment, unlit, scene), `dim` (a factor of the file's own lights, for the light scene).
// Needs f3d and a Chromium (SCREE_BROWSER, or Debian's); OpenGL and WebGL may run on the CPU.
import {execFileSync} from 'node:child_process';
import {createServer} from 'node:http';
import {cpSync, existsSync, mkdirSync, readFileSync, rmSync, writeFileSync} from 'node:fs';
import {basename, dirname, extname, join, resolve} from 'node:path';
import {fileURLToPath} from 'node:url';
import {chromium} from 'playwright-core';

const here = dirname(fileURLToPath(import.meta.url));
const [program, models, folder, pattern = ''] = process.argv.slice(2);
if (!folder) {
  console.error('run.mjs: node run.mjs SCREE MODELS FOLDER [NAME-PATTERN]');
  process.exit(1);
}
const plan = JSON.parse(readFileSync(join(here, 'models.json')));
const {size: [width, height], sheetSize, columns, fov, environment} = plan;
const chosen = plan.models.filter(({name}) => new RegExp(pattern).test(name));
mkdirSync(folder, {recursive: true});
const inFolder = (...parts) => resolve(folder, ...parts);

// ---- Models

/// The JSON of a .gltf or .glb, and a function that writes it back with everything else unchanged.
function openGltf(file) {
  const bytes = readFileSync(file);
  if (extname(file) === '.gltf') return {json: JSON.parse(bytes), save: (json) => writeFileSync(file, JSON.stringify(json))};
  const length = bytes.readUInt32LE(12);
  return {json: JSON.parse(bytes.subarray(20, 20 + length)), save: (json) => {
    let text = Buffer.from(JSON.stringify(json));
    text = Buffer.concat([text, Buffer.alloc((4 - text.length % 4) % 4, ' ')]);
    const out = Buffer.concat([bytes.subarray(0, 20), text, bytes.subarray(20 + length)]);
    out.writeUInt32LE(out.length, 8);
    out.writeUInt32LE(text.length, 12);
    writeFileSync(file, out);
  }};
}

/// Makes every material unlit. The base colour, its texture and alpha remain.
function makeUnlit(file) {
  const {json, save} = openGltf(file);
  json.materials ??= [];
  for (const material of json.materials) {
    material.extensions = {KHR_materials_unlit: {}};
    for (const key of ['normalTexture', 'occlusionTexture', 'emissiveTexture', 'emissiveFactor']) delete material[key];
  }
  for (const primitive of (json.meshes ?? []).flatMap((mesh) => mesh.primitives))
    primitive.material ??= json.materials.length;
  json.materials.push({extensions: {KHR_materials_unlit: {}}});
  const others = (names = []) => names.filter((name) => !name.startsWith('KHR_materials_'));
  json.extensionsUsed = [...others(json.extensionsUsed), 'KHR_materials_unlit'];
  json.extensionsRequired = others(json.extensionsRequired);
  if (!json.extensionsRequired.length) delete json.extensionsRequired;
  save(json);
}

/// Multiplies the strength of the file's lights.
function dimLights(file, factor) {
  const {json, save} = openGltf(file);
  for (const light of json.extensions.KHR_lights_punctual.lights) light.intensity = (light.intensity ?? 1) * factor;
  save(json);
}

/// Removes the file's lights, which f3d and three.js would add to the surroundings, and overrides factors of its
/// materials.
function setFactors(file, factors) {
  const {json, save} = openGltf(file);
  for (const material of json.materials ?? []) Object.assign(material.pbrMetallicRoughness ??= {}, factors);
  for (const node of json.nodes ?? []) delete node.extensions?.KHR_lights_punctual;
  delete json.extensions?.KHR_lights_punctual;
  for (const list of ['extensionsUsed', 'extensionsRequired']) {
    json[list] = json[list]?.filter((name) => name !== 'KHR_lights_punctual');
    if (!json[list]?.length) delete json[list];
  }
  save(json);
}

/// Makes a changed copy of the model's folder for one of the lights.
function copyModel(model, light) {
  const target = inFolder('models', model.name, light);
  rmSync(target, {recursive: true, force: true});
  cpSync(dirname(join(models, model.file)), target, {recursive: true});
  execFileSync('chmod', ['-R', 'u+w', target]);
  const file = join(target, basename(model.file));
  if (light === 'unlit') makeUnlit(file);
  else if (light === 'scene') dimLights(file, model.dim ?? 1);
  else setFactors(file, model.factors ?? {});
  return file;
}

// ---- The surroundings

/// Rotates a Radiance picture by a quarter turn: its middle is +x in f3d and -z in scree.
function turnHdr(from, to) {
  const bytes = readFileSync(from);
  let at = bytes.indexOf('\n\n') + 2;
  const end = bytes.indexOf(10, at);
  const [, h, w] = /-Y (\d+) \+X (\d+)/.exec(bytes.toString('latin1', at, end)).map(Number);
  at = end + 1;
  const rows = [];
  for (let y = 0; y < h; ++y) {
    if (bytes[at] !== 2 || bytes[at + 1] !== 2) throw new Error(`${from}: only run-length coded pictures`);
    at += 4;
    const planes = Buffer.alloc(4 * w);
    for (let i = 0; i < 4 * w;) {
      const count = bytes[at++];
      if (count > 128) {
        planes.fill(bytes[at++], i, i + count - 128);
        i += count - 128;
      } else {
        bytes.copy(planes, i, at, at + count);
        at += count;
        i += count;
      }
    }
    const row = Buffer.alloc(4 * w);
    for (let x = 0; x < w; ++x)
      for (let c = 0; c < 4; ++c) row[4 * ((x + 3 * w / 4) % w) + c] = planes[c * w + x];
    rows.push(row);
  }
  writeFileSync(to, Buffer.concat([Buffer.from(`#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y ${h} +X ${w}\n`), ...rows]));
}

// ---- Programs

const run = (command, words) => execFileSync(command, words, {stdio: ['ignore', 'pipe', 'pipe']}).toString();
const commas = (numbers) => numbers.map((number) => Number(number.toFixed(6))).join(',');

/// Eye and target for a picture of the whole scene; model.view is the direction to the eye.
function cameraOf(model, packed) {
  const {min, max} = JSON.parse(run(program, ['inspect', packed, '--json'])).scene.scenes.find((scene) => scene.default);
  const target = min.map((low, i) => (low + max[i]) / 2);
  const radius = Math.hypot(...min.map((low, i) => max[i] - low)) / 2;
  const reach = radius / Math.sin(fov / 2 * Math.PI / 180) / (model.zoom ?? 1);
  const length = Math.hypot(...model.view);
  return {target, eye: target.map((middle, i) => middle + model.view[i] / length * reach), reach};
}

const screeLight = (light) => light === 'environment' ? ['--environment', join(models, environment)] :
  ['--light', light === 'scene' ? 'scene' : 'camera'];

function drawScree(packed, camera, words, picture) {
  run(program, ['render', packed, '-o', picture, '-f', '-q', `--eye=${commas(camera.eye)}`, `--target=${commas(camera.target)}`,
    '--fov', fov, '--backend', 'cpu', ...words]);
}

function drawF3d(file, camera, words, picture) {
  rmSync(picture, {force: true});
  run('f3d', [file, '--dry-run', '--quiet', '-p', '--no-background',
    '--bg-color', '0,0,0', '--resolution', `${width},${height}`, `--camera-position=${commas(camera.eye)}`,
    `--camera-focal-point=${commas(camera.target)}`, '--camera-view-up=0,1,0', `--camera-view-angle=${fov}`, ...words,
    '--output', picture]);
}

const types = {'.html': 'text/html', '.js': 'text/javascript', '.wasm': 'application/wasm', '.json': 'application/json'};

/// Serves this folder and, under /out/, FOLDER.
function serve() {
  const server = createServer((request, answer) => {
    const path = decodeURIComponent(new URL(request.url, 'http://localhost').pathname);
    const file = path.startsWith('/out/') ? inFolder(path.slice(5)) : join(here, path);
    if (!existsSync(file)) return answer.writeHead(404).end();
    answer.writeHead(200, {'Content-Type': types[extname(file)] ?? 'application/octet-stream'}).end(readFileSync(file));
  });
  return new Promise((done) => server.listen(0, '127.0.0.1', () => done(server)));
}

const compare = (a, b) => JSON.parse(run(program, ['compare', a, b, '--json'])).pictures;
const saveUrl = (url, file) => writeFileSync(file, Buffer.from(url.slice(url.indexOf(',') + 1), 'base64'));

// ---- Main program

const browserPath = [process.env.SCREE_BROWSER, '/usr/bin/chromium-headless-shell', '/usr/bin/chromium']
  .find((path) => path && existsSync(path));
const server = await serve();
const browser = await chromium.launch({executablePath: browserPath,
  args: ['--no-sandbox', '--force-color-profile=srgb', '--use-angle=swiftshader', '--enable-unsafe-swiftshader']});
const page = await browser.newPage({viewport: {width: 1400, height: 1200}});
page.on('console', (message) => { if (message.type() !== 'info') console.error(`three.js: ${message.text()}`); });
page.on('pageerror', (error) => console.error(`three.js: ${error}`));
await page.goto(`http://127.0.0.1:${server.address().port}/three.html`);
await page.waitForFunction(() => window.isReady);

const asData = (file) => `data:image/png;base64,${readFileSync(file).toString('base64')}`;
const urlOf = (file) => `/out/${file.slice(inFolder().length + 1).split('/').map(encodeURIComponent).join('/')}`;
turnHdr(join(models, environment), inFolder('turned.hdr'));
cpSync(join(models, environment), inFolder('light.hdr'));

const versions = {
  scree: `scree ${/commit (\w+)/.exec(run(program, ['--version']))[1]}`,
  f3d: `f3d ${/Version: ([\d.]+\d)/.exec(run('f3d', ['--version']))[1]}`,
  three: `three.js ${JSON.parse(readFileSync(join(here, 'node_modules/three/package.json'))).version}`,
};

/// Draws a model with three.js and f3d; returns the share of pixels that show the model, as text.
async function drawOthers(file, light, camera, name) {
  const wish = {model: urlOf(file), hdr: light === 'environment' ? '/out/light.hdr' : '', ...camera, fov, width, height};
  saveUrl(await page.evaluate((wish) => draw(wish), wish), name('three'));

  // f3d draws the surroundings behind the model. The alpha of a picture without surroundings masks them. It always
  // adds lights of its own to the file's, so that it has no picture under these alone.
  drawF3d(file, camera, [], inFolder('mask.png'));
  drawF3d(file, camera, light === 'environment' ? ['--hdri', inFolder('turned.hdr')] : [], inFolder('uncut.png'));
  const {url, covered} = await page.evaluate(([picture, mask]) => cut(picture, mask),
    [asData(inFolder('uncut.png')), asData(inFolder('mask.png'))]);
  saveUrl(url, name('f3d'));
  return `${covered}\n`;
}

const rows = [['model', 'light', 'a', 'b', 'width', 'height', 'covered', 'psnr_db', 'flip_mean']];
const cells = [];
for (const model of chosen) {
  const original = inFolder(`${model.name}.scree`);
  run(program, ['convert', join(models, model.file), '-o', original, '-f', '-q']);
  const camera = cameraOf(model, original);
  if (model.label) {
    const picture = inFolder(`${model.name}.sheet.png`);
    drawScree(original, camera, ['--size', sheetSize.join('x'), '--samples', 4, '--background', '#50565e',
      ...(model.light ? ['--light', model.light] : [...screeLight('environment'), '--exposure', 1])], picture);
    cells.push({picture: asData(picture), text: model.label});
  }
  for (const light of model.only ?? ['environment', 'unlit']) {
    const file = copyModel(model, light);
    const name = (viewer) => inFolder(`${model.name}.${light}.${viewer}.png`);
    const packed = inFolder(`${model.name}.${light}.scree`);
    run(program, ['convert', file, '-o', packed, '-f', '-q']);
    drawScree(packed, camera, ['--size', `${width}x${height}`, '--background', 'black', ...screeLight(light)], name('scree'));
    const coveredFile = inFolder(`${model.name}.${light}.covered`);
    if (!existsSync(coveredFile)) writeFileSync(coveredFile, await drawOthers(file, light, camera, name));
    const covered = Number(readFileSync(coveredFile));
    const pairs = [['scree', 'f3d'], ['scree', 'three'], ['f3d', 'three']];
    for (const [a, b] of light === 'scene' ? pairs.slice(1, 2) : pairs) {
      const {psnr_db: psnr, flip_mean: flip} = compare(name(a), name(b));
      rows.push([model.name, light, versions[a], versions[b], width, height, covered.toFixed(4),
        psnr === undefined ? 'inf' : psnr.toFixed(2), flip.toFixed(4)]);
      console.log(rows.at(-1).join(','));
    }
  }
}
writeFileSync(inFolder('rows.csv'), rows.map((row) => row.join(',') + '\n').join(''));
await page.evaluate(([count, list]) => showSheet(count, list), [columns, cells]);
await page.locator('#sheet').screenshot({path: inFolder('sheet.png')});
await browser.close();
server.close();
