// A browser and a server for the tests and for pictures of the page.
import {spawn, execFileSync} from 'node:child_process';
import {existsSync} from 'node:fs';
import {chromium} from 'playwright-core';

export const browserPath = [process.env.SCREE_BROWSER, '/usr/bin/chromium-headless-shell', '/usr/bin/chromium',
  '/usr/bin/google-chrome'].find((path) => path && existsSync(path));

export async function launch() {
  // Root in a container cannot use the sandbox; the browser opens only scree's own page.
  return chromium.launch({executablePath: browserPath, args: ['--no-sandbox', '--force-color-profile=srgb', '--disable-gpu']});
}

/// `scree view`; resolves when it has printed its address.
export function serve(program, scene, words = []) {
  const child = spawn(program, ['view', scene, '--port', '0', '--backend', 'cpu', ...words], {stdio: ['ignore', 'pipe', 'inherit']});
  return new Promise((resolve, reject) => {
    let text = '';
    child.on('exit', (code) => reject(new Error(`scree view ended with ${code}`)));
    child.stdout.on('data', (data) => {
      text += data;
      const url = /http:\S+/.exec(text)?.[0];
      if (url && text.includes('\n')) resolve({url, child, end: () => new Promise((done) => {
        child.removeAllListeners('exit');
        child.on('exit', (code) => done(code));
        child.kill('SIGINT');
      })});
    });
  });
}

export async function open(browser, url, options = {viewport: {width: 800, height: 450}}) {
  const context = await browser.newContext(options);
  const page = await context.newPage();
  page.problems = [];
  page.on('pageerror', (error) => page.problems.push(String(error)));
  page.on('console', (message) => { if (message.type() === 'error') page.problems.push(message.text()); });
  // Counts how often the picture stops being exact. It may be exact again before a test can notice.
  await page.addInitScript(() => {
    window.changes = 0;
    new MutationObserver(() => { if (document.documentElement?.dataset.exact === '0') ++window.changes; })
      .observe(document, {attributes: true, attributeFilter: ['data-exact'], subtree: true});
  });
  await page.goto(url);
  return page;
}

/// Runs `action`, and waits until another picture has been requested.
export async function changes(page, action) {
  const before = await page.evaluate(() => window.changes);
  await action();
  await page.waitForFunction((before) => window.changes > before, before);
}

/// Waits until the picture at rest is on the screen, with at least `samples` samples per side.
export const rests = (page, samples = 1) =>
  page.waitForFunction((least) => Number(document.documentElement.dataset.exact) >= least, samples, {timeout: 30000});

/// The RGBA pixels of the canvas.
export async function pixels(page) {
  const {width, height, text} = await page.evaluate(async () => {
    const read = await scree.pixels();
    let text = '';
    const bytes = new Uint8Array(read.pixels);
    for (let i = 0; i < bytes.length; i += 32768) text += String.fromCharCode(...bytes.subarray(i, i + 32768));
    return {width: read.width, height: read.height, text: btoa(text)};
  });
  return {width, height, bytes: Buffer.from(text, 'base64')};
}

/// The RGBA pixels of a PNG file, decoded by the browser.
export async function decode(page, file) {
  const text = await page.evaluate(async (base64) => {
    const blob = new Blob([Uint8Array.from(atob(base64), (c) => c.charCodeAt(0))], {type: 'image/png'});
    const image = await createImageBitmap(blob, {colorSpaceConversion: 'none', premultiplyAlpha: 'none'});
    const canvas = new OffscreenCanvas(image.width, image.height), context = canvas.getContext('2d', {alpha: false});
    context.drawImage(image, 0, 0);
    const bytes = context.getImageData(0, 0, image.width, image.height).data;
    let binary = '';
    for (let i = 0; i < bytes.length; i += 32768) binary += String.fromCharCode(...bytes.subarray(i, i + 32768));
    return btoa(binary);
  }, file.toString('base64'));
  return Buffer.from(text, 'base64');
}

/// Runs the command that the page copies ("scree render ..."), with another program and another output.
export function render(program, command, output) {
  const words = [...command.matchAll(/'((?:[^']|'\\'')*)'|(\S+)/g)].map(([, quoted, plain]) => plain ?? quoted.replaceAll("'\\''", "'"));
  words.shift();
  words[words.indexOf('-o') + 1] = output;
  execFileSync(program, [...words, '-f', '-q', '--backend', 'cpu']);
}
