// Measures the time from input to picture in the page: node measure.mjs PROGRAM SCENE [WIDTHxHEIGHT] [SECONDS] [words of scree view ...]
// A drag with a mouse event every 16 ms, on this machine's processor, browser and server together.
import {launch, open, rests, serve} from './browser.mjs';

const [program, scene, size = '1280x720', seconds = '10', ...words] = process.argv.slice(2);
const [width, height] = size.split('x').map(Number);
const browser = await launch();
const server = await serve(program, scene, words);
const page = await open(browser, server.url, {viewport: {width, height}});
const started = Date.now();
await rests(page);
console.log(`first exact picture after ${Date.now() - started} ms (with the page's loading)`);
await page.mouse.move(width / 2, height / 2);
await page.mouse.down();
// A user does not wait for the page either, so this does not wait.
const input = await page.context().newCDPSession(page);
const move = (x, y) => input.send('Input.dispatchMouseEvent', {type: 'mouseMoved', x, y, button: 'left', buttons: 1}).catch(() => {});
const drag = async (duration) => {
  const start = Date.now();
  for (let i = 0; Date.now() - start < duration; ++i) {
    const angle = i / 40;
    move(width / 2 + 150 * Math.sin(angle), height / 2 + 60 * Math.sin(0.7 * angle));
    await new Promise((resolve) => setTimeout(resolve, Math.max(0, start + 16 * i - Date.now())));
  }
};
await drag(2000);  // until the quality is stable
await page.evaluate(() => { scree.latencies.length = 0; scree.rows.length = 0; });
await drag(1000 * Number(seconds));
const {latencies, rows} = await page.evaluate(() => ({latencies: scree.latencies, rows: scree.rows}));
const restStart = Date.now();
await page.mouse.up();
await rests(page);
const rest = Date.now() - restStart;
const at = (values, share) => [...values].sort((a, b) => a - b)[Math.min(values.length - 1, Math.floor(share * values.length))];
const text = (values) => `${at(values, 0.5).toFixed(1)} / ${at(values, 0.95).toFixed(1)}`;
console.log(`${latencies.length} pictures; input to picture, median / 95%: ${text(latencies)} ms`);
for (const part of ['wait', 'shadow', 'draw', 'shade', 'encode', 'send', 'decode']) console.log(`  ${part}: ${text(rows.map((row) => row[part]))} ms`);
const span = rows.at(-1).shown - rows[0].shown;
console.log(`  ${(1000 * (rows.length - 1) / span).toFixed(1)} pictures/s, ${(rows.reduce((sum, row) => sum + row.bytes, 0) / rows.length / 1024).toFixed(0)} KiB each`);
console.log(`  ${await page.textContent('#exact')} ${rest} ms after the end of the drag`);
await browser.close();
await server.end();
