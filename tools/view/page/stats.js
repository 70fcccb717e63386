// The times of the last pictures as a graph, and as numbers.
const kParts = [['wait', '#5b6675', 'waits'], ['shadow', '#8f7d6a', 'shadows'], ['draw', '#f0a35e', 'draw'], ['shade', '#e3d06a', 'shade'],
  ['encode', '#63c7a2', 'encode'], ['send', '#6ea8f5', 'send'], ['decode', '#b58cf0', 'show']];
const kShown = 96;

export const bytesText = (bytes) => {
  let unit = 0;
  for (; bytes >= 1024 && unit < 4; ++unit) bytes /= 1024;
  return `${unit === 0 ? bytes : bytes.toFixed(bytes < 10 ? 2 : bytes < 100 ? 1 : 0)} ${['B', 'KiB', 'MiB', 'GiB', 'TiB'][unit]}`;
};
export const countText = (count) => {
  let unit = 0;
  for (; count >= 1000 && unit < 4; ++unit) count /= 1000;
  return unit === 0 ? `${count}` : `${count.toFixed(count < 10 ? 2 : count < 100 ? 1 : 0)} ${['', 'k', 'M', 'G', 'T'][unit]}`;
};
/// "1 triangle", "2.00 k triangles".
export const counted = (count, name) => `${countText(count)} ${name}${count === 1 ? '' : 's'}`;

export class Stats {
  constructor(section) {
    this.section = section;
    this.graph = section.querySelector('#graph').getContext('2d');
    this.numbers = section.querySelector('#numbers');
    section.querySelector('#legend').innerHTML = kParts.map(() => '<span><i></i><b></b></span>').join('');
    section.querySelectorAll('#legend span').forEach((span, i) => {
      span.querySelector('i').style.background = kParts[i][1];
      span.querySelector('b').replaceWith(kParts[i][2]);
    });
    this.rows = [];
    this.latencies = [];
    this.last = {};
    this.isDue = false;
  }

  note({head, bytes, decodeMs, latency, shown}) {
    const server = (head.waitMs ?? 0) + head.shadowMs + head.drawMs + head.shadeMs + head.encodeMs;
    if (!head.exact) {
      this.rows.push({wait: head.waitMs ?? 0, shadow: head.shadowMs, draw: head.drawMs, shade: head.shadeMs, encode: head.encodeMs, decode: decodeMs, scale: head.scale,
        send: latency === undefined ? 0 : Math.max(0, latency - server - decodeMs), bytes, shown});
      if (this.rows.length > kShown) this.rows.shift();
      if (latency !== undefined) this.latencies.push(latency);
      if (this.latencies.length > 240) this.latencies.shift();
    }
    this.last = {...this.last, ...head};
    if (this.section.hidden || this.isDue) return;
    this.isDue = true;
    requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.isDue = false;
    const g = this.graph, width = g.canvas.width, height = g.canvas.height;
    g.clearRect(0, 0, width, height);
    const sum = (row) => kParts.reduce((total, [part]) => total + row[part], 0);
    const top = Math.max(40, ...this.rows.map(sum)) * 1.08;
    this.rows.forEach((row, i) => {
      let y = height;
      for (const [part, colour] of kParts) {
        const part_height = row[part] / top * height;
        g.fillStyle = colour;
        g.fillRect((kShown - this.rows.length + i) * 3, y - part_height, 2, part_height);
        y -= part_height;
      }
    });
    g.strokeStyle = 'rgba(255,255,255,.25)';
    g.fillStyle = 'rgba(255,255,255,.55)';
    g.font = '10px system-ui, "DejaVu Sans", sans-serif';
    const line = top > 400 ? 200 : top > 100 ? 50 : 16.7;
    g.beginPath();
    g.moveTo(0, height - line / top * height);
    g.lineTo(width, height - line / top * height);
    g.stroke();
    g.fillText(`${line} ms`, 4, height - line / top * height - 3);
    const sorted = [...this.latencies].sort((a, b) => a - b), at = (share) => sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
    const recent = this.rows.filter((row) => row.shown > (this.rows.at(-1)?.shown ?? 0) - 1000);
    const span = recent.length > 1 ? recent.at(-1).shown - recent[0].shown : 0;
    const l = this.last;
    const table = [
      ['pictures per second', span > 0 ? ((recent.length - 1) * 1000 / span).toFixed(0) : '–'],
      ['input to picture', sorted.length ? `${at(0.5).toFixed(0)} ms, 95%: ${at(0.95).toFixed(0)}` : '–'],
      ['picture', l.width ? `${l.width} × ${l.height}${l.samples > 1 ? `, ${l.samples}×${l.samples}` : ''}, ${l.exact ? 'lossless' : `JPEG ${l.quality}`}` : '–'],
      ['link', recent.length ? `${bytesText(recent.reduce((total, row) => total + row.bytes, 0))}/s` : '–'],
      ['triangles drawn', l.triangles === undefined ? '–' : countText(l.triangles)],
      ['memory of the server', l.hostBytes ? bytesText(l.hostBytes) : '–'],
    ];
    if (l.blendedLayers || l.samplesWithMoreLayers)
      table.push(['blended layers', `${l.blendedLayers}${l.samplesWithMoreLayers ? `, ${counted(l.samplesWithMoreLayers, 'sample')} ${l.samplesWithMoreLayers === 1 ? 'has' : 'have'} more` : ''}`]);
    if (l.deviceBytes) table.push(['memory of the GPU', bytesText(l.deviceBytes)]);
    this.numbers.replaceChildren(...table.flatMap(([name, value]) => {
      const term = document.createElement('dt'), text = document.createElement('dd');
      term.textContent = name;
      text.textContent = value;
      return [term, text];
    }));
  }
}
