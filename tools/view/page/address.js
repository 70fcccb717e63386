// A view as text: the page's address, and the command that draws it.
import {distance} from './vector.js';

const kFlags = ['shadows', 'ssao', 'edl'];

/// The part of the address behind '#'.
export function addressOf(pose, settings, clip) {
  const short = (v) => v.map((value) => Number(value.toPrecision(12))).join(',');
  const parts = [`v=1`, `e=${short(pose.eye)}`, `t=${short(pose.target)}`, `u=${pose.up.join(',')}`, `f=${Number(pose.fov.toPrecision(6))}`, `m=${settings.show}`];
  const flags = kFlags.filter((name) => settings[name]).concat(settings.light ? [] : ['unlit']);
  if (flags.length) parts.push(`o=${flags.join(',')}`);
  if (clip.on) parts.push(`c=${short(clip.box)}`);
  return parts.join('&');
}

/// The view of an address. `hash`: its parts, as URLSearchParams. `shows`: all values of settings.show. Returns
/// {settings, box, pose}; the last two are null if the address has none.
export function readAddress(hash, shows) {
  const numbers = (name, count) => {
    const values = (hash.get(name) ?? '').split(',').map(Number);
    return values.length === count && values.every(Number.isFinite) ? values : null;
  };
  const flags = (hash.get('o') ?? '').split(',');
  const settings = {ssao: flags.includes('ssao'), edl: flags.includes('edl'), light: !flags.includes('unlit')};
  if (shows.includes(hash.get('m'))) settings.show = hash.get('m');
  if (hash.has('v')) settings.shadows = flags.includes('shadows');
  const box = numbers('c', 6);
  const eye = numbers('e', 3), target = numbers('t', 3), up = numbers('u', 3) ?? [0, 1, 0], fov = Number(hash.get('f'));
  const hasPose = eye && target && distance(eye, target) !== 0;
  return {
    settings,
    box: box && [0, 1, 2].every((axis) => box[axis] <= box[axis + 3]) ? box : null,
    pose: hasPose ? {eye, target, up, fov: fov > 0.1 && fov < 179 ? fov : 45} : null,
  };
}

const quoted = (word) => /^[\w./:=,@%+-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`;

/// The command that draws the picture on the screen into `output`. `scene`: the server's "scene" message.
export function commandOf(scene, size, pose, samples, settings, clip, output) {
  const vector = (v) => v.map((value) => String(value)).join(',');
  const words = ['scree', 'render', scene.file, '--size', `${size.width}x${size.height}`, `--eye=${vector(pose.eye)}`, `--target=${vector(pose.target)}`,
    `--up=${vector(pose.up)}`, '--fov', String(pose.fov), '--samples', String(samples), '--show', settings.show, '--background', settings.background];
  if (scene.scene) words.push('--scene', scene.scene);
  words.push(...(settings.light ? scene.light : ['--no-light']));
  if (settings.light && settings.shadows) words.push('--shadows', ...(scene.shadowSize ? ['--shadow-size', String(scene.shadowSize)] : []));
  if (settings.ssao) words.push('--ssao');
  if (settings.edl) words.push('--edl', '--edl-strength', String(settings.edlStrength), '--edl-radius', String(settings.edlRadius));
  if (clip.on) words.push(`--clip-box=${vector(clip.box)}`);
  return [...words, '-o', output].map(quoted).join(' ');
}
