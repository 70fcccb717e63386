// Elements of the page, short messages, the clipboard, files and the browser's storage.
import {bytesText} from './stats.js';

export const $ = (id) => document.getElementById(id);

export function element(name, text) {
  const made = document.createElement(name);
  made.textContent = text;
  return made;
}

/// Fills a list with buttons. `rows`: {text, click, pressed, remove}; the last two are optional.
export function fill(list, rows, empty = 'none') {
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

export function toast(text, isBad = false) {
  const made = element('div', text);
  made.className = isBad ? 'toast bad' : 'toast';
  $('toasts').append(made);
  while ($('toasts').children.length > 3) $('toasts').firstChild.remove();
  setTimeout(() => made.remove(), isBad ? 6000 : 2200);
}

/// `what`: names the text in the message.
export async function copy(text, what) {
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

/// A text of the browser's storage; null if there is none, or if the browser blocks the storage.
export function stored(key) {
  try { return localStorage.getItem(key); } catch { return null; }
}
/// Returns false if the browser blocks its storage, or if the storage is full.
export function store(key, text) {
  try { localStorage.setItem(key, text); } catch { return false; }
  return true;
}

/// `note`: is added to the message.
export function saveFile(blob, name, note = '') {
  const link = element('a', '');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  toast(`${name}: ${bytesText(blob.size)}${note}`, note !== '');
}
