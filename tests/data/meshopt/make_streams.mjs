// Makes streams.bin: streams of ATTRIBUTES written by meshoptimizer, with checksums of its decoder's output; and a .glb of
// KHR_meshopt_compression for the fuzz corpus (tests/fuzz/corpus/gltf/meshopt_v1.glb).
//   npm install meshoptimizer@1.3 && node make_streams.mjs streams.bin meshopt_v1.glb
// Each: u32 count, u32 stride, u32 filter (DocMeshopt::Filter), u32 CRC-32 of the count * stride decoded bytes, u32 bytes
// of the stream, the stream; all little-endian.
import { writeFileSync } from 'node:fs';
import { crc32 } from 'node:zlib';
import { MeshoptDecoder, MeshoptEncoder } from 'meshoptimizer';
await MeshoptEncoder.ready;
await MeshoptDecoder.ready;

let seed = 1;
const random = () => (seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0) >>> 8;  // 24 bits
const noise = (bits) => random() >>> (24 - bits);
const kinds = {
  zeros: () => 0,
  noise: () => noise(8),
  sparse: () => (noise(4) === 0 ? noise(8) : 0),
  ramp: (i, byte) => (i * (byte + 1)) & 255,
  bits: (i, byte) => (noise(3) === 0 ? noise(8) : noise(1 + (byte % 4))),
};
const parts = [];
const filters = ['NONE', 'OCTAHEDRAL', 'QUATERNION', 'EXPONENTIAL', 'COLOR'];
function add(raw, count, stride, version, level, filter = 'NONE') {
  const stream = MeshoptEncoder.encodeVertexBufferLevel(raw, count, stride, level, version);
  const out = new Uint8Array(count * stride);
  MeshoptDecoder.decodeGltfBuffer(out, count, stride, stream, 'ATTRIBUTES', filter);
  const head = new Uint32Array([count, stride, filters.indexOf(filter), crc32(out), stream.length]);
  parts.push(new Uint8Array(head.buffer), stream);
}
for (const stride of [4, 12, 36, 256])
  for (const count of [1, 16, 17, 100, 257])
    for (const kind of Object.keys(kinds)) {
      if (stride * count > 4000 && kind !== 'bits' && kind !== 'zeros' || stride * count > 30000) continue;
      const raw = new Uint8Array(count * stride);
      for (let i = 0; i < raw.length; ++i) raw[i] = kinds[kind]((i / stride) | 0, i % stride);
      add(raw, count, stride, 1, 2);
    }
// Floats, 16-bit integers, and words whose high bits change, so that all modes of channels occur.
for (let level = 0; level <= 3; ++level) {
  const count = 300;
  const floats = new Float32Array(3 * count), shorts = new Uint16Array(4 * count), words = new Uint32Array(count);
  for (let i = 0; i < count; ++i) {
    floats.set([Math.sin(i * 0.01) * 10, i * 0.25, noise(16) / 65536], 3 * i);
    shorts.set([i * 300, 65535 - i * 7, noise(10), 32768 + noise(3)], 4 * i);
    words[i] = ((noise(3) << 28) | (noise(4) << 11)) >>> 0;
  }
  add(new Uint8Array(floats.buffer), count, 12, 1, level);
  add(new Uint8Array(shorts.buffer), count, 8, 1, level);
  add(new Uint8Array(words.buffer), count, 4, 1, level);
}
// Filters.
const count = 67;
const vectors = new Float32Array(4 * count), colors = new Float32Array(4 * count);
for (let i = 0; i < count; ++i) {
  const v = [0, 1, 2, 3].map(() => noise(16) / 32768 - 1 + 1e-3);
  const length = Math.hypot(...v);
  vectors.set(v.map((x) => x / length), 4 * i);
  colors.set([0, 1, 2, 3].map(() => noise(12) / 4095), 4 * i);
}
const units = vectors.slice();
for (let i = 0; i < count; ++i) {
  const length = Math.hypot(units[4 * i], units[4 * i + 1], units[4 * i + 2]);
  for (let c = 0; c < 3; ++c) units[4 * i + c] /= length;
}
for (const version of [0, 1]) {
  for (const bits of [4, 8]) add(MeshoptEncoder.encodeFilterOct(units, count, 4, bits), count, 4, version, 2, 'OCTAHEDRAL');
  for (const bits of [10, 16]) add(MeshoptEncoder.encodeFilterOct(units, count, 8, bits), count, 8, version, 2, 'OCTAHEDRAL');
  for (const bits of [8, 16]) add(MeshoptEncoder.encodeFilterQuat(vectors, count, 8, bits), count, 8, version, 2, 'QUATERNION');
  for (const bits of [12, 23]) add(MeshoptEncoder.encodeFilterExp(vectors, count, 16, bits), count, 16, version, 2, 'EXPONENTIAL');
  for (const bits of [2, 6, 8]) add(MeshoptEncoder.encodeFilterColor(colors, count, 4, bits), count, 4, version, 2, 'COLOR');
  for (const bits of [9, 12, 16]) add(MeshoptEncoder.encodeFilterColor(colors, count, 8, bits), count, 8, version, 2, 'COLOR');
}
writeFileSync(process.argv[2], Buffer.concat(parts));

