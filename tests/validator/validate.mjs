// Runs the Khronos glTF validator over files and folders (searched for .gltf and .glb):
//   node validate.mjs [--json] PATH...
// Prints one line per file, then the errors. Exit code 1 if any file has an error, 2 if a file cannot be read or no
// file was found. Warnings and hints are counted, never fatal.
import fs from 'node:fs';
import path from 'node:path';
import validator from 'gltf-validator';

const kMaxShownErrors = 20;

function collect(place, files) {
  if (!fs.statSync(place).isDirectory()) return files.push(place);
  for (const name of fs.readdirSync(place).sort()) {
    const inner = path.join(place, name);
    if (fs.statSync(inner).isDirectory() || /\.(gltf|glb)$/i.test(name)) collect(inner, files);
  }
}

async function validate(file) {
  const folder = path.dirname(path.resolve(file));
  const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), {
    uri: path.basename(file),
    maxIssues: 0,  // unlimited: a shortened list could hide an error behind hints
    externalResourceFunction: async (uri) => {
      const resource = path.resolve(folder, decodeURIComponent(uri));
      if (!resource.startsWith(folder + path.sep)) throw new Error(`${uri} leaves the folder`);
      return new Uint8Array(fs.readFileSync(resource));
    },
  });
  const errors = report.issues.messages.filter((issue) => issue.severity === 0);
  return {
    file,
    errors: report.issues.numErrors,
    warnings: report.issues.numWarnings,
    vertices: report.info?.totalVertexCount ?? 0,
    triangles: report.info?.totalTriangleCount ?? 0,
    messages: errors.slice(0, kMaxShownErrors).map((issue) => `${issue.code} ${issue.pointer ?? ''} ${issue.message}`),
  };
}

const json = process.argv[2] === '--json';
const files = [];
try {
  for (const place of process.argv.slice(json ? 3 : 2)) collect(place, files);
} catch (error) {
  console.error(`validate: ${error.message}`);
  process.exit(2);
}
if (files.length === 0) {
  console.error('validate: no .gltf or .glb file');
  process.exit(2);
}
const reports = [];
for (const file of files) {
  try {
    reports.push(await validate(file));
  } catch (error) {  // not a glTF
    reports.push({file, errors: 1, warnings: 0, vertices: 0, triangles: 0, messages: [String(error?.message ?? error)]});
  }
}
const failed = reports.filter((report) => report.errors > 0).length;
if (json) {
  console.log(JSON.stringify({failed, reports}, null, 1));
} else {
  for (const report of reports) {
    console.log(`${report.errors ? 'FAIL' : 'ok  '} ${report.file}: ${report.errors} errors, ${report.warnings} warnings, ` +
      `${report.triangles} triangles`);
    for (const message of report.messages) console.log(`     ${message}`);
  }
  console.log(`${reports.length - failed} passed, ${failed} failed`);
}
process.exit(failed ? 1 : 0);
