#!/usr/bin/env node
// Prints the table of docs/viewers.md from rows that run.mjs wrote: node table.mjs ROWS.csv
import {readFileSync} from 'node:fs';

const [head, ...lines] = readFileSync(process.argv[2], 'utf8').trim().split('\n').map((line) => line.split(','));
const rows = lines.map((line) => Object.fromEntries(head.map((name, i) => [name, line[i]])));
const pairs = [['environment', 'scree', 'three.js'], ['environment', 'scree', 'f3d'], ['environment', 'f3d', 'three.js'],
  ['unlit', 'scree', 'three.js'], ['scene', 'scree', 'three.js']];
const find = (model, [light, a, b]) =>
  rows.find((row) => row.model === model && row.light === light && row.a.startsWith(a) && row.b.startsWith(b));
console.log('| model | covered | scree, three.js | scree, f3d | f3d, three.js | unlit: scree, three.js | own lights |');
console.log('|---|--:|--:|--:|--:|--:|--:|');
const models = [...new Set(rows.map((row) => row.model))];
for (const model of models) {
  const cells = pairs.map((pair) => find(model, pair))
    .map((row) => row ? `${Number(row.flip_mean).toFixed(3)}, ${row.psnr_db}` : '');
  console.log(`| ${model} | ${Math.round(100 * find(model, pairs[0]).covered)}% | ${cells.join(' | ')} |`);
}
/// Equal pictures have a PSNR of inf.
function median(values) {
  const sorted = values.map((value) => value === 'inf' ? Infinity : Number(value)).sort((a, b) => a - b);
  return (sorted[Math.floor((sorted.length - 1) / 2)] + sorted[Math.floor(sorted.length / 2)]) / 2;
}

const files = models.filter((model) => !model.endsWith('-matt'));
const medians = pairs.map((pair) => {
  const found = files.map((model) => find(model, pair)).filter((row) => row);
  return `${median(found.map((row) => row.flip_mean)).toFixed(3)}, ${median(found.map((row) => row.psnr_db)).toFixed(2)}`;
});
console.log(`| median of the ${files.length} files | | ${medians.join(' | ')} |`);