// A grid of 6 x 6 vertices with colours and normals.
const points = new Float32Array(3 * 36), normals = new Float32Array(4 * 36), tints = new Float32Array(4 * 36);
const corners = [];
for (let i = 0; i < 36; ++i) {
  const x = i % 6, y = (i / 6) | 0;
  points.set([x, y, Math.sin(x + y)], 3 * i);
  normals.set([0, 0, 1, 0], 4 * i);
  tints.set([x / 5, y / 5, 0.5, 1], 4 * i);
  if (x < 5 && y < 5) corners.push(i, i + 1, i + 7, i, i + 7, i + 6);
}
const bytes = (array) => new Uint8Array(array.buffer);
const views = [];
let bin = Buffer.alloc(0);
function view(stream, count, stride, mode, filter) {
  views.push({ buffer: 1, byteLength: count * stride, ...(mode === 'ATTRIBUTES' ? { byteStride: stride } : {}), extensions: { KHR_meshopt_compression:
    { buffer: 0, byteOffset: bin.length, byteLength: stream.length, byteStride: stride, count, mode, filter } } });
  bin = Buffer.concat([bin, stream, Buffer.alloc((4 - (stream.length % 4)) % 4)]);
}
view(MeshoptEncoder.encodeVertexBufferLevel(bytes(points), 36, 12, 2, 1), 36, 12, 'ATTRIBUTES', 'NONE');
view(MeshoptEncoder.encodeVertexBufferLevel(MeshoptEncoder.encodeFilterOct(normals, 36, 4, 8), 36, 4, 2, 1), 36, 4, 'ATTRIBUTES', 'OCTAHEDRAL');
view(MeshoptEncoder.encodeVertexBufferLevel(MeshoptEncoder.encodeFilterColor(tints, 36, 4, 8), 36, 4, 2, 1), 36, 4, 'ATTRIBUTES', 'COLOR');
view(MeshoptEncoder.encodeIndexBuffer(bytes(new Uint32Array(corners)), corners.length, 4), corners.length, 4, 'TRIANGLES', 'NONE');
const names = ['KHR_meshopt_compression', 'KHR_mesh_quantization'];
let json = JSON.stringify({
  asset: { version: '2.0' }, extensionsUsed: names, extensionsRequired: names,
  buffers: [{ byteLength: bin.length }, { byteLength: 1000, extensions: { KHR_meshopt_compression: { fallback: true } } }],
  bufferViews: views,
  accessors: [
    { bufferView: 0, componentType: 5126, count: 36, type: 'VEC3', min: [0, 0, -1], max: [5, 5, 1] },
    { bufferView: 1, componentType: 5120, normalized: true, count: 36, type: 'VEC3' },
    { bufferView: 2, componentType: 5121, normalized: true, count: 36, type: 'VEC4' },
    { bufferView: 3, componentType: 5125, count: corners.length, type: 'SCALAR' }],
  meshes: [{ primitives: [{ indices: 3, attributes: { POSITION: 0, NORMAL: 1, COLOR_0: 2 } }] }],
  nodes: [{ mesh: 0 }], scenes: [{ nodes: [0] }], scene: 0 });
json += ' '.repeat((4 - (json.length % 4)) % 4);
const head = (...words) => Buffer.from(new Uint32Array(words).buffer);
writeFileSync(process.argv[3], Buffer.concat([head(0x46546c67, 2, 28 + json.length + bin.length, json.length, 0x4e4f534a),
  Buffer.from(json), head(bin.length, 0x004e4942), bin]));
