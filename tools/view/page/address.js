// A view as text: the page's address, and the command that draws it.
import {kFarthest, kFov} from './camera.js';
import {distance} from './vector.js';

const kMostSamples = 16384;  // along a side of a picture
const kFlags = ['shadows', 'ssao', 'edl'];
export const kDefaults = {show: 'texture', light: true, shadows: false, ssao: false, edl: false, edlStrength: 1, edlRadius: 1, samples: 4, background: '#20252d', full: false};
// Settings that are in the address only if they are not the default: their letters, and the values that the server accepts.
const kOthers = [
  ['b', 'background', (text) => `#${text}`, (value) => /^#[0-9a-f]{6}$/.test(value)],
  ['d', 'edlStrength', Number, (value) => value >= 0 && value <= 100],
  ['r', 'edlRadius', Number, (value) => Number.isInteger(value) && value >= 1 && value <= 64],
  ['s', 'samples', Number, (value) => [1, 2, 4].includes(value)],
];

/// The part of the address behind '#'.
export function addressOf(pose, settings, clip) {
  const parts = [`v=1`, `e=${pose.eye}`, `t=${pose.target}`, `u=${pose.up}`, `f=${pose.fov}`, `m=${settings.show}`];
  const flags = kFlags.filter((name) => settings[name]).concat(settings.light ? [] : ['unlit']);
  if (flags.length) parts.push(`o=${flags.join(',')}`);
  for (const [letter, name] of kOthers) if (settings[name] !== kDefaults[name]) parts.push(`${letter}=${String(settings[name]).replace('#', '')}`);
  if (clip.on) parts.push(`c=${clip.box}`);
  return parts.join('&');
}

/// The view of an address. `hash`: its parts, as URLSearchParams. `shows`: all values of settings.show. Returns
/// {settings, box, pose}; the last two are null if the address has none.
export function readAddress(hash, shows) {
  const numbers = (name, count) => {
    const values = (hash.get(name) ?? '').split(',').map((word) => word.trim() ? Number(word) : NaN);
    return values.length === count && values.every((value) => Math.abs(value) <= kFarthest) ? values : null;
  };
  const flags = (hash.get('o') ?? '').split(',');
  const settings = {ssao: flags.includes('ssao'), edl: flags.includes('edl'), light: !flags.includes('unlit')};
  if (shows.includes(hash.get('m'))) settings.show = hash.get('m');
  if (hash.has('v')) settings.shadows = flags.includes('shadows');
  for (const [letter, name, read, isValid] of kOthers) {
    const value = read(hash.get(letter) || NaN);
    settings[name] = isValid(value) ? value : kDefaults[name];
  }
  const box = numbers('c', 6);
  const eye = numbers('e', 3), target = numbers('t', 3), up = numbers('u', 3) ?? [0, 1, 0], fov = Number(hash.get('f'));
  const hasPose = eye && target && distance(eye, target) !== 0;
  return {
    settings,
    box: box && [0, 1, 2].every((axis) => box[axis] <= box[axis + 3]) ? box : null,
    pose: hasPose ? {eye, target, up, fov: fov >= kFov[0] && fov <= kFov[1] ? fov : 45} : null,
  };
}

const quoted = (word) => /^[\w./:=,@%+-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`;

/// The command that draws the picture on the screen into `output`. `scene`: the server's "scene" message.
export function commandOf(scene, size, pose, samples, settings, clip, output) {
  while (samples > 1 && samples * Math.max(size.width, size.height) > kMostSamples) samples /= 2;  // as the server does
  const vector = (v) => v.map((value) => String(value)).join(',');
  const words = ['scree', 'render', scene.file, '--size', `${size.width}x${size.height}`, `--eye=${vector(pose.eye)}`, `--target=${vector(pose.target)}`,
    `--up=${vector(pose.up)}`, '--fov', String(pose.fov), '--samples', String(samples), '--show', settings.show, '--background', settings.background];
  if (scene.scene) words.push('--scene', scene.scene);
  const layers = scene.light.indexOf('--blend-layers');  // they concern more than light
  words.push(...(settings.light ? scene.light : ['--no-light', ...(layers < 0 ? [] : scene.light.slice(layers, layers + 2))]));
  if (settings.light && settings.shadows) words.push('--shadows', ...(scene.shadowSize ? ['--shadow-size', String(scene.shadowSize)] : []));
  if (settings.ssao) words.push('--ssao');
  if (settings.edl) words.push('--edl', '--edl-strength', String(settings.edlStrength), '--edl-radius', String(settings.edlRadius));
  if (clip.on) words.push(`--clip-box=${vector(clip.box)}`);
  return [...words, '-o', output].map(quoted).join(' ');
}
